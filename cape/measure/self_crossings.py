"""Where a cloth passes through itself, measured apart from what keeps it from doing so."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

EDGES = ((0, 1), (1, 2), (2, 0))  # corners of a triangle
MOST_CELLS = 2**19  # along an axis, so that three numbers of cells make one of 64 bits
STRIDE = 2**20
HALF_AROUND = ((0, 0), (0, 1), (1, -1), (1, 0), (1, 1))


def self_crossings(positions: NDArray[np.floating], triangles: NDArray[np.integer]) -> IntArray:
    """Find the pairs of triangles of which an edge of one, that has no vertex of the other, passes through that.

    Args:
        positions: of the vertices [m], shape (V, 3).
        triangles: indices of the vertices, shape (T, 3).

    Returns:
        Indices of the triangles of each pair, shape (n, 2).
    """
    corners = np.asarray(positions, dtype=float)[triangles]
    first, second = _near(corners)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    through = np.zeros(len(first), dtype=bool)
    for one, other in ((first, second), (second, first)):
        heights = np.einsum("nij,nj->ni", corners[other] - corners[one, :1], normals[one])
        below, above = heights < 0.0, heights > 0.0
        across = np.flatnonzero((below[:, 0] | below[:, 1] | below[:, 2]) & (above[:, 0] | above[:, 1] | above[:, 2]))
        one, other = one[across], other[across]
        apart = _are_apart(triangles[one], triangles[other])
        through[across] |= _is_pierced(corners[one], normals[one], corners[other], heights[across], apart)
    return np.stack([first[through], second[through]], axis=1)


def share_crossed(
    positions: NDArray[np.floating],
    triangles: NDArray[np.integer] | Callable[[int], NDArray[np.integer]],
    *,
    most: int,
) -> float:
    """Share of the frames, of at most so many evenly spaced ones, in which a cloth passes through itself.

    Args:
        positions: of the vertices in each frame [m], shape (F, V, 3).
        triangles: indices of the vertices, shape (T, 3), or what gives them for a frame.
        most: frames that are looked at.
    """
    chosen = np.unique(np.linspace(0, len(positions) - 1, min(most, len(positions))).astype(int))
    at = triangles if callable(triangles) else lambda _: triangles
    return sum(len(self_crossings(positions[frame], at(int(frame)))) > 0 for frame in chosen) / len(chosen)


def _near(corners: FloatArray) -> tuple[IntArray, IntArray]:
    """Pairs of triangles (T, 3, 3) whose upright boxes overlap, the first of each the one with the smaller index."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    middles = (low + high) / 2.0
    # Boxes overlap only where middles are no farther apart along each axis than the largest box is wide: in the same
    # cell of that size, or of a larger one where there were too many, or in neighbours.
    start, span = middles.min(axis=0), np.ptp(middles, axis=0)
    size = np.maximum((high - low).max(axis=0) * (1.0 + 1e-9), span / MOST_CELLS)
    cells = ((middles - start) / np.where(size > 0.0, size, 1.0)).astype(np.int64) + 1
    keys = (cells[:, 0] * STRIDE + cells[:, 1]) * STRIDE + cells[:, 2]
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    places = np.arange(len(keys))
    found = []
    for across, along in HALF_AROUND:  # a column of three cells each; the others have these among theirs
        middle = keys + (across * STRIDE + along) * STRIDE
        begin, end = np.searchsorted(keys, middle - 1), np.searchsorted(keys, middle + 1, side="right")
        if across == along == 0:
            begin = places + 1
        counts = np.maximum(end - begin, 0)
        others = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts - begin, counts)
        found.append(np.stack([order[np.repeat(places, counts)], order[others]]))
    first, second = np.concatenate(found, axis=1)
    for least, most in zip(np.ascontiguousarray(low.T), np.ascontiguousarray(high.T), strict=True):
        overlap = (least[first] <= most[second]) & (least[second] <= most[first])
        first, second = first[overlap], second[overlap]
    return np.minimum(first, second), np.maximum(first, second)


def _are_apart(triangles: NDArray[np.integer], others: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Tell which edges of other triangles (n, 3), each after `EDGES`, have no vertex of triangles (n, 3); (n, 3)."""
    a, b, c = triangles[:, :1], triangles[:, 1:2], triangles[:, 2:]
    common = (others == a) | (others == b) | (others == c)
    return np.stack([~(common[:, i] | common[:, j]) for i, j in EDGES], axis=1)


def _is_pierced(
    triangles: FloatArray, normals: FloatArray, others: FloatArray, heights: FloatArray, apart: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Tell of each triangle (n, 3, 3) whether one of some edges (n, 3) of its other (n, 3, 3) is through its inside.

    `heights` of the others' corners above it are along its normal (n, 3), times the length of that, shape (n, 3).
    """
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    pierced = np.zeros(len(triangles), dtype=bool)
    for k, (i, j) in enumerate(EDGES):
        candidates = np.flatnonzero(apart[:, k] & (heights[:, i] * heights[:, j] < 0.0))
        above, below = heights[candidates, i], heights[candidates, j]
        start, end = others[candidates, i], others[candidates, j]
        point = start + (above / (above - below))[:, None] * (end - start)
        inside = np.ones(len(candidates), dtype=bool)
        for u, v in ((a, b), (b, c), (c, a)):
            u, v = u[candidates], v[candidates]
            inside &= np.einsum("ni,ni->n", np.cross(v - u, point - u), normals[candidates]) > 0.0
        pierced[candidates] |= inside
    return pierced
