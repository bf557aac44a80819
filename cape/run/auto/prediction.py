"""What the error of the next part of a motion is likely to be, and what it will hardly exceed.

The errors of parts scatter by factors, not by amounts, so that their logarithms are looked at. What is known of the
next one is told in two ways, and the narrower one holds:

- It is the last one that was measured, changed as errors change from part to part: by steps of a random walk, whose
  variance is that of the changes seen so far, times the number of parts that have passed since.
- It is one of a population, whose mean and variance are those of parts that were measured. Parts that follow each other
  are alike, and tell no more than one of them does: the mean is as sure as so many parts as were measured `APART`.

Of both variances the one of `UNKNOWN` errors counts as much as one part, and each time that `APART` parts have passed
the second grows by it, as motions change.

Errors are taken in units of what shakes the cloth in their part (`Part.jolt`): what a calm part tells is little of one
in which limbs strike. Once a part is taken that is known of it; before, it is likely to be as in the last one.
"""

import math
from typing import NamedTuple

import numpy as np

SURE = 2.326  # standard deviations of a normal distribution that one in a hundred exceeds
# Standard deviation of what was not seen yet: errors in units of jolts differ by a factor of two from part to part, as
# `python -m tests.bench.accuracy.parts` tells.
UNKNOWN = 0.7
APART = 10  # parts, of a tenth of a second each, after which an error tells nothing of the next: a step or a swing


class _Seen(NamedTuple):
    """A part that was measured: the logarithm of its error in units of steps, and its number."""

    value: float
    part: int


class Prediction:
    """Errors of parts that were measured, in units of what they are proportional to in one part's steps."""

    def __init__(self) -> None:
        """Know of none yet."""
        self._seen: list[_Seen] = []
        self._part = 0
        self._jolts: list[float] = []  # logarithms, of all parts

    @property
    def empty(self) -> bool:
        """Whether none is known yet."""
        return not self._seen

    @property
    def likely(self) -> float:
        """The last one that was measured, of a part as much shaken as the last one was."""
        return math.exp(self._jolts[-1]) * math.exp(self._seen[-1].value)

    def bound(self, jolt: float | None = None) -> float:
        """What few of the next exceed, if that part is shaken so, or as the last one was.

        One in a hundred would, were mean and variance known; resting on few parts, it is two to four, of series made up
        to scatter as errors in contact do (`tests/run/test_auto.py`).
        """
        values, parts = (np.array(each) for each in zip(*self._seen, strict=True))
        passed = self._part - int(parts[-1])
        walk = _deviation(np.diff(values) ** 2 / np.diff(parts))
        last = float(values[-1]) + SURE * walk * math.sqrt(passed)
        mean, several = float(values.mean()), 1.0 + (int(parts[-1]) - int(parts[0])) // APART
        spread = _deviation((values - mean) ** 2) * math.sqrt(1.0 + 1.0 / several)
        spread = math.hypot(spread, UNKNOWN * math.sqrt(passed // APART))
        shaken = self._jolts[-1] if jolt is None else math.log(jolt)
        return math.exp(shaken + min(last, mean + SURE * spread))

    @property
    def rise(self) -> float:
        """How many times as much as the last part the next one is likely to be shaken, where more: a deviation."""
        changes = np.diff(self._jolts)
        return math.exp(math.sqrt(float(np.mean(changes**2)))) if changes.size else 1.0

    def note(self, error: float, jolt: float = 1.0) -> None:
        """Note the error of a part that was measured, and how it was shaken; the next one begins."""
        self._seen.append(_Seen(math.log(max(error, 1e-12) / jolt), self._part))
        self.pass_over(jolt)

    def pass_over(self, jolt: float = 1.0) -> None:
        """Let a part pass that is not measured, which was shaken so."""
        self._jolts.append(math.log(jolt))
        self._part += 1


def _deviation(squares: np.ndarray) -> float:
    return math.sqrt((UNKNOWN**2 + float(squares.sum())) / (1 + squares.size))
