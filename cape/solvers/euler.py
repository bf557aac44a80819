"""Symplectic Euler: v += dt a, then x += dt v with the new v."""

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assemble import Assembly
from cape.kernels.euler import euler_frame
from cape.kernels.records import GridSprings, Motion, State
from cape.solvers.base import Solver
from cape.stability import largest_step
from motions.errors import ValueRangeError


class EulerRoom(NamedTuple):
    """What the steps of a run share: springs in its precision, room for forces, and the largest stable step [s]."""

    springs: GridSprings
    forces: NDArray[np.floating]
    spring_room: NDArray[np.floating]
    stable_step: float


@dataclass(frozen=True, kw_only=True)
class SymplecticEuler(Solver):
    """Explicit mass-spring dynamics, first order in time, without numerical damping.

    The step must stay below a bound given by the stiffest spring and lightest vertex (`stability.largest_step`); it
    shrinks with the square root of the stiffness, so that very stiff cloth becomes dear.

    Attributes:
        margin: share of the largest stable step of the cloth at rest that is used; the rest is for what motion and
            contact add.
    """

    name: ClassVar[str] = "euler"
    margin: float = 0.9

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            ValueRangeError: a setting is out of range.
        """
        super().__post_init__()
        if not 0.0 < self.margin <= 1.0:
            raise ValueRangeError(f"margin must be above 0 and at most 1, not {self.margin}")

    def init(self, assembly: Assembly) -> EulerRoom:
        """Convert the springs and find the largest stable step."""
        springs, cloth, dtype = assembly.springs, assembly.scene.cloth, self.dtype
        flat = np.column_stack([cloth.pattern, np.zeros(cloth.vertices)])
        grid = GridSprings(
            offsets=springs.offsets,
            stiffness=springs.stiffness.astype(dtype),
            rest=springs.rest.astype(dtype),
            bend_offsets=springs.bend_offsets,
            bend_stiffness=springs.bend_stiffness.astype(dtype),
            inverse_mass=assembly.inverse_mass.astype(dtype),
            damping_time=cloth.fabric.damping_time,
            bend_damping_time=cloth.fabric.bend_damping_time,
            gravity=np.array(assembly.scene.gravity, dtype=float),
        )
        return EulerRoom(
            grid,
            forces=np.zeros((3, cloth.vertices), dtype=dtype),
            spring_room=np.zeros((3, cloth.vertices), dtype=dtype),
            stable_step=largest_step(springs, cloth.fabric, assembly.inverse_mass, flat),
        )

    def choose_substeps(self, room: EulerRoom, duration: float) -> int:
        """Number of steps in a frame of `duration` [s]: as asked, or as many as stability needs."""
        if self.substeps is not None:
            return self.substeps
        return max(1, math.ceil(duration / (self.margin * room.stable_step)))

    def step(
        self, assembly: Assembly, room: EulerRoom, state: State, motion: Motion, *, duration: float, substeps: int
    ) -> None:
        """Advance `state` in place by a frame of `duration` [s]."""
        euler_frame(
            state, room.springs, room.forces, room.spring_room, motion, assembly.room,
            assembly.attached, assembly.air, *assembly.contacts, substeps, duration,
        )  # fmt: skip
