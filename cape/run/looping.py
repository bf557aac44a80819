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
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.results.loop import Loop
from cape.results.verdict import NOTABLE_PENETRATION
from cape.run.auto import AutoSimulation
from cape.run.frames import Frames
from cape.run.simulation import Simulation
from cape.run.whereabouts import Mark
from cape.scene.loops import Travel
from cape.scene.poses import poses_of
from cape.scene.scene import Scene
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

REPEATED = 0.005  # m between two rounds, below which the cloth repeats
NEARER = 0.9  # times as far apart as the pair of rounds before: if they are farther, more rounds would not help
LEAST_ROUNDS, MOST_ROUNDS = 4, 12  # of cloth that does not repeat
BLENDED = 2.0  # s over which one round passes into the other at most, and at most half of it
MIXED = 0.25  # of that, at the end, in which what is left of the difference is mixed away
SHORTEST, BEGINS = 0.5, 10  # s that it takes at least, where it is drawn there, and how many times between are tried


class Looped(NamedTuple):
    """A round that leads into its beginning, how well it does, time spent on others [s], and whether it was stopped."""

    frames: Frames
    loop: Loop
    other_s: float
    stopped: bool


class Laps:
    """The rounds of a simulation that go on from its first one."""

    def __init__(self, simulation: Simulation, scene: Scene, track: BoneTrack, travel: Travel) -> None:
        """Hold a simulation that goes along a track; `scene` has all colliders, also those left out."""
        self._simulation, self._scene, self._track, self._travel = simulation, scene, track, travel
        self._poses, self._steps = poses_of(track, simulation.bones), np.diff(track.times)
        longest = round(BLENDED / float(np.median(self._steps)))
        self._renewed = False
        self._width = max(1, min(longest, (track.frames - 1) // 2))

    def run(self, first: Frames, progress: Callable[[int, int], None] | None) -> Looped:
        """Go on from the end of a first round until the cloth repeats, or as often as it may, and pass over.

        An interrupt after the second round leaves those that are done, of which the last passes over.

        Raises:
            Diverged: the cloth explodes.
        """
        begun, rounds, former, stopped = time.perf_counter(), 1, np.inf, False
        before: _Lap | None = None
        after: _Lap | None = None
        alike, ways = _Alike(0, np.inf), []
        try:
            while after is None or (alike.gap > REPEATED and rounds < MOST_ROUNDS):
                if rounds >= LEAST_ROUNDS and alike.gap > NEARER * former:
                    break
                lap = self._next(partial(self._tell, progress, rounds + 1))
                rounds, former, before, after = rounds + 1, alike.gap, after, lap
                apart = distances(_frames(before, first).positions, lap.frames.positions)
                alike = closest(apart, self._width)
                if before is not None:
                    ways.append(self._way(before, lap, apart))
        except KeyboardInterrupt:
            if after is None:
                raise
            stopped = True
            alike = closest(distances(_frames(before, first).positions, after.frames.positions), self._width)
        assert after is not None
        if ways and alike.gap > REPEATED and not stopped:
            way = min(ways, key=lambda way: (way.after.frames.deepest > NOTABLE_PENETRATION, way.speed))
            shown, loop = way.after.frames, self._lead(way, rounds)
        else:
            shown, blended = after.frames, (alike.first, alike.first + self._width)
            shown.pass_over(_frames(before, first), passage(self._track.frames, *blended))
            loop = Loop(self._travel, rounds, alike.gap, REPEATED, blended, drawn=False, renewed=self._renewed)
        spent = first.solve_s + time.perf_counter() - begun
        return Looped(shown, loop, spent - shown.solve_s, stopped)

    @property
    def _begins(self) -> list[int]:
        """The frames from which on a round may be drawn to where the one before ended."""
        last = self._track.frames - 1
        least = min(round(SHORTEST / float(np.median(self._steps))), self._width)
        return sorted({last - round(width) for width in np.linspace(max(least, 1), self._width, BEGINS)})

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
            before = simulation.renewed
            simulation.step(self._poses[0], dt, jumped=True)
            self._renewed = simulation.renewed > before
        if isinstance(simulation, AutoSimulation):
            simulation.expect(self._poses[1:], self._steps)
        lap, begins = _Lap(Frames(simulation, self._scene, self._track, check_steps=False), {}, {}), self._begins
        for frame in range(1, self._track.frames):
            if frame - 1 in begins:
                lap.marks[frame - 1] = simulation.mark()
            lap.frames.step(frame)
            if frame > begins[0]:
                lap.states[frame] = simulation.positions.astype(np.float32), simulation.velocities.astype(np.float32)
            told(frame + 1)
        return lap

    def _way(self, before: "_Lap", after: "_Lap", apart: FloatArray) -> "_Way":
        """The slowest way to draw a round to the end of the one before, from which it is `apart` [m], shape (F,)."""
        last = self._track.frames - 1
        gaps = {begin: float(apart[begin:].max()) for begin in self._begins}
        begin = min(gaps, key=lambda begin: gaps[begin] / (last - begin))
        return _Way(before, after, begin, gaps[begin], gaps[begin] / (last - begin))

    def _lead(self, way: "_Way", rounds: int) -> Loop:
        """Simulate the end of a round again, and lead it to that of the round before.

        Raises:
            Diverged: the cloth explodes.
        """
        simulation, frames, last = self._simulation, way.after.frames, self._track.frames - 1
        simulation.go_back(way.after.marks[way.begin])
        frames.go_back(way.begin)
        left = 1.0 - passage(self._track.frames, way.begin, last - 1)
        for frame in range(way.begin + 1, last + 1):
            # Drawn before it is stepped: what limbs then have no place for they push away.
            if frame - 1 > way.begin:
                simulation.draw(*way.before.states[frame - 1], 1.0 - left[frame - 1] / left[frame - 2])
            frames.step(frame)
        # Layers that came to lie otherwise keep it a little off.
        mixed = passage(self._track.frames, last - max(round(MIXED * (last - way.begin)), 1), last)
        frames.pass_over(way.before.frames, mixed)
        return Loop(self._travel, rounds, way.gap, REPEATED, (way.begin, last), drawn=True, renewed=self._renewed)


class _Lap(NamedTuple):
    """A round, and by frame where it may be drawn on from, positions [m] and velocities [m/s] after that, (V, 3)."""

    frames: Frames
    marks: dict[int, Mark]
    states: dict[int, tuple[NDArray[np.float32], NDArray[np.float32]]]


def _frames(lap: _Lap | None, first: Frames) -> Frames:
    """Those of a round, or of the `first` one, which is none that goes on."""
    return first if lap is None else lap.frames


class _Way(NamedTuple):
    """How a round may be drawn to the end of the one before: from which frame on, how far at most [m], and how fast [m
    per frame]."""

    before: _Lap
    after: _Lap
    begin: int
    gap: float
    speed: float


class _Alike(NamedTuple):
    """The frame from which on two rounds are most alike, and how far apart they are there at most [m]."""

    first: int
    gap: float


def distances(first: NDArray[np.floating], second: NDArray[np.floating]) -> FloatArray:
    """Largest distance of a vertex between two runs at each of F frames [m], from positions (F, V, 3); shape (F,)."""
    return np.array([np.linalg.norm(a - b, axis=1).max() for a, b in zip(first, second, strict=True)], dtype=float)


def closest(apart: FloatArray, width: int) -> _Alike:
    """Where two runs that are so far apart at each frame [m], shape (F,), are most alike over so many steps."""
    most = np.lib.stride_tricks.sliding_window_view(apart, width + 1).max(axis=1)
    first = int(most.argmin())
    return _Alike(first, float(most[first]))


def passage(frames: int, first: int, last: int) -> FloatArray:
    """Shares that rise from 0 at one frame to 1 at another, without a jolt at either, shape (frames,)."""
    share = np.clip((np.arange(frames) - first) / max(last - first, 1), 0.0, 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
