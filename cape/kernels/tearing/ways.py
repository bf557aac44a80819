"""How far vertices are from what is held, along the springs of a cloth that tears: measured within a frame.

The same as `cape.assembly.geodesics`, by sweeps over all springs forth and back until no way gets shorter (Bellman
1958), of which a grid takes few.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import inlined, routine

Indices = NDArray[np.int64]


class Ways(NamedTuple):
    """Springs between vertices `first` and `second`, `rest` [m] (n,), and the vertices that are `held` (h,).

    What comes out: `distances` [m] (N,), infinite where no spring leads, and places in `held` of the `nearest` (N,), -1
    for none.
    """

    first: Indices
    second: Indices
    rest: NDArray[np.float64]
    held: Indices
    distances: NDArray[np.float64]
    nearest: Indices


@routine
def measure_ways(g):
    """Set how far each vertex is from the nearest that is held."""
    for i in range(g.distances.size):
        g.distances[i] = math.inf
        g.nearest[i] = -1
    for k in range(g.held.size):
        g.distances[g.held[k]] = 0.0
        g.nearest[g.held[k]] = k
    count, found = g.first.size, True
    while found:
        found = False
        for e in range(count):
            found = _shorter(g, g.first[e], g.second[e], g.rest[e]) or found
        for e in range(count - 1, -1, -1):
            found = _shorter(g, g.first[e], g.second[e], g.rest[e]) or found


@inlined
def _shorter(g, i, j, rest):
    """Take the way along a spring between two vertices where it is shorter, and tell whether it is."""
    forth, back = g.distances[i] + rest, g.distances[j] + rest
    if forth < g.distances[j]:
        g.distances[j], g.nearest[j] = forth, g.nearest[i]
        return True
    if back < g.distances[i]:
        g.distances[i], g.nearest[i] = back, g.nearest[j]
        return True
    return False
