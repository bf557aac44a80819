"""The mesh of a character, that the joints of a clip move: linear blend skinning.

Each vertex goes along with several bones and stands at the mean of where they take it, by weights (Magnenat-Thalmann,
Laperriere and Thalmann 1988, "Joint-dependent local deformations for hand animation and object grasping").
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from motions import quaternions

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SkinPiece:
    """A part of a character's mesh, of one material.

    Attributes:
        name: unique among the pieces.
        vertices: in the frame of the mesh, in the file's unit, shape (V, 3).
        normals: unit vectors there, shape (V, 3); None where the file has none.
        triangles: vertex indices, counter-clockwise seen from outside, shape (T, 3).
        binds: which of the skin's N bindings move each vertex, shape (V, K).
        weights: how much each of them counts, with a sum of 1, shape (V, K).
        texcoords: texture coordinates from the top left, shape (V, 2); None for none.
        rgba: colour, which a texture is multiplied by, 0 to 1 of light, shape (4,).
        image: the encoded image of its colour, PNG or JPEG; None for none.
    """

    name: str
    vertices: FloatArray
    normals: FloatArray | None
    triangles: NDArray[np.int64]
    binds: NDArray[np.int64]
    weights: FloatArray
    texcoords: FloatArray | None = None
    rgba: FloatArray | None = None
    image: bytes | None = None

    @property
    def dominant(self) -> NDArray[np.int64]:
        """The binding that counts most for each vertex, shape (V,)."""
        return np.take_along_axis(self.binds, self.weights.argmax(axis=1)[:, None], axis=1)[:, 0]


@dataclass(frozen=True, eq=False)
class Skin:
    """A character's mesh and how it hangs on the joints.

    Attributes:
        bones: name of the joint of each of N bindings; a joint may have several.
        binds: mesh_to_joint of each, from the mesh's frame and unit to the joint's frame [m]; affine, shape (N, 3, 4).
        pieces: the mesh.
    """

    bones: tuple[str, ...]
    binds: FloatArray
    pieces: tuple[SkinPiece, ...]

    @property
    def vertices(self) -> int:
        """Number of vertices of all pieces."""
        return sum(len(piece.vertices) for piece in self.pieces)

    @property
    def triangles(self) -> int:
        """Number of triangles of all pieces."""
        return sum(len(piece.triangles) for piece in self.pieces)

    def turned(self, turn: FloatArray, scale: float) -> "Skin":
        """The same for joints whose world, and whose own frames, were turned by a matrix (3, 3) and then scaled."""
        return replace(self, binds=scale * turn @ self.binds)

    def posed(
        self, piece: SkinPiece, positions: FloatArray, rotations_wxyz: FloatArray
    ) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32] | None]]:
        """A piece in some poses, one after the other.

        Args:
            piece: one of the pieces.
            positions: of the joint of each binding in the world [m], shape (F, N, 3).
            rotations_wxyz: unit quaternions joint_to_world, shape (F, N, 4).

        Yields:
            Vertices in the world [m], shape (V, 3), and unit normals, shape (V, 3), None where the piece has none.
        """
        used, local = np.unique(piece.binds, return_inverse=True)
        local = local.reshape(piece.binds.shape).T
        binds = self.binds[used]
        weights = piece.weights.astype(np.float32)[..., None]
        vertices = piece.vertices.astype(np.float32)[..., None]
        normals = None if piece.normals is None else piece.normals.astype(np.float32)[..., None]
        for origins, turns in zip(positions[:, used], rotations_wxyz[:, used], strict=True):
            matrices = quaternions.to_matrix(turns) @ binds
            matrices[..., 3] += origins
            # The places of a large world are rounded once, in the end.
            middle = matrices[..., 3].mean(axis=0)
            matrices[..., 3] -= middle
            flat = matrices.reshape(len(used), 12).astype(np.float32)
            blended = weights[:, 0] * flat[local[0]]
            for k in range(1, piece.binds.shape[1]):
                blended += weights[:, k] * flat[local[k]]
            blended = blended.reshape(-1, 3, 4)
            points = (blended[..., :3] @ vertices)[..., 0] + blended[..., 3]
            yield (points + middle).astype(np.float32), None if normals is None else _unit(blended[..., :3] @ normals)


def _unit(vectors: NDArray[np.floating]) -> NDArray[np.float32]:
    flat = vectors[..., 0].astype(np.float32)
    return flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), np.float32(1e-12))
