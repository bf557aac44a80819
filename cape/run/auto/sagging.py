"""The error of XPBD as a function of its step: a sag, and a lag.

Cloth hangs down too far by what a sweep over its threads leaves, which grows as the square of the step, and it follows
too late, by a distance that grows as the step: e = sag h^2 + lag h.
"""

import math
from typing import NamedTuple

from cape.assembly.chains import Chain

SAG, LAG = 0.3, 5.7  # share, and m/s: errors on hanging cloth, as measured on the scenes `swing` and `stiff`

USUAL_SPEED = 0.32  # m/s, root mean square, of the bones in these scenes


class Sagging(NamedTuple):
    """Errors of XPBD on one cloth: `sag` [m/s2] and `lag` [m/s], root mean square over its vertices."""

    sag: float
    lag: float

    @classmethod
    def of(cls, chain: Chain) -> "Sagging":
        """What is likely of cloth that hangs as a chain, before anything is measured."""
        return cls(SAG * chain.sag, LAG)

    def at(self, speed: float) -> "Sagging":
        """The same of a cloth whose bones move at another speed than is usual [m/s]: it lags in proportion."""
        return Sagging(self.sag, self.lag * speed / USUAL_SPEED)

    def error(self, step: float) -> float:
        """The error [m] of steps of a length [s]."""
        return (self.sag * step + self.lag) * step

    def step(self, error: float) -> float:
        """The step [s] that has an error [m]."""
        return 2.0 * error / (self.lag + math.sqrt(self.lag**2 + 4.0 * self.sag * error))
