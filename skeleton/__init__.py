"""Characters: joint trees as Pinocchio models, their bones in the world, capsules around their limbs."""

from skeleton.configurations import column_names, load_configurations
from skeleton.geometry import LinkSurface, link_surfaces
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
    "LinkSurface",
    "Retargeted",
    "RobotMotion",
    "Skeleton",
    "column_names",
    "link_surfaces",
    "load_configurations",
    "retarget",
]
