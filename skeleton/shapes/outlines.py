"""How a shape looks, as plain data: the few kinds of outlines that a recording can draw. All lengths in metres."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CapsuleOutline:
    """All points within `radius` of the segment from `start` to `end`, each of shape (3,)."""

    start: FloatArray
    end: FloatArray
    radius: float


@dataclass(frozen=True, eq=False)
class BoxOutline:
    """A cuboid: centre (3,), half sizes (3,), and unit quaternion outline_to_bone (4,)."""

    center: FloatArray
    half_sizes: FloatArray
    rotation_wxyz: FloatArray


@dataclass(frozen=True, eq=False)
class EllipsoidOutline:
    """An ellipsoid: centre (3,), half sizes (3,), and unit quaternion outline_to_bone (4,)."""

    center: FloatArray
    half_sizes: FloatArray
    rotation_wxyz: FloatArray


@dataclass(frozen=True, eq=False)
class PatchOutline:
    """An endless plane through `point` (3,) across `normal` (3,), of which as much is drawn as the motion needs."""

    point: FloatArray
    normal: FloatArray


@dataclass(frozen=True, eq=False)
class MeshOutline:
    """A closed mesh in a frame of its own.

    Attributes:
        origin: of its frame in that of the bone, shape (3,).
        rotation_wxyz: unit quaternion outline_to_bone, shape (4,).
        vertices: shape (V, 3).
        normals: out of it, of unit length, shape (V, 3).
        triangles: indices of the vertices, counter-clockwise from outside, shape (T, 3).
        middle: where its name is written, in its own frame, shape (3,).
    """

    origin: FloatArray
    rotation_wxyz: FloatArray
    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    triangles: NDArray[np.uint32]
    middle: FloatArray


Outline = CapsuleOutline | BoxOutline | EllipsoidOutline | PatchOutline | MeshOutline
"""Any of them."""
