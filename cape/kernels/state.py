"""Where the vertices of a cloth are, and what they weigh."""

from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

Array = NDArray[np.floating]


def aligned(size: int, dtype: DTypeLike) -> Array:
    """Zeros from the start of a cache line on."""
    array = np.zeros(size + 64, dtype)
    start = -array.ctypes.data % 64 // array.itemsize
    return array[start : start + size]


class State(NamedTuple):
    """Positions [m] and velocities [m/s] of the vertices, each of shape (N,), in the cloth's precision."""

    x: Array
    y: Array
    z: Array
    vx: Array
    vy: Array
    vz: Array

    @classmethod
    def at_rest(cls, positions: Array, dtype: type[np.floating]) -> "State":
        """Vertices at positions [m], shape (N, 3), without velocity; six arrays that share no memory."""
        still = (np.zeros(len(positions), dtype) for _ in range(3))
        return cls(*(np.array(p, dtype=dtype) for p in positions.T), *still)


class Inertia(NamedTuple):
    """What every vertex has: `mass` [kg], `inverse_mass` [1/kg] and `free`, both zero for attached ones, all of shape
    (N,), and `gravity` [m/s2] (3,)."""

    mass: Array
    inverse_mass: Array
    free: Array
    gravity: Array
