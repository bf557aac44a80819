"""Solids where a motion takes them: their ends in the world, their lowest points, the floor that they stand on."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from skeleton.shapes import Bounded, Capsule, Shape, require_known
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

RARE = 0.02  # share of frames that may go below: a foot that sinks in once does not lower the floor


def as_capsules(solids: Sequence[Shape]) -> list[Capsule]:
    """Those of the solids that are round, as capsules on the same bones (`Shape.as_capsule`).

    Raises:
        UnknownNameError: a solid is of no shape in `skeleton.shapes.SHAPES`.
    """
    require_known(solids)
    return [capsule for solid in solids if (capsule := solid.as_capsule()) is not None]


def in_world(points: FloatArray, bone: str | None, track: BoneTrack) -> FloatArray:
    """Points in a bone's frame, in the world's for None, shape (n, 3), over F frames in the world [m], (F, n, 3).

    Raises:
        UnknownNameError: the bone isn't in the track.
    """
    if bone is None:
        return np.broadcast_to(points, (track.frames, *points.shape))
    index = track.index(bone)
    return track.positions[:, index, None] + quaternions.rotate(track.rotations_wxyz[:, index, None], points)


def ends_in_world(capsules: Sequence[Capsule], track: BoneTrack) -> FloatArray:
    """Both ends of each of C capsules in the world over F frames [m], shape (F, C, 2, 3).

    Raises:
        UnknownNameError: a capsule's bone isn't in the track.
    """
    ends = [in_world(np.stack([capsule.start, capsule.end]), capsule.bone, track) for capsule in capsules]
    return np.stack(ends, axis=1) if ends else np.empty((track.frames, 0, 2, 3))


def lowest_points(solids: Sequence[Bounded], track: BoneTrack) -> FloatArray:
    """Height of the lowest point of each of C solids over F frames [m], shape (F, C).

    Raises:
        UnknownNameError: a solid's bone isn't in the track.
    """
    heights = np.empty((track.frames, len(solids)))
    for column, solid in enumerate(solids):
        heights[:, column] = solid.lowest(*_poses(solid.bone, track))
    return heights


def _poses(bone: str | None, track: BoneTrack) -> tuple[FloatArray, FloatArray]:
    """Positions (F, 3) [m] and rotations bone_to_world (F, 4) of a bone, of the world for None."""
    if bone is None:
        return np.zeros((track.frames, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (track.frames, 1))
    index = track.index(bone)
    return track.positions[:, index], track.rotations_wxyz[:, index]


def floor_level(solids: Sequence[Shape], track: BoneTrack) -> float | None:
    """Height of the level floor that a body stands on over a motion [m], None without any solid on a bone.

    It is that of the lowest point of all solids on bones in all frames but the lowest 2 %.

    Raises:
        UnknownNameError: a solid's bone isn't in the track.
    """
    moving = [solid for solid in solids if isinstance(solid, Bounded) and solid.bone is not None]
    return float(np.quantile(lowest_points(moving, track).min(axis=1), RARE)) if moving else None
