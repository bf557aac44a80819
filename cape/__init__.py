"""Cloth on moving bones: `Cloth`, `attach`, `Scene`, `simulate`, and `Simulation` for one's own loop."""

from cape.attach import Attachment, attach
from cape.auto import Auto, AutoSimulation
from cape.batch import Batch
from cape.cloth import Cloth, GridCloth, MeshCloth
from cape.colliders import Box, Collider, Cylinder, Ellipsoid, Plane, Sphere, TaperedCapsule
from cape.cuts import Cuts
from cape.dress import dress
from cape.fabric import FABRICS, Fabric, fabric
from cape.ledger import Balance, Ledger
from cape.poses import Pose
from cape.scene import Scene
from cape.self_contact import SelfContact
from cape.simulate import SlowWarning, simulate
from cape.simulation import Diverged, Simulation
from cape.solvers import SOLVERS, TRBDF2, XPBD, BackwardEuler, Solver, SymplecticEuler, solver
from cape.take import Take
from cape.wind import Wind
from motions.errors import UserError
from skeleton.shapes import Capsule

__all__ = [
    "FABRICS",
    "SOLVERS",
    "TRBDF2",
    "XPBD",
    "Attachment",
    "Auto",
    "AutoSimulation",
    "BackwardEuler",
    "Balance",
    "Batch",
    "Box",
    "Capsule",
    "Cloth",
    "Collider",
    "Cuts",
    "Cylinder",
    "Diverged",
    "Ellipsoid",
    "Fabric",
    "GridCloth",
    "Ledger",
    "MeshCloth",
    "Plane",
    "Pose",
    "Scene",
    "SelfContact",
    "Simulation",
    "SlowWarning",
    "Solver",
    "Sphere",
    "SymplecticEuler",
    "Take",
    "TaperedCapsule",
    "UserError",
    "Wind",
    "attach",
    "dress",
    "fabric",
    "simulate",
    "solver",
]
