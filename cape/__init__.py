"""Cloth on moving bones: `Cloth`, `attach`, `Scene`, `simulate`, and `Simulation` for one's own loop."""

from cape.attach import Attachment, attach
from cape.cloth import Cloth
from cape.colliders import Box, Collider, Plane, Sphere
from cape.dress import dress
from cape.fabric import FABRICS, Fabric, fabric
from cape.scene import Scene
from cape.simulate import simulate
from cape.simulation import Diverged, Pose, Simulation
from cape.solvers import SOLVERS, XPBD, Solver, SymplecticEuler, solver
from cape.take import Take
from cape.wind import Wind
from motions.errors import UserError
from skeleton.capsules import Capsule

__all__ = [
    "FABRICS",
    "SOLVERS",
    "XPBD",
    "Attachment",
    "Box",
    "Capsule",
    "Cloth",
    "Collider",
    "Diverged",
    "Fabric",
    "Plane",
    "Pose",
    "Scene",
    "Simulation",
    "Solver",
    "Sphere",
    "SymplecticEuler",
    "Take",
    "UserError",
    "Wind",
    "attach",
    "dress",
    "fabric",
    "simulate",
    "solver",
]
