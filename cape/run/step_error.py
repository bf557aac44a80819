"""What the time step costs a run in accuracy, measured while it runs.

The error of a part of the motion is the distance between where the run ends it and where the same solver, with the same
contact model, would end it in ever shorter steps, from the run's own state at the part's start: root mean square over
the vertices. That limit is approached by taking the part again in 2, 4... times as many steps, or in those of a solver
that leads to the same limit sooner (`Solver.toward_limit`); the error of the last, of n steps, is told by Richardson
extrapolation (Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.4) with the order p that
the last three show:

    x = x_n + (x_n - x_(n/2)) / (2^p - 1),   2^p = |x_(n/2) - x_(n/4)| / |x_n - x_(n/2)|

That limit is itself not sure: it lies beyond x_n by what was extrapolated, and on which side of it the true one lies is
not known. Taken for the root mean square distance of the two, in a direction that has nothing to do with that of the
error, the mean square of the true error is that of the distance from the limit and its own together, which is what is
told:

    error^2 = |here - x|^2 + |x - x_n|^2

Where errors fall cleanly the second part is small: of order one in four times as many steps a sixteenth of the first.

Impacts, and waves faster than a step resolves, leave no order to a method whose steps are long; so it is measured,
steps are halved until it is `CLEAN`, or `MOST_LEVELS` are reached, and errors are taken to fall like n^-1 at least.

Contact, wind and buckling magnify any error, however short the step; so parts are short (`window_of`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.results.take import StepError
from cape.run.simulation import Simulation
from cape.run.whereabouts import Diverged, Snapshot
from cape.scene.poses import Bones, Pose, read_pose
from cape.scene.scene import Scene
from cape.solvers import Solver
from motions.errors import ValueRangeError

FREE_WINDOW = 1.0  # s: errors of cloth that only swings need so long to show
TOUCHED_WINDOW = 0.1  # s, of cloth that touches something or flutters: later, chaos tells more than the step
CLEAN = 0.8  # order from which on differences shrink as those of a first-order method should
MOST_LEVELS = 5  # numbers of steps, each twice the one before, at most
PARTS = 10  # of a motion whose error is measured, at least,
EVERY = 0.5  # and one in so many seconds


def is_touched(scene: Scene) -> bool:
    """Tell whether cloth may touch something, or flutter: from small differences large ones then come."""
    return bool(scene.colliders) or scene.wind is not None or scene.self_contact is not None


def window_of(scene: Scene) -> float:
    """How long a part of a scene's motion is [s]."""
    return TOUCHED_WINDOW if is_touched(scene) else FREE_WINDOW


class Schedule(NamedTuple):
    """Parts of a motion, evenly spread over it: how long they are [s], and the frames at which they begin."""

    seconds: float
    starts: tuple[int, ...]


def schedule(scene: Scene, times: NDArray[np.float64]) -> Schedule:
    """The parts of a motion with frames at `times` [s], shape (F,), whose errors tell that of a run.

    They overlap where the motion is short, and are as long as half of it where that is less than `window_of`.
    """
    length = float(times[-1] - times[0])
    seconds = min(window_of(scene), 0.5 * length)
    count = max(PARTS, math.ceil(length / EVERY))
    wanted = np.linspace(0.0, length - seconds, count)
    starts = np.searchsorted(times - times[0], wanted + 1e-9, side="right") - 1
    return Schedule(seconds, tuple(int(frame) for frame in np.unique(starts)))


class Limit(NamedTuple):
    """Where runs in ever shorter steps end, positions [m] (V, 3), the order at which they get there, and how far it was
    extrapolated [m], which is how sure it is."""

    positions: NDArray[np.float64]
    order: float
    unsure: float

    def error(self, here: NDArray[np.float64]) -> float:
        """How far a run is likely to be from it [m] that ends `here` [m] (V, 3), root mean square."""
        return math.hypot(distance(here, self.positions), self.unsure)


def limit_of(ends: Sequence[NDArray[np.float64]], ratio: float = 2.0) -> Limit:
    """The limit of three or more runs that end at `ends` [m], each (V, 3), in ever `ratio` times as many steps."""
    coarse, fine, finest = ends[-3:]
    before, last = distance(coarse, fine), distance(fine, finest)
    if last == 0.0:
        return Limit(finest, math.inf, 0.0)
    order = math.log(before / last, ratio) if before > 0.0 else -math.inf
    positions = finest + (finest - fine) / (ratio ** max(order, 1.0) - 1.0)
    return Limit(positions, order, distance(positions, finest))


@dataclass
class _Part:
    """A part of the motion that has begun: where, how long it shall be [s], and its frames so far."""

    start: Snapshot
    wanted: float
    frames: list[tuple[Pose, float, int]] = field(default_factory=list)
    span: float = 0.0


class Watch:
    """Takes parts of a run again; `begin` a part, `note` each frame of it, `end` it once it is `full`.

    Parts may overlap.

    Attributes:
        errors: of the parts that have ended.
    """

    def __init__(self, run: Simulation) -> None:
        """Watch a run that has been started."""
        self.errors: list[StepError] = []
        self._run = run
        self._twin = Simulation(run.scene, solver=run.solver, threads=run.threads, cuts=None)
        self._twin.start_from(run.snapshot())
        self._parts: list[_Part] = []
        self._time = 0.0
        self._jumps = run.jumps

    @property
    def watching(self) -> bool:
        """Whether a part has begun."""
        return bool(self._parts)

    @property
    def full(self) -> bool:
        """Whether the part that has begun first is long enough."""
        return self.watching and self._parts[0].span > self._parts[0].wanted - 1e-9

    def begin(self, seconds: float | None = None) -> None:
        """Begin a part of the motion where the run is, of that length [s], or as long as the scene needs."""
        self._jumps = self._run.jumps
        self._parts.append(_Part(self._run.snapshot(), seconds or window_of(self._run.scene)))

    def note(self, bones: Bones, dt: float) -> None:
        """Note a frame of `dt` [s] that the run has taken, to a pose."""
        self._time += dt
        if self._run.jumps != self._jumps:
            self._parts.clear()
        for part in self._parts:
            pose = read_pose(bones, self._run.bones).without_world()
            part.frames.append((pose, dt, max(self._run.substeps, 1)))
            part.span += dt

    def end(self) -> StepError:
        """End the part that has begun first, now: take it again in shorter steps, and tell the error.

        Raises:
            ValueRangeError: none has begun, or the bones have jumped within it.
        """
        if not self._parts:
            raise ValueRangeError("no part of the motion has begun, or its bones have jumped")
        part = self._parts.pop(0)
        rms, order = self._error(part)
        solver, substeps = self._run.solver.name, part.frames[-1][2] if part.frames else 0
        self.errors.append(StepError(self._time, rms, solver, substeps, part.span, order))
        return self.errors[-1]

    def _error(self, part: _Part) -> tuple[float, float]:
        """Distance of the run from its limit [m], infinite where a shorter step breaks off; and the order."""
        here, (_, dt, most) = self._run.positions, max(part.frames, key=lambda frame: frame[2] / frame[1])
        finer = self._run.toward_limit(dt, most)
        own = type(finer) is type(self._run.solver)
        ends, steps = [here] if own else [], finer.substeps or 1
        try:
            while True:
                ends.append(self._again(part, finer.in_steps(steps, dt), steps / most))
                if len(ends) >= 3:
                    limit = limit_of(ends)
                    if limit.order >= CLEAN:
                        break
                    if len(ends) >= MOST_LEVELS:
                        limit = limit_of(_while_closer(ends))
                        break
                steps *= 2
            return limit.error(here), limit.order
        except Diverged:
            return math.inf, math.nan

    def _again(self, part: _Part, solver: Solver, times: float) -> NDArray[np.float64]:
        """Where the part ends [m] (V, 3) with a solver in so many times as many steps as the run took."""
        self._twin.change_solver(solver)
        self._twin.start_from(part.start)
        for pose, dt, substeps in part.frames:
            self._twin.change_solver(replace(solver, substeps=round(times * substeps)))
            self._twin.step(pose, dt)
        return self._twin.positions


class ScheduledWatch(Watch):
    """A watch over the parts of a motion that are known before it begins."""

    def __init__(self, run: Simulation, scheduled: Schedule) -> None:
        """Watch a run that stands at the motion's first frame."""
        super().__init__(run)
        self._frame = 0
        self._scheduled = scheduled
        self._begin_here()

    def note(self, bones: Bones, dt: float) -> None:
        """Note the motion's next frame; begin and end the parts that do so there."""
        super().note(bones, dt)
        self._frame += 1
        while self.full:
            self.end()
        self._begin_here()

    def _begin_here(self) -> None:
        if self._frame in self._scheduled.starts:
            self.begin(self._scheduled.seconds)


def _while_closer(ends: list[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """The first three or more of those ends, up to the two that are closest to each other.

    Where equations are not solved any more in ever shorter steps, as in contact of implicit solvers, ends part again.
    """
    apart = [distance(first, second) for first, second in pairwise(ends[1:])]
    return ends[: 3 + int(np.argmin(apart))]


def distance(first: NDArray[np.floating], second: NDArray[np.floating]) -> float:
    """Root mean square over all points of the distance between positions (..., 3) [m]."""
    return float(np.sqrt(np.mean(np.sum((first - second) ** 2, axis=-1))))
