"""Binding a fine mesh to the triangles of a coarse one."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.cloth.drawn.visual import Visual
from cape.meshes.nearest import barycentric, nearest_on

FloatArray = NDArray[np.float64]


def embedded(
    positions: FloatArray,
    triangles: ArrayLike,
    uv: ArrayLike | None,
    coarse_positions: FloatArray,
    coarse_triangles: NDArray[np.integer],
) -> Visual:
    """Bind each vertex of a fine mesh to the plane of the triangle of a coarse one that is nearest to it.

    Args:
        positions: of the fine mesh [m], shape (V, 3).
        triangles: its own, shape (T, 3).
        uv: texture coordinates from the top left, shape (V, 2); None for none.
        coarse_positions: of the coarse mesh, in the same place [m], shape (n, 3).
        coarse_triangles: its own, each with an area, shape (m, 3).
    """
    faces = coarse_triangles.astype(np.int64)
    held = faces[nearest_on(positions, coarse_positions, faces).triangles]
    corners = coarse_positions[held]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    _, first, of = np.unique(positions, axis=0, return_index=True, return_inverse=True)
    return Visual(
        np.array(triangles, dtype=np.int32),
        None if uv is None else np.array(uv, dtype=np.float32),
        held,
        barycentric(positions, corners),
        np.sum((positions - corners[:, 0]) * normals, axis=1),
        first[of.ravel()],
    )
