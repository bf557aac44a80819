"""The plug between whatever moves bones and the cloth: world poses of named bones over time, as plain arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motions import quaternions
from motions.border import checked
from motions.curves import between_rows
from motions.errors import UnknownNameError, ValueRangeError
from motions.limits import LARGEST_TRACK
from motions.skin import Skin

FloatArray = NDArray[np.float64]

_UNIT_TOLERANCE = 1e-6
"""How far the length of a given quaternion may be from 1: beyond single precision's rounding it is a mistake."""


@checked
@dataclass(frozen=True, eq=False)
class BoneTrack:
    """World poses of B bones over F frames, right-handed and Z up.

    The arrays are copied and made read-only; quaternions are normalised and made continuous over the frames.

    Attributes:
        names: names of the bones, unique.
        times: times of the frames [s], increasing, shape (F,).
        positions: origins of the bones in the world [m], shape (F, B, 3).
        rotations_wxyz: unit quaternions (w, x, y, z) bone_to_world, shape (F, B, 4), signs continuous over frames.
        parents: index of each bone's parent among `names`, -1 for none, shape (B,); only drawings need it.
        roles: name of the bone that plays each role, such as {"left_shoulder": "LeftCollar"}.
        skin: the mesh that these bones move, such as `clip.skin`; None for none.
        morphs: weight of each of the skin's M morphs in each frame, shape (F, M); None for 0.

    Raises:
        ValueRangeError: shapes don't match, a number isn't finite, times don't increase, a quaternion isn't of unit
            length, a name occurs twice or a bone of a role or of the skin isn't among the names.
    """

    names: tuple[str, ...]
    times: FloatArray
    positions: FloatArray
    rotations_wxyz: FloatArray
    parents: NDArray[np.int64] | None = None
    roles: Mapping[str, str] = field(default_factory=dict)
    skin: Skin | None = field(default=None, repr=False)
    morphs: FloatArray | None = field(default=None, repr=False)

    def __post_init__(self):
        """Copy, check and freeze the arrays."""
        frozen = {
            "names": tuple(self.names),
            "times": np.array(self.times, dtype=float),
            "positions": np.array(self.positions, dtype=float),
            "rotations_wxyz": np.array(self.rotations_wxyz, dtype=float),
            "parents": None if self.parents is None else np.array(self.parents, dtype=np.int64),
            "roles": dict(self.roles),
            "morphs": None if self.morphs is None else np.array(self.morphs, dtype=float),
        }
        for name, value in frozen.items():
            object.__setattr__(self, name, value)
        self._check_names()
        self._check_numbers()
        rotations = quaternions.make_continuous(quaternions.normalize(self.rotations_wxyz))
        object.__setattr__(self, "rotations_wxyz", rotations)
        for array in (self.times, self.positions, self.rotations_wxyz, self.parents, self.morphs):
            if array is not None:
                array.setflags(write=False)

    def _check_names(self) -> None:
        if repeated := sorted({name for name in self.names if self.names.count(name) > 1}):
            raise ValueRangeError(f"bone names must be unique; given twice: {', '.join(repeated)}")
        for role, bone in self.roles.items():
            if bone not in self.names:
                names = ", ".join(self.names)
                raise ValueRangeError(f"the role {role!r} is given to {bone!r}, which isn't among: {names}")
        if self.skin is not None and (unknown := set(self.skin.bones).difference(self.names)):
            raise ValueRangeError(
                f"the skin hangs at {sorted(unknown)[0]!r}, which isn't among: {', '.join(self.names)}"
            )
        if self.parents is not None:
            bones = len(self.names)
            _check_shape("parents", self.parents, (bones,))
            if ((self.parents < -1) | (self.parents >= bones)).any():
                raise ValueRangeError(f"parents must lie between -1 and {bones - 1}, got {self.parents.tolist()}")

    def _check_numbers(self) -> None:
        frames, bones = self.times.size, len(self.names)
        if frames == 0:
            raise ValueRangeError("a track needs at least one frame, got none")
        shapes = {"times": (frames,), "positions": (frames, bones, 3), "rotations_wxyz": (frames, bones, 4)}
        for label, shape in shapes.items():
            array = getattr(self, label)
            _check_shape(label, array, shape)
            if (bad := ~np.isfinite(array)).any():
                raise ValueRangeError(f"{label} must be finite, got NaN or infinity at the index {_first(bad)}")
        if self.morphs is not None:
            if self.skin is None:
                raise ValueRangeError("morphs are those of a skin, and there is none")
            self.skin.require_morphs(self.morphs, frames)
        if (stalled := np.diff(self.times) <= 0).any():
            raise ValueRangeError(f"times must increase, frame {_first(stalled)[0] + 1} is not after the one before")
        if (off := np.abs(np.linalg.norm(self.rotations_wxyz, axis=-1) - 1) > _UNIT_TOLERANCE).any():
            frame, bone = _first(off)
            raise ValueRangeError(
                f"rotations_wxyz must be of unit length, that of {self.names[bone]!r} at frame {frame} isn't"
            )

    @property
    def frames(self) -> int:
        """Number of frames F."""
        return len(self.times)

    @property
    def fps(self) -> float:
        """Mean number of frames per second.

        Raises:
            ValueRangeError: the track has a single frame.
        """
        if self.frames < 2:
            raise ValueRangeError("a track of one frame has no frame rate")
        return (self.frames - 1) / float(self.times[-1] - self.times[0])

    def index(self, bone: str) -> int:
        """Place among `names` of a bone given by its name or by its role; a name wins over a role.

        Raises:
            UnknownNameError: there is neither; lists the bones.
        """
        name = bone if bone in self.names else self.roles.get(bone)
        if name is None:
            raise UnknownNameError("bone", bone, self.names, _roles_hint(self.roles))
        return self.names.index(name)

    def select(self, bones: Sequence[str]) -> "BoneTrack":
        """The track of just these bones, given by name or role, in this order.

        A bone's parent becomes its nearest ancestor among the selected; roles of bones left out are dropped,
        and so is a skin that hangs at one of them.

        Raises:
            UnknownNameError: there is no such bone.
        """
        chosen = list(dict.fromkeys(self.index(bone) for bone in bones))
        names = tuple(self.names[i] for i in chosen)
        return BoneTrack(
            names,
            self.times,
            self.positions[:, chosen],
            self.rotations_wxyz[:, chosen],
            None if self.parents is None else nearest_parents(self.parents, chosen),
            {role: bone for role, bone in self.roles.items() if bone in names},
            **worn_by(names, self.skin, self.morphs),
        )

    def first(self, frames: int) -> "BoneTrack":
        """The track of the first frames, all of them where there are no more.

        Raises:
            ValueRangeError: no frame would be left.
        """
        return self.part(0, max(frames, 0))

    def part(self, first: int, end: int) -> "BoneTrack":
        """The track from a frame on, up to another that is no more part of it; at the times that they have.

        Raises:
            ValueRangeError: no frame would be left, or the first is negative.
        """
        if first < 0:
            raise ValueRangeError(f"a part of a track begins with frame 0 or a later one, not {first}")
        if first == 0 and end >= self.frames:
            return self  # nothing of it ever changes
        kept = slice(first, end)
        return replace(
            self,
            times=self.times[kept],
            positions=self.positions[kept],
            rotations_wxyz=self.rotations_wxyz[kept],
            morphs=None if self.morphs is None else self.morphs[kept],
        )

    def at(self, frame: int) -> tuple[FloatArray, FloatArray]:
        """Poses at a frame, negative from the end: positions [m], shape (B, 3), and rotations_wxyz, shape (B, 4).

        Raises:
            ValueRangeError: there is no such frame.
        """
        if not -self.frames <= frame < self.frames:
            raise ValueRangeError(f"there is no frame {frame}: the track's frames are 0 to {self.frames - 1}")
        return self.positions[frame], self.rotations_wxyz[frame]

    def sample(self, t: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Poses at any time: positions on the straight line between frames, rotations at constant angular velocity.

        Before the first and after the last frame the bones stand still.

        Args:
            t: times [s], any shape (...).

        Returns:
            Positions [m], shape (..., B, 3), and unit quaternions bone_to_world, shape (..., B, 4).

        Raises:
            ValueRangeError: a time isn't finite.
        """
        t = np.asarray(t, dtype=float)
        if not np.isfinite(t).all():
            raise ValueRangeError("times to sample must be finite, got NaN or infinity")
        if self.frames == 1:
            once = np.zeros(t.shape, dtype=np.int64)
            return self.positions[once], self.rotations_wxyz[once]
        before = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, self.frames - 2)
        fraction = np.clip((t - self.times[before]) / (self.times[before + 1] - self.times[before]), 0, 1)[..., None]
        weight = fraction[..., None]
        positions = (1 - weight) * self.positions[before] + weight * self.positions[before + 1]
        rotations = quaternions.slerp(self.rotations_wxyz[before], self.rotations_wxyz[before + 1], fraction)
        return positions, rotations

    def resample(self, fps: float) -> "BoneTrack":
        """The same motion at another frame rate [1/s], from the first frame on as long as it lasts.

        Raises:
            ValueRangeError: the frame rate isn't positive, or asks for too many frames.
        """
        if not (np.isfinite(fps) and fps > 0):
            raise ValueRangeError(f"the frame rate must be positive, got {fps}")
        duration = float(self.times[-1] - self.times[0])
        if duration * fps * len(self.names) > LARGEST_TRACK:
            raise ValueRangeError(f"at {fps:g} frames per second the motion has {duration * fps:.3g} frames: too many")
        # A last frame that rounding puts a hair after the end still counts.
        times = self.times[0] + np.arange(int(duration * fps + 1e-6) + 1) / fps
        positions, rotations = self.sample(times)
        morphs = None if self.morphs is None else between_rows(self.times, self.morphs, times)
        return replace(self, times=times, positions=positions, rotations_wxyz=rotations, morphs=morphs)


def nearest_parents(parents: Sequence[int] | NDArray[np.int64], chosen: Sequence[int]) -> NDArray[np.int64]:
    """Nearest chosen ancestor of each chosen bone, as an index into `chosen`, -1 for none, shape (len(chosen),)."""
    place = {bone: i for i, bone in enumerate(chosen)}
    result = []
    for bone in chosen:
        ancestor = int(parents[bone])
        while ancestor >= 0 and ancestor not in place:
            ancestor = int(parents[ancestor])
        result.append(place.get(ancestor, -1))
    return np.array(result, dtype=np.int64)


def worn_by(names: Sequence[str], skin: Skin | None, morphs: FloatArray | None) -> dict[str, Any]:
    """The skin and its morphs as fields of a track of some bones: none where it hangs at others as well."""
    return {"skin": skin, "morphs": morphs} if skin is not None and set(skin.bones) <= set(names) else {}


def _check_shape(label: str, array: NDArray, shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ValueRangeError(f"{label} must have the shape {shape}, got {array.shape}")


def _first(mask: NDArray[np.bool_]) -> tuple[int, ...]:
    """Index of the first true element."""
    return tuple(int(i) for i in np.argwhere(mask)[0])


def _roles_hint(roles: Mapping[str, str]) -> str:
    return f"Roles: {', '.join(roles)}" if roles else ""
