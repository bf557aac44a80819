"""From springs and triangles of a mesh to the rows and lists of `cape.kernels.cloth.mesh`.

Bending is linear in the positions and the same wherever the cloth is, so that its force is a sum over pairs of vertices
too: of 1/2 k |sum c_a p_a|^2 with zero sum of c, the force on a is sum_b -k c_a c_b (p_b - p_a). The pairs of a hinge
are those of the springs, five edges and a cross spring; so bending costs no pass of its own.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.springs import Springs
from cape.cloth.cloth import Cloth
from cape.kernels.cloth.mesh import BLOCK, ENDS, SLICE, MeshAir, MeshBends, MeshSprings
from cape.kernels.cloth.sharing import share_items

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Rows(NamedTuple):
    """Where items, owned by one of their vertices, stand: `item` (L,) is at `row` of `total` rows, below `owner`."""

    item: IntArray
    row: IntArray
    owner: IntArray
    total: int


class Links(NamedTuple):
    """Pairs of vertices (L, 2), owner first, their springs and the weight of bending between them (L,), in rows."""

    pairs: IntArray
    stiffness: FloatArray
    rest: FloatArray
    weight: FloatArray
    rows: Rows


def mesh_springs_record(springs: Springs, vertices: int, dtype: type[np.floating]) -> MeshSprings:
    """Lay out the springs of a mesh in a solver's precision, on the links that bending needs as well."""
    links = _links_of(springs, vertices)
    return MeshSprings(
        second=_table(links.rows, links.pairs[:, 1], np.arange(vertices), np.uint32),
        stiffness=_table(links.rows, links.stiffness, np.zeros(vertices), dtype),
        rest=_table(links.rows, links.rest, np.ones(vertices), dtype),
        **_lists(links.rows, links.pairs[:, 1:], vertices),
        **_room(links.rows.total, vertices, 1, dtype),
    )


def mesh_bends_record(springs: Springs, vertices: int, dtype: type[np.floating]) -> MeshBends:
    """Lay out the bending of a mesh in a solver's precision, on the same links as `mesh_springs_record`."""
    links = _links_of(springs, vertices)
    return MeshBends(_table(links.rows, links.weight, np.zeros(vertices), dtype))


def mesh_air_record(cloth: Cloth, wind: FloatArray, drag: float, lift: float, dtype: type[np.floating]) -> MeshAir:
    """Lay out the triangles of a mesh in a solver's precision; `wind` [m/s] is kept, to be changed from outside.

    `drag` and `lift` are rho Cd / 12 and rho Cl / 12 [kg/m3].
    """
    n, triangles = cloth.vertices, cloth.triangles.astype(np.int64)
    owned, rows = _share_out(triangles, n)
    itself = np.arange(n)
    return MeshAir(
        wind=wind,
        drag=drag,
        lift=lift,
        second=_table(rows, owned[:, 1], itself, np.uint32),
        third=_table(rows, owned[:, 2], itself, np.uint32),
        **_lists(rows, owned[:, 1:], n),
        **_room(rows.total, n, 2, dtype),
    )


def _room(rows: int, vertices: int, ends: int, dtype: type[np.floating]) -> dict[str, Any]:
    """Room of the kernels: a word holds two numbers; a line of `room` so many rows of other ends, own ends and sums."""
    word, blocks = np.uint64 if np.dtype(dtype) == np.float32 else np.complex128, -(-vertices // BLOCK)
    return {
        "words": np.zeros((3, vertices), word),
        "room": np.zeros((blocks, ends * ENDS + ENDS + ENDS // 2), word),
        "forces": np.zeros((blocks * rows + 1) * 3 * BLOCK, dtype),
    }


@lru_cache(maxsize=1)
def _links_of(springs: Springs, vertices: int) -> Links:
    a, b = np.triu_indices(4, 1)
    c, hinges = springs.bend_coefficients, springs.bend_vertices
    first = np.concatenate([springs.first, hinges[:, a].ravel()])
    second = np.concatenate([springs.second, hinges[:, b].ravel()])
    weight = np.concatenate(
        [np.zeros(len(springs.first)), (-springs.bend_stiffness[:, None] * c[:, a] * c[:, b]).ravel()]
    )
    stiffness = np.concatenate([springs.stiffness, np.zeros(hinges[:, a].size)])
    rest = np.concatenate([springs.rest, np.zeros(hinges[:, a].size)])
    key, link = np.unique(np.minimum(first, second) * vertices + np.maximum(first, second), return_inverse=True)
    # Two springs between the same vertices are one with the sum of their stiffness and of their tensions.
    stiffness, tension = (np.bincount(link, values).astype(float) for values in (stiffness, stiffness * rest))
    sprung = stiffness > 0.0
    pairs, rows = _share_out(np.stack([key // vertices, key % vertices], axis=1), vertices)
    return Links(
        pairs=pairs,
        stiffness=stiffness,
        rest=np.where(sprung, tension / np.where(sprung, stiffness, 1.0), 1.0),
        weight=np.bincount(link, weight).astype(float),
        rows=rows,
    )


def _share_out(items: IntArray, vertices: int) -> tuple[IntArray, Rows]:
    """Give each item (L, m) to one of its m vertices so that all own about as many.

    Returns the items with their owner first, shape (L, m), and where they stand.
    """
    depth = int(np.bincount(items.ravel(), minlength=vertices).max())
    owned, count = np.full((vertices, depth), len(items), dtype=np.int64), np.zeros(vertices, dtype=np.int64)
    share_items(items, owned, count, *(np.zeros(vertices, dtype=np.int64) for _ in range(4)))
    owned[np.arange(depth) >= count[:, None]] = len(items)
    owned.sort(axis=1)
    owner, row = np.nonzero(owned < len(items))
    item = owned[owner, row]
    place = np.argmax(items[item] == owner[:, None], axis=1)
    turned = items.copy()
    turned[item] = np.take_along_axis(
        items[item], (place[:, None] + np.arange(items.shape[1])) % items.shape[1], axis=1
    )
    return turned, Rows(item, row, owner, int(row.max()) + 1)


def _table(rows: Rows, values: NDArray[Any], blank: NDArray[Any], dtype: type[np.generic]) -> NDArray[Any]:
    """Values of items (L,) in rows by block (blocks, D, BLOCK), over what vertices without item hold (N,)."""
    blocks = -(-len(blank) // BLOCK)
    padded = np.pad(blank, (0, blocks * BLOCK - len(blank))).reshape(blocks, 1, BLOCK)
    table = np.repeat(padded, rows.total, axis=1).astype(dtype)
    table[rows.owner // BLOCK, rows.row, rows.owner % BLOCK] = values[rows.item]
    return table


def _lists(rows: Rows, others: IntArray, vertices: int) -> dict[str, Any]:
    """For each vertex the places of items that others own, `others` (L, m - 1) being those who do not.

    Vertices are sorted within their blocks by the length of their lists, so that little is padded.
    """
    place = ((rows.owner // BLOCK * rows.total + rows.row) * 3) * BLOCK + rows.owner % BLOCK
    place, vertex = np.repeat(place, others.shape[1]), others[rows.item].ravel()
    order = np.lexsort((place, vertex))
    place, vertex = place[order], vertex[order]
    count = np.bincount(vertex, minlength=vertices)
    sorted_vertices = np.lexsort((count, np.arange(vertices) // BLOCK))
    slices, blocks = -(-vertices // SLICE), -(-vertices // BLOCK)
    width = np.pad(count[sorted_vertices], (0, slices * SLICE - vertices)).reshape(slices, SLICE).max(axis=1)
    start = np.concatenate([[0], np.cumsum(width * SLICE)])
    incoming = np.full(start[-1], blocks * rows.total * 3 * BLOCK, np.uint32)
    nth = np.arange(len(vertex)) - (np.cumsum(count) - count)[vertex]
    at = np.argsort(sorted_vertices)[vertex]
    incoming[start[at // SLICE] + at % SLICE * width[at // SLICE] + nth] = place
    return {"sorted_vertices": sorted_vertices.astype(np.uint32), "start": start, "incoming": incoming}
