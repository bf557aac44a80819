"""Symplectic Euler: v += dt a, then x += dt v with the new v."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly, force_model, force_scratch, inertia_of
from cape.assembly.stability import largest_step
from cape.cloth.cloth import GridCloth
from cape.kernels.cloth.grid import GridRoom
from cape.kernels.records import ForceModel, Inertia, Motion, State
from cape.kernels.solve.euler import euler_frame
from cape.solvers.base import Precision, Solver
from motions.errors import ValueRangeError

# A step adds dt v to a position. Below some 2000 steps in a frame of a 60th of a second that is, at 1 m/s, more than a
# hundred times the last digit of a position of 0.5 m in single precision.
SHORTEST_SINGLE_STEP = 1.0 / 60.0 / 2000.0  # s


class EulerRoom(NamedTuple):
    """What the steps of a run share.

    Forces in its precision, scratch of each thread, and the largest stable steps [s] of a cloth at rest, and strained.
    """

    model: ForceModel
    inertia: Inertia
    forces: NDArray[np.floating]
    scratch: tuple[GridRoom | None, ...]
    stable_step: float
    strained_step: float


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
    usual_precision: ClassVar[Precision] = "single"
    order: ClassVar[float] = 1.0
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
        if self.precision is None and self.margin * _stable_step(assembly) <= SHORTEST_SINGLE_STEP:
            return np.float64
        return super().dtype(assembly)

    def init(self, assembly: Assembly) -> EulerRoom:
        """Convert the springs and find the largest stable step."""
        dtype = self.dtype(assembly)
        return EulerRoom(
            model=force_model(assembly, dtype),
            inertia=inertia_of(assembly, dtype),
            forces=np.zeros((3, assembly.cloth.vertices), dtype=dtype),
            scratch=force_scratch(assembly, dtype),
            stable_step=_stable_step(assembly),
            strained_step=largest_step(assembly.springs, assembly.cloth.fabric, assembly.inverse_mass, None),
        )

    def choose_substeps(self, room: EulerRoom, duration: float, *, strained: bool = False) -> int:
        """Number of steps in a frame of `duration` [s]: as asked, or as many as stability needs."""
        if self.substeps is not None:
            return self.substeps
        return max(1, math.ceil(duration / (self.margin * (room.strained_step if strained else room.stable_step))))

    @property
    def _frame(self) -> Callable[..., Any]:
        return euler_frame

    def _arguments(
        self, assembly: Assembly, room: EulerRoom, rank: int, state: State, motion: Motion
    ) -> tuple[Any, ...]:
        own = assembly.ranks[rank]
        return (
            state, room.model, room.inertia, room.forces, room.scratch[rank], motion, own.room,
            assembly.attached, own.contacts,
        )  # fmt: skip


def _stable_step(assembly: Assembly) -> float:
    cloth = assembly.cloth
    flat = cloth.positions
    if isinstance(cloth, GridCloth):
        flat = np.column_stack([cloth.pattern, np.zeros(cloth.vertices)])
    return largest_step(assembly.springs, cloth.fabric, assembly.inverse_mass, flat)
