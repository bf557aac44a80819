"""What makes a mesh a cloth: finite, merged, of triangles with an area, two at an edge, turned alike, and whole."""

import numpy as np

from cape.cloth.triangle_mesh import SMALLEST, Edges, edges_of
from cape.meshes.cleaning.slivers import without_slivers
from cape.meshes.source import IntArray, Source
from motions.errors import ValueRangeError
from motions.limits import LARGEST_NUMBER, MOST_MESH_TRIANGLES

TOGETHER = 1e-6  # of the mesh's extent: vertices nearer than this are one
SMALLEST_PART = 0.1  # of the area of the largest part: smaller ones are buttons and crumbs
LISTED = 3  # places that an error names


def clean(source: Source) -> Source:
    """Make a mesh a cloth; its notes tell what was done.

    Raises:
        ValueRangeError: a vertex is not finite, there is no triangle with an area, an edge belongs to more than two
            triangles, the surface has one side only, or it is too large; with the places.
    """
    if len(source.triangles) > MOST_MESH_TRIANGLES:
        raise ValueRangeError(f"the mesh has {len(source.triangles)} triangles, more than {MOST_MESH_TRIANGLES}")
    source = source.compact()
    bad = np.flatnonzero(~(np.abs(source.positions) <= LARGEST_NUMBER).all(axis=1))
    if len(bad):
        raise ValueRangeError(f"{len(bad)} vertices of the mesh are not finite or beyond reason, the first is {bad[0]}")
    source = _merged(source)
    source = _with_area(without_slivers(_single(_with_area(source))))
    source = _single(source).compact()
    _require_two_at_an_edge(source)
    return _whole(_turned_alike(source))


def parts_of(triangles: IntArray, vertices: int) -> IntArray:
    """The number of the connected part of each vertex, shape (V,)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    first, second = triangles[:, [0, 1]].ravel(), triangles[:, [1, 2]].ravel()
    graph = coo_matrix((np.ones(len(first)), (first, second)), shape=(vertices, vertices))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _merged(source: Source) -> Source:
    """Make one of vertices at one place: weights are the largest of theirs, texture coordinates those of the first."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    points, of = np.unique(source.positions, axis=0, return_inverse=True)
    extent = float(np.ptp(points, axis=0).max())
    if extent < SMALLEST:
        raise ValueRangeError(f"the mesh reaches {extent:.3g} m: positions are in metres")
    pairs = KDTree(points).query_pairs(TOGETHER * extent, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    group = connected_components(graph, directed=False)[1][of.ravel()]
    _, first, number = np.unique(group, return_index=True, return_inverse=True)
    number, count = number.ravel(), len(first)
    if count == len(source.positions):
        return source
    order = np.argsort(first, kind="stable")  # in the order of the file
    place = np.empty_like(order)
    place[order] = np.arange(count)
    number = place[number]
    weights = {}
    for name, values in source.weights.items():
        weights[name] = np.zeros(count)
        np.maximum.at(weights[name], number, values)
    note = f"{len(source.positions) - count} vertices at the place of another merged with it"
    merged = source.of_vertices(first[order], number[source.triangles], note)
    merged.weights.update(weights)  # pyright: ignore[reportAttributeAccessIssue]
    return merged


def _with_area(source: Source) -> Source:
    """Leave triangles without an area out.

    Raises:
        ValueRangeError: there is no other one.
    """
    corners = source.positions[source.triangles]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2.0
    good = area > 1e-6 * sides**2
    if not good.any():
        raise ValueRangeError("the mesh has no triangle with an area")
    if good.all():
        return source
    note = f"{np.count_nonzero(~good)} triangles without area dropped"
    return source.of_vertices(np.arange(len(source.positions)), source.triangles[good], note)


def _single(source: Source) -> Source:
    """Leave triangles out that are there already, whichever way round."""
    _, first = np.unique(np.sort(source.triangles, axis=1), axis=0, return_index=True)
    if len(first) == len(source.triangles):
        return source
    note = f"{len(source.triangles) - len(first)} triangles that were there twice dropped"
    return source.of_vertices(np.arange(len(source.positions)), source.triangles[np.sort(first)], note)


def _require_two_at_an_edge(source: Source) -> None:
    edges = edges_of(source.triangles)
    crowded = np.flatnonzero(edges.triangles > 2)
    if not len(crowded):
        return
    places = source.positions[edges.vertices[crowded[:LISTED]]].mean(axis=1)
    told = "; ".join(f"{edges.triangles[e]} at {_place(p)}" for e, p in zip(crowded, places, strict=False))
    more = f", and {len(crowded) - LISTED} more" if len(crowded) > LISTED else ""
    raise ValueRangeError(f"{len(crowded)} edges of the mesh belong to more than two triangles: {told}{more}")


def _turned_alike(source: Source) -> Source:
    """Turn triangles so that neighbours agree on the outside; in each part the larger area keeps its own.

    Raises:
        ValueRangeError: a part has one side only, as a Möbius strip.
    """
    edges = edges_of(source.triangles)
    flipped, of = _flips(edges, source.triangles)
    if not flipped.any():
        return source
    corners = source.positions[source.triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    wrong = np.bincount(of, weights=area * flipped) > 0.5 * np.bincount(of, weights=area)
    flipped ^= wrong[of]
    first, second = (edges.sides // 3).T
    if (odd := _alike(edges, source.triangles) ^ flipped[first] ^ flipped[second]).any():
        place = source.positions[edges.vertices[edges.interior[np.flatnonzero(odd)[0]]]].mean(axis=0)
        raise ValueRangeError(f"the surface has one side only: it can't be told which is outside at {_place(place)}")
    triangles = source.triangles.copy()
    triangles[flipped] = triangles[flipped][:, ::-1]
    notes = (f"{np.count_nonzero(flipped)} triangles turned to face as their neighbours",) if flipped.any() else ()
    return source.of_vertices(np.arange(len(source.positions)), triangles, *notes)


def _alike(edges: Edges, triangles: IntArray) -> np.ndarray:
    """Whether the two triangles of each interior edge go along it the same way, so that one is turned wrong, (I,)."""
    starts = triangles.ravel()[edges.sides]
    return starts[:, 0] == starts[:, 1]


def _flips(edges: Edges, triangles: IntArray) -> tuple[np.ndarray, IntArray]:
    """Which triangles must be turned to agree with the first of their part, and the number of that part, (T,) each."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    count = len(triangles)
    first, second = (edges.sides // 3).T
    # 1 for neighbours that agree and 2 for those that do not, as no edge of a sparse graph may be 0.
    values = 1 + _alike(edges, triangles).astype(np.int64)
    both = (np.concatenate([values, values]), (np.concatenate([first, second]), np.concatenate([second, first])))
    graph = coo_matrix(both, shape=(count, count)).tocsr()
    of = connected_components(graph, directed=False)[1].astype(np.int64)
    flipped = np.zeros(count, dtype=bool)
    for seed in np.unique(of, return_index=True)[1]:
        order, before = breadth_first_order(graph, seed, directed=False)
        if len(order) > 1:
            parents = before[order[1:]]
            turns = np.asarray(graph[order[1:], parents]).ravel() % 2 == 0
            for triangle, parent, turn in zip(order[1:].tolist(), parents.tolist(), turns.tolist(), strict=True):
                flipped[triangle] = flipped[parent] ^ turn
    return flipped, of


def _whole(source: Source) -> Source:
    """Drop parts that are small beside the largest."""
    part = parts_of(source.triangles, len(source.positions))[source.triangles[:, 0]]
    corners = source.positions[source.triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    areas = np.bincount(part, weights=area)
    kept = areas >= SMALLEST_PART * areas.max()
    if kept.all():
        return source
    note = f"{np.count_nonzero(~kept)} loose parts, each smaller than {SMALLEST_PART:.0%} of the largest, dropped"
    return source.of_vertices(np.arange(len(source.positions)), source.triangles[kept[part]], note).compact()


def _place(point: np.ndarray) -> str:
    """A place as an error names it [m]."""
    return "(" + ", ".join(f"{value:.3g}" for value in point) + ")"
