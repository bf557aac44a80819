"""Method and step from a tolerance, or from the time that a frame may take.

Solver and steps begin with what a hanging cloth tells (`choice`, `sagging`). Where the poses to come are known
(`AutoSimulation.expect`) and nothing touches the cloth, companions of the run tell the error of the whole (`course`).
Otherwise part after part of the motion is taken, and compared with the same part in fewer steps, unless errors so far
and what has shaken the cloth in it tell that it hardly misses what is allowed (`prediction`). Where poses are known,
that is done before a part's first frame is handed on, and a part that misses is taken again in shorter steps. In a loop
that tells one pose at a time it can only be done afterwards, for what follows; and before the first frame, as if the
bones moved on as they begin to.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from cape.assembly.chains import chain_of
from cape.results.take import StepError
from cape.run.auto.ahead import Ahead, Coming, is_as_long, onwards
from cape.run.auto.budget import Budget
from cape.run.auto.choice import AIM, AIM_IN_CONTACT, FRAME, MOST_CHANGE, TOLERANCE, Auto, Choice
from cape.run.auto.course import Course
from cape.run.auto.part import End, Part
from cape.run.auto.prediction import Prediction
from cape.run.auto.sagging import Sagging
from cape.run.simulation import DEFAULT_CUTS, Simulation
from cape.run.step_error import distance, is_touched, window_of
from cape.run.whereabouts import Diverged, Mark, Snapshot
from cape.scene.jumps import Cuts
from cape.scene.poses import Bones, Pose, read_pose, read_poses
from cape.scene.scene import Scene
from cape.solvers import XPBD, Solver, SymplecticEuler
from motions.border import checked_first
from motions.errors import ValueRangeError

TRIES = 6  # of a part, at most
OWN_SHARE = 0.5  # of what a comparison takes, that a part bears itself: the rest is for those that it tells of
COARSER = math.sqrt(2.0)  # times as long steps, at least, that tell of an error: smaller differences are mostly chance


@checked_first
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
            ValueRangeError: the number of threads is not positive, or the cloth may tear.
        """
        if scene.tearing is not None:
            raise ValueRangeError(
                "what has torn can't be taken back to try another solver, or other steps: name a solver"
            )
        super().__init__(scene, solver=XPBD(), threads=threads, cuts=cuts)
        self.asked = asked
        self.errors: list[StepError] = []
        self._clock = clock
        self._ahead = Ahead([])
        self._reset()

    def _reset(self, choice: Choice | None = None) -> None:
        """Begin with a choice, knowing nothing of errors."""
        self.errors = []
        self._choice, self._prediction = choice or Choice(), Prediction()
        self._budget = None if self.asked.budget is None else Budget(self.asked.budget)
        self._twin: Simulation | None = None
        self._course: Course | None = None
        self._open: Part | None = None
        self._rest = self._time = 0.0
        self._steps = ("", 0.0, 0.0)  # that were taken last: solver, length, and of the frame

    @property
    def _solvers(self) -> tuple[Solver, ...]:
        return SymplecticEuler(), XPBD()

    @property
    def tolerance(self) -> float:
        """Error that the time step may cause [m]."""
        return self.asked.tolerance or TOLERANCE

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
        told = read_poses(poses, self.bones)
        self._course = None
        self._ahead = Ahead([Coming(pose, float(dt)) for pose, dt in zip(told, durations, strict=True)])

    def move(self, position: ArrayLike, rotation_wxyz: ArrayLike = (1.0, 0.0, 0.0, 0.0)) -> None:
        """Move the cloth as `Simulation.move` does; poses that were expected are forgotten."""
        super().move(position, rotation_wxyz)
        self._forget()

    def go_back(self, mark: Mark) -> None:
        """Be where it was as `Simulation.go_back` is; poses that were expected are forgotten."""
        super().go_back(mark)
        self._forget()

    def _forget(self) -> None:
        """Know nothing of what comes next, and compare no part that has begun."""
        self._ahead, self._course, self._open, self._rest = Ahead([]), None, None, 0.0

    def step(self, bones: Bones, dt: float, *, jumped: bool = False) -> None:
        """Advance the cloth as `Simulation.step` does, and look now and then whether the steps suit."""
        if self._cloth is None:
            self.start(bones)
        if jumped:
            self._forget()
            self._take_steps(dt)
            super().step(bones, dt, jumped=True)
            self._time += dt
            return
        if self._budget is not None:
            self._take_steps(dt)
            begun = self._clock()
            super().step(bones, dt)
            self._budget.spend(self._choice, self._clock() - begun)
            self._take_steps(dt)
            return
        if self._ahead.is_next(bones, self.bones, dt):
            self._step_ahead(self._ahead.next)
            return
        self._ahead, self._course = Ahead([]), None
        pose = read_pose(bones, self.bones).without_world()
        if self._time == 0.0 and 0.0 < dt < math.inf:
            self._rehearse(pose, dt)
        self._step_and_look(Coming(pose, dt))

    def _step_ahead(self, coming: Coming) -> None:
        """Take the frame that was to come, or hand it on where it has been taken."""
        if not self._ahead.taken and self._course is None and self._rest < 1e-9:
            self._look_ahead()
        if self._ahead.taken:
            super().go_back(self._ahead.hand_on())
            return
        self._take(coming)
        self._ahead.pass_on()
        if self._course is not None:
            self._course.note(self)
            if self._course.due:
                self._course.adjust()
                self._tell_course(self._course)
            if self._course.taken == len(self._course.frames):
                self._course = None

    def _look_ahead(self) -> None:
        """Take what comes next as far as it must be known before it is handed on."""
        free, start = self._choice.free, self.mark()
        frames = self._until_jump(self._ahead.part(math.inf if free else window_of(self.scene)))
        if not frames:
            self._rest = self._ahead.part(0.0)[0].dt
        elif free:
            self._ahead.taken.extend(self._begin_course(frames))
        else:
            self._plan()
            self._ahead.taken.extend(self._try_part(frames))
        super().go_back(start)

    def _until_jump(self, frames: list[Coming]) -> list[Coming]:
        """Those of the frames to come that are before the bones jump."""
        cuts, cloth = self.cuts, self._started
        if cuts is None:
            return frames
        here = Pose(*cloth.pose).moved(cloth.origin).without_world()
        poses = [here, *(coming.pose for coming in frames)]
        steps = np.array([coming.dt for coming in frames])
        positions, rotations = (np.stack(each) for each in zip(*poses, strict=True))
        jumps = np.flatnonzero(cuts.among(positions, rotations, steps, cloth.holding))
        return frames[: jumps[0]] if jumps.size else frames

    def _take(self, coming: Coming) -> None:
        """Take a frame in the steps that are chosen."""
        self._take_steps(coming.dt)
        super().step(*coming)
        self._time += coming.dt
        self._rest -= coming.dt

    def _step_and_look(self, coming: Coming) -> None:
        """Take a frame of which none is known beforehand; at the end of a part, learn for what is to come."""
        if self._open is None:
            self._plan()
            self._open = Part(self.mark())
        jumps = self.jumps
        self._take(coming)
        if self.jumps != jumps:
            self._open = None
            return
        self._open.note(coming, self.substeps, self._started.state[3:])
        if self._open.seconds > window_of(self.scene) - 1e-9:
            if self._is_sure(self._open):
                self._prediction.pass_over(self._open.jolt)
            else:
                self._learn(self._compare(self._open, []), self._open)
            self._open = None

    def _rehearse(self, pose: Pose, dt: float) -> None:
        """Find out which steps suit if the bones move on as they begin to, before the first frame is handed on."""
        cloth = self._started
        here = Pose(*cloth.pose).moved(cloth.origin).without_world()
        frames = [Coming(each, dt) for each in onwards(here, pose, math.ceil(window_of(self.scene) / dt - 1e-9))]
        start = self.mark()
        self._plan()
        self._try_part(frames)
        super().go_back(start)
        self._time = self._rest = 0.0
        self.errors.clear()

    def _begin_course(self, frames: list[Coming]) -> list[Mark]:
        """Take the first part of a free motion that is known, again in shorter steps where the whole would miss.

        Raises:
            Diverged: the first frame explodes.
        """
        start, time, taken = self.mark(), self._time, []
        course = Course(self.snapshot(), frames, self._choice, allowed=self.tolerance, twin=self._twin_of(self.solver))
        for attempt in range(TRIES):
            super().go_back(start)
            self._time, taken = time, []
            try:
                for coming in frames[: course.first]:
                    self._take(coming)
                    course.note(self)
                    taken.append(self.mark())
                    if course.due:
                        break
            except Diverged:
                if not taken:
                    raise
                return taken
            if not course.adjust() or attempt == TRIES - 1:
                break
            course.begin()
        self._tell_course(course)
        self._course = course if course.taken < len(frames) else None
        return taken

    def _tell_course(self, course: Course) -> None:
        """Tell the error of the course as it is known now, instead of what was known before."""
        if self._course is course:
            self.errors.pop()
        span = sum(coming.dt for coming in course.frames)
        self.errors.append(StepError(self._time, course.error, self.solver.name, self.substeps, span))

    def _plan(self) -> None:
        """Choose steps for the next part, which is likely to be shaken as the last one was.

        They are so short that it will hardly miss what is allowed, where that takes less time than to compare it.
        """
        choice, known, solver = self._choice, self._prediction, self._choice.solver.name
        if not known.empty:
            wanted = choice.length_of(AIM_IN_CONTACT * self.tolerance / known.likely)
            choice.take(min(wanted, MOST_CHANGE * choice.length))
            sure = choice.length_of(self.tolerance / (known.rise * known.bound()))
            if (
                choice.within(sure) <= sure
                and choice.cost(choice.within(sure), self.scene.cloth.vertices) <= self._cost_compared()
            ):
                choice.take(sure)
                if choice.solver.name == solver:
                    return
        if choice.solver.name != solver:
            self._prediction = Prediction()  # the errors of the one tell nothing of those of the other
        if choice.explodes_at_double:
            choice.take(min(choice.length, 1.0 / COARSER))

    def _cost_compared(self) -> float:
        """What a frame takes together with the one that it is compared with, of which a share is for what follows."""
        choice, vertices = self._choice, self.scene.cloth.vertices
        own, other = choice.length, 2.0 * choice.length
        if choice.explodes_at_double:
            own, other = min(own, 1.0 / COARSER), 1.0
        return choice.cost(own, vertices) + OWN_SHARE * choice.cost(other, vertices)

    def _is_sure(self, part: Part) -> bool:
        """Tell whether a part hardly misses what is allowed, by what is known of others."""
        choice, known = self._choice, self._prediction
        return not known.empty and known.bound(part.jolt) * choice.size(choice.length) <= self.tolerance

    def _try_part(self, frames: list[Coming]) -> list[Mark]:
        """Take frames from here, again in shorter steps where they miss what is allowed; the good ones of those taken.

        Raises:
            Diverged: the first of them explodes.
        """
        choice, start, time, taken = self._choice, self.mark(), self._time, []
        ends: list[End] = []
        for attempt in range(TRIES):
            part, taken, jumps = Part(start), [], self.jumps
            self._time = time
            try:
                for coming in frames:
                    self._take(coming)
                    part.note(coming, self.substeps, self._started.state[3:])
                    taken.append(self.mark())
            except Diverged:
                if not taken:
                    raise
                break
            if self.jumps != jumps:
                break
            if not ends and self._is_sure(part):
                self._prediction.pass_over(part.jolt)
                break
            end = End(choice.solver.name, choice.length, self.positions)
            if not ends and choice.explodes_at_double and choice.length * COARSER > 1.0 + 1e-9:
                choice.take(0.5 * choice.length)
            else:
                error = self._compare(part, ends)
                fits = error.rms <= self.tolerance or attempt == TRIES - 1
                if fits or not choice.scale(AIM_IN_CONTACT * self.tolerance / error.rms):
                    self._learn(error, part)
                    break
            ends.append(end)
            super().go_back(start)
        self._rest = 0.0
        return taken

    def _learn(self, error: StepError, part: Part) -> None:
        """Keep the error of a part that was compared, for what follows."""
        self.errors.append(error)
        if math.isfinite(error.rms):
            self._prediction.note(error.rms / self._choice.size(self._choice.length), part.jolt)
        else:
            self._prediction.pass_over(part.jolt)

    def _compare(self, part: Part, ends: list[End]) -> StepError:
        """The error that the run has gathered in a part that it has just ended, by where it has ended in other steps.

        Where none of these `ends` tells of it, it is taken in fewer steps, or in more where fewer would be unstable,
        and that is added to them. Two of them tell whether what is left shrinks as it should with the step; if not, the
        error is larger by as much.
        """
        solver, choice, rms = self.solver, self._choice, math.inf
        if not ends or ends[-1].solver != solver.name or ends[-1].length < (1.0 - 1e-9) * COARSER * choice.length:
            ends[:] = [self._other_end(part)]
        *before, other = ends
        size, own = choice.size(other.length), choice.size(choice.length)
        if np.isfinite(other.positions[0, 0]):
            apart = distance(other.positions, self.positions)
            rms = apart / abs(size / own - 1.0)
            if before and before[-1].solver == solver.name and np.isfinite(before[-1].positions[0, 0]):
                likely = distance(before[-1].positions, other.positions) / (choice.size(before[-1].length) - size)
                rms *= max(1.0, apart / (size - own) / max(likely, 1e-12))
        order = math.log(size / own) / math.log(other.length / choice.length)
        return StepError(self._time, rms, solver.name, part.frames[-1][1], part.seconds, order)

    def _other_end(self, part: Part) -> End:
        """Where a part of the run ends in other steps, positions not finite where it explodes in them."""
        solver, length = self.solver, self._choice.length
        times = 2.0 if part.fewest >= 2 else 0.5
        if isinstance(solver, SymplecticEuler):
            times = min(times, 1.0 / length) if length * COARSER < 1.0 + 1e-9 else 0.5
        twin = self._twin_of(solver)
        twin.go_back(part.start)
        try:
            for (pose, dt), substeps in part.frames:
                twin.change_solver(replace(solver, substeps=max(1, round(substeps / times))))
                twin.step(pose, dt)
            end = twin.positions
        except Diverged:
            end = np.full_like(self.positions, np.nan)
        return End(solver.name, times * length, end)

    def _twin_of(self, solver: Solver) -> Simulation:
        """A simulation of the scene that takes parts of the motion again, with a solver; the same one every time."""
        if self._twin is None:
            self._twin = Simulation(self.scene, solver=solver, threads=self.threads, cuts=None)
        else:
            self._twin.change_solver(solver)
        return self._twin

    def _choose(self, bones: Bones) -> None:
        """Choose for a cloth that hangs from bones at a pose."""
        tried = Simulation(self.scene, solver=SymplecticEuler(), threads=self.threads, cuts=None)
        tried.start(bones, settle=0.0)
        forecast = tried.forecast(FRAME)
        choice = Choice(
            stable=FRAME / forecast.substeps,
            sagging=Sagging.of(chain_of(tried.assembly)),
            free=not is_touched(self.scene),
        )
        self._reset(choice)
        self._twin = tried
        if self._budget is None:
            choice.aim_at(AIM * self.tolerance)
        else:
            self._budget.choose(choice, tried, forecast.seconds)
        self.solver = choice.for_frame(FRAME)

    def _take_steps(self, dt: float) -> None:
        """Use the solver that is chosen, and as many of its steps as a frame of `dt` [s] needs."""
        *steps, before = self._steps
        if [self._choice.solver.name, self._choice.length] != steps or not is_as_long(dt, before):
            self._steps = self._choice.solver.name, self._choice.length, dt
            self.change_solver(self._choice.for_frame(dt))
