"""Characters: joint trees as Pinocchio models, their bones in the world, capsules around their limbs."""

from skeleton.capsules import Capsule
from skeleton.check import check_motion
from skeleton.findings import Finding
from skeleton.model import Skeleton
from skeleton.robots import ROBOTS
from skeleton.track import BoneTrack

__all__ = ["ROBOTS", "BoneTrack", "Capsule", "Finding", "Skeleton", "check_motion"]
