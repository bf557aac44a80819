"""Characters: joint trees as Pinocchio models, bones in the world, solids around limbs, motions on robots."""

from skeleton.check import check_motion
from skeleton.collision import add_to_geometry_model
from skeleton.configurations import column_names, load_configurations
from skeleton.findings import Finding
from skeleton.geometry import LinkSurface, link_surfaces
from skeleton.hitboxes import Hitboxes, hitboxes_of, load_hitboxes
from skeleton.model import Skeleton
from skeleton.retarget import Retargeted, retarget
from skeleton.robot_motion import RobotMotion
from skeleton.robots import ROBOTS
from skeleton.shapes import Capsule
from skeleton.track import BoneTrack

__all__ = [
    "ROBOTS",
    "BoneTrack",
    "Capsule",
    "Finding",
    "Hitboxes",
    "LinkSurface",
    "Retargeted",
    "RobotMotion",
    "Skeleton",
    "add_to_geometry_model",
    "check_motion",
    "column_names",
    "hitboxes_of",
    "link_surfaces",
    "load_configurations",
    "load_hitboxes",
    "retarget",
]
