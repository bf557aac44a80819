"""The springs of a cloth: the one force model that all solvers share."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.assembly.membrane import Membrane
from cape.cloth.cloth import Cloth, GridCloth, MeshCloth
from cape.cloth.split_grid import SplitGrid
from cape.cloth.split_mesh import SplitMesh

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Families:
    """The springs of a grid by family; one belongs to the vertex it starts from, stiffness 0 is no spring.

    Attributes:
        offsets: index of the second end minus that of the first, of the families right, down and diagonals, shape (4,).
        stiffness: [N/m], shape (4, N).
        rest: rest length [m], shape (4, N).
        bend_offsets: from the first end to the middle of the bend springs across and down, shape (2,).
        bend_stiffness: [N/m], shape (2, N).
        twist_stiffness: against p00 - p10 - p01 + p11 of the cell that starts from each vertex [N/m], shape (N,).
    """

    offsets: IntArray
    stiffness: FloatArray
    rest: FloatArray
    bend_offsets: IntArray
    bend_stiffness: FloatArray
    twist_stiffness: FloatArray


@dataclass(frozen=True, eq=False)
class Springs:
    """E springs between two vertices, energy 1/2 k (l - l0)^2; K bend springs on M, energy 1/2 k |sum c_a p_a|^2.

    Attributes:
        first: first ends, shape (E,).
        second: second ends, shape (E,).
        stiffness: k [N/m], shape (E,), none of them zero unless a membrane takes their place.
        rest: rest length l0 [m], shape (E,).
        measured: which of them run along threads, or edges of a mesh: what stretch is measured on, shape (E,).
        bend_vertices: shape (K, M); those of one triangle follow each other, on the same vertices.
        bend_coefficients: c, zero in sum, shape (K, M); 0 where a bend spring has fewer vertices.
        bend_stiffness: [N/m], shape (K,), none of them zero.
        families: the same springs of a grid by family, None for a mesh.
        membrane: what resists in the plane of a mesh in the springs' place, None where they do.
        nearest: where a membrane takes their place, stiffness of the springs nearest to the fabric, all positive, which
            may precondition its equations [N/m], shape (E,).
    """

    first: IntArray
    second: IntArray
    stiffness: FloatArray
    rest: FloatArray
    measured: NDArray[np.bool_]
    bend_vertices: IntArray
    bend_coefficients: FloatArray
    bend_stiffness: FloatArray
    families: Families | None = None
    membrane: Membrane | None = None
    nearest: FloatArray | None = None

    @property
    def in_slots(self) -> bool:
        """Whether they follow a mesh that splits in place, some of them idle as yet."""
        return False

    @property
    def acting(self) -> "Springs":
        """Those that are there: all, but of a mesh that may split."""
        return self

    @property
    def acting_numbers(self) -> IntArray | slice:
        """The numbers of those."""
        return slice(None)

    def among(self, links: IntArray | NDArray[np.bool_], bends: IntArray | NDArray[np.bool_]) -> dict[str, Any]:
        """What some of the springs of a mesh and of its bend springs are made of, all fields but `membrane`.

        Args:
            links: springs, by number (n,) or by a mask (E,).
            bends: bend springs, by number or by a mask (K,).
        """
        return {
            **{name: getattr(self, name)[links] for name in ("first", "second", "stiffness", "rest", "measured")},
            **{name: getattr(self, name)[bends] for name in ("bend_vertices", "bend_coefficients", "bend_stiffness")},
            "nearest": None if self.nearest is None else self.nearest[links],
        }


def springs_of(cloth: Cloth) -> Springs:
    """Derive the springs of a cloth from its pattern and fabric."""
    if isinstance(cloth, SplitGrid):
        from cape.assembly.grid.split_springs import split_springs

        return split_springs(cloth)
    if isinstance(cloth, GridCloth):
        from cape.assembly.grid.springs import grid_springs

        return grid_springs(cloth)
    if isinstance(cloth, SplitMesh):
        from cape.assembly.mesh.split_springs import split_mesh_springs

        return split_mesh_springs(cloth)
    if isinstance(cloth, MeshCloth):
        from cape.assembly.mesh.springs import mesh_springs

        return mesh_springs(cloth)
    raise TypeError(f"no springs are known for a {type(cloth).__name__}")
