"""Vertex normals of a moving triangle mesh."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

# Frames worked on at once: each triangle's coordinates over the block lie side by side, so that gathering a triangle
# copies one run of memory, and the arrays of 32 frames of a cape of 1,500 vertices (600 kB each) stay in the cache.
FRAMES_PER_BLOCK = 32


def vertex_normals(positions: NDArray[np.floating], triangles: NDArray[np.integer]) -> NDArray[np.float32]:
    """Average the normals of the triangles around each vertex, weighted by their areas.

    The area vectors (half the cross product of two edges) of the triangles that meet at a vertex are summed and the sum
    is scaled to length one. A triangle without area adds nothing; a vertex whose sum vanishes (none but degenerate
    triangles, no triangle at all, or two that cancel out) gets +Z.

    Args:
        positions: of the V vertices over F frames [m], finite, shape (F, V, 3).
        triangles: vertex indices, counter-clockwise seen from outside, shape (T, 3).

    Returns:
        Unit normals in the frame of the positions, shape (F, V, 3).
    """
    around = _triangles_around_vertices(triangles, positions.shape[1])
    normals = np.empty(positions.shape, np.float32)
    for first in range(0, len(positions), FRAMES_PER_BLOCK):
        block = slice(first, first + FRAMES_PER_BLOCK)
        # (3, V, frames): one array per coordinate, a vertex's frames side by side.
        coordinates = np.ascontiguousarray(positions[block].transpose(2, 1, 0), np.float32)
        sums = [_sum_around(area, around) for area in _area_vectors(coordinates, triangles)]
        lengths = np.sqrt(sums[0] ** 2 + sums[1] ** 2 + sums[2] ** 2)
        flat = lengths <= np.finfo(np.float32).tiny ** 0.5
        lengths[flat] = 1.0
        for axis, (total, fallback) in enumerate(zip(sums, (0.0, 0.0, 1.0), strict=True)):
            total /= lengths
            total[flat] = fallback
            normals[block, :, axis] = total.T
    return normals


def _area_vectors(coordinates: NDArray[np.float32], triangles: NDArray[np.integer]) -> list[NDArray[Any]]:
    """Twice the area vectors, coordinate by coordinate: three arrays of shape (T + 1, frames), the last row zero."""
    a, b, c = (coordinates[:, triangles[:, corner]] for corner in range(3))
    u, v = b - a, c - a
    areas = []
    for axis in range(3):
        j, k = (axis + 1) % 3, (axis + 2) % 3
        area = np.zeros((len(triangles) + 1, coordinates.shape[2]), np.float32)
        area[:-1] = u[j] * v[k] - u[k] * v[j]
        areas.append(area)
    return areas


def _sum_around(area: NDArray[np.float32], around: NDArray[np.int64]) -> NDArray[np.float32]:
    """Sum the rows of `area` (T + 1, frames) that each row of `around` (V, K) names, in shape (V, frames)."""
    total = np.zeros((len(around), area.shape[1]), np.float32)
    for column in around.T:
        total += area[column]
    return total


def _triangles_around_vertices(triangles: NDArray[np.integer], vertices: int) -> NDArray[np.int64]:
    """Indices of the triangles that meet at each vertex, shape (V, K), filled up with T where there are fewer."""
    corners = np.asarray(triangles).ravel()
    by_vertex = np.argsort(corners, kind="stable")
    counts = np.bincount(corners, minlength=vertices)
    rank = np.arange(len(corners)) - np.repeat(np.cumsum(counts) - counts, counts)
    around = np.full((vertices, counts.max(initial=0)), len(triangles), np.int64)
    around[corners[by_vertex], rank] = by_vertex // 3
    return around
