"""Joints spread over a cloth, and the chains that they form from where it is held to its hem."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Joints:
    """K joints on a cloth of V vertices.

    Attributes:
        vertices: that the joints are at, those nearest to where it is held first, shape (K,).
        parents: of each joint, always an earlier one, -1 for the first of a chain, shape (K,).
        distances: from each joint to each vertex along the cloth [m], infinite where nothing leads there, shape (K, V).
    """

    vertices: NDArray[np.intp]
    parents: NDArray[np.intp]
    distances: NDArray[np.float64]


def spread(places: NDArray[np.float64], triangles: NDArray[np.int32], held: NDArray[np.int64], count: int) -> Joints:
    """Joints as far from each other as can be, each on the one next to it that is nearer to where the cloth is held.

    Args:
        places: of the vertices [m], shape (V, 3).
        triangles: vertex indices, shape (T, 3).
        held: vertices that are held; the highest one counts where there are none.
        count: how many joints, at most V.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    edges = np.unique(
        np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])), axis=0
    )
    lengths = np.linalg.norm(places[edges[:, 0]] - places[edges[:, 1]], axis=1)
    # An edge of no length would be none to what finds the ways.
    ways = coo_array((np.maximum(lengths, 1e-9), (edges[:, 0], edges[:, 1])), shape=(len(places),) * 2).tocsr()

    def from_vertices(indices: NDArray[np.intp], *, nearest: bool) -> NDArray[np.float64]:
        return np.asarray(dijkstra(ways, directed=False, indices=indices, min_only=nearest))

    tops = held if len(held) else np.array([places[:, 2].argmax()])
    depth = from_vertices(tops, nearest=True)
    chosen = [int(tops[np.linalg.norm(places[tops] - places[tops].mean(axis=0), axis=1).argmin()])]
    distances = [from_vertices(np.array(chosen), nearest=True)]
    while len(chosen) < count:
        chosen.append(int(np.min(distances, axis=0).argmax()))
        distances.append(from_vertices(np.array(chosen[-1:]), nearest=True))
    found = np.array(chosen)
    order = np.lexsort((found, depth[found]))
    vertices, reached = found[order], np.array(distances)[order]
    parents = np.full(count, -1)
    for k in range(1, count):
        before = reached[:k, vertices[k]]
        parents[k] = before.argmin() if np.isfinite(before.min()) else -1
    return Joints(vertices, parents, reached)
