"""XPBD: position-based dynamics with compliance, solved constraint by constraint in small steps."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.assembly.assemble import Assembly, air_model, force_scratch, inertia_of
from cape.assembly.coloring import by_color
from cape.cloth.cloth import GridCloth
from cape.kernels.cloth.grid import GridRoom
from cape.kernels.records import (
    Constraints,
    ForceModel,
    GridConstraints,
    Inertia,
    MeshConstraints,
    Motion,
    State,
)
from cape.kernels.xpbd.xpbd import xpbd_frame
from cape.solvers.base import Precision, Solver
from motions.errors import ValueRangeError

Array = NDArray[np.floating]

SUBSTEPS = 40  # per frame at 60 Hz, where none are asked for
HANDS = 3  # that the rows of a grid are dealt to, see kernels.xpbd.grid


class XpbdRoom(NamedTuple):
    """What the steps of a run share, in its precision: constraints on a grid or a mesh, damping times [s], the air."""

    grid: GridConstraints | None
    mesh: MeshConstraints | None
    damping: float | None
    bend_damping: float | None
    air: ForceModel | None
    inertia: Inertia
    forces: Array | None
    scratch: tuple[GridRoom | None, ...]


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
    usual_precision: ClassVar[Precision] = "single"
    order: ClassVar[float] = 1.8
    sweeps: ClassVar[bool] = True
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
        """Turn springs into constraints: by family on a grid, by colour on a mesh."""
        dtype, fabric, cloth = self.dtype(assembly), assembly.cloth.fabric, assembly.cloth
        windy = assembly.scene.wind is not None
        return XpbdRoom(
            grid=self._grid(assembly, cloth, dtype) if isinstance(cloth, GridCloth) else None,
            mesh=None if isinstance(cloth, GridCloth) else self._mesh(assembly, dtype),
            damping=fabric.damping_time or None,
            bend_damping=(fabric.bend_damping_time or None) if len(assembly.springs.bend_stiffness) else None,
            air=air_model(assembly, dtype) if windy else None,
            inertia=inertia_of(assembly, dtype),
            forces=np.zeros((3, cloth.vertices), dtype=dtype) if windy else None,
            scratch=force_scratch(assembly, dtype) if windy else (None,) * len(assembly.ranks),
        )

    def choose_substeps(self, room: XpbdRoom, duration: float, *, strained: bool = False) -> int:
        """Number of steps in a frame of `duration` [s]: as asked, or in proportion to 40 at 60 Hz."""
        return self.substeps or max(1, round(SUBSTEPS * 60.0 * duration))

    @property
    def _frame(self) -> Callable[..., Any]:
        return xpbd_frame

    def _arguments(
        self, assembly: Assembly, room: XpbdRoom, rank: int, state: State, motion: Motion
    ) -> tuple[Any, ...]:
        own = assembly.ranks[rank]
        return (
            state, room.grid, room.mesh, room.damping, room.bend_damping, room.air, room.inertia, room.forces,
            room.scratch[rank], motion, own.room, assembly.attached, own.contacts, self.iterations,
        )  # fmt: skip

    def _grid(self, assembly: Assembly, cloth: GridCloth, dtype: type[np.floating]) -> GridConstraints:
        families, weights, columns = assembly.springs.families, assembly.inverse_mass, cloth.columns
        assert families is not None
        dealt = _dealt(weights, columns)

        def springs(family: int) -> Constraints | None:
            stiffness, offset = families.stiffness[family], int(families.offsets[family])
            mobility = weights + _ahead(weights, offset)
            return self._grid_family(stiffness, families.rest[family], mobility, columns, dtype)

        def bends(family: int) -> Constraints | None:
            stiffness, offset = families.bend_stiffness[family], int(families.bend_offsets[family])
            mobility = weights + 4.0 * _ahead(weights, offset) + _ahead(weights, 2 * offset)
            return self._grid_family(stiffness, None, mobility, columns, dtype)

        across, down = springs(0), springs(1)
        assert across is not None
        assert down is not None
        return GridConstraints(
            columns=columns,
            inverse_mass=dealt.astype(dtype),
            positions=np.zeros((HANDS, 3, dealt.shape[1]), dtype=dtype),
            velocities=np.zeros((HANDS, 3, dealt.shape[1]), dtype=dtype),
            across=across,
            down=down,
            diagonal=springs(2),
            anti=springs(3),
            bend_across=bends(0),
            bend_down=bends(1),
        )

    def _grid_family(
        self, stiffness: Array, rest: Array | None, mobility: Array, columns: int, dtype: type[np.floating]
    ) -> Constraints | None:
        """One family of constraints, dealt to three hands; None where none has any stiffness."""
        if not stiffness.any():
            return None
        return self._constraints(
            _dealt(stiffness, columns),
            None if rest is None else _dealt(rest, columns),
            _dealt(mobility, columns),
            dtype,
        )

    def _mesh(self, assembly: Assembly, dtype: type[np.floating]) -> MeshConstraints:
        springs, weights = assembly.springs, assembly.inverse_mass
        pairs, hinges = np.stack([springs.first, springs.second], axis=1), springs.bend_vertices
        colors, bend_colors = by_color(pairs), by_color(hinges)
        pairs, hinges = pairs[colors.order], hinges[bend_colors.order]
        coefficients = springs.bend_coefficients[bend_colors.order]
        bend = None
        if len(hinges):
            mobility = (coefficients**2 * weights[hinges]).sum(axis=1)
            bend = self._constraints(springs.bend_stiffness[bend_colors.order], None, mobility, dtype)
        return MeshConstraints(
            first=pairs[:, 0].astype(np.uint32),
            second=pairs[:, 1].astype(np.uint32),
            starts=colors.starts,
            stretch=self._constraints(
                springs.stiffness[colors.order], springs.rest[colors.order], weights[pairs].sum(axis=1), dtype
            ),
            vertices=hinges.astype(np.uint32),
            coefficients=coefficients.astype(dtype),
            bend_starts=bend_colors.starts,
            bend=bend,
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


def _ahead(values: Array, offset: int) -> Array:
    """For each vertex the value of the one that far ahead, zero beyond the last."""
    return np.concatenate([values[offset:], np.zeros(min(offset, len(values)))])


def _dealt(values: ArrayLike, columns: int) -> Array:
    """Values of a grid's vertices (N,) by hand, shape (3, n), filled up with zeros."""
    rows = np.reshape(values, (-1, columns))
    places = -(-len(rows) // HANDS)
    filled = np.zeros((HANDS * places, columns))
    filled[: len(rows)] = rows
    return np.ascontiguousarray(filled.reshape(places, HANDS, columns).transpose(1, 0, 2)).reshape(HANDS, -1)
