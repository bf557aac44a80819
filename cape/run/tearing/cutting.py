"""Cuts that are made by hand before a cloth is worn: along a line in space, or in its pattern."""

import heapq
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.cloth.cloth import Cloth, GridCloth, MeshCloth
from cape.cloth.meshing import as_mesh
from cape.run.tearing.sheets import sheet_of, split_mesh
from cape.run.tearing.tears import edges_along
from motions.border import checked
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@checked
def cut(cloth: Cloth, *, along: ArrayLike) -> MeshCloth:
    """Cut a cloth along its edges next to a line; a line that ends within it leaves a slit, a closed one a piece loose.

    The first vertices are those that there were, so that regions, and what was attached by index, stay; those that the
    cut adds come behind them, each in the regions of the one that it splits off from.

    Args:
        cloth: what to cut.
        along: points of the line: where the cloth starts [m], shape (n, 3), or in its pattern [m], shape (n, 2).

    Raises:
        ValueRangeError: the line has fewer than two points, or of another shape, a number is not finite, or nothing
            parts, as where a cut of a single edge ends within the cloth on both sides.
    """
    line = np.asarray(along, dtype=float)
    if line.ndim != 2 or len(line) < 2 or line.shape[1] not in (2, 3) or not np.isfinite(line).all():
        raise ValueRangeError(
            "a cut leads along at least two points with three finite coordinates, or two in a pattern"
        )
    mesh = as_mesh(cloth) if isinstance(cloth, GridCloth) else cloth
    if not isinstance(mesh, MeshCloth):
        raise TypeError(f"a {type(cloth).__name__} can't be cut")
    sheet = sheet_of(mesh, np.zeros(mesh.vertices, bool))
    places = mesh.positions if line.shape[1] == 3 else mesh.pattern
    parted, copies = sheet.split(edges_along(sheet, _path(mesh, places, line)))
    if not len(copies):
        raise ValueRangeError("nothing parts: a cut of one edge needs an end at a border of the cloth")
    split = split_mesh(mesh, parted, copies)
    regions = {
        name: np.concatenate([held, mesh.vertices + np.flatnonzero(np.isin(copies, held))])
        for name, held in mesh.regions.items()
    }
    return replace(split, regions=regions)


def _path(mesh: MeshCloth, places: FloatArray, line: FloatArray) -> IntArray:
    """Vertices along edges from the one nearest to a line's first point to that nearest to its last, shape (n,)."""
    ends = np.sort(np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges = np.unique(ends, axis=0)
    path: list[int] = []
    for first, second in pairwise(line):
        begin, end = (int(np.linalg.norm(places - point, axis=1).argmin()) for point in (first, second))
        path += _shortest(places, edges, begin, end, (first, second))[len(path) > 0 :]
    if len(path) < 2:
        raise ValueRangeError("the cut is shorter than an edge of the cloth")
    return np.array(path)


def _shortest(
    places: FloatArray, edges: IntArray, begin: int, end: int, line: tuple[FloatArray, FloatArray]
) -> list[int]:
    """The way along edges (E, 2) from a vertex to another that sweeps the least area beside a straight line.

    Dijkstra's algorithm; an edge costs its length times its distance from the line, and a little more for its length.
    """
    way = line[1] - line[0]
    share = np.clip((places - line[0]) @ way / max(float(way @ way), 1e-30), 0.0, 1.0)
    off = np.linalg.norm(places - line[0] - share[:, None] * way, axis=1)
    lengths = np.linalg.norm(places[edges[:, 1]] - places[edges[:, 0]], axis=1)
    costs = lengths * (off[edges].mean(axis=1) + 1e-3 * lengths.mean())
    near: list[list[tuple[int, float]]] = [[] for _ in places]
    for (a, b), cost in zip(edges.tolist(), costs.tolist(), strict=True):
        near[a].append((b, cost))
        near[b].append((a, cost))
    best, before, heap = {begin: 0.0}, {begin: begin}, [(0.0, begin)]
    while heap:
        cost, vertex = heapq.heappop(heap)
        if vertex == end:
            break
        for other, more in near[vertex]:
            if cost + more < best.get(other, np.inf):
                best[other], before[other] = cost + more, vertex
                heapq.heappush(heap, (cost + more, other))
    if end not in before:
        raise ValueRangeError("the cut leads from one piece of the cloth to another: no edges lead there")
    path = [end]
    while path[-1] != begin:
        path.append(before[path[-1]])
    return path[::-1]
