"""How long the threads of a grid may get, and those of one that has split."""

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.assembly.fabrics import longest_allowed
from cape.assembly.grid.split_springs import SplitSprings
from cape.cloth.cloth import Cloth, GridCloth
from cape.cloth.split_grid import SplitGrid
from cape.kernels.solve.link_limit import Links
from cape.kernels.tearing.limit import StrayLinks

Array = NDArray[np.floating]

THREADS_A_CELL = 4  # that a cell adds to: its sides


def longest_threads(assembly: Assembly, dtype: type[np.floating]) -> Array | None:
    """How long the threads may get [m] that lead from each vertex of a grid to the right, and down, shape (2, N).

    None in a scene that does not limit strain. What would leave the grid means nothing.
    """
    families = assembly.springs.families
    if not assembly.scene.strain_limit or families is None:
        return None
    longest = longest_allowed(families.rest[:2], _limits(assembly.cloth)[:, None]).astype(dtype)
    if isinstance(assembly.cloth, SplitGrid):
        longest[families.stiffness[:2] == 0.0] = np.inf
    return longest


def stray_links(assembly: Assembly, dtype: type[np.floating]) -> StrayLinks | None:
    """Room for all threads of a grid that may go astray, and in it those that have.

    None in a scene that does not limit strain, or whose cloth is no grid that may split.
    """
    grid = assembly.cloth
    if not assembly.scene.strain_limit or not isinstance(grid, SplitGrid):
        return None
    room = THREADS_A_CELL * len(grid.corners)
    first, second = np.zeros((2, room), np.uint32)
    chain = max(grid.whole.rows, grid.whole.columns)
    strays = StrayLinks(np.zeros(1, np.int64), Links(first, second, np.ones(room, dtype), chain))
    fill_links(strays, assembly)
    return strays


def fill_links(room: StrayLinks, assembly: Assembly) -> None:
    """Put the threads of a grid that have gone astray into their room, those down the columns first, row by row."""
    springs, grid = assembly.springs, assembly.cloth
    assert isinstance(springs, SplitSprings)
    assert isinstance(grid, SplitGrid)
    strays = np.flatnonzero(springs.measured & ~springs.home)
    family = springs.parts.slot[strays] // grid.whole.vertices
    order = np.lexsort((springs.parts.cell[strays], -family))
    strays, family = strays[order], family[order]
    count = room.counts[0] = len(strays)
    room.links.first[:count], room.links.second[:count] = springs.first[strays], springs.second[strays]
    room.links.longest[:count] = longest_allowed(springs.rest[strays], _limits(grid)[family])


def _limits(cloth: Cloth) -> NDArray[np.float64]:
    """Strain to which threads to the right, and down, may get."""
    assert isinstance(cloth, GridCloth)
    return np.array([cloth.fabric.limit_weft, cloth.fabric.limit_warp])
