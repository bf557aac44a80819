"""Round after round of a motion that begins again, until the cloth does so as well, or is led there.

Each round goes on from the end of the last, and is then taken back to the place of the first, cloth and bones as a
whole: so all rounds are the same motion past the same things in the world, and end nearer and nearer to each other
where the cloth forgets how it began. Then a take shows the last of them from its first frame on, and passes over, where
the two are most alike, to the same frames of the round before: from whose last frame it is a simulated step to its
first.

Cloth that touches itself or limbs seldom forgets: how its folds fall differs from round to round. Such a round is
simulated again towards its end, and drawn there, frame by frame, to where the round before was and how fast, ever more
of the way. Between frames it moves as it must, past limbs and with threads as long as they are.
"""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.results.loop import Loop
from cape.run.auto import AutoSimulation
from cape.run.frames import Frames
from cape.run.simulation import Simulation
from cape.run.step_error import distance
from cape.run.whereabouts import Mark
from cape.scene.loops import Travel
from cape.scene.poses import poses_of
from cape.scene.scene import Scene
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

REPEATED = 0.005  # m between two rounds, below which the cloth repeats
NEARER = 0.9  # times as far apart as the rounds before: others are not worth another round
LEAST_ROUNDS, MOST_ROUNDS = 4, 12  # of cloth that does not repeat
BLENDED = 2.0  # s over which one round passes into the other, at most half of it


class Looped(NamedTuple):
    """A round whose last frame leads into its first one, how well it does, and the time spent on the others [s]."""

    frames: Frames
    loop: Loop
    other_s: float


class Laps:
    """The rounds of a simulation that go on from its first one."""

    def __init__(self, simulation: Simulation, scene: Scene, track: BoneTrack, travel: Travel) -> None:
        """Hold a simulation that goes along a track; `scene` has all colliders, also those left out."""
        self._simulation, self._scene, self._track, self._travel = simulation, scene, track, travel
        self._poses, self._steps = poses_of(track, simulation.bones), np.diff(track.times)
        longest = round(BLENDED / float(np.median(self._steps)))
        self._width = max(1, min(longest, (track.frames - 1) // 2))

    def run(self, first: Frames, progress: Callable[[int, int], None] | None) -> Looped:
        """Go on from the end of a first round until the cloth repeats, or as often as it may, and pass over.

        Raises:
            Diverged: the cloth explodes.
        """
        begun, rounds = time.perf_counter(), 2
        before, after = None, self._next(partial(self._tell, progress, rounds))
        alike, pair = self._alike(first, after), None
        while alike.gap > REPEATED and rounds < MOST_ROUNDS:
            rounds += 1
            before, after = after, self._next(partial(self._tell, progress, rounds))
            nearest, alike = alike.gap, self._alike(before.frames, after)
            latest = _Pair(before, after)
            pair = latest if pair is None or self._apart(latest) < self._apart(pair) else pair
            if rounds >= LEAST_ROUNDS and alike.gap > NEARER * nearest:
                break
        if pair is not None and alike.gap > REPEATED:
            shown, loop = pair.after.frames, self._lead(pair, rounds)
        else:
            shown, blended = after.frames, (alike.first, alike.first + self._width)
            shown.pass_over(first if before is None else before.frames, passage(self._track.frames, *blended))
            loop = Loop(self._travel, rounds, alike.gap, REPEATED, blended, drawn=False)
        spent = first.solve_s + time.perf_counter() - begun
        return Looped(shown, loop, spent - shown.solve_s)

    @property
    def _begin(self) -> int:
        """The frame from which on a round may be drawn to where the one before ended."""
        return self._track.frames - 1 - self._width

    def _tell(self, progress: Callable[[int, int], None] | None, rounds: int, done: int) -> None:
        if progress is not None:
            count = self._track.frames
            progress((rounds - 1) * count + done, rounds * count)

    def _next(self, told: Callable[[int], None]) -> "_Lap":
        """Go on from the end of a round through the next."""
        simulation, dt = self._simulation, float(np.median(self._steps))
        if self._travel.loops:
            simulation.step(self._travel.onwards(self._poses[0]), dt)
            simulation.move(*self._travel.way_back)
        else:
            simulation.step(self._poses[0], dt, jumped=True)
        if isinstance(simulation, AutoSimulation):
            simulation.expect(self._poses[1:], self._steps)
        lap = _Lap(Frames(simulation, self._scene, self._track, check_steps=False), [], [])
        for frame in range(1, self._track.frames):
            if frame == self._begin + 1:
                lap.marks.append(simulation.mark())
            lap.frames.step(frame)
            if frame > self._begin:
                lap.states.append((simulation.positions.astype(np.float32), simulation.velocities.astype(np.float32)))
            told(frame + 1)
        return lap

    def _alike(self, before: Frames, after: "_Lap") -> "_Alike":
        return closest(distances(before.positions, after.frames.positions), self._width)

    def _apart(self, pair: "_Pair") -> float:
        """Root mean square distance of two rounds where the one may be drawn to the other [m]."""
        return distance(*(lap.frames.positions[self._begin] for lap in pair))

    def _lead(self, pair: "_Pair", rounds: int) -> Loop:
        """Simulate the end of a round again, and lead it to that of the round before.

        Raises:
            Diverged: the cloth explodes.
        """
        simulation, begin, frames = self._simulation, self._begin, pair.after.frames
        apart = distances(pair.before.frames.positions[begin:], frames.positions[begin:])
        simulation.go_back(pair.after.marks[0])
        frames.go_back(begin)
        left = 1.0 - passage(self._track.frames, begin, self._track.frames - 1)
        for frame in range(begin + 1, self._track.frames):
            goal = pair.before.states[frame - begin - 1]
            frames.step(frame, then=partial(simulation.draw, *goal, 1.0 - left[frame] / left[frame - 1]))
        frames.pass_over(frames, np.zeros(self._track.frames))
        return Loop(self._travel, rounds, float(apart.max()), REPEATED, (begin, self._track.frames - 1), drawn=True)


class _Lap(NamedTuple):
    """A round, where it may be drawn on from, and positions [m] and velocities [m/s] after that, (V, 3) each."""

    frames: Frames
    marks: list[Mark]
    states: list[tuple[NDArray[np.float32], NDArray[np.float32]]]


class _Pair(NamedTuple):
    """Two rounds, the one after the other."""

    before: _Lap
    after: _Lap


class _Alike(NamedTuple):
    """The frame from which on two rounds are most alike, and how far apart they are there at most [m]."""

    first: int
    gap: float


def distances(first: Sequence[NDArray[np.floating]], second: Sequence[NDArray[np.floating]]) -> FloatArray:
    """Largest distance of a vertex between two runs at each of F frames [m], positions (V, 3) each; shape (F,)."""
    return np.array([np.linalg.norm(a - b, axis=1).max() for a, b in zip(first, second, strict=True)], dtype=float)


def closest(apart: FloatArray, width: int) -> _Alike:
    """Where two runs that are so far apart at each frame [m], shape (F,), are most alike over so many steps."""
    most = np.lib.stride_tricks.sliding_window_view(apart, width + 1).max(axis=1)
    first = int(most.argmin())
    return _Alike(first, float(most[first]))


def passage(frames: int, first: int, last: int) -> FloatArray:
    """Shares that rise from 0 at one frame to 1 at another, without a jolt at either, shape (frames,)."""
    share = np.clip((np.arange(frames) - first) / (last - first), 0.0, 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
