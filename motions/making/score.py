"""The score of a performance: curves over time, written as values at named moments."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motions.curves import keyed, step

FloatArray = NDArray[np.float64]

FPS = 60.0


@dataclass(frozen=True, eq=False)
class Score:
    """Frames and the moments that matter in them.

    Attributes:
        times: of the frames [s], shape (F,).
        at: the moments' times [s] by name.
    """

    times: FloatArray
    at: Mapping[str, float]

    def __call__(self, **values: float) -> FloatArray:
        """The smooth curve with these values at these moments, constant before the first and after the last, (F,)."""
        return keyed(self.times, *sorted((self.at[name], value) for name, value in values.items()))

    def radians(self, **degrees: float) -> FloatArray:
        """The same for angles that are given in degrees."""
        return np.radians(self(**degrees))

    def share(self, start: str, end: str) -> FloatArray:
        """0 until one moment, 1 from another on, shape (F,)."""
        return step(self.times, self.at[start], self.at[end])

    def hump(self, start: str, end: str) -> FloatArray:
        """0 until one moment and from another on, 1 half way, shape (F,)."""
        first, last = self.at[start], self.at[end]
        middle = (first + last) / 2
        return step(self.times, first, middle) - step(self.times, middle, last)

    def later(self, delay: float) -> "Score":
        """The same score, everything `delay` later [s]."""
        return Score(self.times, {name: time + delay for name, time in self.at.items()})


def score(duration: float, **moments: float) -> Score:
    """The score of a clip of that duration [s] with these moments [s]."""
    return Score(np.arange(round(duration * FPS) + 1) / FPS, moments)
