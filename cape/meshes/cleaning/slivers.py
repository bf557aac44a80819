"""Triangles so thin that they would be stiff beyond measure: their shortest sides shrink to a point, or their longest
side goes to the other diagonal of the two triangles that share it."""

import numpy as np
from numpy.typing import NDArray

from cape.meshes.source import IntArray, Source

FloatArray = NDArray[np.float64]

SHORT = 0.02  # of the median side: shorter ones shrink to a point
THIN = 0.02  # height over longest side of a triangle: less is a sliver
ROUNDS = 8


def without_slivers(source: Source) -> Source:
    """Take slivers out of a mesh without opening it, as far as its edges allow; a note tells how many were touched."""
    touched = 0
    for _ in range(ROUNDS):
        source, shrunk = _without_short_sides(source)
        triangles, turned = _without_flat(source.triangles, source.positions)
        if not shrunk + turned:
            break
        touched += shrunk + turned
        source = source.of_vertices(np.arange(len(source.positions)), triangles)
    if not touched:
        return source
    return source.of_vertices(np.arange(len(source.positions)), source.triangles, f"{touched} slivers taken out")


def _without_short_sides(source: Source) -> tuple[Source, int]:
    """Shrink short sides to their lower vertex, and drop the triangles that vanish; gives how many did."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    triangles, count = source.triangles, len(source.positions)
    ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    lengths = np.linalg.norm(np.diff(source.positions[ends], axis=1)[:, 0], axis=1)
    short = ends[lengths < SHORT * np.median(lengths)]
    if not len(short):
        return source, 0
    graph = coo_matrix((np.ones(len(short)), (short[:, 0], short[:, 1])), shape=(count, count))
    group = connected_components(graph, directed=False)[1]
    lowest = np.unique(group, return_index=True)[1]
    shrunk = lowest[group][triangles]
    whole = (shrunk != np.roll(shrunk, 1, axis=1)).all(axis=1)
    if not whole.any():
        return source, 0
    return source.of_vertices(np.arange(count), shrunk[whole]), int(np.count_nonzero(~whole))


def _without_flat(triangles: IntArray, positions: FloatArray) -> tuple[IntArray, int]:
    """Turn the longest sides of flat triangles, and drop those whose longest side is a border; gives how many were."""
    corners = positions[triangles]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    doubled = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    flat = np.flatnonzero(doubled < THIN * sides.max(axis=1) ** 2)
    if not len(flat):
        return triangles, 0
    faces: list[list[int] | None] = triangles.tolist()
    of_edge: dict[tuple[int, int], set[int]] = {}
    for number, face in enumerate(triangles.tolist()):
        for edge in _edges(face):
            of_edge.setdefault(edge, set()).add(number)
    turned, seen = 0, set()
    for number in flat[np.argsort(doubled[flat], kind="stable")].tolist():
        face = faces[number]
        if face is None or number in seen:
            continue
        start = int(sides[number].argmax())
        first, second, apex = (face[(start + k) % 3] for k in range(3))
        beside = of_edge[_edge(first, second)] - {number}
        if not beside:
            faces[number] = None
            turned += 1
            continue
        other = min(beside)
        if len(beside) > 1 or other in seen or faces[other] is None:
            continue
        far = next(v for v in faces[other] or () if v not in (first, second))
        if _edge(apex, far) in of_edge:
            continue
        faces[number], faces[other] = [first, far, apex], [far, second, apex]
        of_edge[_edge(apex, far)] = {number, other}
        seen |= {number, other}
        turned += 1
    return np.array([face for face in faces if face is not None], dtype=np.int64).reshape(-1, 3), turned


def _edges(face: list[int]) -> list[tuple[int, int]]:
    return [_edge(face[k - 1], face[k]) for k in range(3)]


def _edge(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)
