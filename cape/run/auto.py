"""Method and step from a tolerance, or from the time that a frame may take.

Symplectic Euler at its largest stable step is far more accurate than cloth needs, and on usual fabrics hardly slower
than XPBD; on stiff ones it needs so many steps that XPBD, with as many as the tolerance asks for, is faster by far. So
the choice is between the two, by the number of their steps. The number of XPBD's begins with what a hanging cloth tells
(`hanging_step`) and follows the errors that a `Watch` measures on parts of the run.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from cape.assembly.chains import Chain, chain_of
from cape.run.simulation import DEFAULT_CUTS, Simulation, Snapshot
from cape.run.step_error import FREE_WINDOW, TOUCHED_WINDOW, StepError, Watch, window_of
from cape.scene.jumps import Cuts
from cape.scene.poses import Bones
from cape.scene.scene import Scene
from cape.solvers import XPBD, Solver, SymplecticEuler
from motions.errors import ValueRangeError

TOLERANCE = 1e-3  # m, where nothing is asked for
FRAME = 1.0 / 60.0  # s
DEARER = 2.2  # times as long as one of Euler takes a step of XPBD
SAG, LAG = 0.3, 5.7  # share, and m/s: errors of XPBD on a hanging cloth (`hanging_step`)
FEWEST = 8  # steps of XPBD in a frame at 60 Hz: with fewer, cloth is rubber
GATHERED = {"xpbd": 0.8, "euler": 0.2}  # of the tolerance, for a part of a free motion: a whole run gathers more
START = 1.2  # times the tolerance, that a first guess aims at
AIM = 0.8  # of the error that is allowed, which a change of the step aims at
EASY, HARD = 0.25, 1.25  # of it, below which longer steps are tried, and above which shorter ones
LEAST_CHANGE, MOST_CHANGE = 0.25, 1.5  # of the step at once: it becomes longer slowly, as a motion may begin gently
REST = {"xpbd": 2.0, "euler": 3.0}  # s between two parts that are watched, while errors are small,
SHORT_REST = 0.75  # of it, while they are more than
PRESSING, FAR = 0.5, 2.0  # of what is allowed; none beyond
FILLED = 0.8  # of the budget, that is planned for
CLOSE = 0.8  # of what is planned, above which steps stay as they are
FINEST = 8.0  # times as short as stable steps of Euler, beyond which contact tells more than the step
ADJUSTED = 30  # frames after which the number of steps is adjusted to the budget


@dataclass(frozen=True, kw_only=True)
class Auto:
    """Ask for an error or for a time instead of a solver and its steps; one of them.

    Attributes:
        tolerance: root mean square error that the time step may cause [m]: of the whole motion, where cloth swings
            freely; of a tenth of a second where it touches something or flutters, and no step keeps runs together for
            longer. None for 1 mm, or for what the budget allows.
        budget: wall time that a frame may take [s], for the most accurate run that fits; it depends on the machine.
    """

    name: ClassVar[str] = "auto"
    tolerance: float | None = None
    budget: float | None = None

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            ValueRangeError: one is not positive, or both are given.
        """
        for name, value in (("tolerance", self.tolerance), ("budget", self.budget)):
            if value is not None and not 0.0 < value < math.inf:
                raise ValueRangeError(f"the {name} must be positive and finite, not {value}")
        if self.tolerance is not None and self.budget is not None:
            raise ValueRangeError("give a tolerance or a budget: the one decides what becomes of the other")


class AutoSimulation(Simulation):
    """A simulation that chooses its solver and steps, and changes them as the motion needs.

    Attributes:
        asked: what it chooses for.
        errors: the errors of the time step that it has measured, none in a run within a budget.
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
        self._watch: Watch | None = None
        self._step = FRAME / FEWEST  # of XPBD [s]
        self._finer = 1.0  # times as short as stable ones are Euler's steps
        self._stable = FRAME  # largest stable step of Euler [s]
        self._rest = 0.0
        self._clock = clock
        self._spent: list[float] = []

    @property
    def errors(self) -> list[StepError]:
        """The errors of the time step that have been measured."""
        return [] if self._watch is None else self._watch.errors

    @property
    def _solvers(self) -> tuple[Solver, ...]:
        return SymplecticEuler(), XPBD()

    @property
    def allowed(self) -> float:
        """Error that a part of the motion may have [m]."""
        free = window_of(self.scene) == FREE_WINDOW
        return (self.asked.tolerance or TOLERANCE) * (GATHERED[self.solver.name] if free else 1.0)

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
        self._begin_to_watch()

    def start_from(self, snapshot: Snapshot) -> None:
        """Choose solver and steps, then start as `Simulation.start_from` does."""
        self._choose(snapshot.first_pose.without_world())
        self._cloth = None
        super().start_from(snapshot)
        self._begin_to_watch()

    def step(self, bones: Bones, dt: float) -> None:
        """Advance the cloth as `Simulation.step` does, and look now and then whether the steps suit."""
        if self._cloth is None:
            self.start(bones)
        self._take_steps(dt)
        begun = self._clock()
        if self._watch is not None and not self._watch.watching and self._rest <= 0.0:
            # Euler's errors are small, and twice its steps are dear.
            self._watch.begin(TOUCHED_WINDOW if isinstance(self.solver, SymplecticEuler) else None)
        super().step(bones, dt)
        if self._watch is None:
            self._spent.append(self._clock() - begun)
            if len(self._spent) >= ADJUSTED:
                self._fit(float(np.mean(self._spent)))
            return
        self._rest -= dt
        self._watch.note(bones, dt)
        if self._watch.full:
            self._judge(self._watch.end())

    def _choose(self, bones: Bones) -> None:
        """Choose for a cloth that hangs from bones at a pose."""
        euler = SymplecticEuler()
        tried = Simulation(self.scene, solver=euler, threads=self.threads)
        tried.start(bones, settle=0.0)
        self._watch, self._rest, self._finer, self._spent = None, 0.0, 1.0, []
        self._stable = FRAME / tried.forecast(FRAME).substeps
        if self.asked.budget is None:
            wanted = START * (self.asked.tolerance or TOLERANCE)
            self._step = min(hanging_step(chain_of(tried.assembly), wanted), FRAME / FEWEST)
            self.solver = euler if self._euler_is_faster else XPBD(substeps=self._count(FRAME))
            return
        room = FILLED * self.asked.budget
        slow = tried.forecast(FRAME).seconds
        if slow <= room:
            self._finer = min(room / slow, FINEST)
            self.solver = self._finer_euler()
            return
        costs = []
        for count in (10, 40):
            tried.change_solver(XPBD(substeps=count))
            costs.append(tried.forecast(FRAME).seconds)
        each = max((costs[1] - costs[0]) / 30.0, 1e-9)
        self._step = FRAME / max(1, int((room - costs[0]) / each + 10.0))
        self.solver = XPBD(substeps=self._count(FRAME))

    def _begin_to_watch(self) -> None:
        if self.asked.budget is None:
            self._watch = Watch(self)

    @property
    def _euler_is_faster(self) -> bool:
        return self._stable * DEARER >= self._step

    def _finer_euler(self) -> Solver:
        usual = SymplecticEuler()
        return usual if self._finer == 1.0 else replace(usual, margin=usual.margin / self._finer)

    def _make_finer(self, times: float) -> None:
        """Make Euler's steps so many times as short, as far as that makes sense."""
        finer = min(max(times * self._finer, 1.0), FINEST)
        if finer != self._finer:
            self._finer = finer
            self.change_solver(self._finer_euler())

    def _take_steps(self, dt: float) -> None:
        """Set the number of steps in a frame of `dt` [s]."""
        if isinstance(self.solver, XPBD):
            count = self._count(dt)
            if count != self.solver.substeps:
                self.change_solver(replace(self.solver, substeps=count))

    def _count(self, dt: float) -> int:
        """Steps of XPBD in a frame of `dt` [s]."""
        return max(1, math.ceil(dt / self._step - 1e-9))

    def _judge(self, error: StepError) -> None:
        """Change the step where the error tells so, and decide when to look again."""
        share = error.rms / self.allowed
        change = min(max((AIM / max(share, 1e-9)) ** (1.0 / self.solver.order), LEAST_CHANGE), MOST_CHANGE)
        if share > HARD or share < EASY:
            if isinstance(self.solver, XPBD):
                self._step = min(self._step * change, FRAME / FEWEST)
                if self._euler_is_faster:
                    self.change_solver(SymplecticEuler())
            else:
                self._make_finer(1.0 / change)
        if share <= FAR:
            self._rest = REST[self.solver.name] * (SHORT_REST if share > PRESSING else 1.0)

    def _fit(self, seconds: float) -> None:
        """Adjust the steps to the wall time that frames have taken [s]."""
        assert self.asked.budget is not None
        self._spent.clear()
        share = seconds / (FILLED * self.asked.budget)
        if CLOSE < share < 1.0 / FILLED:
            return
        if isinstance(self.solver, XPBD):
            self._step = min(self._step * share, FRAME)
        elif share > 1.0 and self._finer == 1.0:
            self._step = self._stable * DEARER * share
            self.change_solver(XPBD())
        else:
            self._make_finer(1.0 / share)


def hanging_step(chain: Chain, error: float) -> float:
    """The step [s] of XPBD at which hanging cloth is likely to have an error [m], root mean square over its vertices.

    On the scenes `swing` and `stiff` errors are `SAG` of the chain's sag, and `LAG` times the step.
    """
    sag = SAG * chain.sag
    return 2.0 * error / (LAG + math.sqrt(LAG**2 + 4.0 * sag * error))
