"""The error of XPBD as a function of its step: a sag, and a lag.

Cloth hangs down too far by what a sweep over its threads leaves, which grows as the square of the step, and it follows
too late, by a distance that grows as the step: e = sag h^2 + lag h.
"""

import math
from typing import NamedTuple

from cape.assembly.chains import Chain

SAG, LAG = 0.3, 5.7  # share, and m/s: errors on hanging cloth, as measured on the scenes `swing` and `stiff`


class Sagging(NamedTuple):
    """Errors of XPBD on one cloth: `sag` [m/s2] and `lag` [m/s], root mean square over its vertices."""

    sag: float
    lag: float

    @classmethod
    def of(cls, chain: Chain) -> "Sagging":
        """What is likely of cloth that hangs as a chain, before anything is measured."""
        return cls(SAG * chain.sag, LAG)

    @classmethod
    def measured(cls, steps: tuple[float, float, float], apart: tuple[float, float]) -> "Sagging":
        """What fits three runs, in ever shorter steps [s], by the distances [m] of each from the next.

        Errors are taken to point the same way, so that their differences are those of their sizes; neither part is
        taken to be negative.
        """
        (long, middle, short), (first, second) = steps, apart
        # first = sag (long^2 - middle^2) + lag (long - middle), and the same for the others: divided by the brackets.
        slope, next_slope = first / (long - middle), second / (middle - short)
        sag = (slope - next_slope) / (long - short)
        if sag < 0.0:
            return cls(0.0, next_slope)
        lag = next_slope - sag * (middle + short)
        return cls(sag, lag) if lag > 0.0 else cls(next_slope / (middle + short), 0.0)

    def error(self, step: float) -> float:
        """The error [m] of steps of a length [s]."""
        return (self.sag * step + self.lag) * step

    def step(self, error: float) -> float:
        """The step [s] that has an error [m]."""
        return 2.0 * error / (self.lag + math.sqrt(self.lag**2 + 4.0 * self.sag * error))
