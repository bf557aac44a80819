"""Steps in time with the clock: when the next one is due, how late each begins, and how fast the simulation runs."""

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

SHOWN = 60  # steps over which means are taken
SETTLED = 0.0015  # [s] by which a sleep may end late; what is left is waited for in shorter ones


class Step(NamedTuple):
    """How a step went: how late it began, and how long it took [s]."""

    late: float
    took: float


class Pacer:
    """Tells a loop when to take its next step.

    A step that takes longer than there is time for puts off all that follow: the simulation is then slower than the
    clock, and does not hurry to catch up, which would make it late for ever.

    Attributes:
        period: time between steps [s].
        steps: that were taken.
        lost: by how much the clock is ahead of the steps in all [s].
    """

    def __init__(
        self,
        period: float,
        *,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Nothing is due before `begin`; `clock` tells the time [s], `sleep` waits for a time [s]."""
        self._clock, self._sleep = clock, sleep
        self.period = period
        self.steps, self.lost = 0, 0.0
        self._due = self._begun = 0.0
        self._late = 0.0
        self._recent: deque[Step] = deque(maxlen=SHOWN)

    def begin(self) -> None:
        """Have the next step be due now."""
        self._due = self._clock()

    def wait(self, over: threading.Event) -> bool:
        """Wait until the next step is due; False if `over` is set before."""
        while (left := self._due - self._clock()) > 0.0:
            if over.is_set():
                return False
            self._sleep(left if left < 2.0 * SETTLED else min(left - SETTLED, 0.05))
        self._begun = self._clock()
        self._late = self._begun - self._due
        return not over.is_set()

    def done(self) -> Step:
        """Count the step that was waited for, and tell how it went."""
        now = self._clock()
        step = Step(self._late, now - self._begun)
        self._recent.append(step)
        self.steps += 1
        self._due += self.period
        if now > self._due:
            self.lost += now - self._due
            self._due = now
        return step

    @property
    def mean_took(self) -> float:
        """Mean time of the last steps [s]."""
        return sum(step.took for step in self._recent) / max(len(self._recent), 1)

    @property
    def mean_late(self) -> float:
        """How late they began on average [s]."""
        return sum(step.late for step in self._recent) / max(len(self._recent), 1)

    @property
    def rate(self) -> float:
        """How many steps there were for each that was due, lately."""
        if not self._recent:
            return 1.0
        return min(1.0, len(self._recent) * self.period / sum(max(s.took + s.late, self.period) for s in self._recent))
