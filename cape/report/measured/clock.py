"""How long a run takes: wall time, and beside it CPU time, which tells whether the run had the processor to itself."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple

LEAST_SHARE = 0.9  # of wall time on each thread's processor, below which something else was at work
ATTEMPTS = 2  # for each run that is asked for, until none is disturbed


@dataclass
class Clock:
    """Time spent within `running` blocks.

    Attributes:
        wall: wall time [s].
        cpu: CPU time of all threads of the process [s].
    """

    wall: float = 0.0
    cpu: float = 0.0

    @contextmanager
    def running(self) -> Iterator[None]:
        """Count what happens within, also where it ends in an error."""
        cpu, wall = time.process_time(), time.perf_counter()
        try:
            yield
        finally:
            self.wall += time.perf_counter() - wall
            self.cpu += time.process_time() - cpu

    def share(self, threads: int) -> float:
        """CPU time as a share of the wall time of so many threads; 1 where no time has passed."""
        return self.cpu / (self.wall * threads) if self.wall > 0.0 else 1.0


class Timing(NamedTuple):
    """The quickest of several runs of the same.

    Attributes:
        wall: its wall time [s].
        cpu: its CPU time [s].
        disturbed: whether its share of the processors was below `LEAST_SHARE`, and that of all others too.
        spent: CPU time of all runs [s], which does not depend on what else the machine does.
    """

    wall: float
    cpu: float
    disturbed: bool
    spent: float


def quickest(
    run: Callable[[], Clock], *, repeats: int, threads: int = 1, enough: Callable[[float], bool] = lambda spent: False
) -> Timing:
    """Take a run several times, and again where something else had the processor; the quickest that had it counts.

    Args:
        run: takes it once, and tells how long that took.
        repeats: runs that are to be undisturbed; at most `ATTEMPTS` times as many are taken.
        threads: that work on a run.
        enough: told after each run how much CPU time all have taken [s]; True ends them.
    """
    clocks: list[Clock] = []
    undisturbed: list[Clock] = []
    while not clocks or (len(undisturbed) < repeats and len(clocks) < ATTEMPTS * repeats):
        clocks.append(run())
        if clocks[-1].share(threads) >= LEAST_SHARE:
            undisturbed.append(clocks[-1])
        if enough(sum(clock.cpu for clock in clocks)):
            break
    best = min(undisturbed or clocks, key=lambda clock: clock.wall)
    return Timing(best.wall, best.cpu, not undisturbed, sum(clock.cpu for clock in clocks))
