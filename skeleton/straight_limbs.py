"""A body with straight limbs, its arms away from its sides a little or far, as one stands who is being dressed."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from skeleton.rest import RestPose

FloatArray = NDArray[np.float64]

AWAY = np.radians(3.0)  # of a limb that hangs from the direction down the trunk


def lower_arms(rest: RestPose, away: float = AWAY) -> RestPose:
    """The body with both arms stretched, at an angle [rad] from the direction down the trunk, to its sides.

    It is as it was where it has no arms.
    """
    return _stretched(rest, ("upper_arm", "forearm", "hand"), away)


def straighten_legs(rest: RestPose) -> RestPose:
    """The body with both legs stretched, a little apart; as it is where it has none."""
    return _stretched(rest, ("thigh", "shin", "foot"), AWAY)


def _stretched(rest: RestPose, limb: Sequence[str], away: float) -> RestPose:
    """The body with the joints of a limb in one line on both sides, at an angle [rad] from the direction down."""
    positions, rotations = rest.positions.copy(), rest.rotations_wxyz.copy()
    for side, sign in (("left", 1.0), ("right", -1.0)):
        wanted = np.sin(away) * sign * rest.left - np.cos(away) * rest.up
        joints = [f"{side}_{part}" for part in limb]
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
