"""Characters: joint trees as Pinocchio models, their bones in the world, capsules around their limbs."""

from skeleton.collision import add_to_geometry_model
from skeleton.hitboxes import Hitboxes, hitboxes_of, load_hitboxes
from skeleton.model import Skeleton
from skeleton.robots import ROBOTS
from skeleton.shapes import Capsule
from skeleton.track import BoneTrack

__all__ = [
    "ROBOTS",
    "BoneTrack",
    "Capsule",
    "Hitboxes",
    "Skeleton",
    "add_to_geometry_model",
    "hitboxes_of",
    "load_hitboxes",
]
