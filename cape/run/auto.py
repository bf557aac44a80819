"""Method and step from a tolerance, or from the time that a frame may take.

Solver and steps begin with what a hanging cloth tells (`choice`, `sagging`). Within a tolerance, part after part of the
motion is then compared with the same part in half as many steps, or twice as many. Where the poses to come are known
(`AutoSimulation.expect`) that is done before a part's first frame is handed on, and the part is taken again in shorter
steps where it misses. In a loop that tells one pose at a time it can only be done afterwards, for what follows; and
before the first frame, as if the bones moved on as they begin to.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.assembly.chains import chain_of
from cape.results.take import StepError
from cape.run.ahead import Ahead, Coming, Part, Taken, onwards
from cape.run.choice import AIM, DEARER, EASY, FEWEST, FRAME, TOLERANCE, Auto, Choice
from cape.run.sagging import Sagging
from cape.run.simulation import DEFAULT_CUTS, Diverged, Simulation, Snapshot
from cape.run.step_error import TOUCHED_WINDOW, distance, is_touched, window_of
from cape.scene.jumps import Cuts
from cape.scene.poses import Bones, Pose, read_pose
from cape.scene.scene import Scene
from cape.solvers import XPBD, Solver, SymplecticEuler
from motions.errors import ValueRangeError

GATHERED = 0.8  # of the tolerance, for a part of a free motion: a whole run gathers more
BRIEF = 0.2  # of the tolerance, for a part of a free motion that is as short as one that is touched
START = 1.2  # times the tolerance, that a first guess aims at
TRIES = 6  # of a part, at most
PILOTS = (FEWEST // 2, FEWEST)  # steps of XPBD in a frame that tell how many more are needed
MOST_KEPT = 4_000_000  # vertices of all frames that are kept at once: some 200 MB
REST_FREE = 3.0  # s between two parts that are compared of a motion that is free,
REST_TOUCHED = 0.3  # and of one that is touched, where errors are `FAR_BELOW` what is allowed
FAR_BELOW = 0.1  # of it
FASTER = 1.5  # times as fast as when it was last compared, cloth is compared again
FILLED = 0.8  # of the budget, that is planned for
CLOSE = 0.8  # of what is planned, above which steps stay as they are
FINEST_IN_TIME = 8.0  # times as short as stable steps of Euler, within a budget
ADJUSTED = 30  # frames after which the number of steps is adjusted to the budget

__all__ = ["Auto", "AutoSimulation"]


class AutoSimulation(Simulation):
    """A simulation that chooses its solver and steps, and changes them as the motion needs.

    Attributes:
        asked: what it chooses for.
        errors: of the time step, as the run itself estimated them, none in a run within a budget. Each is of a part of
            the motion, or of the whole where it is free and was known. `simulate(..., check_steps=True)` measures them
            as of any other run.
    """

    def __init__(
        self,
        scene: Scene,
        asked: Auto,
        *,
        threads: int | None = None,
        cuts: Cuts | None = DEFAULT_CUTS,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Hold the scene and what is asked for; nothing is computed before `start`.

        Args:
            scene: cloth, attachments, colliders, forces.
            asked: the tolerance or the budget.
            threads: how many share the cloth, None for as many as pay off.
            cuts: what counts as a jump of the bones, and what becomes of the cloth; None to take all as motion.
            clock: tells the time [s]; only what is asked to stay within a budget looks at it.

        Raises:
            ValueRangeError: the number of threads is not positive.
        """
        super().__init__(scene, solver=XPBD(), threads=threads, cuts=cuts)
        self.asked = asked
        self.errors: list[StepError] = []
        self._choice = Choice()
        self._twin: Simulation | None = None
        self._ahead = Ahead([])
        self._open: Part | None = None
        self._rest = self._time = self._speed = 0.0
        self._clock = clock
        self._spent: list[float] = []

    @property
    def _solvers(self) -> tuple[Solver, ...]:
        return SymplecticEuler(), XPBD()

    @property
    def tolerance(self) -> float:
        """Error that the time step may cause [m]."""
        return self.asked.tolerance or TOLERANCE

    @property
    def allowed(self) -> float:
        """Error that a part of the motion may have [m]."""
        free = self._choice.free
        return self.tolerance * ((BRIEF if self._choice.explodes_at_half else GATHERED) if free else 1.0)

    def start(
        self,
        bones: Bones,
        *,
        settle: float | None = None,
        velocity: ArrayLike = (0.0, 0.0, 0.0),
        spin: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Choose solver and steps, then start as `Simulation.start` does."""
        self._choose(bones)
        super().start(bones, settle=settle, velocity=velocity, spin=spin)

    def start_from(self, snapshot: Snapshot) -> None:
        """Choose solver and steps, then start as `Simulation.start_from` does."""
        self._choose(snapshot.first_pose.without_world())
        self._cloth = None
        super().start_from(snapshot)

    def expect(self, poses: Sequence[Bones], steps: ArrayLike) -> None:
        """Tell which poses `step` will be given next, and after how long each [s], shape (F,).

        Within a tolerance, parts of the motion are then tried before their first frame is handed on, and taken again in
        shorter steps where they miss it. A call that comes with another pose ends that.

        Raises:
            UnknownNameError: a bone's pose is missing.
            ValueRangeError: a pose is not finite, or there are more or fewer steps than poses.
        """
        durations = np.asarray(steps, dtype=float)
        if durations.shape != (len(poses),):
            raise ValueRangeError(f"{len(poses)} poses need as many steps, not of shape {durations.shape}")
        told = [read_pose(pose, self.bones).without_world() for pose in poses]
        self._ahead = Ahead([Coming(pose, float(dt)) for pose, dt in zip(told, durations, strict=True)])

    def step(self, bones: Bones, dt: float) -> None:
        """Advance the cloth as `Simulation.step` does, and look now and then whether the steps suit."""
        if self._cloth is None:
            self.start(bones)
        if self.asked.budget is not None:
            self._step_in_time(bones, dt)
            return
        pose = read_pose(bones, self.bones).without_world()
        if self._ahead.is_next(pose, dt):
            if not self._ahead.taken:
                self._take_ahead()
            self._go_to(self._ahead.hand_on())
            return
        self._ahead = Ahead([])
        if self._time == 0.0 and 0.0 < dt < math.inf:
            self._rehearse(pose, dt)
        self._step_and_look(pose, dt)

    def _step_in_time(self, bones: Bones, dt: float) -> None:
        self._take_steps(dt)
        begun = self._clock()
        super().step(bones, dt)
        self._spent.append(self._clock() - begun)
        if len(self._spent) >= ADJUSTED:
            self._fit(float(np.mean(self._spent)))

    def _step_and_look(self, pose: Pose, dt: float) -> None:
        """Take a frame of which none is known beforehand; at the end of a part, adjust the steps to come."""
        if self._open is None and self._rest <= 0.0:
            self._open = Part(self.snapshot(), [])
        jumps = self.jumps
        self._take_steps(dt)
        super().step(pose, dt)
        self._time += dt
        self._rest -= dt
        if self.jumps != jumps:
            self._open = None
        if self._open is not None:
            self._open.frames.append((Coming(pose, dt), self.substeps))
            if self._open.seconds > (TOUCHED_WINDOW if self._choice.explodes_at_half else window_of(self.scene)) - 1e-9:
                error = self._compare(self._open)
                self._open = None
                self.errors.append(error)
                self._adjust(error.rms / self.allowed)

    def _rehearse(self, pose: Pose, dt: float) -> None:
        """Find out which steps suit if the bones move on as they begin to, before the first frame is handed on."""
        cloth = self._started
        here = Pose(*cloth.pose).moved(cloth.origin).without_world()
        frames = [Coming(each, dt) for each in onwards(here, pose, math.ceil(window_of(self.scene) / dt - 1e-9))]
        start = self._taken()
        self._try_part(frames)
        self._go_to(start)
        self._time = self._rest = 0.0
        self.errors.clear()

    def _take_ahead(self) -> None:
        """Take the part of the motion that comes next, until its error is allowed."""
        start, frames = self._taken(), self._ahead.part(math.inf)
        taken: list[Taken] = []
        if isinstance(self.solver, XPBD) and self._choice.free:
            taken = self._climb(frames[: max(1, MOST_KEPT // self.scene.cloth.vertices)])
        self._ahead.taken.extend(taken or self._try_part(self._ahead.part(window_of(self.scene))))
        self._go_to(start)

    def _climb(self, frames: list[Coming]) -> list[Taken]:
        """Take frames of a free motion in ever shorter steps of XPBD, until the error of all of them is allowed.

        What is learned from long steps, which cost little, tells how short they must be. Nothing is returned where
        Euler's are then the better ones.

        Raises:
            Diverged: the first frame explodes.
        """
        start, snapshot, taken = self._taken(), self.snapshot(), []
        runs = [self._pilot(snapshot, frames, count) for count in PILOTS]
        allowed, error = self.tolerance, math.nan
        # Of the two parts of an error long steps tell the sum; what is likely of a hanging cloth, their quotient.
        choice, likely = self._choice, self._choice.sagging
        scale = distance(runs[0][1], runs[1][1]) / (likely.error(runs[0][0]) - likely.error(runs[1][0]))
        choice.step = likely.step(AIM * allowed / scale)
        for _ in range(TRIES):
            self._go_to(start)
            choice.step = min(choice.step, FRAME / (FEWEST + 1))
            choice.decide()
            if not isinstance(choice.solver, XPBD):
                return []
            jumps, taken, places = self.jumps, [], []
            try:
                for coming in frames:
                    self._take_steps(coming.dt)
                    super().step(*coming)
                    taken.append(self._taken())
                    places.append(self.positions)
            except Diverged:
                if not taken:
                    raise
                break
            if self.jumps != jumps:
                break
            runs.append((FRAME / choice.count(FRAME), np.array(places)))
            (long, first), (middle, second), (short, third) = runs[-3:]
            found = Sagging.measured((long, middle, short), (distance(first, second), distance(second, third)))
            error = found.error(short)
            if error <= allowed:
                break
            choice.step = found.step(AIM * allowed)
        seconds = sum(coming.dt for coming in frames[: len(taken)])
        self._time += seconds
        self.errors.append(StepError(self._time, error, self.solver.name, self.substeps, seconds))
        return taken

    def _pilot(self, start: Snapshot, frames: list[Coming], count: int) -> tuple[float, NDArray[np.float64]]:
        """Take frames in steps of XPBD of which so many make a frame at 60 Hz.

        Returns:
            The step [s], and the positions at the end of each frame [m], shape (F, V, 3).
        """
        pilot = Simulation(self.scene, solver=XPBD(substeps=count), threads=self.threads, cuts=None)
        pilot.start_from(start)
        places = []
        for pose, dt in frames:
            pilot.change_solver(XPBD(substeps=max(1, math.ceil(count * dt / FRAME - 1e-9))))
            pilot.step(pose, dt)
            places.append(pilot.positions)
        return FRAME / count, np.array(places)

    def _try_part(self, frames: list[Coming]) -> list[Taken]:
        """Take frames from here, again in shorter steps where they miss what is allowed; the good ones of those taken.

        Raises:
            Diverged: the first of them explodes.
        """
        start, time = self._taken(), self._time
        span, taken = sum(coming.dt for coming in frames), []
        for attempt in range(TRIES):
            part, taken = Part(self.snapshot(), []), []
            jumps, self._time = self.jumps, time
            try:
                for coming in frames:
                    if self._choice.explodes_at_half and self._time - time < span - TOUCHED_WINDOW + 1e-9:
                        part = Part(self.snapshot(), [])
                    self._take_steps(coming.dt)
                    super().step(*coming)
                    self._time += coming.dt
                    part.frames.append((coming, self.substeps))
                    taken.append(self._taken())
            except Diverged:
                if not taken:
                    raise
                break
            if self.jumps != jumps or not self._is_due:
                break
            error = self._compare(part)
            share = error.rms / self.allowed
            if share <= 1.0 or attempt == TRIES - 1 or not self._choice.shorten(share):
                self.errors.append(error)
                self._adjust(share)
                break
            self._go_to(start)
        self._rest -= sum(coming.dt for coming in frames[: len(taken)])
        return taken

    @property
    def _is_due(self) -> bool:
        """Whether it is time to compare a part, or the cloth has become much faster since one was."""
        return self._rest <= 0.0 or _speed(self.velocities) > FASTER * self._speed

    def _compare(self, part: Part) -> StepError:
        """The error that the run has gathered in a part that it has just ended, by half as many steps, or twice."""
        solver, growth = self.solver, self._choice.growth
        twice = self._choice.explodes_at_half or min(substeps for _, substeps in part.frames) < 2
        here, rms, self._speed = self.positions, math.inf, _speed(self.velocities)
        if self._twin is None:
            self._twin = Simulation(self.scene, solver=solver, threads=self.threads, cuts=None)
        else:
            self._twin.change_solver(solver)
        twin = self._twin
        twin.start_from(part.start)
        try:
            for (pose, dt), substeps in part.frames:
                twin.change_solver(replace(solver, substeps=2 * substeps if twice else substeps // 2))
                twin.step(pose, dt)
            rms = distance(twin.positions, here) / (1.0 - 1.0 / growth if twice else growth - 1.0)
        except Diverged:
            pass
        return StepError(self._time, rms, solver.name, part.frames[-1][1], part.seconds, math.log2(growth))

    def _taken(self) -> Taken:
        counts = (self.substeps, self.retried, self.refined, self.unconverged, self.jumps, self.renewed)
        return Taken(self._started.frame(), self.solver, counts)

    def _go_to(self, taken: Taken) -> None:
        """Be where a frame ended; steps stay as they were changed since."""
        self._started.go_back_to(taken.frame)
        self.substeps, self.retried, self.refined, self.unconverged, self.jumps, self.renewed = taken.counts

    def _choose(self, bones: Bones) -> None:
        """Choose for a cloth that hangs from bones at a pose."""
        tried = Simulation(self.scene, solver=SymplecticEuler(), threads=self.threads)
        tried.start(bones, settle=0.0)
        forecast = tried.forecast(FRAME)
        self._twin, self._open, self._spent, self.errors = None, None, [], []
        self._rest = self._time = self._speed = 0.0
        self._choice = choice = Choice(
            stable=FRAME / forecast.substeps,
            sagging=Sagging.of(chain_of(tried.assembly)),
            free=not is_touched(self.scene),
        )
        if self.asked.budget is None:
            choice.aim_at(START * self.tolerance)
        else:
            self._choose_in_time(tried, forecast.seconds)
        self.solver = choice.for_frame(FRAME)

    def _choose_in_time(self, tried: Simulation, slow: float) -> None:
        """Choose what fits into the budget, where a frame of Euler takes `slow` [s]."""
        assert self.asked.budget is not None
        room, choice = FILLED * self.asked.budget, self._choice
        if slow <= room:
            choice.refine(room / slow, FINEST_IN_TIME)
            return
        costs = []
        for count in (10, 40):
            tried.change_solver(XPBD(substeps=count))
            costs.append(tried.forecast(FRAME).seconds)
        each = max((costs[1] - costs[0]) / 30.0, 1e-9)
        choice.solver, choice.step = XPBD(), FRAME / max(1, int((room - costs[0]) / each + 10.0))

    def _take_steps(self, dt: float) -> None:
        """Use the solver that is chosen, and as many of its steps as a frame of `dt` [s] needs."""
        solver = self._choice.for_frame(dt)
        if solver != self.solver:
            self.change_solver(solver)

    def _adjust(self, share: float) -> None:
        """Take other steps where an error is that share of what is allowed, and decide when to look again."""
        if share > 1.0:
            self._choice.shorten(share)
        elif share < EASY:
            self._choice.lengthen(share)
        free = self._choice.free
        self._rest = REST_FREE if free and share <= 1.0 else REST_TOUCHED if share < FAR_BELOW else 0.0

    def _fit(self, seconds: float) -> None:
        """Adjust the steps to the wall time that frames have taken [s]."""
        assert self.asked.budget is not None
        self._spent.clear()
        share = seconds / (FILLED * self.asked.budget)
        if CLOSE < share < 1.0 / FILLED:
            return
        choice = self._choice
        if isinstance(choice.solver, XPBD):
            choice.step = min(choice.step * share, FRAME)
        elif share > 1.0 and choice.finer == 1.0:
            choice.solver, choice.step = XPBD(), choice.stable * DEARER * share
        else:
            choice.refine(1.0 / share, FINEST_IN_TIME)
        self._take_steps(FRAME)


def _speed(velocities: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.sum(velocities**2, axis=1))))
