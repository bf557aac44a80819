"""The matrix of a Newton step, laid out for a cloth: see `cape.kernels.implicit.stiffness`."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.assembly.multigrid.levels import LinkBlocks
from cape.cloth.cloth import GridCloth
from cape.forces.elastic import Links
from cape.kernels.cloth.grid import GridSprings
from cape.kernels.cloth.mesh import BLOCK, MeshBends
from cape.kernels.implicit.conjugate_gradients import CHUNK
from cape.kernels.implicit.stiffness import Matrix

Array = NDArray[np.floating]


class Layout(NamedTuple):
    """Room for what the springs and bend springs give to the matrix: see `GridStiffness` and `MeshStiffness`."""

    coefficients: Array
    couplings: Array | None
    ends: Array | None


def matrix_of(assembly: Assembly, links: Links, dtype: type[np.floating]) -> tuple[Matrix, Layout]:
    """Lay out the matrix of a cloth, and what springs give to it; see `kernels.implicit.stiffness`."""
    springs, cloth = assembly.springs, assembly.cloth
    count = cloth.vertices
    front = 0
    if isinstance(cloth, GridCloth):
        front = -(-2 * (cloth.columns + 1) // CHUNK) * CHUNK
    size = front + -(-count // CHUNK) * CHUNK + front

    def padded(values: NDArray[Any], outside: float = 0.0) -> Array:
        rows = np.full((*values.shape[:-1], size), outside, dtype)
        rows[..., front : front + count] = values
        return rows

    diagonal = np.zeros(count)
    bends, ends, families = None, None, springs.families
    coefficients = np.zeros((16, size), dtype)
    if not isinstance(links.springs, GridSprings):
        blocks, rows_of_links, lanes = links.springs.second.shape
        coefficients = np.zeros((blocks, rows_of_links, 4, lanes), dtype)
        ends = np.zeros(links.springs.forces.shape, dtype)
    if families is not None and links.bends is not None:
        rows, twist = [], families.twist_stiffness
        np.add.at(diagonal, springs.bend_vertices, springs.bend_stiffness[:, None] * springs.bend_coefficients**2)
        # An edge across is a side of the cells below and above it, one down of those to its right and left.
        for offset, beside, stiffness in zip(
            families.bend_offsets, families.bend_offsets[::-1], families.bend_stiffness, strict=True
        ):
            sides = twist + _behind(twist, beside)
            rows += [-2.0 * (stiffness + _behind(stiffness, offset)) - sides, stiffness]
        bends = padded(np.stack([*rows, twist]))
    matrix = Matrix(
        front=front,
        bend_diagonal=padded(diagonal),
        mass=padded(assembly.mass, 1.0),
        free=padded(assembly.free),
        own=np.zeros((6, size), dtype),
        inverse=np.zeros((6, size), dtype),
        vectors=np.zeros((5, 3, size), dtype),
        damping=links.damping or 0.0,
        bend_damping=links.bend_damping or 0.0,
    )
    return matrix, Layout(coefficients, bends, ends)


def link_blocks(matrix: Matrix, layout: Layout, links: Links) -> LinkBlocks:
    """Where the blocks of the springs are in the matrix of a cloth."""
    coefficients = layout.coefficients
    if isinstance(links.springs, GridSprings):
        family, first = np.nonzero(links.springs.stiffness)
        size = coefficients.shape[1]
        place = 4 * family * size + matrix.front + first
        second = first + links.springs.offsets[family]
        return LinkBlocks(first, second, place, np.zeros(len(first)), coefficients.reshape(-1), size)
    springs, rows = links.springs, coefficients.shape[1]
    block, row, lane = np.nonzero(springs.stiffness)
    second = springs.second[block, row, lane].astype(np.int64)
    bending = np.zeros(len(second))
    if isinstance(links.bends, MeshBends):
        bending = links.bends.weight[block, row, lane].astype(float)
    place = (block * rows + row) * 4 * BLOCK + lane
    return LinkBlocks(block * BLOCK + lane, second, place, bending, coefficients.reshape(-1), BLOCK)


def _behind(values: Array, offset: int) -> Array:
    """For each vertex the value of the one that far before it, zero before the first."""
    return np.concatenate([np.zeros(offset), values[: len(values) - offset]])
