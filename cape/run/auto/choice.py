"""What is asked for, and which solver in how many steps suits it, as far as is known; from errors it learns more.

Symplectic Euler at its largest stable step is far more accurate than cloth needs, and on usual fabrics hardly slower
than XPBD; on stiff ones it needs so many steps that XPBD, with as many as the tolerance asks for, is faster by far; and
on the stiffest, small errors are TR-BDF2's. So the choice is by the number of their steps, which is the same on every
machine.
"""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from cape.run.auto.sagging import USUAL_SPEED, USUAL_TIME, Sagging
from cape.solvers import TRBDF2, XPBD, Solver, SymplecticEuler
from motions.border import checked
from motions.errors import ValueRangeError

TOLERANCE = 1e-3  # m, where nothing is asked for
FRAME = 1.0 / 60.0  # s
# What steps cost beside each other, as `python -m tests.bench.accuracy.costs` measures it.
DEARER = 2.2  # times as long as one of Euler takes a step of XPBD,
IMPLICIT = 330  # and steps of XPBD that take as long as a frame of TR-BDF2 in `USUAL` steps, both of cloth of 1e6 N/m
FEWEST = 8  # steps of XPBD in a frame at 60 Hz: with fewer, cloth is rubber
USUAL = 8  # steps of TR-BDF2
FRAME_COST = 9000  # vertices that a step of XPBD moves on in the time that the rest of a frame takes
AIM = 0.8  # of the error that is allowed, which steps aim at in free motion,
AIM_IN_CONTACT = 0.65  # and in contact, where it scatters by a half: see `python -m tests.bench.accuracy.parts`
LEAST_CHANGE, MOST_CHANGE = 0.25, 2.0  # of the step at once: theory of small errors holds no farther
FINEST = 64.0  # times as short as stable steps of Euler, beyond which contact tells more than the step


@checked
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


class Choice:
    """A solver and its steps.

    Attributes:
        solver: the one that is chosen.
        step: of XPBD [s].
        finer: times as short as stable ones are steps of Euler, and
        shorter: times as short as `USUAL` ones those of TR-BDF2.
        stable: largest stable step of Euler [s].
        sagging: the errors of XPBD that are likely.
        free: whether nothing touches the cloth, so that its errors shrink with the step as theory tells.
    """

    def __init__(self, *, stable: float = FRAME, sagging: Sagging | None = None, free: bool = False) -> None:
        """Choose Euler's stable steps, until told otherwise."""
        self.solver: Solver = SymplecticEuler()
        self.step, self.finer, self.shorter = FRAME / FEWEST, 1.0, 1.0
        self.stable, self.free = stable, free
        self.sagging = sagging or Sagging(0.0, 1.0)

    def aim_at(self, error: float, *, speed: float = USUAL_SPEED, seconds: float = USUAL_TIME) -> None:
        """Choose what is likely to make an error [m], of a cloth that is moved at some speed [m/s] for so long."""
        self.step = min(self.sagging.at(speed, seconds).step(error), FRAME / FEWEST)
        self.decide()

    def decide(self) -> None:
        """Choose the fastest of the solvers at the steps that they need."""
        if self.stable * DEARER >= self.step:
            self.solver = self.euler()
        elif self.free and self.count(FRAME) > IMPLICIT:
            self.solver = TRBDF2()
        else:
            self.solver = XPBD()

    def euler(self, times: float = 1.0) -> Solver:
        """Euler at its steps, or at some that are so many times as long."""
        usual = SymplecticEuler()
        return usual if self.finer == times else replace(usual, margin=usual.margin * times / self.finer)

    def count(self, dt: float) -> int:
        """Steps of XPBD in a frame of `dt` [s]."""
        return max(1, math.ceil(dt / self.step - 1e-9))

    def for_frame(self, dt: float, *, times: float = 1.0) -> Solver:
        """The solver with its steps in a frame of `dt` [s], or with steps so many times as long."""
        if isinstance(self.solver, XPBD):
            return replace(self.solver, substeps=max(1, math.ceil(dt / (self.step * times) - 1e-9)))
        if isinstance(self.solver, TRBDF2):
            count = self.shorter * USUAL * dt / FRAME / times
            return replace(self.solver, substeps=max(1, math.ceil(count - 1e-9)))
        return self.euler(times)

    def cost(self, length: float, vertices: int) -> float:
        """What a frame at 60 Hz takes in steps of a length, of a cloth of so many vertices, in steps of the solver."""
        rest = FRAME_COST / vertices
        if isinstance(self.solver, XPBD):
            return FRAME / length + rest
        if isinstance(self.solver, TRBDF2):
            return USUAL / length + USUAL / IMPLICIT * rest
        return FRAME / self.stable / length + DEARER * rest

    @property
    def length(self) -> float:
        """Length of the solver's steps, in units of its own."""
        if isinstance(self.solver, XPBD):
            return self.step
        return 1.0 / (self.shorter if isinstance(self.solver, TRBDF2) else self.finer)

    @property
    def explodes_at_double(self) -> bool:
        """Whether steps twice as long would be unstable."""
        return isinstance(self.solver, SymplecticEuler) and self.finer < 2.0

    def size(self, length: float) -> float:
        """What errors are proportional to in steps of a length: as theory tells, or of XPBD its `Sagging`.

        Of whatever touches something the length itself: impacts leave no order above the first.
        """
        if not self.free:
            return length
        return self.sagging.error(length) if isinstance(self.solver, XPBD) else length**self.solver.order

    def length_of(self, size: float) -> float:
        """The length of steps in which errors have that size."""
        if not self.free:
            return size
        return self.sagging.step(size) if isinstance(self.solver, XPBD) else size ** (1.0 / self.solver.order)

    def within(self, length: float) -> float:
        """The length that is closest to one, of those that the solver's steps may have."""
        if isinstance(self.solver, XPBD):
            return min(length, FRAME / FEWEST)
        if isinstance(self.solver, TRBDF2):
            return min(length, USUAL)
        return min(max(length, 1.0 / FINEST), 1.0)

    def take(self, length: float) -> bool:
        """Take steps of a length, or the closest to it; tell whether they are others than before."""
        before, length = (self.solver, self.length), self.within(length)
        if isinstance(self.solver, XPBD):
            shorter, self.step = length < self.step, length
            if shorter:
                self.decide()
        elif isinstance(self.solver, TRBDF2):
            self.shorter = 1.0 / length
        else:
            self.refine(1.0 / length / self.finer, FINEST)
        return (self.solver, self.length) != before

    def scale(self, share: float) -> bool:
        """Take steps whose errors are so many times as large; tell whether they are others than before."""
        change = self.length_of(share * self.size(self.length)) / self.length
        return self.take(self.length * min(max(change, LEAST_CHANGE), MOST_CHANGE))

    def refine(self, times: float, most: float) -> bool:
        """Make Euler's steps so many times as short, `most` times as short as stable ones; tell whether it did."""
        finer = min(max(times * self.finer, 1.0), most)
        if finer == self.finer:
            return False
        self.finer = finer
        self.solver = self.euler()
        return True
