"""XPBD: position-based dynamics with compliance, solved constraint by constraint in small steps."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly, force_scratch, inertia_of
from cape.assembly.chains import Chain, chain_of
from cape.assembly.coloring import Blocks, by_color, in_blocks
from cape.assembly.membrane import Membrane
from cape.assembly.springs import Springs
from cape.cloth.cloth import GridCloth
from cape.forces.base import Force
from cape.forces.elastic import Elastic, damping_times
from cape.forces.hold import Hands, Hold
from cape.forces.registry import forces_in
from cape.kernels.cloth.grid import GridRoom
from cape.kernels.cloth.membrane import Tension
from cape.kernels.linking import Linker
from cape.kernels.program import Use
from cape.kernels.solve.attachments import Held, aim_attached
from cape.kernels.solve.soft import Drawn, draw_vertices
from cape.kernels.state import Inertia, aligned
from cape.kernels.store import Request
from cape.kernels.xpbd.bending import ROWS, BendConstraints, count_members, lay_bends
from cape.kernels.xpbd.formulas import Constraints
from cape.kernels.xpbd.grid import GridConstraints, GridSweeps, dealt, hands_for, prepare_grid, solve_grid
from cape.kernels.xpbd.membrane import MembraneConstraints
from cape.kernels.xpbd.mesh import MeshConstraints, MeshSweeps, SpringConstraints, lay_springs, prepare_mesh, solve_mesh
from cape.kernels.xpbd.packed import LANES, NEXT, SIDE
from cape.kernels.xpbd.xpbd import Blown, Falling, blow_all, drift_all, fall_all
from cape.solvers.base import MOST_ITERATIONS, Precision, Solver
from cape.solvers.euler import SymplecticEuler
from cape.solvers.order import Order, begin_frame, blow, end_substep, forces, move_bones, wait
from cape.solvers.running import Running, Thread
from motions.border import checked
from motions.errors import require_whole

if TYPE_CHECKING:
    from cape.assembly.mesh.split_springs import Changed
    from cape.solvers.xpbd_splits import SplitConstraints

Array = NDArray[np.floating]

SUBSTEPS = 40  # at least, per frame at 60 Hz, where none are asked for
TOO_LONG = 0.0025  # of its length, that cloth may hang down too far with as many as are chosen
DEAR = 16  # times as many steps as were taken, that it may cost at least to learn where shorter ones lead
SWEPT = 0.5  # of a chain's sag, that is left by sweeps; 0.43 to 0.51 as measured


class PieceConstraints(NamedTuple):
    """The constraints of a piece of a mesh, and its damping times [s]; None for none."""

    constraints: MeshConstraints
    damping: float | None
    bend_damping: float | None


class XpbdArrays(NamedTuple):
    """What the steps of a run share, in its precision: constraints on a grid or a mesh, damping times [s], the other
    forces with their sums (3, N) [N] and scratch of each thread; and the longest step [s] that solves for a chain.

    `pieces` are those of other fabrics, where the numbers of these differ; the rest is then of the first. `splits` lays
    constraints out anew where a mesh may split that has no such pieces.
    """

    forces: dict[type[Force], Any]
    constraints: GridConstraints | MeshConstraints
    damping: float | None
    bend_damping: float | None
    inertia: Inertia
    total: Array
    scratch: tuple[GridRoom | None, ...]
    longest_step: float
    pieces: tuple[PieceConstraints, ...] = ()
    splits: "SplitConstraints | None" = None


@checked
@dataclass(frozen=True, kw_only=True)
class XPBD(Solver):
    """Macklin, Mueller, Chentanez 2016 with the small steps of Macklin et al. 2019.

    A constraint's compliance is exactly one over its spring's stiffness, so that all solvers converge to the same
    motion as steps shrink; at few steps it is softer and damped, and never unstable. First order in time. Damping
    times much longer than a step soften it further, until more iterations are asked for.

    Attributes:
        precision: single unless double is asked for. Velocities are the unknowns of a step, so that no small correction
            is lost in the digits of a position.
        iterations: sweeps over all constraints in each step.
    """

    name: ClassVar[str] = "xpbd"
    title: ClassVar[str] = "XPBD"
    colour: ClassVar[str] = "#c8553d"
    measured_steps: ClassVar[tuple[int, ...]] = (5, 10, 20, 40, 80, 160, 320)
    usual_precision: ClassVar[Precision] = "single"
    order: ClassVar[float] = 1.0
    sweeps: ClassVar[bool] = True
    splits: ClassVar[bool] = True
    iterations: int = 1

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            ValueRangeError: a setting is out of range.
        """
        super().__post_init__()
        require_whole("iterations", self.iterations, 1, MOST_ITERATIONS)

    def arrays(self, assembly: Assembly) -> XpbdArrays:
        """Turn springs into constraints: by family on a grid, by colour on a mesh."""
        dtype, cloth, pieces, splits = self.dtype(assembly), assembly.cloth, [], None
        damping, bend_damping = damping_times(cloth.fabric, assembly.springs)
        others = [force for force in forces_in(assembly) if force not in (Elastic, Hold, Hands)]
        if isinstance(cloth, GridCloth):
            constraints = self._grid(assembly, cloth, dtype)
        else:
            (constraints, damping, bend_damping), *pieces = self._pieces(assembly, dtype)
            if assembly.springs.in_slots and not pieces:
                from cape.solvers.xpbd_splits import SplitConstraints

                splits = SplitConstraints(assembly, constraints)
                constraints = splits.laid
        return XpbdArrays(
            forces={force: force.arrays(assembly, dtype) for force in others},
            constraints=constraints,
            damping=damping,
            bend_damping=bend_damping,
            inertia=inertia_of(assembly, dtype),
            total=np.zeros((3, cloth.vertices), dtype=dtype),
            scratch=force_scratch(assembly, dtype) if others else (None,) * len(assembly.ranks),
            longest_step=step_of(chain_of(assembly)),
            pieces=tuple(pieces),
            splits=splits,
        )

    def follow(self, arrays: XpbdArrays, assembly: Assembly, changed: "Changed") -> XpbdArrays:
        """Lay out the constraints of a mesh anew, in place, and take steps for the chains of springs that are left.

        Raises:
            NoRoom: they find no room, and the arrays are of no use any more.
        """
        from cape.assembly.mesh.places import NoRoom

        if arrays.splits is None:
            raise NoRoom
        arrays.splits.follow(assembly, changed)
        return arrays._replace(longest_step=step_of(arrays.splits.chain(assembly)))

    def follow_requests(self, arrays: XpbdArrays) -> list[Request]:
        """The code that `follow` needs."""
        return [] if arrays.splits is None else arrays.splits.requests

    def choose_substeps(self, running: Running, duration: float, *, strained: bool = False) -> int:
        """Number of steps in a frame of `duration` [s]: as asked, or as many as a hanging cloth needs, 40 at 60 Hz at
        least."""
        if self.substeps is not None:
            return self.substeps
        return max(1, round(SUBSTEPS * 60.0 * duration), math.ceil(duration / running.arrays.longest_step))

    def toward_limit(self, running: Running, duration: float, substeps: int) -> Solver:
        """Symplectic Euler's stable steps, unless they are more than `DEAR` times as many as were taken.

        Both come to the same as steps shrink, as constraints are as compliant as springs and contact is the same. But
        cloth sags in few steps of XPBD. When it is let go, in steps ever shorter, it rebounds, and as long as they are
        longer than stable ones of Euler the sweeps damp that: steps of XPBD then seem to converge to where they don't.
        """
        euler = SymplecticEuler()
        stable = euler.choose_substeps(euler.init(running.assembly, running.state), duration)
        if stable > DEAR * substeps:
            return super().toward_limit(running, duration, substeps)
        return euler.in_steps(stable * 2 ** max(0, math.ceil(math.log2(0.25 * substeps / stable))), duration)

    def units(self, thread: Thread, linker: Linker) -> Order:
        """Predict velocities, sweep over the constraints, move; then contact."""
        running, assembly = thread.running, thread.running.assembly
        arrays: XpbdArrays = running.arrays
        prepare, solve = self._sweeps(running)
        uses: list[Use] = []
        if arrays.forces:
            uses += blow(thread, 0.5)
            uses += forces(thread, list(arrays.forces), arrays.total, arrays.scratch[thread.rank])
            uses += [*wait(thread), Use(blow_all, Blown(running.state, arrays.inertia, arrays.total))]
        uses += [Use(fall_all, Falling(running.state, arrays.inertia)), *move_bones(thread)]
        if assembly.attached is not None:
            uses.append(Use(aim_attached, Held(running.state, assembly.attached, thread.bones)))
        uses += [*wait(thread), *solve, *wait(thread)]
        # After the springs, whose load these then bear at rest without having seen a vertex yield.
        uses += [Use(draw_vertices, Drawn(running.state, pull, arrays.inertia)) for pull in assembly.pulls]
        uses += [Use(drift_all, running.state), *end_substep(thread, linker)]
        return Order(begin=[*begin_frame(thread), *prepare], substep=[*uses, *wait(thread)])

    def _sweeps(self, running: Running) -> tuple[list[Use], list[Use]]:
        """What sets the gains of a frame, and what goes through all constraints, piece by piece."""
        arrays: XpbdArrays = running.arrays
        c, times = arrays.constraints, (arrays.damping, arrays.bend_damping)
        if isinstance(c, GridConstraints):
            grid = GridSweeps(running.state, c, *times, self.iterations)
            return [Use(prepare_grid, grid)], [Use(solve_grid, grid)]
        light = arrays.inertia.inverse_mass
        meshes = [
            MeshSweeps(running.state, piece.constraints, light, piece.damping, piece.bend_damping, self.iterations)
            for piece in (PieceConstraints(c, *times), *arrays.pieces)
        ]
        return [Use(prepare_mesh, mesh) for mesh in meshes], [Use(solve_mesh, mesh) for mesh in meshes]

    def _grid(self, assembly: Assembly, cloth: GridCloth, dtype: type[np.floating]) -> GridConstraints:
        families, weights, columns = assembly.springs.families, assembly.inverse_mass, cloth.columns
        assert families is not None

        def springs(family: int) -> Constraints | None:
            stiffness, offset = families.stiffness[family], int(families.offsets[family])
            mobility = weights + _ahead(weights, offset)
            return self._grid_family(stiffness, families.rest[family], mobility, columns, dtype)

        def bends(family: int) -> Constraints | None:
            stiffness, offset = families.bend_stiffness[family], int(families.bend_offsets[family])
            mobility = weights + 4.0 * _ahead(weights, offset) + _ahead(weights, 2 * offset)
            return self._grid_family(stiffness, None, mobility, columns, dtype)

        cells = weights + _ahead(weights, 1) + _ahead(weights, columns) + _ahead(weights, columns + 1)
        across, down = springs(0), springs(1)
        assert across is not None
        assert down is not None
        return GridConstraints(
            columns=columns,
            hands=hands_for(cloth.rows, columns, dtype),
            inverse_mass=dealt(weights, columns, dtype),
            across=across,
            down=down,
            diagonal=springs(2),
            anti=springs(3),
            bend_across=bends(0),
            bend_down=bends(1),
            twist=self._grid_family(families.twist_stiffness, None, cells, columns, dtype),
        )

    def _grid_family(
        self, stiffness: Array, rest: Array | None, mobility: Array, columns: int, dtype: type[np.floating]
    ) -> Constraints | None:
        """One family of constraints, dealt to nine hands; None where none has any stiffness."""
        if not stiffness.any():
            return None
        return self._constraints(
            dealt(stiffness, columns, dtype),
            None if rest is None else dealt(rest, columns, dtype),
            dealt(mobility, columns, dtype),
            dtype,
        )

    def _pieces(self, assembly: Assembly, dtype: type[np.floating]) -> list[PieceConstraints]:
        from cape.assembly.mesh.pieces import alike_pieces

        return [
            PieceConstraints(self._mesh(assembly, own.springs, dtype), *damping_times(own.fabric, own.springs))
            for own in alike_pieces(assembly.cloth, assembly.springs)
        ]

    def _mesh(self, assembly: Assembly, springs: Springs, dtype: type[np.floating]) -> MeshConstraints:
        weights = assembly.inverse_mass
        stretched = membrane = None
        if springs.membrane is not None:
            membrane = self._membrane(springs.membrane, len(weights), dtype)
        else:
            stretched = self._springs(springs, weights, dtype)
        return MeshConstraints(
            springs=stretched,
            membrane=membrane,
            bends=self._bends(springs, weights, dtype) if springs.bend_stiffness.any() else None,
            packed=aligned(SIDE * (len(weights) + 1), dtype),
            rows=np.zeros((len(assembly.ranks), 4 * NEXT), dtype=dtype),
        )

    def _springs(self, springs: Springs, weights: Array, dtype: type[np.floating]) -> SpringConstraints:
        own = springs.acting_numbers
        pairs = np.stack([springs.first[own], springs.second[own]], axis=1)
        blocks = in_blocks(by_color(pairs), LANES)
        ends, laid = np.zeros((len(blocks.places), 2 * LANES), np.uint32), np.zeros((3, blocks.places.size))
        lay_springs(pairs, springs.stiffness[own], springs.rest[own], weights, blocks.places, ends, laid)
        stiffness, rest, mobility = laid
        stretch = self._constraints(stiffness, rest, mobility, dtype)
        return SpringConstraints(ends=ends, starts=blocks.starts, stretch=stretch)

    def _membrane(self, membrane: Membrane, nobody: int, dtype: type[np.floating]) -> MembraneConstraints:
        edges, c = membrane.edges(), membrane.stiffness
        blocks = in_blocks(by_color(edges.vertices), LANES)
        vertices = edges.vertices.copy()
        vertices[edges.shares[:, 1] == 0.0, 3] = nobody
        impulse = np.zeros((len(blocks.places), 3 * LANES), dtype=dtype) if self.iterations > 1 else None
        return MembraneConstraints(
            tension=Tension(float(c[0, 0]), float(c[1, 1]), float(c[0, 1]), float(c[2, 2])),
            vertices=_by_rows(vertices, blocks, nobody).astype(np.uint32),
            numbers=_by_rows(edges.numbers, blocks).astype(dtype),
            starts=blocks.starts,
            impulse=impulse,
        )

    def _bends(self, springs: Springs, weights: Array, dtype: type[np.floating]) -> BendConstraints:
        vertices, coefficients, stiffness = _patches(springs)
        counts, colors = np.zeros(len(vertices), np.int64), by_color(vertices)
        count_members(coefficients, counts)
        # Within a colour any order is the same: patches of one size follow each other, so that loops end as foreseen.
        color = np.repeat(np.arange(len(colors.starts) - 1), np.diff(colors.starts))
        order = colors.order[np.lexsort([counts[colors.order], color])]
        first, total = np.zeros(len(order) + 1, np.int64), int(counts.sum())
        members, table = np.zeros(total, np.uint32), np.zeros(ROWS * total, dtype)
        mixed, mobility = np.zeros((2, len(order), ROWS))
        lay_bends(vertices, coefficients, weights, order, first, members, table, mixed, mobility)
        return BendConstraints(
            first=first,
            members=members,
            coefficients=table,
            mixed=mixed.astype(dtype),
            starts=colors.starts,
            bend=self._constraints(stiffness[order].ravel(), None, mobility.ravel(), dtype),
        )

    def _constraints(
        self, stiffness: Array, rest: Array | None, mobility: Array, dtype: type[np.floating]
    ) -> Constraints:
        """Constraints with room for their gains, and for impulses where several sweeps need them."""
        several = self.iterations > 1
        shape = stiffness.shape if rest is not None else (3, *stiffness.shape)
        return Constraints(
            stiffness=stiffness.astype(dtype),
            rest=None if rest is None else rest.astype(dtype),
            mobility=mobility.astype(dtype),
            gain=np.zeros(stiffness.shape, dtype=dtype),
            slack=np.zeros(stiffness.shape, dtype=dtype) if several else None,
            impulse=np.zeros(shape, dtype=dtype) if several else None,
        )


def step_of(chain: Chain) -> float:
    """The step [s] with which a cloth hangs down too far by `TOO_LONG` of its length, infinite without gravity."""
    sag = SWEPT * chain.sag
    return math.sqrt(TOO_LONG * chain.length / sag) if min(sag, chain.length) > 0.0 else math.inf


def _patches(springs: Springs) -> tuple[NDArray[np.int64], Array, Array]:
    """Bend springs on the same vertices together: vertices (K, M), coefficients (K, 3, M) and stiffness (K, 3)."""
    members, count = springs.bend_vertices, len(springs.bend_vertices)
    if springs.in_slots:
        # Three by three already, but some may be idle.
        acts, coefficients = springs.bend_stiffness > 0.0, springs.bend_coefficients
        vertices, stiffness = np.ascontiguousarray(members[::3]), springs.bend_stiffness.reshape(-1, 3)
        if acts.all():
            return vertices, coefficients.reshape(count // 3, 3, -1), stiffness
        some = acts.reshape(-1, 3).any(axis=1)
        coefficients = (coefficients * acts[:, None]).reshape(count // 3, 3, -1)
        return vertices[some], coefficients[some], stiffness[some]
    # Neighbours may have the same vertices, too: three by three of each run.
    unlike = np.ones(count, dtype=bool)
    unlike[1:] = (members[1:] != members[:-1]).any(axis=1)
    place = np.arange(count)
    row = (place - np.maximum.accumulate(np.where(unlike, place, 0))) % 3
    patch, first = np.cumsum(row == 0) - 1, np.flatnonzero(row == 0)
    shape = (len(first), 3)
    coefficients, stiffness = np.zeros((*shape, members.shape[1])), np.zeros(shape)
    coefficients[patch, row], stiffness[patch, row] = springs.bend_coefficients, springs.bend_stiffness
    return members[first], coefficients, stiffness


def _by_rows(values: NDArray[Any], blocks: Blocks, nobody: float = 0) -> NDArray[Any]:
    """Values of constraints, (E,) or (E, m), block by block, (B, m lanes): the first of each, then the next;
    `nobody` where there is none."""
    rows = np.reshape(values, (len(values), -1))
    found = np.where(blocks.places[..., None] < 0, nobody, rows[blocks.places])
    return np.ascontiguousarray(np.swapaxes(found, 1, 2)).reshape(len(found), -1)


def _ahead(values: Array, offset: int) -> Array:
    """For each vertex the value of the one that far ahead, zero beyond the last."""
    return np.concatenate([values[offset:], np.zeros(min(offset, len(values)))])
