"""A mesh of several fabrics: which of its pieces is of which."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.cloth.fabric import Fabric
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Patchwork:
    """The fabrics of a mesh whose pieces are not sewn together: no vertex is of two.

    Attributes:
        fabrics: each once.
        number: of the fabric that each triangle is of, shape (T,).
    """

    fabrics: tuple[Fabric, ...]
    number: IntArray

    def of_triangles(self, value: Callable[[Fabric], ArrayLike], triangles: IntArray | None = None) -> FloatArray:
        """A value of the fabric of each of some triangles (n,), or of all: one more axis before its own."""
        return self._values(value)[self.number if triangles is None else self.number[triangles]]

    def of_vertices(
        self, value: Callable[[Fabric], ArrayLike], faces: IntArray, vertices: IntArray | None = None
    ) -> FloatArray:
        """The same of each of some vertices (n,), or of all, of a mesh with these faces (T, 3)."""
        number = self.at_vertices(faces)
        return self._values(value)[number if vertices is None else number[vertices]]

    def at_vertices(self, faces: IntArray) -> IntArray:
        """Number of the fabric that each vertex of a mesh with these faces (T, 3) is of, shape (V,)."""
        found = np.zeros(int(faces.max()) + 1, np.int64)
        found[faces] = self.number[:, None]
        return found

    def in_order(self, order: IntArray) -> Self:
        """The same where triangle i is what was number `order[i]`."""
        return type(self)(self.fabrics, self.number[order])

    def require(self, faces: IntArray, fabric: Fabric) -> None:
        """Look whether a mesh with these faces (T, 3), said to be of a fabric, is of these.

        Raises:
            ValueRangeError: the fabric is none of them, numbers are not one for each face or of no fabric, or a vertex
                is of two.
        """
        if fabric not in self.fabrics:
            raise ValueRangeError("a mesh of several fabrics can't be of another one besides: leave out its patchwork")
        if self.number.shape != (len(faces),) or not np.isin(self.number, range(len(self.fabrics))).all():
            raise ValueRangeError(
                f"a patchwork tells of each of {len(faces)} triangles which of {len(self.fabrics)} fabrics it is of"
            )
        if (self.at_vertices(faces)[faces] != self.number[:, None]).any():
            raise ValueRangeError("pieces of different fabrics share a vertex: they may not be sewn together")

    def _values(self, value: Callable[[Fabric], ArrayLike]) -> FloatArray:
        return np.array([value(fabric) for fabric in self.fabrics], dtype=float)
