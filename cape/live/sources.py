"""Where bones come from while a cloth is simulated live: a motion, or whatever tells where they are now."""

from collections.abc import Callable, Mapping
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.scene.poses import Bones, Pose
from motions import quaternions
from motions.curves import between_rows, step
from motions.errors import ValueRangeError
from motions.skin import Skin
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

FADE = 0.3  # [s] in which the end of a motion fades into its beginning
FASTEST = 3.0  # [m/s] of what is moved by hand
UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])
Told = Callable[[float], Bones]
"""What tells the poses of bones, given the time of the simulation [s]."""


@runtime_checkable  # since arguments are looked at
class Source(Protocol):
    """Tells where bones are."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the B bones."""
        ...

    @property
    def parents(self) -> tuple[int, ...] | None:
        """Index of each bone's parent, -1 for none, shape (B,); None where that is not known."""
        ...

    @property
    def roles(self) -> Mapping[str, str]:
        """Name of the bone that plays each role."""
        ...

    def pose(self, time: float) -> Pose:
        """Where all bones are at a time of the simulation [s], which never goes back."""
        ...


@runtime_checkable
class Dressed(Protocol):
    """A source that also tells what its character looks like."""

    @property
    def skin(self) -> Skin | None:
        """Its mesh; None for none."""
        ...

    @property
    def morphs(self) -> FloatArray:
        """Weights of the mesh's M morphs in the pose that was told last, shape (M,)."""
        ...


def dressed_in(source: Source, skin: Skin | None) -> Dressed | None:
    """The source, where it is its own mesh that is drawn, whose morphs it tells; None for another's, or none."""
    return source if isinstance(source, Dressed) and skin is not None and source.skin is skin else None


class TrackSource:
    """A motion, played over and over.

    A character goes on from where it has got to, and its last moments fade into the first ones; anything else goes back
    the way it came.

    Attributes:
        track: the motion.
        skin: the mesh that it carries; None for none.
        morphs: weights of the mesh's M morphs in the pose that was told last, shape (M,).
    """

    def __init__(self, track: BoneTrack) -> None:
        """Play a track."""
        self.names, self.roles = track.names, track.roles
        self.parents = None if track.parents is None else tuple(int(p) for p in track.parents)
        self.track, self.skin = track, track.skin
        self._begin, length = float(track.times[0]), float(track.times[-1] - track.times[0])
        pelvis = track.roles.get("pelvis")
        self._root = track.names.index(pelvis) if pelvis in track.names else None
        self._fade = min(FADE, length / 3.0)
        self._length = length - (0.0 if self._root is None else self._fade)
        self._round, self._turn, self._shift = 0, UNTURNED, np.zeros(3)
        self._step = (UNTURNED, np.zeros(3)) if self._root is None else self._way(self._root)
        self._before = self._turn, self._shift
        self.morphs = self._morphs_at(0.0)

    def pose(self, time: float) -> Pose:
        """Where all bones are at a time [s]."""
        rounds, into = divmod(time, self._length) if self._length > 0.0 else (0.0, 0.0)
        if self._root is None:
            into = self._length - into if rounds % 2 else into
            self.morphs = self._morphs_at(into)
            return self._at(into)
        while self._round < rounds:
            turn, shift = self._step
            self._before = self._turn, self._shift
            self._shift = self._shift + quaternions.rotate(self._turn, shift)
            self._turn = quaternions.normalize(quaternions.multiply(self._turn, turn))
            self._round += 1
        now = self._at(into).turned(self._turn).moved(self._shift)
        self.morphs = self._morphs_at(into)
        if self._round == 0 or into >= self._fade:
            return now
        (turn, shift), ended = self._before, self._length + into
        before, share = self._at(ended).turned(turn).moved(shift), float(step(np.array(into), 0.0, self._fade))
        self.morphs = (1.0 - share) * self._morphs_at(ended) + share * self.morphs
        return before.towards(now, share)

    def _morphs_at(self, time: float) -> FloatArray:
        if self.track.morphs is None:
            return np.zeros(0 if self.skin is None else self.skin.morphs)
        return between_rows(self.track.times, self.track.morphs, self._begin + time)

    def _at(self, time: float) -> Pose:
        return Pose(*self.track.sample(self._begin + time))

    def _way(self, root: int) -> tuple[FloatArray, FloatArray]:
        """How the figure stands at the end of a round, to where it stood at its beginning: a turn about Z, a shift."""
        begin, end = self._at(0.0), self._at(self._length)
        turned = quaternions.multiply(end.rotations_wxyz[root], quaternions.conjugate(begin.rotations_wxyz[root]))
        about = np.array([turned[0], 0.0, 0.0, turned[3]])  # the part of it about the vertical
        turn = quaternions.normalize(about) if np.linalg.norm(about) > 1e-6 else UNTURNED
        shift = end.positions[root] - quaternions.rotate(turn, begin.positions[root])
        return turn, shift * np.array([1.0, 1.0, 0.0])


class ToldSource:
    """Bones that a function tells, by their names or in the order in which the scene names them."""

    def __init__(self, told: Told, bones: tuple[str, ...]) -> None:
        """Ask once who there is; `bones` are those that the scene uses.

        Raises:
            ValueRangeError: the function gives no poses.
        """
        self._told = told
        self.parents: tuple[int, ...] | None = None
        self.roles: dict[str, str] = {}
        first = told(0.0)
        self.names = bones if isinstance(first, Pose) else tuple(first)
        self.pose(0.0)

    def pose(self, time: float) -> Pose:
        """Where all bones are now, as the function tells at a time [s].

        Raises:
            ValueRangeError: a bone is missing, or its pose is none.
        """
        told = self._told(time)
        if isinstance(told, Pose):
            return told
        try:
            places = np.array([told[name][0] for name in self.names], dtype=float).reshape(-1, 3)
            turns = np.array([told[name][1] for name in self.names], dtype=float).reshape(-1, 4)
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise ValueRangeError(
                f"bones are told as name: (position, quaternion wxyz), of {', '.join(self.names)[:200]}: {error}"
            ) from None
        return Pose(places, quaternions.normalize(turns))


class Hands:
    """Bones of a source, some of them moved by hand, and others that stand where they were put."""

    def __init__(self, source: Source) -> None:
        """Nothing is moved yet."""
        self.source = source
        self._offsets = np.zeros((len(source.names), 3))
        self._put: dict[str, FloatArray] = {}
        self._goals: dict[str, FloatArray] = {}
        self._time = 0.0
        self._told = source.pose(0.0)

    @property
    def names(self) -> tuple[str, ...]:
        """Of all bones, those that were put somewhere last."""
        return (*self.source.names, *self._put)

    def index(self, bone: str) -> int:
        """Place of a bone, given by its name or role, among `names`.

        Raises:
            KeyError: there is none.
        """
        names = self.names
        name = bone if bone in names else self.source.roles.get(bone)
        if name is None or name not in names:
            raise KeyError(bone)
        return names.index(name)

    def move(self, bone: str, by: ArrayLike) -> None:
        """Move a bone by a vector in the world [m] from where it was, for good.

        Raises:
            KeyError: there is none of that name.
        """
        if bone in self._put:
            self._put[bone] = self._put[bone] + np.asarray(by, dtype=float)
        else:
            self._offsets[self.index(bone)] += np.asarray(by, dtype=float)

    def put(self, bone: str, place: ArrayLike, *, going: bool = False) -> None:
        """Have a bone of one's own stand at a place in the world [m]; `going` on to where it was to go, if anywhere."""
        self._put[bone] = np.asarray(place, dtype=float)
        if not going:
            self._goals.pop(bone, None)

    def reach(self, bone: str, place: ArrayLike) -> None:
        """Have a bone that was put somewhere go to a place in the world [m], no faster than `FASTEST`.

        Raises:
            KeyError: there is none of that name.
        """
        if bone not in self._put:
            raise KeyError(bone)
        self._goals[bone] = np.asarray(place, dtype=float)

    def place(self, bone: str) -> FloatArray:
        """Where a bone that was put somewhere is in the world [m], shape (3,).

        Raises:
            KeyError: there is none of that name.
        """
        return self._put[bone]

    def take_away(self, bone: str) -> None:
        """Have a bone that was put somewhere be no more.

        Raises:
            KeyError: there is none of that name.
        """
        del self._put[bone]
        self._goals.pop(bone, None)

    def take_back(self) -> None:
        """Forget all that was moved; what was put somewhere stays."""
        self._offsets[:] = 0.0

    def pose(self, time: float) -> Pose:
        """Where all of `names` are at a time [s]."""
        self._told = self.source.pose(time)
        most, self._time = FASTEST * max(time - self._time, 0.0), time
        for bone, goal in self._goals.items():
            way = goal - self._put[bone]
            length = float(np.linalg.norm(way))
            self._put[bone] = goal if length <= most else self._put[bone] + way * (most / length)
        return self.now

    @property
    def now(self) -> Pose:
        """Where all of `names` are since they were last asked for, and moved."""
        told = self._told
        positions = np.asarray(told.positions, dtype=float) + self._offsets
        rotations = np.asarray(told.rotations_wxyz, dtype=float)
        if self._put:
            still = np.tile([1.0, 0.0, 0.0, 0.0], (len(self._put), 1))
            positions = np.concatenate([positions, np.array(list(self._put.values()))])
            rotations = np.concatenate([rotations, still])
        return Pose(positions, rotations)
