"""Threads of a grid that lead to vertices which have split off, and stretch no further than their fabric allows.

They are shortened as those of a mesh are, by one thread of the team, between two looks at what is left in the grid.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import unit
from cape.kernels.solve.link_limit import shorten_links
from cape.kernels.solve.strain_limit import RETURN, sweeps_over
from cape.kernels.state import State

Array = NDArray[np.floating]


class StrayLinks(NamedTuple):
    """Links of threads, of which the first `counts` (1,) are there: vertices `first` and `second` (n,), and how long
    each may get, `longest` [m] (n,). No chain of them is longer than `chain`."""

    counts: NDArray[np.int64]
    first: NDArray[np.uint32]
    second: NDArray[np.uint32]
    longest: Array
    chain: int


class LimitedStrays(NamedTuple):
    """A cloth whose stray `links` are limited; `inverse_mass` [1/kg] (N,) is zero for attached vertices."""

    state: State
    inverse_mass: Array
    links: StrayLinks


@unit
def limit_strays(g, team, substep, substeps, step):
    """Keep stray links of threads from getting too long."""
    s, links, count = g.state, g.links, g.links.counts[0]
    for _ in range(sweeps_over(links.chain, step)):
        if not shorten_links(
            s.x, s.y, s.z, s.vx, s.vy, s.vz, g.inverse_mass, links.first[:count], links.second[:count],
            links.longest[:count], RETURN * step,
        ):  # fmt: skip
            break
