"""Implicit solvers for what explicit steps cannot reach: backward Euler and TR-BDF2."""

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly, force_scratch, inertia_of
from cape.assembly.contact import Contacts
from cape.forces.base import Force
from cape.forces.elastic import Elastic
from cape.forces.registry import forces_in
from cape.kernels.cloth.grid import GridRoom
from cape.kernels.contact.penalty import Penalty, PenaltyContact, find_touchable, press_colliders
from cape.kernels.contact.units import note_motion
from cape.kernels.implicit.accelerations import (
    Balance,
    find_acceleration,
    hold_back,
    hold_back_at_start,
    keep_acceleration,
    leave_out_contact,
)
from cape.kernels.implicit.conjugate_gradients import CHUNK
from cape.kernels.implicit.implicit import (
    GAMMA,
    GUARD,
    UNSOLVED,
    Holding,
    Placing,
    Problem,
    Settings,
    Stage,
    System,
    Work,
    aim_again,
    aim_backward,
    aim_bdf2,
    aim_newton_step,
    aim_trapezoid,
    evaluate,
    place_attached,
    place_bones,
    solve_stage,
)
from cape.kernels.implicit.sliding import Railing, pull_to_rails
from cape.kernels.implicit.stiffness import Matrix
from cape.kernels.linking import Linker
from cape.kernels.program import Use
from cape.kernels.self_contact.self_contact import PressedAcceleration, PressedForces, add_held, add_pressure
from cape.kernels.state import Inertia
from cape.solvers.base import MOST_ITERATIONS, Precision, Solver
from cape.solvers.matrix import Layout, link_blocks, matrix_of, matrix_units
from cape.solvers.multigrid import Levels, levels_of, multigrid
from cape.solvers.order import Order, aim_springs, begin_frame, blow, end_substep, forces
from cape.solvers.running import Running, Thread
from motions.border import checked
from motions.errors import ValueRangeError, require_whole

SUBSTEPS = 8  # per frame at 60 Hz, where none are asked for
PRESSED = 0.1  # of the thickness
OFF_RAIL = 1e-4  # m that the whole cloth's weight on a single vertex takes that off its curve within a stage
AT_START = 1e-3  # forcing, for the accelerations with which a frame begins
ROUNDED = 4.0  # times a coordinate's last digit
WEAK = 0.2  # of the forcing and of mass/b^2, b of a usual step or a longer one: bending that a matrix does without
INNER = np.float32  # precision of the linear systems, whose solutions the next Newton step corrects
Array = NDArray[np.floating]


class ImplicitArrays(NamedTuple):
    """What the steps of a run share; of `room`, `scratch` and `counts` each thread has its own."""

    forces: dict[type[Force], Any]
    inertia: Inertia
    room: tuple[GridRoom | None, ...]
    matrix: Matrix
    layout: Layout
    levels: Levels | None
    work: Work
    scratch: tuple[Array, ...]
    counts: NDArray[np.int64]
    penalty: Penalty | None


@dataclass(frozen=True, kw_only=True)
class ImplicitSolver(Solver):
    """What the implicit solvers share: stable at any step and stiffness, at the price of a system of equations.

    Each stage is solved by Newton's method, each of its linear systems by conjugate gradients. Where cloth can touch
    nothing these have a multigrid preconditioner, so that finer cloth takes no more iterations; otherwise, where a
    tenth of the residual may stay, the inverse of each vertex's own 3x3 block. What a step leaves for contact and for
    limits of strain to correct they correct on a copy in single precision (`kernels.solve.rounding`).

    Attributes:
        stage: b in A = M - b^2 df/dx of the method's stages, as a share of its step.
        tolerance: a stage is solved when no vertex is corrected by more than this [m], nor one that is pressed onto a
            collider by more than 1e-4 m/s; what is left is far less, as Newton's method converges faster than linearly.
            In steps shorter than the usual ones it shrinks as their square, so that what is left is the same force.
            At its default it is that of cloth that may touch something, whose impacts leave no order to keep.
        left_free: what may be left to correct in a usual step [m] of cloth that can touch nothing, at the default
            tolerance: root mean square over the vertices, as errors are told. The largest of all would ask for more,
            the finer the cloth. A method of order p makes errors of h^(p+1) in the velocities of a step of h, and
            vertices that are off by this have velocities off by this over b: it shrinks as h^(p+2), so that the order
            stays. What is left is seen from how far the linear solver would go next, so that one Newton step may be
            enough.
        forcing_free: the forcing of such cloth, at the default forcing; less will do where little is left.
        iterations: Newton steps at most in a stage.
        forcing: residual of a linear system, relative to its right hand side, at which it is solved well enough.
        linear_iterations: of the conjugate gradients, at most in a Newton step.
    """

    usual_precision: ClassVar[Precision] = "double"
    rounds: ClassVar[bool] = True
    measured_steps: ClassVar[tuple[int, ...]] = (1, 2, 4, 8, 16, 32, 64)
    cost_growth: ClassVar[float] = 0.5
    stage: ClassVar[float]
    left_free: ClassVar[float]
    forcing_free: ClassVar[float]
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
            require_whole(name, getattr(self, name), 1, MOST_ITERATIONS)

    def arrays(self, assembly: Assembly) -> ImplicitArrays:
        """Lay out the matrix and the room for its products."""
        dtype, count = self.dtype(assembly), assembly.cloth.vertices
        arrays = {force: force.arrays(assembly, dtype) for force in forces_in(assembly)}
        longest = self.stage / (60.0 * min(self.substeps or SUBSTEPS, SUBSTEPS))
        negligible = WEAK * min(self.forcing, self.forcing_free) / longest**2
        matrix, layout = matrix_of(assembly, arrays[Elastic], INNER, negligible=negligible)
        chunks, size = -(-count // CHUNK), matrix.mass.size
        ranks, terms = len(assembly.ranks), np.zeros(size, INNER)
        # What touches something is solved for so loosely that levels cost more than they save; pieces that are damped
        # in different ways have no springs in common of which levels could be made.
        leveled = _is_free(assembly.contacts) and not layout.pieces
        links = link_blocks(matrix, layout, arrays[Elastic]) if leveled else None
        return ImplicitArrays(
            forces=arrays,
            inertia=inertia_of(assembly, dtype),
            room=force_scratch(assembly, dtype),
            matrix=matrix,
            layout=layout,
            levels=levels_of(assembly, matrix, links, terms),
            work=Work(
                start=np.zeros((6, count), dtype),
                target=np.zeros((6, count), dtype),
                old=np.zeros((3, count), dtype),
                acceleration=np.zeros((3, count), dtype),
                forces=np.zeros((3, count), dtype),
                terms=terms,
                sums=np.zeros((3, chunks)),
                largest=np.zeros(chunks),
            ),
            scratch=tuple(np.zeros((3, size), INNER) for _ in range(ranks)),
            counts=np.zeros((ranks, 4), dtype=np.int64),
            penalty=_penalty(assembly, dtype) if assembly.scene.colliders else None,
        )

    def choose_substeps(self, running: Running, duration: float, *, strained: bool = False) -> int:
        """Number of steps in a frame of `duration` [s]: as asked, or in proportion to 8 at 60 Hz."""
        return self.substeps or max(1, math.ceil(SUBSTEPS * 60.0 * duration - 1e-6))

    def begin(self, running: Running) -> None:
        """Count anew."""
        running.arrays.counts[:] = 0

    def unconverged(self, running: Running) -> int:
        """How many stages were left with a correction above the tolerance."""
        return int(running.arrays.counts[0, UNSOLVED])

    def units(self, thread: Thread, linker: Linker) -> Order:
        """The stages of a step, then what contact forces have left to do."""
        begin = begin_frame(thread)
        contact = self._contact(thread)
        if contact is not None:
            begin.append(Use(find_touchable, contact))
        return Order(begin, self._step(thread, linker, contact))

    @abstractmethod
    def _step(self, thread: Thread, linker: Linker, contact: PenaltyContact | None) -> list[Use]:
        """The units of a step."""

    def _contact(self, thread: Thread) -> PenaltyContact | None:
        running, contacts = thread.running, thread.contacts
        arrays: ImplicitArrays = running.arrays
        if contacts.colliders is None or arrays.penalty is None:
            return None
        return PenaltyContact(
            running.state, arrays.inertia, contacts.free, contacts.colliders, thread.bones, arrays.penalty,
            arrays.work.target, arrays.work.forces,
        )  # fmt: skip

    def _railing(self, thread: Thread) -> Railing | None:
        """The springs that stand for curves within a stage; None where nothing slides."""
        running, arrays = thread.running, thread.running.arrays
        rails = running.assembly.rails
        if rails is None:
            return None
        least = _weight(running.assembly) / OFF_RAIL
        return Railing(running.state, arrays.inertia, rails, thread.bones, least, arrays.work.forces, arrays.matrix)

    def _problem(
        self,
        thread: Thread,
        linker: Linker,
        contact: PenaltyContact | None,
        *,
        start: bool = False,
        later: bool = False,
    ) -> Problem:
        """The equations of a stage with some contact, or none; or of the accelerations at the `start` of a frame.

        A `later` stage of a step is preconditioned by what the one before has left, as long as no contact may come in
        between: to find it anew takes about as long as an iteration, and saves none.
        """
        running = thread.running
        arrays: ImplicitArrays = running.arrays
        residual = forces(thread, list(arrays.forces), arrays.work.forces, arrays.room[thread.rank])
        if contact is not None:
            residual.append(Use(press_colliders, contact))
        railing = self._railing(thread)
        if railing is not None:
            residual.append(Use(pull_to_rails, railing))
        pressure = thread.contacts.pressure
        if pressure is not None:
            residual.append(Use(add_pressure, PressedForces(pressure, arrays.inertia.mass, arrays.work.forces)))
        units = matrix_units(
            thread, arrays.matrix, arrays.layout, arrays.forces[Elastic], arrays.scratch[thread.rank],
            contact=contact, railing=railing,
        )  # fmt: skip
        gathering, precondition = multigrid(thread, arrays.levels, linker)
        linearise = units.linearise
        if not (later and arrays.levels is not None):
            linearise = [*linearise, *units.diagonal, *(units.nearest if gathering else []), *gathering]
        system = System(
            state=running.state,
            inertia=arrays.inertia,
            matrix=arrays.matrix,
            work=arrays.work,
            settings=self._settings(thread, start=start),
            counts=arrays.counts[thread.rank],
            found=np.zeros(2),
            residual=linker.program(residual),
            linearise=linker.program(linearise),
            product=linker.program(units.product),
            precondition=linker.program(precondition),
        )
        return Problem(
            system=system,
            evaluate=linker.program([Use(evaluate, system)]),
            aim=linker.program([Use(aim_newton_step, system)]),
            again=linker.program([Use(aim_again, system)] if system.settings.closely else []),
            pressing=np.zeros((3, 0), arrays.work.forces.dtype) if contact is None else contact.penalty.force,
        )

    def _settings(self, thread: Thread, *, start: bool) -> Settings:
        """What stages are solved to, or the accelerations at the `start` of a frame."""
        contacts, dtype = thread.contacts, thread.running.state.x.dtype
        free = _is_free(contacts)
        # What is asked for holds as it is; the defaults know better where no contact spoils the order.
        usual = type(self)
        follows = free and self.tolerance == usual.tolerance
        forcing = self.forcing_free if free and self.forcing == usual.forcing else self.forcing
        return Settings(
            tolerance=self.left_free if follows else self.tolerance,
            power=int(self.order) + 2 if follows else 2,
            closely=follows and not start,
            usual=self.stage / (60.0 * SUBSTEPS),
            digits=ROUNDED * float(np.finfo(dtype).eps),
            iterations=self.iterations,
            forcing=min(forcing, AT_START) if start else forcing,
            forcing_power=2 if start else 0,
            linear_iterations=self.linear_iterations,
        )

    def _place(self, thread: Thread, at: float) -> list[Use]:
        """Place the bones, and what they hold, at a share of the step."""
        running = thread.running
        attached, colliders = running.assembly.attached, thread.contacts.colliders
        uses = [*blow(thread, at), Use(place_bones, Placing(running.motion, thread.bones, at))]
        if colliders is not None:
            uses.append(Use(note_motion, colliders))
        if attached is not None:
            holding = Holding(running.state, attached, thread.bones, running.arrays.work.target, at, self.stage)
            uses.append(Use(place_attached, holding))
        return [*uses, *aim_springs(thread, at)]

    def _end(self, thread: Thread, linker: Linker, earlier: Array | None) -> list[Use]:
        """Move out what a step leaves deeper than contact forces should, or on a fast limb's other side."""
        arrays: ImplicitArrays = thread.running.arrays
        force = None if arrays.penalty is None else arrays.penalty.force
        return end_substep(thread, linker, pressing=False, earlier=earlier, share=GUARD, force=force)


@checked
@dataclass(frozen=True, kw_only=True)
class BackwardEuler(ImplicitSolver):
    """Backward Euler: first order, L-stable, damps whatever is faster than its steps and some of what is slower."""

    name: ClassVar[str] = "backward_euler"
    title: ClassVar[str] = "backward Euler"
    colour: ClassVar[str] = "#6a994e"
    order: ClassVar[float] = 1.0
    stage: ClassVar[float] = 1.0
    left_free: ClassVar[float] = 1e-7
    forcing_free: ClassVar[float] = 0.01

    def _step(self, thread: Thread, linker: Linker, contact: PenaltyContact | None) -> list[Use]:
        """One stage, from the step's start to its end."""
        problem = self._problem(thread, linker, contact)
        return [
            *self._place(thread, 0.0),
            Use(aim_backward, problem.system),
            *self._place(thread, 1.0),
            Use(solve_stage, Stage(problem, self.stage)),
            *self._end(thread, linker, None),
        ]


@checked
@dataclass(frozen=True, kw_only=True)
class TRBDF2(ImplicitSolver):
    """TR-BDF2: second order and L-stable, of two stages a step (Bank et al. 1985; Hosea and Shampine 1996).

    Linear systems of free cloth are solved so well that one Newton step is enough for most stages, from where the
    acceleration before would lead. What a stage leaves unbalanced becomes motion, as the method damps little: 1e-6 m at
    1e8 N/m is some per cent of a swing.
    """

    name: ClassVar[str] = "tr_bdf2"
    title: ClassVar[str] = "TR-BDF2"
    colour: ClassVar[str] = "#8e6bbf"
    order: ClassVar[float] = 2.0
    stage: ClassVar[float] = 0.5 * GAMMA
    left_free: ClassVar[float] = 1e-8
    forcing_free: ClassVar[float] = 0.001
    tolerance: float = 1e-7

    def _step(self, thread: Thread, linker: Linker, contact: PenaltyContact | None) -> list[Use]:
        """A stage of the trapezoidal rule, one of the backward differentiation formula."""
        problem, work = self._problem(thread, linker, contact), thread.running.arrays.work
        later = self._problem(thread, linker, contact, later=True)
        pressure = thread.contacts.pressure
        start = self._problem(thread, linker, None, start=True)
        uses = [*self._place(thread, 0.0), Use(find_acceleration, Stage(start, self.stage))]
        balancing = None
        if contact is not None:
            pressing = linker.program([Use(press_colliders, contact)])
            balancing = Balance(
                work.acceleration, problem.system.inertia.inverse_mass, contact.penalty, pressing, self.stage
            )
            uses.append(Use(hold_back_at_start, balancing))
        uses += [
            Use(aim_trapezoid, problem.system),
            *self._place(thread, GAMMA),
            Use(solve_stage, Stage(problem, self.stage)),
            Use(aim_bdf2, problem.system),
            *self._place(thread, 1.0),
            Use(solve_stage, Stage(later, self.stage)),
            Use(keep_acceleration, Stage(problem, self.stage)),
        ]
        if balancing is not None:
            uses.append(Use(leave_out_contact, balancing))
        if pressure is not None:
            uses.append(Use(add_held, PressedAcceleration(pressure, work.acceleration, -1.0)))
        uses += self._end(thread, linker, work.start)
        if pressure is not None:
            uses.append(Use(add_held, PressedAcceleration(pressure, work.acceleration, 1.0)))
        if balancing is not None:
            uses.append(Use(hold_back, balancing))
        return uses


def _is_free(contacts: Contacts) -> bool:
    """Tell whether a cloth can touch nothing."""
    return contacts.colliders is None and contacts.layers is None


def _penalty(assembly: Assembly, dtype: type[np.floating]) -> Penalty:
    """Contact that the weight of the whole cloth on a single vertex presses in by a tenth of the thickness."""
    count, thickness = assembly.cloth.vertices, assembly.scene.thickness
    least = _weight(assembly) / (PRESSED * max(thickness, 1e-4))
    return Penalty(np.full(count, least, dtype), np.zeros((3, count), dtype), np.zeros((6, count), dtype))


def _weight(assembly: Assembly) -> float:
    """Weight of the whole cloth [N], in some gravity where there is none."""
    return max(float(np.linalg.norm(assembly.scene.gravity)), 1.0) * float(assembly.mass.sum())
