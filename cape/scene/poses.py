"""Where bones are at one instant, as a simulation takes it."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motions import quaternions
from motions.errors import UnknownNameError, ValueRangeError
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

FARTHEST = 1e7  # m from the world's origin, a quarter of the way around the earth: beyond it centimetres are rounding


class Pose(NamedTuple):
    """Where bones are: origins in the world [m] (B, 3), unit quaternions bone_to_world wxyz (B, 4)."""

    positions: FloatArray
    rotations_wxyz: FloatArray

    def moved(self, shift: FloatArray) -> "Pose":
        """Give the pose that lies a vector [m] further on."""
        return Pose(self.positions + shift, self.rotations_wxyz)

    def turned(self, rotation_wxyz: FloatArray) -> "Pose":
        """Give the pose turned about the origin by a unit quaternion wxyz, shape (4,)."""
        return Pose(
            quaternions.rotate(rotation_wxyz, self.positions), quaternions.multiply(rotation_wxyz, self.rotations_wxyz)
        )

    def towards(self, other: "Pose", share: float) -> "Pose":
        """A pose on the way to another one, 0 to 1 of it: straight, turning at an even rate."""
        return Pose(
            self.positions + share * (other.positions - self.positions),
            quaternions.slerp(self.rotations_wxyz, other.rotations_wxyz, share),
        )

    def without_world(self) -> "Pose":
        """The pose as it was before `read_pose` added the world."""
        return Pose(self.positions[:-1], self.rotations_wxyz[:-1])


Bones = Mapping[str, tuple[ArrayLike, ArrayLike]] | Pose


class Poses(Sequence[Pose]):
    """Poses at frames of a track, each made when it is asked for."""

    def __init__(self, track: BoneTrack, chosen: Sequence[int], frames: range) -> None:
        """Of the chosen bones."""
        self._track, self._chosen, self._frames = track, list(chosen), frames

    def __len__(self) -> int:
        """How many there are."""
        return len(self._frames)

    @overload
    def __getitem__(self, index: int) -> Pose: ...

    @overload
    def __getitem__(self, index: slice) -> "Poses": ...

    def __getitem__(self, index: int | slice) -> "Pose | Poses":
        """One of them, or several."""
        if isinstance(index, slice):
            return Poses(self._track, self._chosen, self._frames[index])
        frame = self._frames[index]
        return Pose(self._track.positions[frame, self._chosen], self._track.rotations_wxyz[frame, self._chosen])


def poses_of(track: BoneTrack, bones: Sequence[str]) -> Poses:
    """The pose of some bones, given by name or role and in this order, at each frame of a track.

    Raises:
        UnknownNameError: the track lacks a bone.
    """
    return Poses(track, [track.index(bone) for bone in bones], range(track.frames))


def read_poses(poses: Sequence[Bones], names: Sequence[str]) -> list[Pose]:
    """Check poses of the named bones as `read_pose` does, and copy them, without the world.

    Raises:
        UnknownNameError: a bone's pose is missing.
        ValueRangeError: the number of bones is wrong, or a pose is not finite or no rotation.
    """
    given = [pose for pose in poses if isinstance(pose, Pose)]
    if given and len(given) == len(poses) and all(_fits(pose, len(names)) for pose in given):
        positions, rotations = np.array([p.positions for p in given]), np.array([p.rotations_wxyz for p in given])
        # At once, as most motions are told frame by frame; what is wrong with one is found below.
        near = np.abs(positions).max(initial=0.0) <= FARTHEST  # False for what is not finite
        if near and np.isfinite(rotations).all() and np.any(rotations, axis=2).all():
            return [Pose(*pose) for pose in zip(positions, rotations, strict=True)]
    return [read_pose(pose, names).without_world() for pose in poses]


def _fits(pose: Pose, count: int) -> bool:
    return np.shape(pose.positions) == (count, 3) and np.shape(pose.rotations_wxyz) == (count, 4)


def read_pose(bones: Bones, names: Sequence[str]) -> Pose:
    """Check the poses of the named bones, and add the world as one that comes last.

    `bones` is a mapping from each name to (position [m], quaternion bone_to_world wxyz), or a `Pose` in their order.

    Raises:
        UnknownNameError: a bone's pose is missing.
        ValueRangeError: the number of bones is wrong, or a pose is not finite or no rotation.
    """
    if isinstance(bones, Pose):
        positions, rotations = np.asarray(bones.positions), np.asarray(bones.rotations_wxyz)
    else:
        missing = [name for name in names if name not in bones]
        if missing:
            raise UnknownNameError("bone", missing[0], bones, "The scene uses " + ", ".join(names))
        try:
            positions = np.array([bones[name][0] for name in names], dtype=float).reshape(len(names), 3)
            rotations = np.array([bones[name][1] for name in names], dtype=float).reshape(len(names), 4)
        except (TypeError, ValueError, IndexError, KeyError):
            raise ValueRangeError(
                f"a bone's pose is its position, three numbers, and its quaternion wxyz, four: {', '.join(names)}"
            ) from None
    if positions.shape != (len(names), 3) or rotations.shape != (len(names), 4):
        raise ValueRangeError(f"a pose of {len(names)} bones is needed: {', '.join(names)}")
    if not (np.isfinite(positions).all() and np.isfinite(rotations).all()):
        raise ValueRangeError("the pose of the bones is not finite")
    if np.abs(positions).max(initial=0.0) > FARTHEST:
        raise ValueRangeError(f"a bone is {np.abs(positions).max():.3g} m away: positions are in metres")
    if not np.linalg.norm(rotations, axis=1).all():
        raise ValueRangeError("the rotation of a bone is a quaternion of zeros")
    return Pose(
        np.concatenate([positions, np.zeros((1, 3))]),
        np.concatenate([quaternions.normalize(rotations), [[1.0, 0.0, 0.0, 0.0]]]),
    )


def read_vector(values: ArrayLike, name: str) -> FloatArray:
    """Check three numbers, and copy them, shape (3,).

    Raises:
        ValueRangeError: they are other than three, or not finite.
    """
    vector = np.array(values, dtype=float)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueRangeError(f"the {name} must be three finite numbers, not {values}")
    return vector
