"""A character that is steered as it moves: it passes over to another clip at once, whenever it is told to."""

from collections import deque
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.curves import step
from motions.graph.alignment import window_distances
from motions.graph.blend import SUPPORTS, Blends, blend_windows
from motions.graph.blend_source import Source
from motions.graph.motion_graph import MotionGraph

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BLEND = 0.3  # [s] in which the character passes over, or longer where joints would be too fast
HURRY = 0.2  # [s] in which it does from within a passage, whose end it does not wait for
EARLY = 0.25  # [s] from the start of a clip that is played once within which it is entered


class Frame(NamedTuple):
    """A pose of J joints.

    Attributes:
        rotations: unit quaternions joint_to_parent wxyz, shape (J, 4).
        local: positions in the parent's frame, the root's in the world [m], shape (J, 3).
        morphs: weights of the mesh's M morphs, shape (M,).
    """

    rotations: FloatArray
    local: FloatArray
    morphs: FloatArray


class Walker:
    """Moves frame by frame through the clips of a motion graph.

    Clips that go round, such as a walk, are played until told otherwise; others once, and then the one before goes on.

    Attributes:
        clip: name of the clip that is played, or passed over to.
    """

    def __init__(self, graph: MotionGraph, start: str, *, once: Sequence[str] = ()) -> None:
        """Stand at the first frame of a clip.

        Args:
            graph: the clips.
            start: name of the first one, which goes round.
            once: names of clips that are played once.

        Raises:
            UnknownNameError: there is no such clip.
        """
        self._graph, self._once = graph, frozenset(once)
        self.clip = self._base = start
        self._source, self._at = graph.source(start), 0
        self._coming: deque[Frame] = deque()  # of a passage, in the clip that is left
        self._after: tuple[FloatArray, FloatArray] | None = None  # turn and shift of the clip then entered
        self._turn, self._shift = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
        self._root: FloatArray | None = None  # where it was last
        self.turning = 0.0
        """Rate at which the character turns on its way, counter-clockwise from above [rad/s]."""

    def prepare(self) -> None:
        """Find all passages that may be needed, which takes a few seconds."""
        names = [clip.name for clip in self._graph.clips]
        for name in names:
            if name not in self._once:
                self._graph.loop(name)
            for other in names:
                if other != name:
                    self._entries(name, other)

    @property
    def fps(self) -> float:
        """Frames a second."""
        return self._graph.fps

    def go(self, name: str) -> None:
        """Pass over to a clip from the next frame on; nothing changes where it is played already.

        Raises:
            UnknownNameError: there is no such clip.
        """
        self._graph.source(name)
        if name not in self._once:
            self._base = name
        if name != self.clip:
            self._pass_to(name)

    def next(self) -> Frame:
        """The next frame, in the world."""
        if not self._coming:
            self._arrive()
        self._steer()
        frame = _moved(self._coming.popleft(), self._turn, self._shift)
        self._root = frame.local[0]
        return frame

    def _arrive(self) -> None:
        """Have at least one frame to come: of the clip that is played, or of the passage that follows on it."""
        if self._after is not None:
            turn, shift = self._after
            self._shift = self._shift + quaternions.rotate(self._turn, shift)
            self._turn = quaternions.normalize(quaternions.multiply(self._turn, turn))
            self._after = None
        frames = self._source.clip.frames
        if self.clip in self._once:
            if self._at >= frames - 1 - self._frames(BLEND):
                self._pass_to(self._base)
                return
        else:
            loop = self._graph.loop(self.clip)
            if self._at > loop.at.leave:
                self._coming.extend(_frames_of(loop.blends))
                self._after = loop.blends.turns[0], loop.blends.shifts[0]
                self._at = loop.at.enter + loop.at.frames
                return
        self._coming.append(self._still(self._at))
        self._at += 1

    def _pass_to(self, name: str) -> None:
        """Leave the clip that is played for another one at the next frame."""
        if self._after is not None or self._coming:
            self._hurry_to(name)
            return
        frames = self._frames(BLEND)
        source, target = self._source, self._graph.source(name)
        leave = min(max(self._at - 1, 0), source.clip.frames - 1 - frames)  # which was seen last
        enters, headings = self._entries(self.clip, name)
        enter, heading = int(enters[leave]), float(headings[leave])
        at = np.array([leave]), np.array([enter]), np.array([heading])
        tried = blend_windows(source, target, *at, np.array(SUPPORTS), frames)
        support = int(np.lexsort((tried.slides, tried.extra_frames()))[0])
        extra = int(min(tried.extra_frames()[support], 2 * frames))
        blends = blend_windows(source, target, *at, np.array([SUPPORTS[support]]), frames, extra=extra)
        self._coming.extend(_frames_of(blends))
        self._after = blends.turns[0], blends.shifts[0]
        self._enter(name, enter + frames)

    def _hurry_to(self, name: str) -> None:
        """Leave a passage for another clip: what is still to come of it fades, wherever its feet stand."""
        frames = self._frames(HURRY)
        old = list(self._coming)
        turn, shift = self._after or (np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
        for k in range(frames - len(old)):
            old.append(_moved(self._still(self._at + k), turn, shift))
        old = old[:frames]
        enters, headings = self._entries(self.clip, name)
        at = min(self._at, len(enters) - 1)
        enter = int(enters[at])
        source = self._graph.source(name)
        last = source.clip.frames - 1
        about = quaternions.from_rotation_vector(np.array([0.0, 0.0, float(headings[at])]))
        turn = quaternions.normalize(quaternions.multiply(turn, about))
        first = _clip_frame(source, min(enter, last))
        shift = (old[0].local[0] - quaternions.rotate(turn, first.local[0])) * np.array([1.0, 1.0, 0.0])
        self._coming.clear()
        weights = step(np.arange(1, len(old) + 1), 0.0, len(old) + 1)
        for k, (here, weight) in enumerate(zip(old, weights, strict=True), 1):
            new = _moved(_clip_frame(source, min(enter + k, last)), turn, shift)
            mixed = quaternions.slerp(here.rotations, new.rotations, np.full(len(new.rotations), weight))
            local, morphs = (a + weight * (b - a) for a, b in zip(here[1:], new[1:], strict=True))
            self._coming.append(Frame(mixed, local, morphs))
        self._after = turn, shift
        self._enter(name, min(enter + len(old) + 1, last))

    def _enter(self, name: str, at: int) -> None:
        self.clip, self._source, self._at = name, self._graph.source(name), at

    def _still(self, at: int) -> Frame:
        return _clip_frame(self._source, min(at, self._source.clip.frames - 1))

    def _steer(self) -> None:
        """Turn all that follows about where the root was last."""
        if self.turning and self._root is not None:
            about = quaternions.from_rotation_vector(np.array([0.0, 0.0, self.turning / self.fps]))
            self._turn = quaternions.normalize(quaternions.multiply(about, self._turn))
            self._shift = self._root + quaternions.rotate(about, self._shift - self._root)
            self._shift[2] = 0.0

    def _frames(self, seconds: float) -> int:
        return max(round(seconds * self.fps), 1)

    def _entries(self, source: str, target: str) -> tuple[IntArray, FloatArray]:
        """For each frame at which a clip may be left, which of another is most like it, and the turn to it [rad]."""
        return _entries(self._graph, source, target, self._frames(BLEND), self._frames(EARLY), target in self._once)


@cache
def _entries(
    graph: MotionGraph, source: str, target: str, frames: int, early: int, once: bool
) -> tuple[IntArray, FloatArray]:
    a, b = graph.source(source), graph.source(target)
    # Clips that go round are entered where much of them is still to come.
    last = early if once else max(2 * b.third - frames, 1)
    distances, headings = window_distances(a.points, b.points[: last + frames + 1], frames + 1)
    enters = distances.argmin(axis=1)
    return enters, headings[np.arange(len(enters)), enters]


def _clip_frame(source: Source, frame: int) -> Frame:
    at = np.array([[frame]], dtype=float)
    rotations, local, _ = source.at(at)
    return Frame(rotations[0, 0], local[0, 0], source.morphs_at(at)[0, 0])


def _frames_of(blends: Blends) -> list[Frame]:
    """What lies between the ends of a single blend: these are of its two clips."""
    every = zip(blends.rotations_wxyz[0], blends.local_positions[0], blends.morphs[0], strict=True)
    return [Frame(*each) for each in every][1:-1]


def _moved(frame: Frame, turn: FloatArray, shift: FloatArray) -> Frame:
    rotations, local = frame.rotations.copy(), frame.local.copy()
    rotations[0] = quaternions.multiply(turn, rotations[0])
    local[0] = quaternions.rotate(turn, local[0]) + shift
    return Frame(rotations, local, frame.morphs)
