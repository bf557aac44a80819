"""Characters: bones in the world, solids around limbs, robots as Pinocchio models, motions on these."""

from skeleton.checks.check import check_motion
from skeleton.checks.findings import Finding
from skeleton.known_robots import ROBOTS
from skeleton.model import Skeleton
from skeleton.retargeting.retarget import Retargeted, retarget
from skeleton.robot.collision_geometry import add_to_geometry_model
from skeleton.robot.configurations import column_names, load_configurations
from skeleton.robot.hitboxes import Hitboxes, hitboxes_of, load_hitboxes
from skeleton.robot.kept_fits import kept_hitboxes_of
from skeleton.robot.meshes.link_surfaces import LinkSurface, link_surfaces, missing_meshes
from skeleton.robot_motion import RobotMotion
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
    "kept_hitboxes_of",
    "link_surfaces",
    "load_configurations",
    "load_hitboxes",
    "missing_meshes",
    "retarget",
]
