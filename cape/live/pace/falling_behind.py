"""What to do where the simulation is slower than the clock: fewer substeps, then a solver that needs few, then time
stretches; and back again."""

from collections import deque
from dataclasses import dataclass

FULL = 0.95  # of a frame's time, from which on steps take too long
ROOM = 0.7  # of it, below which what would be given back has room
LOOKED_AT = 30  # frames
PATIENCE = 90  # frames for which there has to be room, at first
MOST_PATIENCE = 1800  # frames, the same after it was given back in vain
TRIAL = 1800  # frames with time to spare, after which what seems to have no room is tried; twice as many each time


@dataclass
class _Level:
    """How long a frame took where a level was left, and in the first frames of the next one [s]."""

    here: float
    after: float = 0.0


class FallingBehind:
    """Decides from the times of frames alone how much is to be given up: level 0 is nothing, each further one more.

    Attributes:
        level: that is in force.
    """

    def __init__(self, most: int) -> None:
        """Give up so many levels at most; beyond them the simulation is slower than the clock."""
        self.level, self.most = 0, most
        self._recent: deque[float] = deque(maxlen=LOOKED_AT)
        self._left: list[_Level] = []
        self._roomy, self._patience, self._since = 0, PATIENCE, 0
        self._idle, self._trial = 0, TRIAL
        self._returned = False  # whether what was given up has come back lately

    @property
    def mean(self) -> float:
        """How long frames took lately [s], 0 where there were too few."""
        return sum(self._recent) / LOOKED_AT if len(self._recent) == LOOKED_AT else 0.0

    def note(self, seconds: float, period: float) -> int:
        """Take how long a frame has taken, of the time that there is for it [s]; gives the level from now on."""
        self._recent.append(seconds)
        self._since += 1
        if len(self._recent) < LOOKED_AT:
            return self.level
        mean = self.mean
        if self._left and self._left[-1].after == 0.0:
            self._left[-1].after = mean
        if mean > FULL * period and self.level < self.most:
            if self._returned and self._since < PATIENCE:  # too soon
                self._patience, self._trial = min(2 * self._patience, MOST_PATIENCE), 2 * self._trial
            self._left.append(_Level(mean))
            return self._go_to(self.level + 1)
        self._roomy = self._roomy + 1 if self._has_room(mean, period) else 0
        # How long frames took when a level was left, others may have been the reason of.
        self._idle = self._idle + 1 if self._left and mean < ROOM * period else 0
        if self._left and (self._roomy >= self._patience or self._idle >= self._trial):
            self._left.pop()
            self._returned = True
            return self._go_to(self.level - 1)
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

    def _go_to(self, level: int) -> int:
        self.level, self._roomy, self._idle, self._since = level, 0, 0, 0
        self._recent.clear()
        return level
