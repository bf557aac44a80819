"""Capsules where a motion takes them: their ends in the world, their lowest points, the floor that they stand on."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from skeleton.shapes import Capsule
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

RARE = 0.02  # share of frames that may go below: a foot that sinks in once does not lower the floor


def ends_in_world(capsules: Sequence[Capsule], track: BoneTrack) -> FloatArray:
    """Both ends of each of C capsules in the world over F frames [m], shape (F, C, 2, 3).

    Raises:
        UnknownNameError: a capsule's bone isn't in the track.
    """
    ends = np.empty((track.frames, len(capsules), 2, 3))
    for c, capsule in enumerate(capsules):
        local = np.stack([capsule.start, capsule.end])
        if capsule.bone is None:
            ends[:, c] = local
            continue
        bone = track.index(capsule.bone)
        turned = quaternions.rotate(track.rotations_wxyz[:, bone, None], local)
        ends[:, c] = track.positions[:, bone, None] + turned
    return ends


def lowest_points(capsules: Sequence[Capsule], track: BoneTrack) -> FloatArray:
    """Height of the lowest point of each of C capsules over F frames [m], shape (F, C).

    Raises:
        UnknownNameError: a capsule's bone isn't in the track.
    """
    radii = np.array([capsule.radius for capsule in capsules])
    return ends_in_world(capsules, track)[..., 2].min(axis=2) - radii


def floor_level(capsules: Sequence[Capsule], track: BoneTrack) -> float | None:
    """Height of the level floor that a body of capsules stands on over a motion [m], None without any on a bone.

    It is that of the lowest point of all capsules on bones in all frames but the lowest 2 %.

    Raises:
        UnknownNameError: a capsule's bone isn't in the track.
    """
    moving = [capsule for capsule in capsules if capsule.bone is not None]
    return float(np.quantile(lowest_points(moving, track).min(axis=1), RARE)) if moving else None
