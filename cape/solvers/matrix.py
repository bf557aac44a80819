"""The matrix of an implicit solver's Newton steps, and what the forces of a cloth give to it."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.assembly.multigrid.levels import LinkBlocks
from cape.assembly.springs import Springs
from cape.cloth.cloth import GridCloth
from cape.forces.elastic import Links
from cape.kernels.cloth.grid import GridSprings
from cape.kernels.cloth.membrane import MeshMembrane
from cape.kernels.cloth.mesh import BLOCK, ENDS, MeshSprings
from cape.kernels.cloth.mesh_bending import SIDE, MeshBends
from cape.kernels.contact.penalty import PenaltyContact
from cape.kernels.implicit.conjugate_gradients import CHUNK
from cape.kernels.implicit.membrane_stiffness import (
    STRETCH,
    MembraneStiffness,
    Points,
    add_membrane_diagonal,
    linearise_membrane,
    multiply_membrane,
)
from cape.kernels.implicit.mesh_stiffness import (
    MeshBendStiffness,
    MeshStiffness,
    add_mesh_bend_diagonal,
    add_mesh_diagonal,
    linearise_mesh,
    multiply_mesh,
    multiply_mesh_bends,
    multiply_packed_bends,
)
from cape.kernels.implicit.points import PAIRS, order_kept
from cape.kernels.implicit.sliding import Railing, add_rail_blocks
from cape.kernels.implicit.stiffness import (
    Blocks,
    GridStiffness,
    Matrix,
    PullBlocks,
    add_contact_blocks,
    add_grid_diagonal,
    add_pull_blocks,
    invert_diagonal,
    linearise_springs,
    multiply_grid,
    multiply_own,
    set_own,
    start_diagonal,
)
from cape.kernels.program import Use
from cape.kernels.state import aligned
from cape.solvers.order import wait
from cape.solvers.running import Thread

STIFFER = 1.25  # times what is nearest: 4 % fewer iterations of 20,000 vertices, no more of 1,536
Array = NDArray[np.floating]


class Nearest(NamedTuple):
    """The springs nearest to a membrane, of which its levels are made, and room for their `coefficients` w and c.

    The blocks between a membrane's own vertices are no such sums of squares, but negative across from obtuse angles.
    """

    springs: MeshSprings
    coefficients: Array


class Layout(NamedTuple):
    """What springs, or a membrane, and bend springs give to the matrix: see `GridStiffness`, `MeshStiffness`,
    `MembraneStiffness` and `MeshBendStiffness`. Of a membrane `coefficients` are its tension, `ends` what p changes,
    and `points` what is fetched. `pieces` are those of other fabrics, each with the matrix as it is damped there."""

    coefficients: Array
    couplings: Array | None = None
    ends: Array | None = None
    membrane: MeshMembrane | None = None
    points: Points | None = None
    nearest: Nearest | None = None
    bends: MeshBends | None = None
    diagonal: Array | None = None
    pieces: "tuple[tuple[Matrix, Layout], ...]" = ()


def matrix_of(
    assembly: Assembly, links: Links, dtype: type[np.floating], *, negligible: float = 0.0
) -> tuple[Matrix, Layout]:
    """Lay out the matrix of a cloth, and what springs give to it; see `kernels.implicit.stiffness`.

    Bending of a mesh leaves out pairs of vertices whose weight is at most `negligible` [1/s2] times the lesser of their
    masses, many of the pairs that are far from each other.
    """
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
    families = springs.families
    if isinstance(links.springs, GridSprings):
        layout, *others = [Layout(np.zeros((16, size), dtype))]
    else:
        from cape.assembly.mesh.pieces import alike_pieces

        every, least = _each(links), negligible * assembly.mass
        own = [piece.springs for piece in alike_pieces(cloth, springs)]
        layout, *others = [
            _of_mesh(each, of, least, len(assembly.ranks), padded, dtype) for each, of in zip(every, own, strict=True)
        ]
    if families is not None and links.bends is not None:
        rows, twist = [], families.twist_stiffness
        np.add.at(diagonal, springs.bend_vertices, springs.bend_stiffness[:, None] * springs.bend_coefficients**2)
        # An edge across is a side of the cells below and above it, one down of those to its right and left.
        for offset, beside, stiffness in zip(
            families.bend_offsets, families.bend_offsets[::-1], families.bend_stiffness, strict=True
        ):
            sides = twist + _behind(twist, beside)
            rows += [-2.0 * (stiffness + _behind(stiffness, offset)) - sides, stiffness]
        layout = layout._replace(couplings=padded(np.stack([*rows, twist])))
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
    times = [{"damping": p.links.damping or 0.0, "bend_damping": p.links.bend_damping or 0.0} for p in links.pieces]
    pieces = [(matrix._replace(**own), other) for own, other in zip(times, others, strict=True)]
    return matrix, layout._replace(pieces=tuple(pieces))


def _each(links: Links) -> list[Links]:
    """The springs of each piece of a cloth."""
    return [links, *(piece.links for piece in links.pieces)]


def _of_mesh(
    links: Links,
    springs: Springs,
    least: NDArray[np.float64],
    ranks: int,
    padded: Callable[[NDArray[Any]], Array],
    dtype: type[np.floating],
) -> Layout:
    """What a mesh, or a piece of it, gives to the matrix; bending as far as its weight is above `least` [N/m] (N,)."""
    from cape.assembly.mesh.links import mesh_springs_record, thinned

    count = len(least)
    if isinstance(links.springs, MeshMembrane):
        inner, kind = in_precision(links.springs, dtype), links.springs.slopes.dtype.type
        assert springs.nearest is not None
        nearest = mesh_springs_record(replace(springs, stiffness=STIFFER * springs.nearest), count, kind)
        layout = Layout(
            np.zeros_like(inner.strains),
            ends=np.zeros_like(inner.shape),
            membrane=inner,
            points=_points(inner, count, ranks),
            nearest=Nearest(nearest, _coefficients(nearest, dtype)),
        )
    else:
        assert isinstance(links.springs, MeshSprings)
        ends = np.zeros(links.springs.forces.shape, dtype)
        layout = Layout(_coefficients(links.springs, dtype), ends=ends)
    if not isinstance(links.bends, MeshBends):
        return layout
    # Rows are zero in sum.
    row = np.repeat(np.arange(count), np.diff(links.bends.start))
    sums = np.bincount(row, links.bends.weight, count)
    bends = thinned(links.bends, least, dtype)
    if layout.points is not None:
        bends = bends._replace(packed=layout.points.packed)
    return layout._replace(bends=bends, diagonal=padded(sums))


class MatrixUnits(NamedTuple):
    """What linearises at a state; what then sets the inverse of the block diagonal; what linearises the springs nearest
    to a membrane; and what multiplies with the matrix."""

    linearise: list[Use]
    diagonal: list[Use]
    nearest: list[Use]
    product: list[Use]


def matrix_units(
    thread: Thread,
    matrix: Matrix,
    layout: Layout,
    links: Links,
    scratch: Array,
    *,
    contact: PenaltyContact | None,
    railing: Railing | None,
) -> MatrixUnits:
    """The units of a matrix; `scratch` (3, L) is the thread's own."""
    own = [Use(set_own, matrix)]
    if contact is not None:
        own.append(Use(add_contact_blocks, Blocks(matrix, contact.penalty.blocks)))
    own += [Use(add_pull_blocks, PullBlocks(pull, matrix)) for pull in thread.running.assembly.pulls]
    if railing is not None:
        own.append(Use(add_rail_blocks, railing))
    start, invert = Use(start_diagonal, matrix), Use(invert_diagonal, matrix)
    linearise, diagonal, nearest, product = [], [], [], [Use(multiply_own, matrix)]
    for (damped, of), each in zip([(matrix, layout), *layout.pieces], _each(links), strict=True):
        units = _units_of(thread, damped, of, each, scratch)
        for here, more in zip((linearise, diagonal, nearest, product), units, strict=True):
            here += more
    return MatrixUnits([*linearise, *wait(thread), *own], [start, *diagonal, invert], nearest, product)


def _units_of(thread: Thread, matrix: Matrix, layout: Layout, links: Links, scratch: Array) -> MatrixUnits:
    """The same of what the springs of a cloth, or of a piece of it, give to the matrix."""
    state, nearest = thread.running.state, []
    if isinstance(links.springs, GridSprings):
        assert not isinstance(links.bends, MeshBends)
        grid = GridStiffness(state, links.springs, links.bends, matrix, layout.coefficients, layout.couplings, scratch)
        first, last, product = Use(linearise_springs, grid), Use(add_grid_diagonal, grid), Use(multiply_grid, grid)
    elif isinstance(links.springs, MeshMembrane):
        assert layout.ends is not None
        assert layout.membrane is not None
        assert layout.points is not None
        sheet = MembraneStiffness(
            links.springs, layout.membrane, matrix, layout.coefficients, layout.ends, layout.points
        )
        first, last = Use(linearise_membrane, sheet), Use(add_membrane_diagonal, sheet)
        product = Use(multiply_membrane, sheet)
        if layout.nearest is not None:
            (springs, found), nowhere = layout.nearest, layout.ends[:0]
            nearest.append(Use(linearise_mesh, MeshStiffness(state, springs, matrix, found, nowhere)))
    else:
        assert layout.ends is not None
        mesh = MeshStiffness(state, links.springs, matrix, layout.coefficients, layout.ends)
        first, last, product = Use(linearise_mesh, mesh), Use(add_mesh_diagonal, mesh), Use(multiply_mesh, mesh)
    diagonals, products = [last], [product]
    if layout.bends is not None:
        assert layout.diagonal is not None
        bends = MeshBendStiffness(layout.bends, matrix, layout.diagonal)
        diagonals.append(Use(add_mesh_bend_diagonal, bends))
        products.append(Use(multiply_mesh_bends if layout.points is None else multiply_packed_bends, bends))
    return MatrixUnits([first], diagonals, nearest, products)


def _points(inner: MeshMembrane, vertices: int, ranks: int) -> Points:
    """Lay out what the matrix of a membrane of so many vertices fetches and keeps, with room for so many threads."""
    dtype = inner.strains.dtype.type

    def places(values: NDArray[np.uint32]) -> NDArray[np.uint32]:
        """Places of vectors, of which ENDS numbers make a row, as places of points."""
        row, lane = np.divmod(values, np.uint32(ENDS))
        return (PAIRS * (row * BLOCK + order_kept(BLOCK)[lane])).astype(np.uint32)

    blocks, rows = inner.second.shape[:2]
    stretch, count = np.arange(blocks) * BLOCK // STRETCH, -(-vertices // STRETCH)
    beyond = stretch[inner.neighbours.astype(np.int64) // (rows * ENDS)]
    real = np.broadcast_to(inner.smoothing[:, :, :1] > 0.0, beyond.shape)
    own = np.broadcast_to(stretch[:, None, None, None], beyond.shape)[real]
    since, until = np.arange(count), np.arange(count)
    np.minimum.at(since, own, beyond[real])
    np.maximum.at(until, own, beyond[real])
    return Points(
        packed=aligned(SIDE * vertices, dtype),
        strains=aligned(SIDE * (inner.strains.size // 3), dtype),
        forces=aligned(SIDE * (inner.forces.size // 3), dtype),
        mixed=aligned(SIDE * (inner.forces.size // 3), dtype),
        second=PAIRS * inner.second,
        third=PAIRS * inner.third,
        neighbours=places(inner.neighbours),
        incoming=places(inner.incoming),
        since=since,
        until=np.maximum.accumulate(until),
        fetched=np.zeros((ranks, 3 * ENDS), dtype),
        seconds=np.zeros((ranks, 2 * ENDS), dtype),
        thirds=np.zeros((ranks, 2 * ENDS), dtype),
        total=np.zeros((ranks, ENDS), dtype),
    )


def link_blocks(matrix: Matrix, layout: Layout, links: Links) -> LinkBlocks:
    """Where the blocks of the springs are in the matrix of a cloth, or of those that stand for a membrane."""
    springs, coefficients = links.springs, layout.coefficients
    if isinstance(springs, MeshMembrane):
        assert layout.nearest is not None
        springs, coefficients = layout.nearest
    if isinstance(springs, GridSprings):
        family, first = np.nonzero(springs.stiffness)
        size = coefficients.shape[1]
        place = 4 * family * size + matrix.front + first
        return LinkBlocks(first, first + springs.offsets[family], place, coefficients.reshape(-1), size)
    rows = coefficients.shape[1]
    block, row, lane = np.nonzero(springs.stiffness)
    second = springs.second[block, row, lane].astype(np.int64)
    place = (block * rows + row) * 4 * BLOCK + lane
    return LinkBlocks(block * BLOCK + lane, second, place, coefficients.reshape(-1), BLOCK)


def _coefficients(springs: MeshSprings, dtype: type[np.floating]) -> Array:
    """Room for w and c of the springs of a mesh."""
    blocks, rows, lanes = springs.second.shape
    return np.zeros((blocks, rows, 4, lanes), dtype)


def in_precision(record: Any, dtype: type[np.floating]) -> Any:
    """A record of a mesh in another precision, with room of its own; a word of its room holds two numbers."""
    word = np.uint64 if np.dtype(dtype) == np.float32 else np.complex128

    def converted(name: str, value: Any) -> Any:
        if name in ("words", "room"):
            return np.zeros(value.shape, word)
        is_real = isinstance(value, np.ndarray) and value.dtype.kind == "f"
        return value.astype(dtype) if is_real else value

    return type(record)(*(converted(*item) for item in record._asdict().items()))


def _behind(values: Array, offset: int) -> Array:
    """For each vertex the value of the one that far before it, zero before the first."""
    return np.concatenate([np.zeros(offset), values[: len(values) - offset]])
