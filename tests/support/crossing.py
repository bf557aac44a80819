"""Where a triangle mesh passes through itself."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree


def crossings(positions: NDArray[np.floating], triangles: NDArray[np.integer]) -> int:
    """Number of edges and triangles without a common vertex of which one passes through the other."""
    p = np.asarray(positions, dtype=float)
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64), axis=1)
    edges = np.stack(np.divmod(np.unique(sides[:, 0] * len(p) + sides[:, 1]), len(p)), axis=1)
    edge, triangle = _overlapping(p[edges], p[triangles])
    apart = ~(edges[edge][:, :, None] == triangles[triangle][:, None, :]).any(axis=(1, 2))
    edge, triangle = edge[apart], triangle[apart]
    start, end = p[edges[edge, 0]], p[edges[edge, 1]]
    corners = p[triangles[triangle]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    above = np.einsum("nk,nk->n", start - corners[:, 0], normal)
    below = np.einsum("nk,nk->n", end - corners[:, 0], normal)
    through = above * below < 0.0
    start, end, corners, normal = start[through], end[through], corners[through], normal[through]
    share = above[through] / (above[through] - below[through])
    hit = start + share[:, None] * (end - start)
    inside = np.ones(len(hit), dtype=bool)
    for k in range(3):
        side = np.cross(corners[:, (k + 1) % 3] - corners[:, k], hit - corners[:, k])
        inside &= np.einsum("nk,nk->n", side, normal) > 0.0
    return int(inside.sum())


def _overlapping(edges: NDArray[np.floating], triangles: NDArray[np.floating]) -> tuple[NDArray, NDArray]:
    """Edges (E, 2, 3) and triangles (T, 3, 3) whose boxes overlap, of those whose middles are near enough for it."""
    (low, high), (least, most) = ((corners.min(axis=1), corners.max(axis=1)) for corners in (edges, triangles))
    reach = sum(np.linalg.norm(to - fro, axis=1).max() / 2 for fro, to in ((low, high), (least, most)))
    middles, others = (KDTree((fro + to) / 2) for fro, to in ((low, high), (least, most)))
    near = middles.sparse_distance_matrix(others, (1.0 + 1e-9) * reach, output_type="ndarray")
    edge, triangle = near["i"], near["j"]
    overlap = ((low[edge] <= most[triangle]) & (least[triangle] <= high[edge])).all(axis=1)
    return edge[overlap], triangle[overlap]
