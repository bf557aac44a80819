"""The borders of a mesh, and which part of them lies on top."""

import numpy as np
from numpy.typing import NDArray

from cape.cloth.triangle_mesh import edges_of
from cape.meshes.cleaning.clean import parts_of

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BAND = 0.03  # m below its highest place that belongs to a top edge


def borders(triangles: NDArray[np.integer]) -> list[IntArray]:
    """Vertices of each connected border, in ascending order; none for a closed surface."""
    edges = edges_of(triangles)
    ends = edges.vertices[edges.triangles == 1]
    if not len(ends):
        return []
    part = parts_of(ends[:, [0, 1, 1]], int(triangles.max()) + 1)
    vertices = np.unique(ends)
    return [vertices[part[vertices] == number] for number in np.unique(part[vertices])]


def top_edge(positions: FloatArray, triangles: NDArray[np.integer]) -> IntArray:
    """Border vertices of the topmost border that lie at most 3 cm below its highest place; none for a closed surface.

    Where the border is one, as that of a cape open in front, this is its upper end. The topmost is the one whose
    vertices are the highest in the mean: a neckline, not the arms' ends that hang beside it.

    Args:
        positions: z up [m], shape (V, 3).
        triangles: shape (T, 3).
    """
    found = borders(triangles)
    if not found:
        return np.empty(0, dtype=np.int64)
    heights = positions[:, 2]
    highest = max(found, key=lambda border: float(heights[border].mean()))
    return highest[heights[highest] >= heights[highest].max() - BAND]
