"""How alike two stretches of motion are, wherever they take place and whichever way they face."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def window_distances(a: FloatArray, b: FloatArray, window: int) -> tuple[FloatArray, FloatArray]:
    """Distance of every window of one motion from every window of another, the second turned and moved to fit best.

    A window is a cloud of all points over some consecutive frames, so that it holds the points' velocities as well. Two
    of them are compared by the root of the mean squared distance of their points, where the second has been turned
    about the vertical and moved over the ground so that this is least. L. Kovar, M. Gleicher and F. Pighin, "Motion
    Graphs", ACM Trans. Graph. 21 (2002), section 3.1, eq. 1 with equal weights, and eq. 2 for the turn.

    Args:
        a: points of one motion [m], Z up, shape (F, P, 3).
        b: the same points in the other motion [m], shape (G, P, 3).
        window: number of frames K in a window, at most F and G.

    Returns:
        Distances [m] and headings [rad], the turns from b to a counter-clockwise about +Z in (-pi, pi], both of the
        shape (F - K + 1, G - K + 1), by the first frames of the windows.
    """
    count = window * a.shape[1]
    # Near the origin the differences of squares below keep their digits.
    ground_a, ground_b = _ground(a), _ground(b)
    squares = _along((np.abs(ground_a) ** 2 + a[..., 2] ** 2).sum(axis=1), window)[:, None] + _along(
        (np.abs(ground_b) ** 2 + b[..., 2] ** 2).sum(axis=1), window
    )
    products = _diagonally(ground_a @ ground_b.conj().T, window)
    heights = _diagonally(a[..., 2] @ b[..., 2].T, window)
    sums_a, sums_b = _along(ground_a.sum(axis=1), window)[:, None], _along(ground_b.sum(axis=1), window)
    turns = products - sums_a * sums_b.conj() / count
    least = squares - (np.abs(sums_a) ** 2 + np.abs(sums_b) ** 2) / count - 2 * heights - 2 * np.abs(turns)
    return np.sqrt(np.maximum(least, 0.0) / count), np.angle(turns)


def _ground(points: FloatArray) -> NDArray[np.complex128]:
    """Places on the ground as complex numbers x + iy about the middle of all [m], shape (F, P)."""
    places = points[..., 0] + 1j * points[..., 1]
    return places - places.mean()


def _along(values: NDArray, window: int) -> NDArray:
    """Sums over windows of consecutive values, shape (F,) to (F - K + 1,)."""
    total = np.zeros(len(values) - window + 1, dtype=values.dtype)
    for k in range(window):
        total += values[k : len(total) + k]
    return total


def _diagonally(values: NDArray, window: int) -> NDArray:
    """Sums over windows that advance in both directions at once, shape (F, G) to (F - K + 1, G - K + 1)."""
    rows, columns = (size - window + 1 for size in values.shape)
    total = np.zeros((rows, columns), dtype=values.dtype)
    for k in range(window):
        total += values[k : rows + k, k : columns + k]
    return total
