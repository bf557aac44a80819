"""The error of XPBD as a function of its step: a sag, and a lag.

Cloth hangs down too far by what a sweep over its threads leaves, which grows as the square of the step, and it follows
too late, by a distance that grows as the step, and with the time that it has swung: e = sag h^2 + lag h.
"""

import math
from typing import NamedTuple

from cape.assembly.chains import Chain

# Share, and m/s in a second: errors of whole runs of hanging cloth. They lag by 0.92 in a second on sheets that swing
# for 0.6 to 10 s, as `python -m tests.bench.accuracy.lags` measures it, and by some 2 on the scenes `swing`, `stiff`.
SAG, LAG = 0.3, 1.25

USUAL_SPEED = 0.32  # m/s, root mean square, of the bones in these scenes
USUAL_TIME = 6.0  # s, of a motion whose end is not known; longer ones tell more of themselves as they go


class Sagging(NamedTuple):
    """Errors of XPBD on one cloth: `sag` [m/s2] and `lag` [m/s], root mean square over its vertices."""

    sag: float
    lag: float

    @classmethod
    def of(cls, chain: Chain) -> "Sagging":
        """What is likely of cloth that hangs as a chain, before anything is measured."""
        return cls(SAG * chain.sag, LAG * USUAL_TIME)

    def at(self, speed: float, seconds: float = USUAL_TIME) -> "Sagging":
        """The same of a cloth whose bones move at another speed than is usual [m/s], for so long [s]: it lags in
        proportion to both, but to no more than `USUAL_TIME`."""
        return Sagging(self.sag, self.lag * speed / USUAL_SPEED * min(seconds / USUAL_TIME, 1.0))

    def error(self, step: float) -> float:
        """The error [m] of steps of a length [s]."""
        return (self.sag * step + self.lag) * step

    def step(self, error: float) -> float:
        """The step [s] that has an error [m]."""
        return 2.0 * error / (self.lag + math.sqrt(self.lag**2 + 4.0 * self.sag * error))
