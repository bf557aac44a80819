"""Threads of a grid that lead to vertices which have split off, and stretch no further than their fabric allows.

They are shortened as those of a mesh are, by one thread of the team, between two looks at what is left in the grid.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import unit
from cape.kernels.solve.link_limit import LimitedLinks, Links, keep_short


class StrayLinks(NamedTuple):
    """Room for `links` of threads, of which the first `counts` (1,) are there."""

    counts: NDArray[np.int64]
    links: Links


class LimitedStrays(NamedTuple):
    """A cloth whose links are `limited`, of which the first `counts` (1,) are there."""

    limited: LimitedLinks
    counts: NDArray[np.int64]


@unit
def limit_strays(g, team, substep, substeps, step):
    """Keep stray links of threads from getting too long."""
    keep_short(g.limited, g.counts[0], step)
