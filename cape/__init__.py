"""Cloth on moving bones: `Cloth`, `attach`, `Scene`, `simulate`, and `Simulation` for one's own loop."""

from cape import importing as importing  # before what takes its time
from cape.air.record import WindRecord, read_wind
from cape.air.wind import Wind
from cape.cloth.cloth import Cloth, GridCloth, MeshCloth
from cape.cloth.drawn.textures import Textures, read_textures
from cape.cloth.drawn.visual import Visual
from cape.cloth.fabric import Fabric
from cape.cloth.fabrics import FABRICS, MEASUREMENTS, fabric
from cape.cloth.measurement import Measurement
from cape.garments.registry import GARMENTS
from cape.live.live import Live
from cape.measure.ledger import Balance, Ledger
from cape.meshes.reading import read_cloth
from cape.meshes.wearing import wear
from cape.results.take import Take
from cape.run.auto import Auto, AutoSimulation
from cape.run.batch import Batch
from cape.run.simulate import SlowWarning, simulate
from cape.run.simulation import Simulation
from cape.run.tearing.cutting import cut
from cape.run.whereabouts import Diverged
from cape.scene.colliders import Box, Collider, Cylinder, Ellipsoid, Plane, Sphere, TaperedCapsule
from cape.scene.dress import dress
from cape.scene.holding.attachments import Attachment, attach
from cape.scene.holding.confinement import Confinement, confine
from cape.scene.holding.tethers import Tethers
from cape.scene.jumps import Cuts
from cape.scene.poses import Pose
from cape.scene.scene import Scene
from cape.scene.self_contact import SelfContact
from cape.scene.tearing import Tearing
from cape.solvers import SOLVERS, TRBDF2, XPBD, BackwardEuler, Solver, SymplecticEuler, solver
from cape.version import VERSION as __version__
from motions.errors import UserError
from skeleton.shapes import Capsule

__all__ = [
    "FABRICS",
    "GARMENTS",
    "MEASUREMENTS",
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
    "Confinement",
    "Cuts",
    "Cylinder",
    "Diverged",
    "Ellipsoid",
    "Fabric",
    "GridCloth",
    "Ledger",
    "Live",
    "Measurement",
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
    "Tearing",
    "Tethers",
    "Textures",
    "UserError",
    "Visual",
    "Wind",
    "WindRecord",
    "__version__",
    "attach",
    "confine",
    "cut",
    "dress",
    "fabric",
    "read_cloth",
    "read_textures",
    "read_wind",
    "simulate",
    "solver",
    "wear",
]
