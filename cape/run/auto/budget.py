"""Solver and steps from the wall time that a frame may take."""

from cape.run.auto.choice import DEARER, FRAME, Choice
from cape.run.simulation import Simulation
from cape.solvers import XPBD

FILLED = 0.8  # of the budget, that is planned for
CLOSE = 0.8  # of what is planned, above which steps stay as they are
FINEST = 8.0  # times as short as stable steps of Euler
ADJUSTED = 30  # frames after which the number of steps is adjusted


class Budget:
    """Fits steps to a time."""

    def __init__(self, seconds: float) -> None:
        """Plan for frames that take so long [s]."""
        self._room = FILLED * seconds
        self._spent: list[float] = []

    def choose(self, choice: Choice, tried: Simulation, slow: float) -> None:
        """Choose what fits, where a frame of Euler takes `slow` [s], by trying XPBD on a simulation."""
        if slow <= self._room:
            choice.refine(self._room / slow, FINEST)
            return
        costs = []
        for count in (10, 40):
            tried.change_solver(XPBD(substeps=count))
            costs.append(tried.forecast(FRAME).seconds)
        each = max((costs[1] - costs[0]) / 30.0, 1e-9)
        choice.solver, choice.step = XPBD(), FRAME / max(1, int((self._room - costs[0]) / each + 10.0))

    def spend(self, choice: Choice, seconds: float) -> None:
        """Note the time that a frame took [s]; adjust the steps now and then."""
        self._spent.append(seconds)
        if len(self._spent) < ADJUSTED:
            return
        share = sum(self._spent) / len(self._spent) / self._room
        self._spent.clear()
        if CLOSE < share < 1.0 / FILLED:
            return
        if isinstance(choice.solver, XPBD):
            choice.step = min(choice.step * share, FRAME)
        elif share > 1.0 and choice.finer == 1.0:
            choice.solver, choice.step = XPBD(), choice.stable * DEARER * share
        else:
            choice.refine(1.0 / share, FINEST)
