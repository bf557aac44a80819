"""Which triangle is nearest to a point, and where on it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MOST_PAIRS = 2_000_000  # of a point and a triangle that are looked at together


class Nearest(NamedTuple):
    """Of n points the nearest triangle (n,), the barycentric coordinates there (n, 3), and the distance [m] (n,)."""

    triangles: IntArray
    shares: FloatArray
    distances: FloatArray


def nearest_on(points: FloatArray, positions: FloatArray, triangles: IntArray) -> Nearest:
    """The nearest places of a mesh, whose triangles all have an area; the first of those at one distance.

    A triangle at distance d from a point has its middle within d and its own reach, and the triangle with the nearest
    middle bounds d: those within that much are looked at.

    Args:
        points: [m], shape (n, 3).
        positions: of the mesh [m], shape (V, 3).
        triangles: shape (T, 3).
    """
    from scipy.spatial import KDTree

    corners = positions[triangles]
    middles = corners.mean(axis=1)
    reach = np.linalg.norm(corners - middles[:, None], axis=2).max()
    tree = KDTree(middles)
    first = np.asarray(tree.query(points)[1], dtype=np.int64)
    bounds = np.linalg.norm(points - _on(points, corners[first])[0], axis=1)
    found = Nearest(first.copy(), np.zeros((len(points), 3)), np.zeros(len(points)))
    counts = np.asarray(tree.query_ball_point(points, bounds * (1.0 + 1e-9) + reach, return_length=True))
    block = np.cumsum(counts) // MOST_PAIRS
    for number in np.unique(block):
        rows = np.flatnonzero(block == number)
        lists = tree.query_ball_point(points[rows], bounds[rows] * (1.0 + 1e-9) + reach, return_sorted=True)
        near = np.concatenate([np.asarray(each, dtype=np.int64) for each in lists])
        of = np.repeat(np.arange(len(rows)), [len(each) for each in lists])
        places, shares = _on(points[rows][of], corners[near])
        off = np.linalg.norm(points[rows][of] - places, axis=1)
        order = np.lexsort((near, off, of))
        best = order[np.unique(of[order], return_index=True)[1]]
        found.triangles[rows], found.shares[rows], found.distances[rows] = near[best], shares[best], off[best]
    return found


def _on(points: FloatArray, corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The nearest place of a triangle to a point and its barycentric coordinates, for n of both, (n, 3) each.

    Inside where the point's projection is, otherwise on the nearest of the three sides.
    """
    shares = barycentric(points, corners)
    outside = (shares < 0.0).any(axis=1)
    least = np.full(len(points), np.inf)
    for first, second in ((0, 1), (1, 2), (2, 0)):
        start, way = corners[:, first], corners[:, second] - corners[:, first]
        along = np.clip(np.sum((points - start) * way, axis=1) / np.sum(way * way, axis=1), 0.0, 1.0)
        off = np.linalg.norm(points - start - along[:, None] * way, axis=1)
        nearer = outside & (off < least)
        least[nearer] = off[nearer]
        shares[nearer] = 0.0
        shares[nearer, first], shares[nearer, second] = 1.0 - along[nearer], along[nearer]
    return np.einsum("nc,nck->nk", shares, corners), shares


def barycentric(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Barycentric coordinates of the projections of n points to the planes of triangles (n, 3, 3), shape (n, 3)."""
    p, q, r = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], points - corners[:, 0]
    normal = np.cross(p, q)
    squared = np.sum(normal * normal, axis=1)
    v = np.sum(np.cross(r, q) * normal, axis=1) / squared
    w = np.sum(np.cross(p, r) * normal, axis=1) / squared
    return np.stack([1.0 - v - w, v, w], axis=1)
