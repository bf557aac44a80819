"""Round after round of a motion that begins again, until the cloth does so as well.

Each round goes on from the end of the last, and is then taken back to the place of the first, cloth and bones as a
whole: so all rounds are the same motion past the same things in the world, and end nearer and nearer to each other
where the cloth forgets how it began. What is left of the difference is blended away. The take shows a round from its
first frame on, and passes over, where the two are most alike, to the same frames of the round before: from whose last
frame it is a simulated step to its first.
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
from cape.scene.loops import Travel
from cape.scene.poses import poses_of
from cape.scene.scene import Scene
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

REPEATED = 0.005  # m between two rounds, below which the cloth repeats
MOST_ROUNDS = 12
BLENDED = 1.0  # s over which one round passes into the other, at most half of it


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

    def run(self, first: Frames, progress: Callable[[int, int], None] | None) -> Looped:
        """Go on from the end of a first round until the cloth repeats, or as often as it may, and blend.

        Raises:
            Diverged: the cloth explodes.
        """
        begun, rounds = time.perf_counter(), 2
        best = latest = self._pair(first, partial(self._tell, progress, rounds))
        while best.gap > REPEATED and rounds < MOST_ROUNDS:
            rounds += 1
            latest = self._pair(latest.after, partial(self._tell, progress, rounds))
            best = latest if latest.gap < best.gap else best
        spent = first.solve_s + time.perf_counter() - begun
        blended = best.first, best.first + self._width
        best.after.pass_over(best.before, passage(self._track.frames, *blended))
        return Looped(best.after, Loop(self._travel, rounds, best.gap, REPEATED, blended), spent - best.after.solve_s)

    @property
    def _width(self) -> int:
        """Frames over which one round passes into the other."""
        return max(1, min(round(BLENDED / float(np.median(self._steps))), (self._track.frames - 1) // 2))

    def _tell(self, progress: Callable[[int, int], None] | None, rounds: int, done: int) -> None:
        if progress is not None:
            count = self._track.frames
            progress((rounds - 1) * count + done, rounds * count)

    def _pair(self, before: Frames, told: Callable[[int], None]) -> "_Pair":
        """Go on from the end of a round through the next, and compare them."""
        simulation, dt = self._simulation, float(np.median(self._steps))
        if self._travel.loops:
            simulation.step(self._travel.onwards(self._poses[0]), dt)
            simulation.move(*self._travel.way_back)
        else:
            simulation.step(self._poses[0], dt, jumped=True)
        if isinstance(simulation, AutoSimulation):
            simulation.expect(self._poses[1:], self._steps)
        after = Frames(simulation, self._scene, self._track, check_steps=False)
        after.run(told)
        return _Pair(before, after, *closest(distances(before.positions, after.positions), self._width))


class _Pair(NamedTuple):
    """Two rounds, of which one came after the other, the frame from which on they are most alike, and how far apart
    they are there at most [m]."""

    before: Frames
    after: Frames
    first: int
    gap: float


def distances(first: Sequence[NDArray[np.floating]], second: Sequence[NDArray[np.floating]]) -> FloatArray:
    """Largest distance of a vertex between two runs at each of F frames [m], positions (V, 3) each; shape (F,)."""
    return np.array([np.linalg.norm(a - b, axis=1).max() for a, b in zip(first, second, strict=True)], dtype=float)


def closest(apart: FloatArray, width: int) -> tuple[int, float]:
    """The frame from which on the next `width` ones are least apart, and how far they are at most.

    `apart` is how far two runs are at each frame [m], shape (F,).
    """
    most = np.lib.stride_tricks.sliding_window_view(apart, width + 1).max(axis=1)
    first = int(most.argmin())
    return first, float(most[first])


def passage(frames: int, first: int, last: int) -> FloatArray:
    """Shares that rise from 0 at one frame to 1 at another, and begin and end evenly, shape (frames,)."""
    share = np.clip((np.arange(frames) - first) / (last - first), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)
