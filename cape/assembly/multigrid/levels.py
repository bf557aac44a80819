"""From aggregates of vertices to the arrays of `cape.kernels.implicit.levels`."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.multigrid.coarsening import Aggregation, Hats, coarsen
from cape.kernels.cloth.mesh_bending import SIDE, SUMS
from cape.kernels.implicit.levels import Between, Interpolation, Level, Lists

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class LinkBlocks(NamedTuple):
    """Where the blocks w w' + c of the links between vertices are, for whoever adds them up.

    Attributes:
        first: one end of each link, shape (L,).
        second: the other end, shape (L,).
        place: of wx in `coefficients`, shape (L,).
        coefficients: all w and c, flat, which change from Newton step to Newton step.
        stride: from wx to wy, wz and c in `coefficients`.
    """

    first: IntArray
    second: IntArray
    place: IntArray
    coefficients: NDArray[np.floating]
    stride: int


def lay_out_levels(
    links: LinkBlocks,
    positions: FloatArray,
    free: NDArray[np.bool_],
    *,
    columns: int | None,
    dtype: type[np.floating],
    ranks: int,
) -> tuple[tuple[Level, ...], Interpolation | None]:
    """Lay out the levels above a cloth's vertices, see `coarsen`; none for a cloth of few vertices.

    Also gives how a grid's vertices lie between the nodes of the first level, None for a mesh.
    """
    levels, place, interpolation = [], links.place, None
    for aggregation in coarsen(links.first, links.second, positions, free, columns=columns):
        packed = columns is None and not levels
        levels.append(_level(aggregation, place, dtype, packed=packed))
        place = np.arange(levels[-1].blocks.shape[1] - 1)
        if aggregation.hats is not None:
            interpolation = _interpolation(*aggregation.hats, ranks, dtype)
    return tuple(levels), interpolation


def _level(found: Aggregation, place: IntArray, dtype: type[np.floating], *, packed: bool) -> Level:
    """Lay out a level whose finer links have their blocks at those places; its own are in the order of `coarsen`.

    What it is moved by may be `packed`.
    """
    count, near, far = found.total, found.label[found.first], found.label[found.second]
    held = far < 0
    pairs, item = np.unique(np.sort(np.stack([near, far], axis=1)[~held], axis=1), axis=0, return_inverse=True)
    item = item.ravel()
    of, to = np.concatenate([pairs, pairs[:, ::-1]]).T
    order = np.lexsort((to, of))
    degree = np.bincount(of, minlength=count)
    slot, depth = np.arange(len(of)) - (np.cumsum(degree) - degree)[of[order]], int(degree.max(initial=0))
    neighbours, links = np.tile(np.arange(count), (depth, 1)), np.full((depth, count), len(pairs))
    neighbours[slot, of[order]] = to[order]
    links[slot, of[order]] = order % max(len(pairs), 1)
    inner = np.flatnonzero(found.label >= 0)
    node, k = np.nonzero(found.weights)

    def rows(*shape: int) -> NDArray[np.floating]:
        return np.zeros(shape, dtype)

    moving = _lists(found.nodes[node, k], node, found.weights[node, k], count, dtype)
    return Level(
        moving=_filled_up(moving, len(found.label)) if packed else moving,
        nodes=np.ascontiguousarray(found.nodes.T, np.uint32),
        weights=np.ascontiguousarray(found.weights.T, dtype),
        gathered=_lists(found.label[inner], inner, np.ones(len(inner)), count, dtype),
        crossing=_lists(item, place[found.link[~held]], found.scale[~held], len(pairs), dtype),
        held=_lists(near[held], place[found.link[held]], found.scale[held], count, dtype),
        neighbours=neighbours.astype(np.uint32),
        links=links.astype(np.uint32),
        blocks=rows(6, len(pairs) + 1),
        beside=rows(depth, 6, count),
        own=rows(6, count),
        diagonal=rows(6, count),
        inverse=rows(6, count),
        residual=rows(3, count),
        moved=rows(3, count),
        left=rows(3, count),
        result=rows(3, count),
    )


def _interpolation(rows: Hats, columns: Hats, ranks: int, dtype: type[np.floating]) -> Interpolation:
    """Lay out the interpolation of a grid between blocks, with room for so many threads."""
    down, across = (
        Between(
            first=hats.first,
            second=np.minimum(hats.first + 1, hats.first.max() + (hats.weight < 1.0).any()),
            weight=hats.weight.astype(dtype),
        )
        for hats in (rows, columns)
    )
    blocks = np.arange(int(down.second.max()) + 1)
    begin, end = np.searchsorted(down.second, blocks), np.searchsorted(down.first, blocks, side="right")
    room = np.zeros((ranks, 6, len(columns.first)), dtype)
    return Interpolation(down, across, begin, end, int(across.second.max()) + 1, room)


def _lists(item: IntArray, members: IntArray, weights: FloatArray, count: int, dtype: type[np.floating]) -> Lists:
    """Lists of items from their entries, in the order in which these come."""
    order = np.argsort(item, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(item, minlength=count))])
    return Lists(start, members[order].astype(np.uint32), weights[order].astype(dtype))


def _filled_up(lists: Lists, nothing: int) -> Lists:
    """The same lists as places in what is packed, filled up to a multiple of SUMS with an item that is 0."""
    sizes = np.diff(lists.start)
    start = np.concatenate([[0], np.cumsum(-(-sizes // SUMS) * SUMS)])
    places = np.arange(len(lists.members)) + np.repeat(start[:-1] - lists.start[:-1], sizes)
    members, weights = np.full(start[-1], nothing, np.uint32), np.zeros(start[-1], lists.weights.dtype)
    members[places], weights[places] = lists.members, lists.weights
    return Lists(start, np.uint32(SIDE) * members, weights)
