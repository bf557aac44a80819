"""Implicit solvers for what explicit steps cannot reach: backward Euler and TR-BDF2."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly, force_model, force_scratch, inertia_of
from cape.cloth.cloth import GridCloth
from cape.kernels.cloth.grid import GridRoom
from cape.kernels.implicit.conjugate_gradients import CHUNK
from cape.kernels.implicit.implicit import GAMMA, UNSOLVED, backward_euler_frame, tr_bdf2_frame
from cape.kernels.records import Attached, Contacts, ForceModel, Inertia, Motion, MotionRoom, State
from cape.kernels.solve.journal import Journal
from cape.solvers.base import Precision, Solver
from motions.errors import ValueRangeError

SUBSTEPS = 8  # per frame at 60 Hz, where none are asked for
PRESSED = 0.1  # of the thickness
INNER = np.float32  # precision of the linear systems, whose solutions the next Newton step corrects
Array = NDArray[np.floating]


class Matrix(NamedTuple):
    """What the matrix of a Newton step is made of, as in `kernels.implicit.stiffness`: vectors and rows of length L.

    `springs` holds w and c of each spring of a grid (4 F, L), or as in `kernels.implicit.mesh_stiffness`, which needs
    `ends`; `bends` the couplings of a vertex with the next ones and the second next along each family [N/m] (2 K, L),
    None without bends; `bend_diagonal` [N/m], `mass` [kg] and `free`, 0 for attached vertices, (L,);
    `own` blocks (6, L).
    """

    front: int
    springs: Array
    ends: Array | None
    bends: Array | None
    bend_diagonal: Array
    mass: Array
    free: Array
    own: Array


class Work(NamedTuple):
    """Room that threads share: stage data (6, N), positions before a Newton step (3, N), forces (3, N), blocks (6, L),
    vectors of the conjugate gradients (5, 3, L), and sums; `scratch` is this thread's own."""

    start: Array
    target: Array
    old: Array
    acceleration: Array
    forces: Array
    inverse: Array
    vectors: Array
    terms: Array
    sums: Array
    largest: Array
    scratch: Array


class Settings(NamedTuple):
    """See `ImplicitSolver`; the tolerance is for steps that are solved with a b of `usual` [s] or more."""

    tolerance: float
    usual: float
    iterations: int
    forcing: float
    linear_iterations: int


class Penalty(NamedTuple):
    """Contact: `least` stiffness [N/m] (N,), room for forces [N] (3, N) and minus their derivatives [N/m] (6, N)."""

    least: Array
    force: Array
    blocks: Array


class Problem(NamedTuple):
    """What a thread needs to advance a frame; what is its own: `scratch`, `work.scratch`, `counts`, `bones` and
    `contacts`."""

    state: State
    model: ForceModel
    inertia: Inertia
    scratch: GridRoom | None
    matrix: Matrix
    work: Work
    settings: Settings
    counts: NDArray[np.int64]
    motion: Motion
    bones: MotionRoom
    attached: Attached | None
    contacts: Contacts
    penalty: Penalty | None


class ImplicitRoom(NamedTuple):
    """What the steps of a run share; of `scratch`, `works` and `counts` each thread has its own."""

    model: ForceModel
    inertia: Inertia
    scratch: tuple[GridRoom | None, ...]
    matrix: Matrix
    works: tuple[Work, ...]
    counts: NDArray[np.int64]
    penalty: Penalty | None


@dataclass(frozen=True, kw_only=True)
class ImplicitSolver(Solver):
    """What the implicit solvers share: stable at any step and stiffness, at the price of a system of equations.

    Each stage is solved by Newton's method, each of its linear systems by conjugate gradients with the inverse of each
    vertex's own 3x3 block as preconditioner.

    Attributes:
        stage: b in A = M - b^2 df/dx of the method's stages, as a share of its step.
        tolerance: a stage is solved when no vertex is corrected by more than this [m], nor one that is pressed onto a
            collider by more than 1e-4 m/s; what is left is far less, as Newton's method converges faster than linearly.
            In steps shorter than the usual ones it shrinks as their square, so that what is left is the same force.
        iterations: Newton steps at most in a stage.
        forcing: residual of a linear system, relative to its right hand side, at which it is solved well enough.
        linear_iterations: of the conjugate gradients, at most in a Newton step.
    """

    usual_precision: ClassVar[Precision] = "double"
    stage: ClassVar[float]
    tolerance: float = 1e-6
    iterations: int = 40
    forcing: float = 0.1
    linear_iterations: int = 500

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            ValueRangeError: a setting is out of range.
        """
        super().__post_init__()
        if not 0.0 < self.tolerance < math.inf:
            raise ValueRangeError(f"tolerance must be positive and finite, not {self.tolerance}")
        if not 0.0 < self.forcing < 1.0:
            raise ValueRangeError(f"forcing must be above 0 and below 1, not {self.forcing}")
        for name in ("iterations", "linear_iterations"):
            if getattr(self, name) < 1:
                raise ValueRangeError(f"{name} must be 1 or more, not {getattr(self, name)}")

    def init(self, assembly: Assembly) -> ImplicitRoom:
        """Lay out the matrix and the room for its products."""
        dtype, count, inner = self.dtype(assembly), assembly.cloth.vertices, INNER
        model = force_model(assembly, dtype)
        matrix = matrix_of(assembly, model, inner)
        chunks, size = -(-count // CHUNK), matrix.mass.size
        shared = Work(
            start=np.zeros((6, count), dtype),
            target=np.zeros((6, count), dtype),
            old=np.zeros((3, count), dtype),
            acceleration=np.zeros((3, count), dtype),
            forces=np.zeros((3, count), dtype),
            inverse=np.zeros((6, size), inner),
            vectors=np.zeros((5, 3, size), inner),
            terms=np.zeros(size, inner),
            sums=np.zeros((3, chunks)),
            largest=np.zeros(chunks),
            scratch=np.zeros((3, size), inner),
        )
        ranks = len(assembly.ranks)
        return ImplicitRoom(
            model=model,
            inertia=inertia_of(assembly, dtype),
            scratch=force_scratch(assembly, dtype),
            matrix=matrix,
            works=tuple(shared._replace(scratch=np.zeros((3, size), inner)) for _ in range(ranks)),
            counts=np.zeros((ranks, 4), dtype=np.int64),
            penalty=_penalty(assembly, dtype) if assembly.scene.colliders else None,
        )

    def choose_substeps(self, room: ImplicitRoom, duration: float, *, strained: bool = False) -> int:
        """Number of steps in a frame of `duration` [s]: as asked, or in proportion to 8 at 60 Hz."""
        return self.substeps or max(1, math.ceil(SUBSTEPS * 60.0 * duration - 1e-6))

    def step(
        self,
        assembly: Assembly,
        room: ImplicitRoom,
        state: State,
        motion: Motion,
        *,
        duration: float,
        substeps: int,
        threads: int = 1,
        journal: Journal | None = None,
    ) -> int:
        """Advance `state` in place by a frame of `duration` [s].

        Returns:
            How many stages were left with a correction above the tolerance.
        """
        room.counts[:] = 0
        super().step(
            assembly, room, state, motion, duration=duration, substeps=substeps, threads=threads, journal=journal
        )
        return int(room.counts[0, UNSOLVED])

    def _arguments(
        self, assembly: Assembly, room: ImplicitRoom, rank: int, state: State, motion: Motion
    ) -> tuple[Problem]:
        own = assembly.ranks[rank]
        usual = self.stage / (60.0 * SUBSTEPS)
        settings = Settings(self.tolerance, usual, self.iterations, self.forcing, self.linear_iterations)
        return (
            Problem(
                state, room.model, room.inertia, room.scratch[rank], room.matrix, room.works[rank], settings,
                room.counts[rank], motion, own.room, assembly.attached, own.contacts, room.penalty,
            ),
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class BackwardEuler(ImplicitSolver):
    """Backward Euler: first order, L-stable, damps whatever is faster than its steps and some of what is slower."""

    name: ClassVar[str] = "backward_euler"
    order: ClassVar[float] = 1.0
    stage: ClassVar[float] = 1.0

    @property
    def _frame(self) -> Callable[..., Any]:
        return backward_euler_frame


@dataclass(frozen=True, kw_only=True)
class TRBDF2(ImplicitSolver):
    """TR-BDF2: second order and L-stable, of two stages a step (Bank et al. 1985; Hosea and Shampine 1996).

    Attributes:
        tolerance: smaller than backward Euler's, since the method damps little: what a stage leaves unbalanced becomes
            motion, at 1e8 N/m and 1e-6 m some per cent of a swing's energy.
    """

    name: ClassVar[str] = "tr_bdf2"
    order: ClassVar[float] = 2.0
    stage: ClassVar[float] = 0.5 * GAMMA
    tolerance: float = 1e-7

    @property
    def _frame(self) -> Callable[..., Any]:
        return tr_bdf2_frame


def matrix_of(assembly: Assembly, model: ForceModel, dtype: type[np.floating]) -> Matrix:
    """Lay out the matrix of a cloth; see `kernels.implicit.stiffness`."""
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
    if model.mesh is not None:
        blocks, links, lanes = model.mesh.second.shape
        coefficients = np.zeros((blocks, links, 4, lanes), dtype)
        ends = np.zeros(model.mesh.forces.shape, dtype)
    if families is not None and model.grid_bends is not None:
        rows = []
        np.add.at(diagonal, springs.bend_vertices, springs.bend_stiffness[:, None] * springs.bend_coefficients**2)
        for offset, stiffness in zip(families.bend_offsets, families.bend_stiffness, strict=True):
            arriving = np.concatenate([np.zeros(offset), stiffness[: count - offset]])
            rows += [-2.0 * (stiffness + arriving), stiffness]
        bends = padded(np.stack(rows))
    return Matrix(
        front=front,
        springs=coefficients,
        ends=ends,
        bends=bends,
        bend_diagonal=padded(diagonal),
        mass=padded(assembly.mass, 1.0),
        free=padded(assembly.free),
        own=np.zeros((6, size), dtype),
    )


def _penalty(assembly: Assembly, dtype: type[np.floating]) -> Penalty:
    """Contact that the weight of the whole cloth on a single vertex presses in by a tenth of the thickness."""
    count, thickness = assembly.cloth.vertices, assembly.scene.thickness
    gravity = max(float(np.linalg.norm(assembly.scene.gravity)), 1.0)
    least = gravity * float(assembly.mass.sum()) / (PRESSED * max(thickness, 1e-4))
    return Penalty(np.full(count, least, dtype), np.zeros((3, count), dtype), np.zeros((6, count), dtype))
