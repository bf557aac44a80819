"""Putting a cape on: where the wearer's frame is, and what holds the neckline."""

import numpy as np
from numpy.typing import NDArray

from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]

# Roles that place the wearer's frame.
WEARER_ROLES = ("left_upper_arm", "right_upper_arm", "pelvis")


def wearer_to_world(left: FloatArray, right: FloatArray, pelvis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Give the wearer's frame from the shoulder joints and the pelvis in the world [m], each of shape (3,).

    Returns:
        The rotation wearer_to_world, shape (3, 3), and the origin between the shoulders [m], shape (3,): x forward,
        y from the right shoulder to the left, z up the trunk.

    Raises:
        ValueRangeError: the three points lie on a line.
    """
    origin = (left + right) / 2.0
    lateral, trunk = left - right, origin - pelvis
    forward = np.cross(lateral, trunk)
    if np.linalg.norm(forward) < 1e-6:
        raise ValueRangeError("the shoulder joints and the pelvis lie on a line: the cape can't be put on")
    y = lateral / np.linalg.norm(lateral)
    x = forward / np.linalg.norm(forward)
    return np.stack([x, y, np.cross(x, y)], axis=1), origin
