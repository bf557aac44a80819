"""A free motion that is known to its end: which steps its run needs, told by a companion in longer or shorter ones.

The error of the whole run is what is asked for. It is the same motion in other steps that tells it, from the same start
on; but as that must not take long, the companion takes half of its steps where these are stable, and goes no farther
than a share of the run's time takes it. From there on errors drift on as they did (`drift`), in proportion to how fast
the bones move. The run looks at its companion a few times, ever later, and takes other steps for what is left.
"""

import math
from collections.abc import Container, Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from cape.run.auto.ahead import Coming, is_as_long
from cape.run.auto.choice import AIM, FEWEST, FRAME, FRAME_COST, LEAST_CHANGE, MOST_CHANGE, Choice
from cape.run.auto.drift import Drift, Orders
from cape.run.simulation import Simulation
from cape.run.step_error import FREE_WINDOW, distance
from cape.run.whereabouts import Snapshot
from cape.solvers import TRBDF2, XPBD, Solver, SymplecticEuler

SHARE = 0.15  # of the time that a run takes, that its companion may
SHORT = 0.75  # of a short motion, that it takes at most
SHORTER = math.sqrt(0.5)  # times as long steps of a companion where longer ones would explode: their errors are halved
WELL = 0.5  # of what is allowed, below which steps that can't be longer need no second look
MOST = 1.7  # times as fast as is likely, that errors of XPBD grow at most: see `sagging`
SAMPLES = 10  # in a second: shapes are compared so often
NEAR = 1.3  # times as long steps, which tell too little of each other
# XPBD sags as the square of its step and lags behind as the step. TR-BDF2 is of second order. Euler's stable steps are
# so short that the slow motion of a cloth is as good as exact: its period is off by (w h)^2 / 24. What they miss are
# waves, which are damped, so that their error does not grow.
ORDERS = {XPBD.name: Orders(2.0, 1.0), TRBDF2.name: Orders(2.0, 2.0), SymplecticEuler.name: Orders(2.0, None)}


class Companion:
    """A run of the motion in other steps, as far as it is asked for.

    Attributes:
        places: of the vertices at the end of each frame that is sampled [m], by the number of frames until then.
    """

    def __init__(self, start: Snapshot, choice: Choice, times: float, twin: Simulation) -> None:
        """Begin where a run does, in steps so many times as long as are chosen, with a simulation that is started."""
        self.places: dict[int, NDArray[np.float64]] = {}
        self._choice, self._times, self._taken, self._dt = copy(choice), times, 0, FRAME
        self._run = twin
        twin.change_solver(self._solver(FRAME))
        twin.start_from(start)

    @property
    def length(self) -> float:
        """Of its steps, in units of the solver's own."""
        return self._choice.length * self._times

    def go(self, frames: Sequence[Coming], sampled: Container[int]) -> None:
        """Go on from where it is, through the frames up to some, and note where vertices are after those sampled."""
        for pose, dt in frames[self._taken :]:
            if not is_as_long(dt, self._dt):
                self._dt = dt
                self._run.change_solver(self._solver(dt))
            self._run.step(pose, dt)
            self._taken += 1
            if self._taken in sampled:
                self.places[self._taken] = self._run.positions

    def _solver(self, dt: float) -> Solver:
        return self._choice.for_frame(dt, times=self._times)


class Course:
    """The motion, what is known of the run's error in it, and when to look.

    Attributes:
        frames: all that are left.
        first: how many of them are taken before any is handed on.
        taken: how many of them the run has taken.
        error: root mean square of the whole run, as far as is known [m].
    """

    def __init__(
        self, start: Snapshot, frames: list[Coming], choice: Choice, *, allowed: float, twin: Simulation
    ) -> None:
        """Begin a run of a motion, whose error may be so large [m], with a simulation of the scene for companions."""
        self.frames, self.taken, self.error = frames, 0, math.nan
        self._start, self._choice, self._allowed, self._twin = start, choice, allowed, twin
        self._times = np.cumsum([coming.dt for coming in frames])
        self._total = float(self._times[-1])
        least = min(FREE_WINDOW, SHORT * self._total)
        self._spend = max(least, SHARE * self._total)  # s of the run
        self.first = self._until(max(least, 0.5 * SHARE * self._total))
        self._ways = np.cumsum(_ways(start, frames))
        self._speed = math.sqrt(self._ways[-1] / self._total)
        choice.aim_at(AIM * allowed, speed=self._speed, seconds=self._total)
        self.begin()

    def begin(self) -> None:
        """Begin the run, for the first time or again, with a companion that suits its steps."""
        choice = self._choice
        few = isinstance(choice.solver, XPBD) and choice.count(FRAME) < 2 * FEWEST
        times = 0.5 if few else SHORTER if choice.explodes_at_double else 2.0
        self._companion = Companion(self._start, choice, times, self._twin)
        self._places: dict[int, NDArray[np.float64]] = {}
        self.taken, self._long = 0, 0.0
        last = self._until(self._reach())
        self._looks = [min(self.first, last)]
        while self._looks[-1] < last:
            self._looks.append(min(2 * self._looks[-1], last))
        every = max(1, round(last / SAMPLES / float(self._times[last - 1])))
        self._sampled = {*range(every, last, every), *self._looks}

    def note(self, run: Simulation) -> None:
        """Note where the run's next frame ends."""
        self._long += self._choice.length * self.frames[self.taken].dt
        self.taken += 1
        if self._looks and self.taken in self._sampled:
            self._places[self.taken] = run.positions

    @property
    def due(self) -> bool:
        """Whether it is time to look."""
        return bool(self._looks) and self.taken == self._looks[0]

    def adjust(self) -> bool:
        """Compare the run with its companion, which tells its `error`, and choose steps for what is left.

        Returns:
            Whether the run is to be taken again from its start, as no steps from now on keep to what is allowed.
        """
        choice, drift, aim = self._choice, self._look(), AIM * self._allowed
        now, before = float(self._times[self.taken - 1]), (choice.solver.name, choice.length)
        solver, mean = choice.solver.name, self._mean_length
        left, total = self.taken < len(self.frames), self._total
        ratio = min(max(drift.ratio(aim, now if left else 0.0, total), LEAST_CHANGE), MOST_CHANGE)
        missed = (drift.rms(now, total, ratio) if left else self.error) > self._allowed
        if self.taken == self.first and missed:
            choice.take(max(drift.ratio(aim, 0.0, total), LEAST_CHANGE) * mean)
            return (choice.solver.name, choice.length) != before
        if not left:
            return False
        choice.take(ratio * mean)
        self.error = drift.rms(now, total, choice.length / mean if choice.solver.name == solver else ratio)
        well = choice.length == choice.within(math.inf) and self.error < WELL * self._allowed
        if well or choice.solver.name != solver or 1.0 / NEAR < choice.length / self._companion.length < NEAR:
            self._looks.clear()
        return self.taken == self.first and choice.solver.name != solver

    def _look(self) -> Drift:
        self._looks.pop(0)
        count, companion = self.taken, self._companion
        companion.go(self.frames[:count], self._sampled)
        chosen = np.array(list(self._places))
        apart = np.array([distance(companion.places[k], self._places[k]) for k in chosen])
        ratio, orders = companion.length / self._mean_length, ORDERS[self._choice.solver.name]
        if count == len(self.frames) and not isinstance(self._choice.solver, XPBD):
            # All of it was seen, of errors of one order: no line is needed.
            orders = Orders(self._choice.solver.order, None)
        likely = self._likely_growth()
        drift = Drift.between(
            self._times[chosen - 1], apart * self._pace(count), ratio, orders,
            likely=likely, most=MOST * likely or math.inf, seen=float(self._times[count - 1]) / self._total,
        )  # fmt: skip
        self.error = drift.rms(self._total, self._total)
        return drift

    @property
    def _mean_length(self) -> float:
        """Of the steps of the run until now."""
        return self._long / float(self._times[self.taken - 1])

    def _likely_growth(self) -> float:
        """Growth of the error [m/s] whose root mean square over the motion is what XPBD is likely to lag."""
        if not isinstance(self._choice.solver, XPBD):
            return 0.0
        lag = self._choice.sagging.at(self._speed, self._total).lag
        return math.sqrt(3.0) * lag * self._choice.step / self._total

    def _pace(self, count: int) -> float:
        """How many times as fast as in the first frames bones move in all of them, at least once."""
        seen = self._ways[count - 1] / self._times[count - 1]
        return max(1.0, math.sqrt(self._ways[-1] / self._total / seen)) if seen > 0.0 else 1.0

    def _reach(self) -> float:
        """How long a part of the motion the companion may take [s]."""
        ratio = self._companion.length / self._choice.length
        if not isinstance(self._choice.solver, XPBD):
            return self._spend * ratio
        rest, count = FRAME_COST / self._start.scene.cloth.vertices, self._choice.count(FRAME)
        return self._spend * (count + rest) / (count / ratio + rest)

    def _until(self, seconds: float) -> int:
        """Number of frames that take so long, all where there are not so many."""
        return min(int(np.searchsorted(self._times, seconds - 1e-9)) + 1, len(self.frames))


def _ways(start: Snapshot, frames: list[Coming]) -> NDArray[np.float64]:
    """Mean square over all bones of their speed in each frame, times its length [m2/s]."""
    here = start.place.pose.moved(start.place.origin).without_world().positions
    places = np.array([here, *(coming.pose.positions for coming in frames)])
    ways = np.sum(np.diff(places, axis=0) ** 2, axis=(1, 2)) / max(len(here), 1)
    return ways / np.array([coming.dt for coming in frames])
