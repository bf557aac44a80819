"""A mesh as a file gives it: triangles, texture coordinates, and a map for all that names some of its vertices."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.cloth.drawn.textures import Textures
from motions.errors import UnknownNameError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

AS_IS = "as-is"
UPS: dict[str, FloatArray] = {
    "y": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "z": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    AS_IS: np.eye(3),
}
"""Rotations file_to_wearer by the file's up axis: Y up and facing +Z as glTF has it, Z up and facing -Y as Blender; or
axes that are taken as they are, as those of a bone."""


@dataclass(frozen=True, eq=False)
class Source:
    """A triangle mesh of V vertices and T triangles.

    Attributes:
        positions: x forward, y left, z up [m], shape (V, 3).
        triangles: vertex indices, shape (T, 3).
        uv: texture coordinates from the top left, shape (V, 2); None for none.
        weights: maps over the vertices, 0 to 1, shape (V,), by name: groups, attributes and a skin's bones.
        textures: those of the file; None for none.
        notes: what was done to it, a sentence each.
    """

    positions: FloatArray
    triangles: IntArray
    uv: FloatArray | None = None
    weights: Mapping[str, FloatArray] = field(default_factory=dict)
    textures: Textures | None = None
    notes: tuple[str, ...] = ()

    def of_vertices(self, kept: IntArray, triangles: IntArray, *notes: str) -> Self:
        """The same with some of its vertices, (n,), and triangles that count those."""
        return replace(
            self,
            positions=self.positions[kept],
            triangles=triangles,
            uv=None if self.uv is None else self.uv[kept],
            weights={name: values[kept] for name, values in self.weights.items()},
            notes=self.notes + notes,
        )

    def compact(self) -> Self:
        """The same without vertices that belong to no triangle."""
        used, numbered = np.unique(self.triangles, return_inverse=True)
        return self.of_vertices(used, numbered.reshape(-1, 3))


def upright(points: ArrayLike, up: str) -> FloatArray:
    """Points of a file, (V, 3), turned to x forward, y left, z up.

    Raises:
        UnknownNameError: up is none of `UPS`.
    """
    if up not in UPS:
        raise UnknownNameError("up axis of a cloth", up, UPS)
    return np.asarray(points, dtype=float).reshape(-1, 3) @ UPS[up].T


def add_weight(weights: dict[str, FloatArray], name: str, vertices: ArrayLike, values: ArrayLike, count: int) -> None:
    """Raise a map over `count` vertices, new or known, to values at some of them."""
    found = weights.setdefault(name, np.zeros(count))
    np.maximum.at(found, np.asarray(vertices, dtype=np.int64), np.asarray(values, dtype=float))
