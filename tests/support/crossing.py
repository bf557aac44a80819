"""Where a triangle mesh passes through itself."""

import numpy as np
from numpy.typing import NDArray


def crossings(positions: NDArray[np.floating], triangles: NDArray[np.integer]) -> int:
    """Number of edges and triangles without a common vertex of which one passes through the other."""
    p = np.asarray(positions, dtype=float)
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges = np.unique(sides, axis=0)
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
    """Edges and triangles whose boxes overlap."""
    overlap = np.ones((len(edges), len(triangles)), dtype=bool)
    for axis in range(3):
        e, t = edges[..., axis], triangles[..., axis]
        overlap &= e.min(axis=1)[:, None] <= t.max(axis=1)
        overlap &= t.min(axis=1) <= e.max(axis=1)[:, None]
    edge, triangle = np.nonzero(overlap)
    return edge, triangle
