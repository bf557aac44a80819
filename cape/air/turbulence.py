"""Turbulence: eddies that the wind carries along."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

LARGEST, SMALLEST = 4.0, 0.2  # m, lengths of the waves
COUNT = 48  # of the waves
UNSTEADY = 0.5  # share of its own turning rate at which an eddy changes


class Eddies:
    """A velocity of the air that is the curl of a sum of waves, so that none of it appears or vanishes anywhere.

    It is a function of place and time alone: the same at whatever frame rate it is asked for. Noise whose curl is the
    velocity is Bridson, Hourihan and Nordenstam's (Curl-noise for procedural fluid flow, 2007, equation 2); its waves
    and the rate at which they change, half of the eddies' own (k^3 E(k))^1/2, are Fung, Hunt, Malik and Perkins'
    (Kinematic simulation of homogeneous turbulence, 1992). Energies follow Kolmogorov's k^-5/3.
    """

    def __init__(self, seed: int) -> None:
        """Draw the waves."""
        rng = np.random.default_rng((seed, 2))
        ends = 2.0 * np.pi / np.geomspace(LARGEST, SMALLEST, COUNT + 1)
        number = np.sqrt(ends[:-1] * ends[1:])
        energy = number ** (-5.0 / 3.0)
        share = energy * np.diff(ends) / np.sum(energy * np.diff(ends))
        along = rng.normal(size=(COUNT, 3))
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        across = np.cross(along, rng.normal(size=(COUNT, 3)))
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        self._waves = number[:, None] * along
        self._velocities = np.sqrt(3.0 * 2.0 * share)[:, None] * across
        self._rate = UNSTEADY * np.sqrt(1.5 * number**3 * energy / np.sum(energy * np.diff(ends)))
        self._phase = rng.uniform(0.0, 2.0 * np.pi, COUNT)

    def at(self, time: float, places: FloatArray, *, speed: float) -> FloatArray:
        """Velocities [m/s] at places [m], (N, 3), that move with the mean wind, at a time [s].

        `speed` is the root mean square of each of their components [m/s], over long times and all directions.
        """
        turned = places @ self._waves.T + (speed * self._rate * time + self._phase)
        return speed * np.cos(turned) @ self._velocities


eddies_of = cache(Eddies)
"""The eddies of a seed."""
