"""Signed distances from shapes, many points at once, sharing nothing with the package's own."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def capsule_distance(points: FloatArray, start: ArrayLike, end: ArrayLike, radius: float) -> FloatArray:
    """Distance of points (N, 3) from a capsule's surface [m], negative inside, shape (N,).

    The least of the distances from both ends and, between them, from the axis as a line.
    """
    a, b = np.asarray(start, float), np.asarray(end, float)
    nearest = np.minimum(np.linalg.norm(points - a, axis=1), np.linalg.norm(points - b, axis=1))
    length = float(np.linalg.norm(b - a))
    if length > 0:
        axis = (b - a) / length
        along = (points - a) @ axis
        off_axis = np.linalg.norm(np.cross(points - a, axis), axis=1)
        nearest = np.where((along >= 0) & (along <= length), off_axis, nearest)
    return nearest - radius


def box_distance(points: FloatArray, halves: ArrayLike) -> FloatArray:
    """Distance of points (N, 3), in the box's own frame, from its surface [m], negative inside, shape (N,)."""
    beyond = np.abs(points) - np.asarray(halves, float)
    outside = np.linalg.norm(np.clip(beyond, 0, None), axis=1)
    return np.where((beyond <= 0).all(axis=1), beyond.max(axis=1), outside)
