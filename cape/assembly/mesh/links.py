"""From springs and triangles of a mesh to the rows and lists of `cape.kernels.cloth.mesh` and its neighbours.

Bending is linear in the positions and the same wherever the cloth is: of 1/2 k |sum c_a p_a|^2 with zero sum of c the
force on a is sum_b -k c_a c_b (p_b - p_a), and the sum of all bends a constant matrix.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.membrane import Membrane
from cape.assembly.springs import Springs
from cape.cloth.cloth import Cloth
from cape.kernels.cloth.membrane import SHAPE, MeshMembrane, Tension
from cape.kernels.cloth.mesh import BLOCK, ENDS, SLICE, MeshAir, MeshSprings
from cape.kernels.cloth.mesh_bending import SIDE, SUMS, MeshBends
from cape.kernels.cloth.sharing import share_items
from cape.kernels.state import aligned

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ROUNDING = 1e-13  # of a row's own entry: less is what sums leave that are zero, as many are where cells are split


Spare = int | None
"""From which vertex on all are spare, with lists that have room; None where there are none."""


class Rows(NamedTuple):
    """Where items, owned by one of their vertices, stand: `item` (L,) is at `row` of `total` rows, below `owner`.

    `used` are the rows of each block in which any item stands, shape (blocks,).
    """

    item: IntArray
    row: IntArray
    owner: IntArray
    total: int
    used: IntArray


def mesh_springs_record(springs: Springs, vertices: int, dtype: type[np.floating]) -> MeshSprings:
    """Lay out the springs of a mesh in a solver's precision."""
    return springs_in_rows(springs, vertices, dtype)[0]


def springs_in_rows(
    springs: Springs, vertices: int, dtype: type[np.floating], spare: Spare = None
) -> tuple[MeshSprings, IntArray, Rows]:
    """The same, with the ends of springs (E, 2), owners first, and where they stand; with room where any are spare."""
    pairs, rows = _share_out(np.stack([springs.first, springs.second], axis=1), vertices, more=spare is not None)
    record = MeshSprings(
        rows=rows.used,
        second=_table(rows, pairs[:, 1], np.arange(vertices), np.uint32),
        stiffness=_table(rows, springs.stiffness, np.zeros(vertices), dtype),
        rest=_table(rows, springs.rest, np.ones(vertices), dtype),
        **_lists(rows, pairs[:, 1:], vertices, spare=spare),
        **_room(rows.total, vertices, 1, dtype),
    )
    return record, pairs, rows


def mesh_bends_record(springs: Springs, vertices: int, dtype: type[np.floating]) -> MeshBends:
    """Lay out the bending of a mesh in a solver's precision."""
    matrix = bend_matrix(springs, vertices)
    row = np.repeat(np.arange(vertices), np.diff(matrix.indptr))
    apart = (matrix.indices != row) & (np.abs(matrix.data) > ROUNDING * matrix.diagonal()[row])
    return _bend_rows(row[apart], matrix.indices[apart], -matrix.data[apart], np.arange(vertices), dtype)


def thinned(bends: MeshBends, least: FloatArray, dtype: type[np.floating]) -> MeshBends:
    """The same without pairs whose weight is at most the lesser of `least` [N/m] (N,) at both, in some precision.

    Rows stay symmetric, and zero in sum.
    """
    count = len(least)
    row, others = np.repeat(np.arange(count), np.diff(bends.start)), bends.others.astype(np.int64) // SIDE
    kept = np.abs(bends.weight) > np.minimum(least[row], least[others])
    return _bend_rows(row[kept], others[kept], bends.weight[kept], np.arange(count), dtype)


def _bend_rows(
    row: IntArray, others: IntArray, weight: NDArray[np.floating], own: IntArray, dtype: type[np.floating]
) -> MeshBends:
    """Lay out the rows of some vertices (n,) from their entries, sorted by row; see `MeshBends`."""
    count = np.bincount(row, minlength=len(own))
    width = count + -count % SUMS
    start = np.concatenate([[0], np.cumsum(width)])
    place = start[row] + np.arange(len(row)) - (np.cumsum(count) - count)[row]
    table = np.repeat((SIDE * own).astype(np.uint32), width)
    weights: NDArray[Any] = np.zeros(start[-1], dtype)
    table[place], weights[place] = SIDE * others, weight
    return MeshBends(start, table, weights, aligned(SIDE * len(own), dtype))


def bent_at(springs: Springs, chosen: NDArray[np.bool_]) -> IntArray:
    """Triangles whose bends, three of each, lead to some chosen vertices (N,)."""
    vertices = springs.bend_vertices[::3]
    return np.unique(np.flatnonzero(chosen[vertices]) // max(vertices.shape[1], 1))


def bend_rows(springs: Springs, rows: IntArray, vertices: int, dtype: type[np.floating]) -> MeshBends:
    """Lay out some rows (n,), in their order, of the bending of a mesh whose springs by threes have the same
    vertices."""
    wanted = np.zeros(vertices, bool)
    wanted[rows] = True
    bends = (3 * bent_at(springs, wanted)[:, None] + np.arange(3)).ravel()
    members = springs.bend_vertices[bends]
    wanted[members] = True
    columns = np.flatnonzero(wanted)
    number = np.cumsum(wanted) - 1
    rooted = np.sqrt(springs.bend_stiffness[bends])[:, None] * springs.bend_coefficients[bends]
    own = np.full(vertices, -1)
    own[rows] = np.arange(len(rows))
    bend, member = np.nonzero((own[members] >= 0) & (rooted != 0.0))
    place = own[members[bend, member], None] * len(columns) + number[members[bend]]
    products = rooted[bend, member, None] * rooted[bend]
    sums = np.bincount(place.ravel(), products.ravel(), len(rows) * len(columns))
    matrix = sums.reshape(len(rows), -1).astype(float)
    least = ROUNDING * matrix[np.arange(len(rows)), number[rows]]
    matrix[np.arange(len(rows)), number[rows]] = 0.0
    row, column = np.nonzero(np.abs(matrix) > least[:, None])
    return _bend_rows(row, columns[column], -matrix[row, column], rows, dtype)


def bend_matrix(springs: Springs, vertices: int) -> Any:
    """The sum of k c c' of all bend springs [N/m], a scipy.sparse.csr_array (N, N) with sorted rows."""
    from scipy.sparse import csr_array

    count, members = springs.bend_vertices.shape
    starts = np.arange(count + 1) * members
    rooted = np.sqrt(springs.bend_stiffness)[:, None] * springs.bend_coefficients
    rows = csr_array((rooted.ravel(), springs.bend_vertices.ravel(), starts), (count, vertices))
    matrix = csr_array(rows.T @ rows)
    matrix.sort_indices()
    return matrix


def mesh_membrane_record(
    membrane: Membrane, vertices: int, dtype: type[np.floating], *, piece: bool = False
) -> MeshMembrane:
    """Lay out the membrane of a mesh in a solver's precision, or of a `piece`, which has not all of the vertices."""
    record, _, rows = membrane_in_rows(membrane, vertices, dtype)
    return record._replace(used=rows.used) if piece else record


def turned_slopes(membrane: Membrane, triangles: IntArray, owners: IntArray) -> FloatArray:
    """Slopes of some triangles (n,) [1/m], as they are from other corners of theirs (n,), shape (n, 4)."""
    first, second = membrane.slopes[triangles, 0], membrane.slopes[triangles, 1]
    by_corner = np.stack([-first - second, first, second], axis=1)
    place = np.argmax(membrane.faces[triangles] == owners[:, None], axis=1)
    return np.concatenate([by_corner[np.arange(len(place)), (place + step) % 3] for step in (1, 2)], axis=1)


def smoothing_of(membrane: Membrane, triangles: IntArray) -> FloatArray:
    """Area times the shares of a triangle's own strain and its neighbours', of some (n,) [m2], shape (n, 4)."""
    shares = np.concatenate([membrane.own[triangles, None], membrane.share[triangles]], axis=1)
    return membrane.area[triangles, None] * shares


def membrane_in_rows(
    membrane: Membrane, vertices: int, dtype: type[np.floating], spare: Spare = None
) -> tuple[MeshMembrane, IntArray, Rows]:
    """The same, with the corners of triangles (T, 3), owners first, and where they stand; with room where any are
    spare."""
    owned, rows = _share_out(membrane.faces, vertices)
    standing = np.zeros(len(owned), dtype=np.int64)
    standing[rows.item] = _places(rows, 1)
    every = np.arange(len(owned))
    itself, none, c = np.arange(vertices), np.zeros(vertices), membrane.stiffness
    blocks = -(-vertices // BLOCK)

    def tables(values: NDArray[Any], blank: NDArray[Any], kind: type[np.generic]) -> NDArray[Any]:
        return np.ascontiguousarray(np.stack([_table(rows, column, blank, kind) for column in values.T], axis=2))

    kept: dict[str, Any] = _room(rows.total, vertices, 2, dtype)
    kept["forces"] = np.zeros((2 * blocks * rows.total + 1) * ENDS, dtype)
    record = MeshMembrane(
        tension=Tension(float(c[0, 0]), float(c[1, 1]), float(c[0, 1]), float(c[2, 2])),
        second=_table(rows, owned[:, 1], itself, np.uint32),
        third=_table(rows, owned[:, 2], itself, np.uint32),
        slopes=tables(turned_slopes(membrane, every, owned[:, 0]), none, dtype),
        neighbours=tables(standing[membrane.neighbours], none, np.uint32),
        smoothing=tables(smoothing_of(membrane, every), none, dtype),
        shape=np.zeros(blocks * rows.total * SHAPE, dtype),
        strains=np.zeros(blocks * rows.total * ENDS, dtype),
        **_lists(rows, owned[:, 1:], vertices, apart=True, spare=spare),
        **kept,
    )
    return record, owned, rows


def mesh_air_record(cloth: Cloth, wind: FloatArray, drag: float, lift: float, dtype: type[np.floating]) -> MeshAir:
    """Lay out the triangles of a mesh in a solver's precision; `wind` [m/s] is kept, to be changed from outside.

    `drag` and `lift` are rho Cd / 12 and rho Cl / 12 [kg/m3].
    """
    return air_in_rows(cloth, wind, drag, lift, dtype)[0]


def air_in_rows(
    cloth: Cloth, wind: FloatArray, drag: float, lift: float, dtype: type[np.floating], spare: Spare = None
) -> tuple[MeshAir, IntArray, Rows]:
    """The same, with the corners of triangles (T, 3), owners first, and where they stand; with room where any are
    spare."""
    n, triangles = cloth.vertices, cloth.triangles.astype(np.int64)
    owned, rows = _share_out(triangles, n)
    itself = np.arange(n)
    record = MeshAir(
        wind=wind,
        drag=drag,
        lift=lift,
        second=_table(rows, owned[:, 1], itself, np.uint32),
        third=_table(rows, owned[:, 2], itself, np.uint32),
        **_lists(rows, owned[:, 1:], n, spare=spare),
        **_room(rows.total, n, 2, dtype),
    )
    return record, owned, rows


def _room(rows: int, vertices: int, ends: int, dtype: type[np.floating]) -> dict[str, Any]:
    """Room of the kernels: a word holds two numbers; a line of `room` so many rows of other ends, own ends and sums."""
    word, blocks = np.uint64 if np.dtype(dtype) == np.float32 else np.complex128, -(-vertices // BLOCK)
    return {
        "words": np.zeros((3, vertices), word),
        "room": np.zeros((blocks, ends * ENDS + ENDS + ENDS // 2), word),
        "forces": np.zeros((blocks * rows + 1) * 3 * BLOCK, dtype),
    }


def _share_out(items: IntArray, vertices: int, *, more: bool = False) -> tuple[IntArray, Rows]:
    """Give each item (L, m) to one of its m vertices so that all own about as many.

    Returns the items with their owner first, shape (L, m), and where they stand, with one `more` row or not.
    """
    depth = int(np.bincount(items.ravel(), minlength=vertices).max())
    owned, count = np.full((vertices, depth), len(items), dtype=np.int64), np.zeros(vertices, dtype=np.int64)
    share_items(items, BLOCK, owned, count, *(np.zeros(vertices, dtype=np.int64) for _ in range(5)))
    owned[np.arange(depth) >= count[:, None]] = len(items)
    owned.sort(axis=1)
    owner, row = np.nonzero(owned < len(items))
    item = owned[owner, row]
    place = np.argmax(items[item] == owner[:, None], axis=1)
    turned = items.copy()
    turned[item] = np.take_along_axis(
        items[item], (place[:, None] + np.arange(items.shape[1])) % items.shape[1], axis=1
    )
    used = np.maximum.reduceat(count, np.arange(0, vertices, BLOCK))
    return turned, Rows(item, row, owner, int(row.max()) + 1 + more, used)


def _table(rows: Rows, values: NDArray[Any], blank: NDArray[Any], dtype: type[np.generic]) -> NDArray[Any]:
    """Values of items (L,) in rows by block (blocks, D, BLOCK), over what vertices without item hold (N,)."""
    blocks = -(-len(blank) // BLOCK)
    padded = np.pad(blank, (0, blocks * BLOCK - len(blank))).reshape(blocks, 1, BLOCK)
    table = np.repeat(padded, rows.total, axis=1).astype(dtype)
    table[rows.owner // BLOCK, rows.row, rows.owner % BLOCK] = values[rows.item]
    return table


def _places(rows: Rows, kept: int) -> IntArray:
    """Where what items keep begins, `kept` vectors each: in the order of the items that `rows` has."""
    return (rows.owner // BLOCK * rows.total + rows.row) * kept * ENDS + rows.owner % BLOCK


def _lists(rows: Rows, others: IntArray, vertices: int, *, apart: bool = False, spare: Spare = None) -> dict[str, Any]:
    """For each vertex the places of items that others own, `others` (L, m - 1) being those who do not.

    An item keeps the same for all of these, or something for each where they are taken `apart`. Vertices are sorted
    within their blocks by the length of their lists, so that little is padded; those from `spare` on have room for
    one more than any other.
    """
    kept = others.shape[1] if apart else 1
    place = (
        _places(rows, kept)[:, None] + (np.arange(others.shape[1]) if apart else np.zeros(others.shape[1], int)) * ENDS
    )
    place, vertex = place.ravel(), others[rows.item].ravel()
    order = np.lexsort((place, vertex))
    place, vertex = place[order], vertex[order]
    count = np.bincount(vertex, minlength=vertices)
    long = count.copy()
    long[vertices if spare is None else spare :] = count.max(initial=0) + 1
    sorted_vertices = np.lexsort((long, np.arange(vertices) // BLOCK))
    slices, blocks = -(-vertices // SLICE), -(-vertices // BLOCK)
    width = np.pad(long[sorted_vertices], (0, slices * SLICE - vertices)).reshape(slices, SLICE).max(axis=1)
    start = np.concatenate([[0], np.cumsum(width * SLICE)])
    incoming = np.full(start[-1], blocks * rows.total * kept * ENDS, np.uint32)
    nth = np.arange(len(vertex)) - (np.cumsum(count) - count)[vertex]
    at = np.argsort(sorted_vertices)[vertex]
    incoming[start[at // SLICE] + at % SLICE * width[at // SLICE] + nth] = place
    return {"sorted_vertices": sorted_vertices.astype(np.uint32), "start": start, "incoming": incoming}
