"""Symplectic Euler: v += dt a, then x += dt v with the new v."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly, force_scratch, inertia_of
from cape.assembly.fabrics import patchwork_of
from cape.assembly.stability import Ground, largest_step
from cape.cloth.cloth import GridCloth
from cape.forces.base import Force
from cape.forces.registry import forces_in
from cape.kernels.cloth.grid import GridRoom
from cape.kernels.linking import Linker
from cape.kernels.program import Use
from cape.kernels.solve.euler import EulerStep, advance
from cape.kernels.state import Inertia
from cape.solvers.base import Precision, Solver
from cape.solvers.order import Order, begin_frame, blow, end_substep, forces, move_bones, wait
from cape.solvers.running import Running, Thread
from motions.border import checked
from motions.errors import ValueRangeError

if TYPE_CHECKING:
    from cape.assembly.mesh.split_springs import Changed

# A step adds dt v to a position. Below some 2000 steps in a frame of a 60th of a second that is, at 1 m/s, more than a
# hundred times the last digit of a position of 0.5 m in single precision.
SHORTEST_SINGLE_STEP = 1.0 / 60.0 / 2000.0  # s


class EulerArrays(NamedTuple):
    """What the steps of a run share.

    The arrays of each force in its precision, the sums of forces (3, N) [N], scratch of each thread, and the largest
    stable steps [s] of a cloth at rest, and strained.
    """

    forces: dict[type[Force], Any]
    inertia: Inertia
    total: NDArray[np.floating]
    scratch: tuple[GridRoom | None, ...]
    stable_step: float
    strained_step: float


@checked
@dataclass(frozen=True, kw_only=True)
class SymplecticEuler(Solver):
    """Explicit mass-spring dynamics, first order in time, without numerical damping.

    The step must stay below a bound given by the stiffest spring and lightest vertex (`stability.largest_step`); it
    shrinks with the square root of the stiffness, so that very stiff cloth becomes dear.

    Attributes:
        precision: None for single, or double where steps are too short for single precision.
        margin: share of the largest stable step that is used; the rest is for what strain, as long as it is small,
            and contact add.
    """

    name: ClassVar[str] = "euler"
    title: ClassVar[str] = "symplectic Euler"
    colour: ClassVar[str] = "#1b6ca8"
    usual_precision: ClassVar[Precision] = "single"
    order: ClassVar[float] = 1.0
    splits: ClassVar[bool] = True
    splits_grids: ClassVar[bool] = True
    margin: float = 0.9

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            ValueRangeError: a setting is out of range.
        """
        super().__post_init__()
        if not 0.0 < self.margin <= 1.0:
            raise ValueRangeError(f"margin must be above 0 and at most 1, not {self.margin}")

    def dtype(self, assembly: Assembly) -> type[np.floating]:
        """The precision for a scene, as a numpy type."""
        return self._dtype(assembly, lambda: _stable_step(assembly))

    def _dtype(self, assembly: Assembly, stable_step: Callable[[], float]) -> type[np.floating]:
        if self.precision is None and self.margin * stable_step() <= SHORTEST_SINGLE_STEP:
            return np.float64
        return super().dtype(assembly)

    def steps_as(self, other: Solver, running: Running) -> bool:
        """Tell whether it steps what another solver has made as that does; a margin tells the number of steps alone,
        unless they are too short for the precision."""
        if not isinstance(other, SymplecticEuler) or not super().steps_as(replace(other, margin=self.margin), running):
            return False
        arrays: EulerArrays = running.arrays
        return self._dtype(running.assembly, lambda: arrays.stable_step) is running.state.x.dtype.type

    def in_steps(self, substeps: int, duration: float) -> "SymplecticEuler":
        """The same with so many steps in a frame of `duration` [s], in double precision where they are too short."""
        precision = "double" if duration / substeps <= SHORTEST_SINGLE_STEP else self.precision
        return replace(self, substeps=substeps, precision=precision)

    def arrays(self, assembly: Assembly) -> EulerArrays:
        """Convert the forces and find the largest stable step."""
        dtype = self.dtype(assembly)
        return EulerArrays(
            forces={force: force.arrays(assembly, dtype) for force in forces_in(assembly)},
            inertia=inertia_of(assembly, dtype),
            total=np.zeros((3, assembly.cloth.vertices), dtype=dtype),
            scratch=force_scratch(assembly, dtype),
            stable_step=_stable_step(assembly),
            strained_step=_largest_step(assembly, None),
        )

    def choose_substeps(self, running: Running, duration: float, *, strained: bool = False) -> int:
        """Number of steps in a frame of `duration` [s]: as asked, or as many as stability needs."""
        if self.substeps is not None:
            return self.substeps
        arrays: EulerArrays = running.arrays
        return max(1, math.ceil(duration / (self.margin * (arrays.strained_step if strained else arrays.stable_step))))

    def grip(self, running: Running, mass: float) -> tuple[float, float]:
        """As firm and as damped as the margin of the step leaves room for, without steps any shorter.

        Where w^2 h^2 + 2 c h = 4 at the largest step (`stability.stable_step`), a share of it takes up no more than
        that share of 4: half of the rest is for the spring of a hand, half for its damper. A margin of 1 leaves none.
        """
        stiffness, damping = super().grip(running, mass)
        room, step = 2.0 * (1.0 - self.margin) * mass, self.margin * running.arrays.stable_step
        return min(stiffness, room / step**2), min(damping, 0.5 * room / step)

    def follow(self, arrays: EulerArrays, assembly: Assembly, changed: "Changed") -> EulerArrays:
        """Take steps as short as a mesh needs that has split, if they were longer."""
        from cape.assembly.mesh.split_springs import SplitMeshSprings
        from cape.assembly.mesh.split_stability import steps_near

        springs = assembly.springs
        assert isinstance(springs, SplitMeshSprings)
        fabric, flat = assembly.cloth.fabric, _flat(assembly)
        rest, strained = steps_near(springs, changed, fabric, assembly.inverse_mass, flat, _ground(assembly))
        return arrays._replace(
            stable_step=min(arrays.stable_step, rest), strained_step=min(arrays.strained_step, strained)
        )

    def units(self, thread: Thread, linker: Linker) -> Order:
        """Forces, integration, contact, attachments."""
        running = thread.running
        arrays: EulerArrays = running.arrays
        return Order(
            begin=begin_frame(thread),
            substep=[
                *blow(thread, 0.5),
                *forces(thread, list(arrays.forces), arrays.total, arrays.scratch[thread.rank]),
                *wait(thread),
                Use(advance, EulerStep(running.state, arrays.inertia, arrays.total)),
                *move_bones(thread),
                *end_substep(thread, linker, holding=True),
                *wait(thread),
            ],
        )


def _stable_step(assembly: Assembly) -> float:
    return _largest_step(assembly, _flat(assembly))


def _flat(assembly: Assembly) -> NDArray[np.float64]:
    """Where vertices are at rest [m], shape (N, 3)."""
    cloth = assembly.cloth
    if isinstance(cloth, GridCloth) and not cloth.darted:
        return np.column_stack([cloth.pattern, np.zeros(cloth.vertices)])
    return cloth.positions


def _largest_step(assembly: Assembly, positions: NDArray[np.float64] | None) -> float:
    """The largest stable step [s]: of the piece, where these are of several fabrics, that needs the shortest."""
    cloth, springs, ground = assembly.cloth, assembly.springs.acting, _ground(assembly)
    if patchwork_of(cloth) is None:
        return largest_step(springs, cloth.fabric, assembly.inverse_mass, positions, ground)
    from cape.assembly.mesh.pieces import pieces_of

    light = assembly.inverse_mass
    return min(
        largest_step(piece.springs, piece.fabric, np.where(piece.vertices, light, 0.0), positions, ground)
        for piece in pieces_of(cloth, springs)
    )


def _ground(assembly: Assembly) -> Ground | None:
    """What holds vertices softly; None for nothing."""
    pull = assembly.pull
    if pull is None:
        return None
    held = np.zeros((2, assembly.cloth.vertices))
    held[:, pull.attached.vertices] = pull.stiffness, pull.damping
    return Ground(*held)
