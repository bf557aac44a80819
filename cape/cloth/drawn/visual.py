"""A finer mesh that is drawn in place of the one that is simulated, and moves with its triangles."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motions.border import checked

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@checked
@dataclass(frozen=True, eq=False)
class Visual:
    """V vertices, each in the frame of a triangle of the simulated mesh: sum of its corners times shares, plus the
    triangle's normal times a height.

    Exact where the cloth moves as a whole; along an edge of the simulated mesh that folds it has a crease as that has.

    Attributes:
        triangles: vertex indices of what is drawn, shape (T, 3).
        uv: texture coordinates from the top left, shape (V, 2); None for none.
        corners: of each vertex, the three simulated vertices that carry it, shape (V, 3).
        shares: barycentric coordinates, 1 in sum, shape (V, 3).
        heights: above the triangle, along its normal [m], shape (V,).
        whole: of each vertex the first at its place, shape (V,): those of a seam in the texture share their normals.
    """

    triangles: NDArray[np.int32]
    uv: NDArray[np.float32] | None
    corners: IntArray
    shares: FloatArray
    heights: FloatArray
    whole: IntArray

    def places(self, positions: NDArray[np.floating]) -> NDArray[np.float32]:
        """Where the vertices are [m], (F, V, 3), for the simulated ones (F, n, 3); both may be of one frame."""
        corners = np.asarray(positions, dtype=float)[..., self.corners, :]
        normals = np.cross(corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :])
        lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
        normals /= np.where(lengths > 0.0, lengths, 1.0)
        placed = np.einsum("...vck,vc->...vk", corners, self.shares)
        return (placed + self.heights[:, None] * normals).astype(np.float32)
