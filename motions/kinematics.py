"""Where the joints of a tree are in the world."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motions import quaternions

FloatArray = NDArray[np.float64]


def forward_kinematics(
    parents: ArrayLike, local_positions: FloatArray, local_rotations: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """World poses of a tree's joints.

    Args:
        parents: index of each joint's parent, parents before children, -1 for a root, shape (J,).
        local_positions: in the parent's frame [m], broadcasts to (F, J, 3).
        local_rotations: unit quaternions (w, x, y, z) joint_to_parent, shape (F, J, 4).

    Returns:
        Positions [m], shape (F, J, 3), and unit quaternions joint_to_world, shape (F, J, 4).
    """
    parents = np.asarray(parents)
    rotations = np.array(local_rotations)
    positions = np.array(np.broadcast_to(local_positions, (*rotations.shape[:-1], 3)))
    # All joints of one depth in one go: a tree is some ten levels deep but has several tens of joints.
    depths = _depths(parents)
    for depth in range(1, depths.max(initial=0) + 1):
        level = np.flatnonzero(depths == depth)
        above = parents[level]
        positions[:, level] = positions[:, above] + quaternions.rotate(rotations[:, above], positions[:, level])
        rotations[:, level] = quaternions.multiply(rotations[:, above], rotations[:, level])
    return positions, rotations


def _depths(parents: NDArray[np.int64]) -> NDArray[np.int64]:
    depths = np.zeros(len(parents), dtype=np.int64)
    for joint, parent in enumerate(parents):
        if parent >= 0:
            depths[joint] = depths[parent] + 1
    return depths
