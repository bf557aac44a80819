"""A motion clip: a joint tree and the pose of each of its joints over time."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motions import quaternions
from motions.bodies import stature
from motions.border import checked
from motions.curves import between_rows
from motions.errors import UnknownNameError, ValueRangeError
from motions.kinematics import forward_kinematics
from motions.skin import Skin

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@checked
@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of a clip's J joints at N times, frames and units as in `Clip`.

    Attributes:
        root_positions: position of the root in the world [m], shape (N, 3).
        rotations_wxyz: unit quaternions (w, x, y, z) joint_to_parent, shape (N, J, 4).
        local_positions: position of each joint in its parent's frame [m], shape (N, J, 3), or None as in the clip.
    """

    root_positions: FloatArray
    rotations_wxyz: FloatArray
    local_positions: FloatArray | None = None


@checked
@dataclass(frozen=True, eq=False)
class Clip:
    """An immutable motion of a joint tree, in metres, right-handed and Z up.

    The pose of joint j relative to its parent is `local_positions` (or `offsets`, where that is None) followed by
    `rotations_wxyz`; the pose of the root is relative to the world. Arrays are copied, checked and made read-only.

    Attributes:
        name: what the clip is called, by default the stem of its file.
        joints: names of the J joints, unique, parents before children, the root first.
        parents: index of each joint's parent, shape (J,), -1 for the root.
        offsets: position of each joint's origin in its parent's frame [m], shape (J, 3), zero for the root.
        end_parents: joint at which each of the E end sites hangs, shape (E,).
        end_offsets: position of each end site in its joint's frame [m], shape (E, 3).
        fps: frames per second.
        root_positions: position of the root in the world [m], shape (F, 3).
        rotations_wxyz: unit quaternions (w, x, y, z) joint_to_parent, shape (F, J, 4), signs continuous over frames.
        local_positions: position of each joint in its parent's frame [m], shape (F, J, 3), the root's its position in
            the world, or None where all joints but the root stay at their offsets.
        decisions: what the reader had to decide (unit, up axis, dropped frames, renamed joints), a sentence each.
        roles: name of the joint of each role (`motions.ROLES`) that the file itself tells, as VRM files do.
        skin: the mesh that the joints carry; None for none.
        morphs: weight of each of the skin's M morphs in each frame, shape (F, M); None for 0.
        whole: the motion that this is a part of, or the same at another frame rate: the body's typical pose is that of
            all of it. None for this one itself; one of other joints is left out.

    Raises:
        ValueRangeError: shapes that don't fit, numbers that aren't finite, a tree that isn't one, fps of 0 or less.
    """

    name: str
    joints: tuple[str, ...]
    parents: IntArray
    offsets: FloatArray
    end_parents: IntArray
    end_offsets: FloatArray
    fps: float
    root_positions: FloatArray
    rotations_wxyz: FloatArray
    local_positions: FloatArray | None = None
    decisions: tuple[str, ...] = field(default=())
    roles: Mapping[str, str] = field(default_factory=dict)
    skin: Skin | None = field(default=None, repr=False)
    morphs: FloatArray | None = field(default=None, repr=False)
    whole: "Clip | None" = field(default=None, repr=False)

    def __post_init__(self) -> None:
        """Copy, check and freeze the arrays."""
        joints, ends = len(self.joints), len(self.end_parents)
        if joints == 0 or len(set(self.joints)) != joints:
            raise ValueRangeError(f"clip {self.name!r}: joint names must be unique, and at least one")
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise ValueRangeError(f"clip {self.name!r}: fps must be more than 0, not {self.fps:g}")
        frames = len(self.root_positions)
        if frames == 0:
            raise ValueRangeError(f"clip {self.name!r} has no frame")
        self._freeze("parents", (joints,), np.int64)
        self._freeze("offsets", (joints, 3))
        self._freeze("end_parents", (ends,), np.int64)
        self._freeze("end_offsets", (ends, 3))
        self._freeze("root_positions", (frames, 3))
        self._freeze("rotations_wxyz", (frames, joints, 4))
        if self.local_positions is not None:
            self._freeze("local_positions", (frames, joints, 3))
        if self.morphs is not None:
            self._freeze("morphs", (frames, 0 if self.skin is None else self.skin.morphs))
        if self.parents[0] != -1 or np.any(self.parents[1:] < 0) or np.any(self.parents >= np.arange(joints)):
            raise ValueRangeError(f"clip {self.name!r}: the root comes first with parent -1, parents before children")
        if np.any(self.end_parents < 0) or np.any(self.end_parents >= joints):
            raise ValueRangeError(f"clip {self.name!r}: end sites hang at joints 0 to {joints - 1}")
        squares = np.einsum("...i,...i", self.rotations_wxyz, self.rotations_wxyz)
        if np.abs(squares - 1).max() > 1e-6:
            raise ValueRangeError(f"clip {self.name!r}: rotations_wxyz must be unit quaternions")
        if self.whole is not None and not self._is_of(self.whole):
            object.__setattr__(self, "whole", None)

    def _is_of(self, other: "Clip") -> bool:
        """Tell whether another clip moves the same joints, at the same places where these are its own."""
        if self.joints != other.joints or not np.array_equal(self.parents, other.parents):
            return False
        return self.local_positions is None or np.array_equal(self.offsets, other.offsets)

    def _freeze(self, attribute: str, shape: tuple[int, ...], dtype: type = np.float64) -> None:
        array = np.array(getattr(self, attribute), dtype=dtype)
        if array.shape != shape:
            raise ValueRangeError(f"clip {self.name!r}: {attribute} has shape {array.shape}, not {shape}")
        if not np.isfinite(array).all():
            raise ValueRangeError(f"clip {self.name!r}: {attribute} holds a number that isn't finite")
        array.setflags(write=False)
        object.__setattr__(self, attribute, array)

    @property
    def frames(self) -> int:
        """Number of frames F."""
        return len(self.root_positions)

    @property
    def duration(self) -> float:
        """Time from the first frame to the last [s]."""
        return (self.frames - 1) / self.fps

    @property
    def times(self) -> FloatArray:
        """Times of the frames [s], the first at 0, shape (F,)."""
        return np.arange(self.frames) / self.fps

    def index(self, joint: str) -> int:
        """Index of the joint of that name.

        Raises:
            UnknownNameError: there is none; lists the joints.
        """
        if joint not in self.joints:
            raise UnknownNameError("bone", joint, self.joints)
        return self.joints.index(joint)

    def sample(self, times: ArrayLike) -> Poses:
        """Poses between the frames: rotations by slerp, positions linearly.

        Args:
            times: one time or N times since the first frame [s]; before the first and after the last frame the pose is
                theirs.

        Returns:
            N poses; one for a single time.

        Raises:
            ValueRangeError: a time isn't finite.
        """
        times = np.atleast_1d(np.asarray(times, dtype=float))
        if not np.isfinite(times).all():
            raise ValueRangeError("times must be finite")
        at = np.clip(times * self.fps, 0, self.frames - 1)
        before = np.minimum(at.astype(np.int64), max(self.frames - 2, 0))
        after = np.minimum(before + 1, self.frames - 1)
        fraction = at - before

        def between(positions: FloatArray) -> FloatArray:
            weight = fraction.reshape(-1, *[1] * (positions.ndim - 1))
            return (1 - weight) * positions[before] + weight * positions[after]

        return Poses(
            between(self.root_positions),
            quaternions.slerp(self.rotations_wxyz[before], self.rotations_wxyz[after], fraction[:, None]),
            None if self.local_positions is None else between(self.local_positions),
        )

    def resample(self, fps: float) -> "Clip":
        """The same motion at another frame rate [1/s], from the first frame to the last that still fits in.

        Raises:
            ValueRangeError: fps is 0, negative or not finite.
        """
        if not (np.isfinite(fps) and fps > 0):
            raise ValueRangeError(f"fps must be more than 0, not {fps:g}")
        # A frame that rounding puts just beyond the end still belongs to the clip.
        frames = int(self.duration * fps * (1 + 1e-12) + 1e-9) + 1
        times = np.arange(frames) / fps
        poses = self.sample(times)
        return replace(
            self,
            fps=float(fps),
            root_positions=poses.root_positions,
            rotations_wxyz=quaternions.make_continuous(poses.rotations_wxyz),
            local_positions=poses.local_positions,
            morphs=None if self.morphs is None else between_rows(self.times, self.morphs, times),
            whole=self.whole or self,
        )

    def trim(self, start: float = 0.0, end: float | None = None) -> "Clip":
        """The frames from `start` to `end` [s], both included; the new clip begins at time 0.

        Raises:
            ValueRangeError: no frame lies between the two, or they lie outside of the clip.
        """
        end = self.duration if end is None else end
        rounding = 1e-6 / self.fps
        if not (-rounding <= start <= end <= self.duration + rounding):
            raise ValueRangeError(
                f"can't trim clip {self.name!r} to {start:g} s .. {end:g} s: it lasts from 0 to {self.duration:g} s"
            )
        kept = np.flatnonzero((self.times >= start - rounding) & (self.times <= end + rounding))
        if len(kept) == 0:
            raise ValueRangeError(f"clip {self.name!r} has no frame between {start:g} s and {end:g} s")
        return replace(
            self,
            root_positions=self.root_positions[kept],
            rotations_wxyz=self.rotations_wxyz[kept],
            local_positions=None if self.local_positions is None else self.local_positions[kept],
            morphs=None if self.morphs is None else self.morphs[kept],
            whole=self.whole or self,
        )

    def world_poses(self) -> tuple[FloatArray, FloatArray]:
        """Positions of the joints in the world [m], (F, J, 3), and unit quaternions joint_to_world wxyz, (F, J, 4)."""
        if self.local_positions is None:
            local_positions = np.repeat(self.offsets[None], self.frames, axis=0)
        else:
            local_positions = np.array(self.local_positions)
        local_positions[:, 0] = self.root_positions
        return forward_kinematics(self.parents, local_positions, self.rotations_wxyz)

    def world_positions(self) -> FloatArray:
        """Positions of the joints in the world [m], shape (F, J, 3)."""
        return self.world_poses()[0]

    def end_positions(self) -> FloatArray:
        """Positions of the end sites in the world [m], shape (F, E, 3)."""
        return self.world_points()[:, len(self.joints) :]

    def world_points(self) -> FloatArray:
        """Positions of the joints and then of the end sites in the world [m], shape (F, J + E, 3)."""
        positions, rotations = self.world_poses()
        at = self.end_parents
        ends = positions[:, at] + quaternions.rotate(rotations[:, at], self.end_offsets)
        return np.concatenate([positions, ends], axis=1)

    def sampled(self) -> "Clip":
        """A few of the frames, spread over the clip: enough to measure a body by."""
        few = np.unique(np.linspace(0, self.frames - 1, stature.SAMPLES).astype(np.int64))
        return replace(
            self,
            root_positions=self.root_positions[few],
            rotations_wxyz=self.rotations_wxyz[few],
            local_positions=None if self.local_positions is None else self.local_positions[few],
            morphs=None if self.morphs is None else self.morphs[few],
        )

    def standing_height(self) -> float:
        """Height of the body if it stood upright [m], whatever its pose in the clip; see `stature.standing_height`."""
        points = self.sampled().world_points()
        landmarks = stature.find_landmarks(self.joints, self.parents, self.end_parents, points, self.roles)
        return stature.standing_height(points, landmarks)
