"""How the mesh of an exported character looks: its image as a file, and its normals."""

import numpy as np
from numpy.typing import NDArray

from cape.cloth.normals import vertex_normals
from motions.skin import SkinPiece

PLAIN = (0.43, 0.38, 0.31)
"""Of light, for what has no colour of its own: what recordings give a body."""
_KINDS = {b"\x89PNG": "png", b"\xff\xd8\xff": "jpeg"}
"""By how an encoded image begins."""


def image_of(piece: SkinPiece) -> tuple[bytes, str] | None:
    """A piece's encoded image, and its kind, "png" or "jpeg"; None where it has none that files can carry."""
    if piece.image is None or piece.texcoords is None:
        return None
    kind = next((kind for start, kind in _KINDS.items() if piece.image.startswith(start)), None)
    return None if kind is None else (piece.image, kind)


def colour_of(piece: SkinPiece) -> tuple[float, float, float, float]:
    """Colour and opacity, of light, which an image is multiplied by."""
    r, g, b, a = (*PLAIN, 1.0) if piece.rgba is None else piece.rgba.tolist()
    return r, g, b, a


def normals_of(piece: SkinPiece) -> NDArray[np.float32]:
    """Unit normals in the frame of the mesh, those of the triangles around where it has none, shape (V, 3)."""
    around = vertex_normals(piece.vertices[None], piece.triangles)[0]
    if piece.normals is None:
        return around
    lengths = np.linalg.norm(piece.normals, axis=1, keepdims=True)
    return np.where(lengths > 1e-6, piece.normals / np.maximum(lengths, 1e-6), around).astype(np.float32)
