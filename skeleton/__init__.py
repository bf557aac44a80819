"""Characters: joint trees as Pinocchio models, their bones in the world, capsules around their limbs."""

from skeleton.model import Skeleton
from skeleton.retarget import Retargeted, retarget
from skeleton.robots import ROBOTS
from skeleton.shapes import Capsule
from skeleton.track import BoneTrack

__all__ = ["ROBOTS", "BoneTrack", "Capsule", "Retargeted", "Skeleton", "retarget"]
