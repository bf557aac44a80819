"""What is asked for, and which solver in how many steps suits it, as far as is known; from errors it learns more.

Symplectic Euler at its largest stable step is far more accurate than cloth needs, and on usual fabrics hardly slower
than XPBD; on stiff ones it needs so many steps that XPBD, with as many as the tolerance asks for, is faster by far; and
on the stiffest, small errors are TR-BDF2's. So the choice is by the number of their steps, which is the same on every
machine.
"""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from cape.run.sagging import Sagging
from cape.solvers import TRBDF2, XPBD, Solver, SymplecticEuler
from motions.errors import ValueRangeError

TOLERANCE = 1e-3  # m, where nothing is asked for
FRAME = 1.0 / 60.0  # s
DEARER = 2.2  # times as long as one of Euler takes a step of XPBD
WORTH = 2.0  # times as fast as Euler should XPBD be where its steps must be found out first, in free motion
FLAT = 1300  # steps of XPBD that take as long as a frame of TR-BDF2 in few steps, of cloth of 1e6 N/m
FEWEST = 8  # steps of XPBD in a frame at 60 Hz: with fewer, cloth is rubber
USUAL = 8  # steps of TR-BDF2
AIM = 0.8  # of the error that is allowed, which a change of the step aims at
EASY = 0.4  # of it, below which longer steps are tried
LEAST_CHANGE, MOST_CHANGE = 0.25, 1.5  # of the step at once: it becomes longer slowly, as a motion may begin gently
FINEST = 64.0  # times as short as stable steps of Euler, beyond which contact tells more than the step


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
        finer: times as short as stable ones are steps of Euler.
        stable: largest stable step of Euler [s].
        sagging: the errors of XPBD that are likely.
        free: whether nothing touches the cloth, so that its errors shrink with the step as theory tells.
    """

    def __init__(self, *, stable: float = FRAME, sagging: Sagging | None = None, free: bool = False) -> None:
        """Choose Euler's stable steps, until told otherwise."""
        self.solver: Solver = SymplecticEuler()
        self.step, self.finer, self.stable, self.free = FRAME / FEWEST, 1.0, stable, free
        self.sagging = sagging or Sagging(0.0, 1.0)
        self._implicit = 1.0

    def aim_at(self, error: float) -> None:
        """Choose what is likely to make an error [m]."""
        self.step = min(self.sagging.step(error), FRAME / FEWEST)
        self.decide()

    def decide(self) -> None:
        """Choose the fastest of the solvers at the steps that they need."""
        if self.stable * DEARER * (WORTH if self.free else 1.0) >= self.step:
            self.solver = self.euler()
        elif self.free and self.count(FRAME) > FLAT:
            self.solver = TRBDF2()
        else:
            self.solver = XPBD()

    def euler(self) -> Solver:
        """Euler at its steps."""
        usual = SymplecticEuler()
        return usual if self.finer == 1.0 else replace(usual, margin=usual.margin / self.finer)

    def count(self, dt: float) -> int:
        """Steps of XPBD in a frame of `dt` [s]."""
        return max(1, math.ceil(dt / self.step - 1e-9))

    def for_frame(self, dt: float) -> Solver:
        """The solver with its steps in a frame of `dt` [s]."""
        if isinstance(self.solver, XPBD):
            return replace(self.solver, substeps=self.count(dt))
        if isinstance(self.solver, TRBDF2):
            return replace(self.solver, substeps=max(1, math.ceil(self._implicit * USUAL * dt / FRAME - 1e-9)))
        return self.solver

    @property
    def explodes_at_half(self) -> bool:
        """Whether half as many steps would be unstable."""
        return isinstance(self.solver, SymplecticEuler) and self.finer < 2.0

    @property
    def growth(self) -> float:
        """How many times as large errors are in steps twice as long: as theory tells, or of XPBD its `Sagging`.

        Of whatever touches something twice as large: impacts leave no order above the first.
        """
        if not self.free:
            return 2.0
        if isinstance(self.solver, XPBD):
            return self.sagging.error(2.0 * self.step) / self.sagging.error(self.step)
        return 2.0**self.solver.order

    def shorten(self, share: float) -> bool:
        """Take shorter steps where an error is that share of what is allowed; tell whether there are any."""
        change = self._change(share)
        if isinstance(self.solver, SymplecticEuler):
            return self.refine(1.0 / change, FINEST)
        if isinstance(self.solver, TRBDF2):
            self._implicit /= change
            return True
        self.step *= change
        self.decide()
        return True

    def lengthen(self, share: float) -> None:
        """Take longer steps where an error is that small a share of what is allowed."""
        change = self._change(share)
        if isinstance(self.solver, SymplecticEuler):
            self.refine(1.0 / change, FINEST)
        elif isinstance(self.solver, TRBDF2):
            self._implicit = max(self._implicit / change, 1.0 / USUAL)
        else:
            self.step = min(self.step * change, FRAME / FEWEST)

    def refine(self, times: float, most: float) -> bool:
        """Make Euler's steps so many times as short, `most` times as short as stable ones; tell whether it did."""
        finer = min(max(times * self.finer, 1.0), most)
        if finer == self.finer:
            return False
        self.finer = finer
        self.solver = self.euler()
        return True

    def _change(self, share: float) -> float:
        """What the step is to be multiplied by where an error is that share of what is allowed."""
        wanted = AIM / max(share, 1e-9)
        if not self.free:
            change = wanted
        elif isinstance(self.solver, XPBD):
            change = self.sagging.step(wanted * self.sagging.error(self.step)) / self.step
        else:
            change = wanted ** (1.0 / self.solver.order)
        return min(max(change, LEAST_CHANGE), MOST_CHANGE)
