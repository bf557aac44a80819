"""Poses of bones over the frames of a recording."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cape.record.frames import Frames
from motions import quaternions
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]


def bone_poses(bones: BoneTrack, names: Sequence[str | None], frames: Frames) -> tuple[FloatArray, FloatArray]:
    """World poses of n bones, given by name or role, the world's own for None.

    Returns:
        Positions [m], shape (F, n, 3), and unit quaternions bone_to_world, shape (F, n, 4).

    Raises:
        UnknownNameError: a bone isn't in the track.
    """
    positions = np.zeros((len(frames.numbers), len(names), 3))
    rotations = np.zeros((len(frames.numbers), len(names), 4))
    rotations[..., 0] = 1.0
    for place, name in enumerate(names):
        if name is not None:
            bone = bones.index(name)
            positions[:, place] = bones.positions[frames.numbers, bone]
            rotations[:, place] = bones.rotations_wxyz[frames.numbers, bone]
    return positions, rotations


def from_z_axis(directions: FloatArray) -> FloatArray:
    """Unit quaternions of the shortest rotations that take +Z to the directions, shape (..., 3) to (..., 4).

    A zero direction gives the identity; for -Z, where any horizontal axis will do, it is X.
    """
    x, y, z = np.moveaxis(directions, -1, 0)
    horizontal = np.hypot(x, y)
    angles = np.arctan2(horizontal, z)
    axes = np.stack([-y, x, np.zeros_like(x)], axis=-1)
    safe = np.where(horizontal > 0, horizontal, 1.0)[..., None]
    axes = np.where(horizontal[..., None] > 0, axes / safe, np.array([1.0, 0.0, 0.0]))
    return quaternions.from_rotation_vector(axes * angles[..., None])


def xyzw(wxyz: FloatArray) -> NDArray[np.float32]:
    """Rerun's order of quaternion components."""
    return np.roll(wxyz, -1, axis=-1).astype(np.float32)
