"""Gusts: how much faster than its mean the wind is at a time."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

GUST_TIME = 3.0  # s, integral scale: some 10 m of air that passes at 3 m/s
SLOWEST, FASTEST = 0.01, 3.0  # Hz
COUNT = 80  # of the waves


class Gusts:
    """A sum of waves whose spectrum is the wind's, as a function of time: the same at whatever times it is asked for.

    The spectrum S of the share by which the wind is faster is von Karman's, n S(n) = 4 n T / (1 + 70.8 (n T)^2)^(5/6)
    at the frequency n and the integral scale T (Dyrbye and Hansen, Wind Loads on Structures, 1997, section 3.4), and
    the sum of waves with random phases is Shinozuka and Jan's (J. Sound and Vibration 25, 1972, 111).
    """

    def __init__(self, seed: int) -> None:
        """Draw frequencies and phases."""
        rng = np.random.default_rng((seed, 1))
        ends = np.geomspace(SLOWEST, FASTEST, COUNT + 1)
        self._frequency = ends[:-1] * (ends[1:] / ends[:-1]) ** rng.random(COUNT)
        variance = spectrum(np.sqrt(ends[:-1] * ends[1:])) * np.diff(ends)
        self._amplitude = np.sqrt(2.0 * variance / variance.sum())
        self._phase = rng.uniform(0.0, 2.0 * np.pi, COUNT)

    def at(self, time: float) -> float:
        """The gust at a time [s], of mean square 1 over long times."""
        return float(self._amplitude @ np.cos(2.0 * np.pi * self._frequency * time + self._phase))


def spectrum(frequency: FloatArray) -> FloatArray:
    """Von Karman's spectrum of a variance of 1 [s] at frequencies [Hz]."""
    return 4.0 * GUST_TIME / (1.0 + 70.8 * (frequency * GUST_TIME) ** 2) ** (5.0 / 6.0)


gusts_of = cache(Gusts)
"""The gusts of a seed."""
