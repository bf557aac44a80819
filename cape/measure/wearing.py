"""How a garment sits on who wears it, from points alone: what a ray meets, and how many folds a hem falls in."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

PROMINENT = 0.01  # m that a fold stands out from the lower of the hollows beside it


def ray_hits(origins: FloatArray, directions: FloatArray, corners: FloatArray) -> FloatArray:
    """How far along each of n rays each of its triangles is met (Moeller and Trumbore 1997).

    Args:
        origins: where the rays begin [m], shape (n, 3).
        directions: where they go, of unit length, shape (n, 3).
        corners: of the triangles that each may meet [m], shape (n, T, 3, 3).

    Returns:
        The ways [m], shape (n, T), infinite where a triangle is missed, or lies behind the origin or along the ray.
    """
    along = directions[:, None]
    first, second = corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0]
    across = np.cross(along, second)
    size = np.sum(first * across, axis=2)
    off = origins[:, None] - corners[:, :, 0]
    turned = np.cross(off, first)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = np.sum(off * across, axis=2) / size, np.sum(along * turned, axis=2) / size
        way = np.sum(second * turned, axis=2) / size
        met = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (way >= 0.0)
    return np.where(met, way, np.inf)


def across(directions: FloatArray) -> FloatArray:
    """Two directions across each of n of unit length, at right angles to it and each other, shape (n, 2, 3)."""
    least = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    aside = np.cross(directions, least)
    return np.stack([aside, np.cross(directions, aside)], axis=1)


def near_ray(
    origin: FloatArray, aside: FloatArray, positions: NDArray[np.floating], triangles: NDArray[np.integer]
) -> IntArray:
    """The triangles that a ray may meet: those whose corners aren't all on one side of it, as seen along it.

    Args:
        origin: where it begins [m], shape (3,).
        aside: two directions `across` it, shape (2, 3).
        positions: of the vertices [m], shape (V, 3).
        triangles: three vertices each, shape (T, 3).
    """
    x, y = aside @ (positions - origin).T
    sides = (x > 0.0) | (x < 0.0) << np.uint8(1) | (y > 0.0) << np.uint8(2) | (y < 0.0) << np.uint8(3)  # a bit each
    a, b, c = triangles.T
    return np.flatnonzero((sides[a] & sides[b] & sides[c]) == 0)


def folds(hem: FloatArray, origin: FloatArray, axis: FloatArray, *, closed: bool = False) -> int:
    """In how many folds a hem falls: the prominent maxima of its distance from an axis.

    Args:
        hem: its points in their order [m], shape (n, 3).
        origin: a point of the axis [m], shape (3,).
        axis: its direction, of unit length, shape (3,).
        closed: whether the last point is the neighbour of the first.
    """
    off = hem - origin
    return len(prominent_maxima(np.linalg.norm(off - (off @ axis)[:, None] * axis, axis=1), PROMINENT, closed=closed))


def prominent_maxima(values: FloatArray, least: float, *, closed: bool = False) -> IntArray:
    """Indices of the maxima of n values, shape (n,), that stand out by `least` or more.

    A maximum's prominence is its height above the higher one of two least values, to either side of it as far as to a
    higher value or the end. Ends are no maxima; of a flat top the first value is taken. The values of a ring are
    `closed`: the last one is the neighbour of the first.
    """
    if closed:
        turn = int(values.argmin())
        found = prominent_maxima(np.append(np.roll(values, -turn), values[turn]), least)
        return np.sort((found + turn) % len(values))
    chosen = []
    for k in range(1, len(values) - 1):
        after = values[k + 1 :][values[k + 1 :] != values[k]]
        if values[k - 1] >= values[k] or not len(after) or after[0] > values[k]:
            continue
        higher = np.flatnonzero(values > values[k])
        left = values[higher[higher < k].max(initial=-1) + 1 : k].min()
        right = values[k + 1 : higher[higher > k].min(initial=len(values))].min()
        if values[k] - max(left, right) >= least:
            chosen.append(k)
    return np.array(chosen, dtype=np.int64)
