"""XPBD: position-based dynamics with compliance, solved constraint by constraint in small steps."""

from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assemble import Assembly
from cape.kernels.records import Constraints, Motion, State
from cape.kernels.xpbd import xpbd_frame
from cape.solvers.base import Solver
from motions.errors import ValueRangeError

IntArray = NDArray[np.int64]

SUBSTEPS = 40  # per frame at 60 Hz, where none are asked for


class XpbdRoom(NamedTuple):
    """What the steps of a run share: constraints, room for forces and for positions at the start of a step."""

    constraints: Constraints
    forces: NDArray[np.floating]
    old: NDArray[np.floating]


@dataclass(frozen=True, kw_only=True)
class XPBD(Solver):
    """Macklin, Mueller, Chentanez 2016 with the small steps of Macklin et al. 2019.

    A constraint's compliance is exactly one over its spring's stiffness, so that both solvers converge to the same
    motion as steps shrink; at few steps it is softer and damped, and never unstable. First order in time. Damping
    times much longer than a step soften it further, until more iterations are asked for.

    Attributes:
        precision: double unless asked otherwise. Corrections of positions shrink with the square of the step, below
            what single precision can add to a position, and the velocity is their difference divided by the step.
        iterations: sweeps over all constraints in each step.
    """

    name: ClassVar[str] = "xpbd"
    precision: Literal["single", "double"] = "double"
    iterations: int = 1

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            ValueRangeError: a setting is out of range.
        """
        super().__post_init__()
        if self.iterations < 1:
            raise ValueRangeError(f"iterations must be 1 or more, not {self.iterations}")

    def init(self, assembly: Assembly) -> XpbdRoom:
        """Turn springs into constraints, sorted by colour."""
        springs, scene, dtype = assembly.springs, assembly.scene, self.dtype
        first, second, stiffness, rest = springs.pairs()
        order = _by_colour(np.stack([first, second], axis=1))
        first, second, stiffness, rest = first[order], second[order], stiffness[order], rest[order]
        start, offset, bend = springs.triples()
        order = _by_colour(np.stack([start, start + offset, start + 2 * offset], axis=1))
        start, offset, bend = start[order], offset[order], bend[order]
        count = scene.cloth.vertices
        constraints = Constraints(
            first=first,
            second=second,
            rest=rest.astype(dtype),
            compliance=(1.0 / stiffness).astype(dtype),
            lagrange=np.zeros(len(first), dtype=dtype),
            bend_first=start,
            bend_middle=start + offset,
            bend_last=start + 2 * offset,
            bend_compliance=(1.0 / bend).astype(dtype),
            bend_lagrange=np.zeros((3, len(start)), dtype=dtype),
            inverse_mass=assembly.inverse_mass.astype(dtype),
            damping_time=scene.cloth.fabric.damping_time,
            bend_damping_time=scene.cloth.fabric.bend_damping_time,
            gravity=np.array(scene.gravity, dtype=float),
        )
        return XpbdRoom(constraints, np.zeros((3, count), dtype=dtype), np.zeros((3, count), dtype=dtype))

    def choose_substeps(self, room: XpbdRoom, duration: float) -> int:
        """Number of steps in a frame of `duration` [s]: as asked, or in proportion to 40 at 60 Hz."""
        return self.substeps or max(1, round(SUBSTEPS * 60.0 * duration))

    def step(
        self, assembly: Assembly, room: XpbdRoom, state: State, motion: Motion, *, duration: float, substeps: int
    ) -> None:
        """Advance `state` in place by a frame of `duration` [s]."""
        xpbd_frame(
            state, room.constraints, room.forces, room.old, motion, assembly.room,
            assembly.attached, assembly.air, *assembly.contacts, substeps, self.iterations, duration,
        )  # fmt: skip


def _by_colour(members: IntArray) -> IntArray:
    """Order constraints, shape (E, k) of vertices, so that no two of one colour share a vertex: first fit, greedy."""
    used: list[int] = [0] * (int(members.max(initial=-1)) + 1)
    colours = np.empty(len(members), dtype=np.int64)
    for row, vertices in enumerate(members.tolist()):
        taken = 0
        for v in vertices:
            taken |= used[v]
        # The lowest bit that is still free at every vertex.
        bit = ~taken & (taken + 1)
        colours[row] = bit.bit_length()
        for v in vertices:
            used[v] |= bit
    return np.argsort(colours, kind="stable")
