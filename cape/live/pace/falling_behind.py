"""What to do where the simulation is slower than the clock: fewer substeps, then a solver that needs few, then time
stretches; and back again. What turns out to save nothing is not given up for nothing."""

from collections import deque
from dataclasses import dataclass

FULL = 0.95  # of a frame's time, from which on steps take too long
ROOM = 0.7  # of it, below which what would be given back has room
SAVED = 0.9  # of the least time that a frame took before, above which nothing was saved by what was given up
LOOKED_AT = 30  # frames
LATELY = 10  # the last of them, of which the least time is taken, before a level is left: others may compute just now
VAIN = 300  # frames after which what has saved nothing is tried again, at first; twice as many each time, until
MOST_VAIN = 18000  # frames
PATIENCE = 90  # frames for which there has to be room, at first
MOST_PATIENCE = 1800  # frames, the same after it was given back in vain
TRIAL = 1800  # frames with time to spare, after which what seems to have no room is tried; twice as many each time


@dataclass
class _Left:
    """A level that was left: how long a frame took there, and in the first frames of the next one, and the least that
    one took there lately [s]."""

    level: int
    here: float
    least: float
    after: float = 0.0


@dataclass
class _Vain:
    """A level that saved nothing: the least that a frame took there [s], the frame from which on it may be tried again,
    and how many frames it was to wait for that."""

    least: float
    until: int
    wait: int


class FallingBehind:
    """Decides from the times of frames alone how much is to be given up: level 0 is nothing, each further one more.

    Attributes:
        level: that is in force.
    """

    def __init__(self, levels: int) -> None:
        """Give up so many levels at most; beyond them the simulation is slower than the clock."""
        self.level, self._levels = 0, levels
        self._recent: deque[float] = deque(maxlen=LOOKED_AT)
        self._left: list[_Left] = []
        self._vain: dict[int, _Vain] = {}
        self._doubted: list[int] = []  # levels that have just been found to save nothing
        self._frames = 0
        self._roomy, self._patience, self._since = 0, PATIENCE, 0
        self._idle, self._trial = 0, TRIAL
        self._returned = False  # whether what was given up has come back lately

    @property
    def mean(self) -> float:
        """How long frames took lately [s], 0 where there were too few."""
        return sum(self._recent) / LOOKED_AT if len(self._recent) == LOOKED_AT else 0.0

    @property
    def saved_nothing(self) -> bool:
        """Whether the level that was in force last was left because it saved nothing."""
        return bool(self._doubted)

    @property
    def lowest(self) -> bool:
        """Whether there is nothing more to give up that would save time."""
        return self._next_after(self.level) is None

    def forget(self) -> None:
        """Take it that each level may save time, whatever was found."""
        self._vain.clear()
        self._doubted.clear()

    def note(self, seconds: float, period: float) -> int:
        """Take how long a frame has taken, of the time that there is for it [s]; gives the level from now on."""
        self._recent.append(seconds)
        self._since += 1
        self._frames += 1
        if len(self._recent) < LOOKED_AT:
            return self.level
        mean = self.mean
        if self._left and self._left[-1].after == 0.0:
            self._left[-1].after = mean
            if mean > FULL * period and min(self._recent) > SAVED * self._left[-1].least:
                return self._give_back()
        self._judge_again()
        further = self._next_after(self.level)
        if mean > FULL * period and further is not None:
            if self._returned and self._since < PATIENCE:  # too soon
                self._patience, self._trial = min(2 * self._patience, MOST_PATIENCE), 2 * self._trial
            self._left.append(_Left(self.level, mean, min(list(self._recent)[-LATELY:])))
            return self._go_to(further)
        self._roomy = self._roomy + 1 if self._has_room(mean, period) else 0
        # How long frames took when a level was left, others may have been the reason of.
        self._idle = self._idle + 1 if self._left and mean < ROOM * period else 0
        if self._left and (self._roomy >= self._patience or self._idle >= self._trial):
            self._returned = True
            return self._go_to(self._left.pop().level)
        if self._since > MOST_PATIENCE:
            self._returned, self._patience = False, PATIENCE
        if self._since > MOST_PATIENCE and self.level == 0:
            self._trial = TRIAL
        return self.level

    def _has_room(self, mean: float, period: float) -> bool:
        """Tell whether the level before would fit, by how much longer its frames took when it was left."""
        if not self._left:
            return False
        left = self._left[-1]
        return mean * left.here / left.after < ROOM * period

    def _give_back(self) -> int:
        """Leave a level that saves nothing: for a further one, if there is any, else for the one before."""
        vain = self._vain.get(self.level)
        wait = VAIN if vain is None else min(2 * vain.wait, MOST_VAIN)
        self._vain[self.level] = _Vain(min(self._recent), self._frames + wait, wait)
        self._doubted.append(self.level)
        further = self._next_after(self.level)
        if further is None:
            return self._go_to(self._left.pop().level)
        self._left[-1].after = 0.0
        return self._go_to(further)

    def _judge_again(self) -> None:
        """Once without what saved nothing, look whether it did not: others may have begun to compute meanwhile."""
        for level in self._doubted:
            vain = self._vain[level]
            if vain.wait == VAIN and vain.least < SAVED * min(self._recent):
                vain.until = self._frames
        self._doubted.clear()

    def _next_after(self, level: int) -> int | None:
        """The next level that may save time, None for none."""
        for each in range(level + 1, self._levels + 1):
            if each not in self._vain or self._frames >= self._vain[each].until:
                return each
        return None

    def _go_to(self, level: int) -> int:
        self.level, self._roomy, self._idle, self._since = level, 0, 0, 0
        self._recent.clear()
        return level
