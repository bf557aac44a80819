"""How the error of a run of freely swinging cloth grows, e(t) = a + b t, and how both parts shrink with the step.

A step that is not short enough leaves cloth out of place at once, as it sags too far or its waves are out of step, and
lets it swing a little too fast or too slow, so that it falls ever farther behind where it should be.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

RATIOS = 2.0 ** np.linspace(3.0, -4.0, 141)  # of steps that are looked at, 5 % apart


class Orders(NamedTuple):
    """Powers of the step by which what is out of place `at_once` shrinks, and what `grows`: None where nothing does."""

    at_once: float
    grows: float | None


class Drift(NamedTuple):
    """An error: `start` [m], and its growth [m/s], neither negative, and how they shrink."""

    start: float
    growth: float
    orders: Orders

    @classmethod
    def between(
        cls,
        times: NDArray[np.float64],
        apart: NDArray[np.float64],
        ratio: float,
        orders: Orders,
        *,
        likely: float = 0.0,
        most: float = math.inf,
        seen: float = 1.0,
    ) -> "Drift":
        """That of a run, of which one in steps `ratio` times as long is `apart` [m] at some times [s], both (n,).

        A line through them tells the growth of the share of the motion that was `seen`; of the rest, what is `likely`
        [m/s]. What grows faster than errors may at `most` [m/s] is out of place at once: motions set out from rest.
        """
        at_once = abs(ratio**orders.at_once - 1.0)
        if orders.grows is None:
            return cls(float(np.sqrt(np.mean(apart**2))) / at_once, 0.0, orders)
        grown = abs(ratio**orders.grows - 1.0)
        slope = seen * min(_slope(times, apart), most * grown) + (1.0 - seen) * likely * grown
        start = max(float(np.mean(apart - slope * times)), 0.0)
        return cls(start / at_once, slope / grown, orders)

    def rms(self, now: float, end: float, ratio: float = 1.0) -> float:
        """Root mean square error [m] at the `end`, if steps from `now` [s] on are `ratio` times as long.

        What was gathered by then stays: b now. What cloth is out of place changes at once.
        """
        start = self.start * ratio**self.orders.at_once
        growth = self.growth * ratio ** (self.orders.grows or 1.0)
        before = _squares(self.start, self.growth, now)
        return math.sqrt((before + _squares(start + self.growth * now, growth, end - now)) / end)

    def ratio(self, allowed: float, now: float, end: float) -> float:
        """How many times as long steps may be from `now` on for an error that is allowed [m]: the least, if none."""
        errors = np.array([self.rms(now, end, ratio) for ratio in RATIOS])
        return float(RATIOS[np.argmax(errors <= allowed)] if errors[-1] <= allowed else RATIOS[-1])


def _slope(times: NDArray[np.float64], errors: NDArray[np.float64]) -> float:
    """That of the straight line which fits by least squares, not falling and not from below zero."""
    if times.size < 2:
        return 0.0
    slope, start = (float(part) for part in np.polyfit(times, errors, 1))
    return max(slope, 0.0) if start > 0.0 else float(times @ errors / (times @ times))


def _squares(start: float, growth: float, span: float) -> float:
    """The integral of (start + growth t)^2 from 0 to `span`."""
    return start**2 * span + start * growth * span**2 + growth**2 * span**3 / 3.0
