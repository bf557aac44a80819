"""A body with its arms hanging a little away from its sides, as one stands who is being dressed."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from skeleton.rest import RestPose

FloatArray = NDArray[np.float64]

AWAY = np.radians(3.0)  # of an arm from the direction down the trunk


def lower_arms(rest: RestPose) -> RestPose:
    """The body with both arms stretched, and hanging beside the trunk; as it is where it has none."""
    positions, rotations = rest.positions.copy(), rest.rotations_wxyz.copy()
    for side, sign in (("left", 1.0), ("right", -1.0)):
        wanted = np.sin(AWAY) * sign * rest.left - np.cos(AWAY) * rest.up
        joints = [f"{side}_{limb}" for limb in ("upper_arm", "forearm", "hand")]
        joints = [rest.segment_start(joint) for joint in joints if joint in rest.roles]
        for start, end in pairwise(joints):
            turn = _turn(positions[end] - positions[start], wanted, about=rest.forward)
            below = [bone for bone in range(start, len(rest.bones)) if rest.chain(start, bone)[0] == start]
            positions[below] = positions[start] + quaternions.rotate(turn, positions[below] - positions[start])
            rotations[below] = quaternions.multiply(turn, rotations[below])
    return replace(rest, positions=positions, rotations_wxyz=rotations)


def _turn(first: FloatArray, second: FloatArray, *, about: FloatArray) -> FloatArray:
    """The least turn from one direction to another, `about` an axis where they are opposite; a quaternion wxyz."""
    normal = np.cross(first, second)
    sine, cosine = float(np.linalg.norm(normal)), float(first @ second)
    axis = normal / sine if sine > 1e-9 * abs(cosine) else about
    return quaternions.from_rotation_vector(np.arctan2(sine, cosine) * axis)
