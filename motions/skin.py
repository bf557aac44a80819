"""The mesh of a character, that the joints of a clip move: linear blend skinning.

Each vertex goes along with several bones and stands at the mean of where they take it, by weights (Magnenat-Thalmann,
Laperriere and Thalmann 1988, "Joint-dependent local deformations for hand animation and object grasping").
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.border import checked
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]

_ARRAYS = ("vertices", "triangles", "binds", "weights")
_OPTIONAL = ("normals", "texcoords", "rgba", "targets", "normal_targets", "target_morphs")
_WHOLE = ("triangles", "binds", "target_morphs")


@checked
@dataclass(frozen=True, eq=False)
class SkinPiece:
    """A part of a character's mesh, of one material.

    Attributes:
        name: unique among the pieces.
        vertices: in the frame of the mesh, in the file's unit, shape (V, 3).
        normals: unit vectors there, shape (V, 3); None where the file has none.
        triangles: vertex indices, counter-clockwise seen from outside, shape (T, 3).
        binds: which I of the skin's N bindings move each vertex, shape (V, I).
        weights: how much each of them counts, with a sum of 1, shape (V, I).
        texcoords: texture coordinates from the top left, shape (V, 2); None for none.
        rgba: colour, which a texture is multiplied by, and opacity, 0 to 1 of light, shape (4,); None for none.
        image: the encoded image of its colour, PNG or JPEG; None for none.
        targets: how far each of K morph targets moves the vertices at a weight of 1, before any bone does, in the frame
            of the mesh, shape (K, V, 3); None for none.
        normal_targets: what each adds to the normals, shape (K, V, 3); None where they stay.
        target_morphs: which of the skin's M morphs weighs each target, shape (K,); None where there is none.

    Raises:
        ValueRangeError: shapes don't fit each other, there is no triangle, or one has a vertex that there is not.
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
    targets: FloatArray | None = None
    normal_targets: FloatArray | None = None
    target_morphs: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        """Check that all of it is of one mesh."""
        for name in (*_ARRAYS, *_OPTIONAL):
            if (array := getattr(self, name)) is not None:
                object.__setattr__(self, name, np.asarray(array))
        count, own = len(self.vertices), f"the mesh {self.name!r}"
        influences = self.binds.shape[-1] if self.binds.ndim == 2 else 0
        shapes = {"vertices": (count, 3), "triangles": (len(self.triangles), 3)}
        shapes |= dict.fromkeys(("binds", "weights"), (count, max(influences, 1)))
        shapes |= {"normals": (count, 3), "texcoords": (count, 2), "rgba": (4,)}
        targets = 0 if self.target_morphs is None else len(self.target_morphs)
        shapes |= {"target_morphs": (targets,)}
        shapes |= dict.fromkeys(("targets", "normal_targets"), (targets, count, 3))
        for name, shape in shapes.items():
            array: NDArray[Any] = getattr(self, name)
            if name in _OPTIONAL and getattr(self, name) is None:
                continue
            if array.dtype.kind not in ("iu" if name in _WHOLE else "fiu") or array.shape != shape:
                raise ValueRangeError(f"{own}: {name} must be numbers of the shape {shape}, not {array.shape}")
            if not np.isfinite(array).all():
                raise ValueRangeError(f"{own}: {name} hold a number that isn't finite")
        if (self.targets is None) != (self.target_morphs is None):
            raise ValueRangeError(f"{own}: morph targets come with the morphs that weigh them")
        if self.target_morphs is not None and not targets:
            raise ValueRangeError(f"{own}: morph targets must be None where there are none")
        if not len(self.triangles):
            raise ValueRangeError(f"{own} has no triangle")
        if not (self.triangles.min() >= 0 and self.triangles.max() < count):
            raise ValueRangeError(f"{own}: a triangle has a vertex that is not among the {count} there are")

    @property
    def dominant(self) -> NDArray[np.int64]:
        """The binding that counts most for each vertex, shape (V,)."""
        return np.take_along_axis(self.binds, self.weights.argmax(axis=1)[:, None], axis=1)[:, 0]


@checked
@dataclass(frozen=True, eq=False)
class Skin:
    """A character's mesh and how it hangs on the joints.

    Attributes:
        bones: name of the joint of each of N bindings; a joint may have several.
        binds: mesh_to_joint of each, from the mesh's frame and unit to the joint's frame [m]; affine, shape (N, 3, 4).
        pieces: the mesh, at least one.

    Raises:
        ValueRangeError: there is no piece, one hangs at a binding that there is not, or shapes don't fit.
    """

    bones: tuple[str, ...]
    binds: FloatArray
    pieces: tuple[SkinPiece, ...]

    def __post_init__(self) -> None:
        """Check that the pieces hang at what there is."""
        object.__setattr__(self, "binds", np.asarray(self.binds))
        count = len(self.bones)
        if self.binds.dtype.kind not in "fiu" or self.binds.shape != (count, 3, 4):
            raise ValueRangeError(f"binds must be numbers of the shape {(count, 3, 4)}, not {self.binds.shape}")
        if not np.isfinite(self.binds).all():
            raise ValueRangeError("binds hold a number that isn't finite")
        if not self.pieces:
            raise ValueRangeError("a skin has at least one piece")
        for piece in self.pieces:
            if piece.binds.size and not (piece.binds.min() >= 0 and piece.binds.max() < count):
                raise ValueRangeError(f"the mesh {piece.name!r} hangs at a binding that is not among {count}")
            if piece.target_morphs is not None and piece.target_morphs.min(initial=0) < 0:
                raise ValueRangeError(f"the mesh {piece.name!r} has a target of no morph")

    @property
    def vertices(self) -> int:
        """Number of vertices of all pieces."""
        return sum(len(piece.vertices) for piece in self.pieces)

    @property
    def triangles(self) -> int:
        """Number of triangles of all pieces."""
        return sum(len(piece.triangles) for piece in self.pieces)

    @property
    def morphs(self) -> int:
        """Number of morphs M, each of which weighs a target of one piece or of several."""
        found = [piece.target_morphs.max(initial=-1) for piece in self.pieces if piece.target_morphs is not None]
        return 1 + int(max(found, default=-1))

    def require_morphs(self, morphs: FloatArray, frames: int) -> None:
        """Check weights of the morphs over some frames.

        Raises:
            ValueRangeError: they are not of the shape (F, M), or not finite.
        """
        if morphs.shape != (frames, self.morphs) or not np.isfinite(morphs).all():
            raise ValueRangeError(f"morphs must be finite numbers of the shape {(frames, self.morphs)}")

    def turned(self, turn: FloatArray, scale: float) -> "Skin":
        """The same for joints whose world, and whose own frames, were turned by a matrix (3, 3) and then scaled."""
        return replace(self, binds=scale * turn @ self.binds)

    def posed(
        self,
        piece: SkinPiece,
        positions: FloatArray,
        rotations_wxyz: FloatArray,
        *,
        morphs: FloatArray | None = None,
    ) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32] | None]]:
        """A piece in some poses, one after the other.

        Args:
            piece: one of the pieces.
            positions: of the joint of each binding in the world [m], shape (F, N, 3).
            rotations_wxyz: unit quaternions joint_to_world, shape (F, N, 4).
            morphs: weights of the skin's morphs, shape (F, M); None for 0.

        Yields:
            Vertices in the world [m], shape (V, 3), and unit normals, shape (V, 3), None where the piece has none.

        Raises:
            ValueRangeError: as `require_morphs`, before the first.
        """
        if morphs is not None:
            self.require_morphs(morphs, len(positions))
        used, local = np.unique(piece.binds, return_inverse=True)
        local = local.reshape(piece.binds.shape).T
        binds = self.binds[used]
        weights = piece.weights.astype(np.float32)[..., None]
        shapes = _morphed(piece.vertices, piece.targets, piece.target_morphs, morphs)
        shades = None
        if piece.normals is not None:
            shades = _morphed(piece.normals, piece.normal_targets, piece.target_morphs, morphs)
        for origins, turns in zip(positions[:, used], rotations_wxyz[:, used], strict=True):
            vertices, normals = next(shapes), None if shades is None else next(shades)
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


def _morphed(
    rest: FloatArray,
    targets: FloatArray | None,
    target_morphs: NDArray[np.int64] | None,
    morphs: FloatArray | None,
) -> Iterator[NDArray[np.float32]]:
    """Vectors with what targets add to them, as columns (V, 3, 1), frame by frame."""
    still = rest.astype(np.float32)[..., None]
    if targets is None or target_morphs is None or morphs is None:
        while True:
            yield still
    for weights in morphs[:, target_morphs]:
        count = weights != 0.0
        moved = np.tensordot(weights[count], targets[count], axes=1)
        yield (rest + moved).astype(np.float32)[..., None] if count.any() else still


def _unit(vectors: NDArray[np.floating]) -> NDArray[np.float32]:
    flat = vectors[..., 0].astype(np.float32)
    return flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), np.float32(1e-12))
