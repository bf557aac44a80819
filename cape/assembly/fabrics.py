"""What pieces of cloth are made of, whether all is of one fabric or not."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.cloth.cloth import Cloth, MeshCloth
from cape.cloth.fabric import Fabric
from cape.cloth.patches.patchwork import Patchwork

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

HELD = 0.95  # of the strain that a fabric allows, to which threads are taken back: what sweeps leave stays within it


def patchwork_of(cloth: Cloth) -> Patchwork | None:
    """What tells which piece of a cloth is of which fabric; None where all is of one."""
    return cloth.patchwork if isinstance(cloth, MeshCloth) else None


def fabrics_of(cloth: Cloth) -> tuple[Fabric, ...]:
    """The fabrics of a cloth, each once."""
    patches = patchwork_of(cloth)
    return (cloth.fabric,) if patches is None else patches.fabrics


def of_triangles(
    cloth: MeshCloth, value: Callable[[Fabric], ArrayLike], triangles: IntArray | None = None
) -> FloatArray:
    """A value of the fabric that triangles of a mesh are of, some (n,) or all.

    The shape is that of the value where all is of one fabric, and has one more axis before it, for the triangles, where
    pieces are of different ones.
    """
    patches = cloth.patchwork
    return np.array(value(cloth.fabric), float) if patches is None else patches.of_triangles(value, triangles)


def of_vertices(cloth: Cloth, value: Callable[[Fabric], ArrayLike], vertices: IntArray | None = None) -> FloatArray:
    """The same of the vertices of a cloth, some (n,) or all."""
    if not isinstance(cloth, MeshCloth) or cloth.patchwork is None:
        return np.array(value(cloth.fabric), float)
    return cloth.patchwork.of_vertices(value, cloth.faces, vertices)


def longest_allowed(rest: FloatArray, limit: ArrayLike) -> FloatArray:
    """To what length threads are taken back [m] that are so long at rest [m] and may be strained up to a limit."""
    return (1.0 + HELD * np.asarray(limit, float)) * rest
