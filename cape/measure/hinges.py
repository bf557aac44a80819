"""Whether parts of a cloth hang together by a single vertex, as no thread could hold them."""

import numpy as np
from numpy.typing import NDArray

from cape.assembly.self_contact import connected_pieces


def hinges(triangles: NDArray[np.integer]) -> int:
    """How many more fans of triangles (T, 3), which hang together by edges, there are than vertices in their middle."""
    if not len(triangles):
        return 0
    ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    corners = np.arange(triangles.size).reshape(triangles.shape)
    corners = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    lower = np.argsort(ends, axis=1, kind="stable")
    ends, corners = np.take_along_axis(ends, lower, axis=1), np.take_along_axis(corners, lower, axis=1)
    order = np.lexsort(ends.T)
    shared = (ends[order[1:]] == ends[order[:-1]]).all(axis=1)
    # Two triangles at an edge have their corners at each end of it in common.
    first, second = corners[order[:-1][shared]].ravel(), corners[order[1:][shared]].ravel()
    fans = connected_pieces(np.stack([first, second, second], axis=1), triangles.size)
    return int(fans.max()) + 1 - len(np.unique(triangles))
