"""Poses of bones over the frames of a recording."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cape.record.frames import Frames
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


def xyzw(wxyz: FloatArray) -> NDArray[np.float32]:
    """Rerun's order of quaternion components."""
    return np.roll(wxyz, -1, axis=-1).astype(np.float32)
