"""Coarser and coarser copies of a cloth, in which a few numbers move many vertices: levels of a multigrid method.

Each level gathers the nodes of the one before into aggregates, which are the nodes of the next: blocks of a grid, or
around a maximal independent set of a mesh's graph, as Chan and Smith 1994, "Domain decomposition and multigrid
algorithms for elliptic problems on unstructured meshes" (ETNA 2), choose coarse meshes. What an aggregate moves is
smooth: a grid's vertices are interpolated linearly between blocks; elsewhere an aggregate's indicator is averaged over
neighbours, as in smoothed aggregation, but by the graph alone. So weights hold for the whole run, whatever the cloth
does. See `cape.kernels.implicit.multigrid` for what is done with them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

KEPT = 3  # aggregates that move a node: four take no iteration less, and cost a third more
FIRST_WIDTH, WIDTH = 3, 2  # nodes of a grid across an aggregate, of the first level and of the others
FIRST_AVERAGES, AVERAGES = 3, 2  # of indicators over neighbours: about the width of a linear interpolation
FEWEST = 32  # nodes that are not gathered any more
MOST_LEFT = 0.8  # of the nodes: pieces too small to be gathered are many


class Aggregation(NamedTuple):
    """How the n nodes of a level are gathered into N aggregates.

    Attributes:
        total: N.
        label: each node's aggregate, -1 for none, shape (n,).
        nodes: aggregates that move each node, shape (n, KEPT); of none, shape (0, KEPT), where `hats` tell.
        weights: how far they do, of sum 1, or all 0 for a node that nothing moves, shape (n, KEPT).
        first: one end of each of the E links between aggregates, a node that has one, shape (E,).
        second: the other end, in another aggregate or in none, shape (E,).
        link: which of the links between nodes it is, shape (E,).
        scale: what its stiffness is multiplied by, shape (E,).
        hats: what moves the rows and the columns of a grid, None but for a grid's vertices.
    """

    total: int
    label: IntArray
    nodes: IntArray
    weights: FloatArray
    first: IntArray
    second: IntArray
    link: IntArray
    scale: FloatArray
    hats: tuple["Hats", "Hats"] | None


class Hats(NamedTuple):
    """Rows or columns of a grid between those of its blocks: each moves with block `first` by `weight`, and by the rest
    with the next one; both shape (R,)."""

    first: IntArray
    weight: FloatArray


def coarsen(
    first: IntArray, second: IntArray, positions: FloatArray, free: NDArray[np.bool_], *, columns: int | None = None
) -> list[Aggregation]:
    """Gather a cloth's vertices level by level, until few nodes are left; no level for a cloth of few vertices.

    Args:
        first: one end of each link between vertices, shape (L,).
        second: the other end, shape (L,).
        positions: of the V vertices where the cloth starts [m], shape (V, 3).
        free: False for vertices that are held, which no aggregate moves, shape (V,).
        columns: of a grid, None for a mesh.
    """
    levels: list[Aggregation] = []
    links = np.stack([first, second], axis=1)
    width, averages = FIRST_WIDTH, FIRST_AVERAGES
    shape = None if columns is None else (len(positions) // columns, columns)
    while len(positions) > FEWEST and free.any():
        hats = None
        if shape is None:
            label = _around_seeds(links, len(positions), width - 1)
            count = int(label.max()) + 1
        else:
            down, across = (max(1, round(size / width)) for size in shape)
            row, column = (np.arange(size) * blocks // size for size, blocks in zip(shape, (down, across), strict=True))
            label, count = (row[:, None] * across + column).ravel(), down * across
            hats = None if levels else (_hats(row), _hats(column))
            shape = down, across
        if count > MOST_LEFT * len(label):
            break
        label = np.where(free, label, -1)
        levels.append(_aggregation(label, count, links, positions, averages, hats))
        positions = _centres(label, count, positions)
        level = levels[-1]
        pairs = level.label[np.stack([level.first, level.second], axis=1)]
        links = np.unique(np.sort(pairs[(pairs >= 0).all(axis=1)], axis=1), axis=0)
        free = np.bincount(label[label >= 0], minlength=count) > 0
        width, averages = WIDTH, AVERAGES
    return levels


def _hats(block: IntArray) -> Hats:
    """Linear interpolation between the middles of blocks, of rows or columns that belong to those; constant beyond."""
    middles = np.bincount(block, np.arange(len(block))) / np.bincount(block)
    if len(middles) == 1:
        return Hats(block, np.ones(len(block)))
    first = np.clip(np.searchsorted(middles, np.arange(len(block))) - 1, 0, len(middles) - 2)
    weight = (middles[first + 1] - np.arange(len(block))) / (middles[first + 1] - middles[first])
    return Hats(first, np.clip(weight, 0.0, 1.0))


def _around_seeds(links: IntArray, count: int, distance: int) -> IntArray:
    """Labels by the nearest of seeds, along links, none of which is within so many links of another."""
    start, neighbours = _neighbours(links, count)
    starts, others = start.tolist(), neighbours.tolist()
    label, near = [-1] * count, [False] * count
    front: list[int] = []
    for seed in range(count):
        if near[seed]:
            continue
        label[seed] = len(front)
        front.append(seed)
        near[seed] = True
        reached, edge = {seed}, [seed]
        for _ in range(distance):
            edge = [n for node in edge for n in others[starts[node] : starts[node + 1]]]
            edge = [n for n in dict.fromkeys(edge) if n not in reached]
            reached.update(edge)
        for node in reached:
            near[node] = True
    while front:
        following = []
        for node in front:
            for other in others[starts[node] : starts[node + 1]]:
                if label[other] < 0:
                    label[other] = label[node]
                    following.append(other)
        front = following
    return np.array(label)


def _neighbours(links: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Neighbours of each node one after the other, and where each node's begin, shape (count + 1,)."""
    both = np.concatenate([links, links[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    return np.concatenate([[0], np.cumsum(np.bincount(both[:, 0], minlength=count))]), both[:, 1]


def _aggregation(
    label: IntArray,
    count: int,
    links: IntArray,
    positions: FloatArray,
    averages: int,
    hats: tuple[Hats, Hats] | None,
) -> Aggregation:
    """Find what moves with each aggregate, and the links between them."""
    nodes, weights = np.zeros((0, KEPT), np.int64), np.zeros((0, KEPT))
    if hats is None:
        nodes, weights = _weights(label, count, links, averages)
    link = np.flatnonzero(label[links[:, 0]] != label[links[:, 1]])
    ends = links[link]
    # The end that has an aggregate comes first.
    ends = np.where((label[ends[:, 0]] < 0)[:, None], ends[:, ::-1], ends)
    centre, far = _centres(label, count, positions), label[ends[:, 1]]
    apart = np.where((far < 0)[:, None], positions[ends[:, 1]], centre[far]) - centre[label[ends[:, 0]]]
    along = np.abs(np.einsum("ek,ek->e", apart, positions[ends[:, 1]] - positions[ends[:, 0]]))
    squared = np.einsum("ek,ek->e", apart, apart)
    scale = np.minimum(along / np.where(squared > 0.0, squared, 1.0), 1.0)
    return Aggregation(count, label, nodes, weights, ends[:, 0], ends[:, 1], link, scale, hats)


def _centres(label: IntArray, count: int, positions: FloatArray) -> FloatArray:
    """Means of the positions of each aggregate's nodes, shape (count, 3); the origin of one that has none."""
    inner = np.flatnonzero(label >= 0)
    size = np.maximum(np.bincount(label[inner], minlength=count), 1)
    return np.stack([np.bincount(label[inner], p[inner], count) / size for p in positions.T], axis=1)


def _weights(label: IntArray, count: int, links: IntArray, averages: int) -> tuple[IntArray, FloatArray]:
    """The aggregates that move each node most, and how far: indicators averaged over a node and its neighbours."""
    from scipy import sparse

    size, free = len(label), label >= 0
    moved = np.flatnonzero(free)
    indicator = sparse.csr_array((np.ones(len(moved)), (moved, label[moved])), shape=(size, count))
    ends = np.concatenate([links, links[:, ::-1]])
    graph = sparse.csr_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(size, size))
    degree = np.maximum(np.bincount(ends[:, 0], minlength=size), 1)
    average = 0.5 * (sparse.eye_array(size, format="csr") + sparse.diags_array(1.0 / degree, format="csr") @ graph)
    for _ in range(averages):
        indicator = average @ indicator
    found = sparse.coo_array(indicator)
    order = np.lexsort((found.col, -1.0 * found.data, found.row))
    row = found.row[order]
    place = np.arange(len(row)) - np.searchsorted(row, row)
    kept = (place < KEPT) & free[row]
    nodes, weights = np.zeros((size, KEPT), np.int64), np.zeros((size, KEPT))
    nodes[row[kept], place[kept]] = found.col[order][kept]
    weights[row[kept], place[kept]] = found.data[order][kept]
    total = weights.sum(axis=1, keepdims=True)
    return nodes, weights / np.where(total > 0.0, total, 1.0)
