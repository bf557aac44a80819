"""What keeps a grid together, and the air around it, where it has split."""

from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.assembly.grid.split_springs import SplitSprings
from cape.cloth.cloth import GridCloth
from cape.cloth.split_grid import SplitGrid
from cape.forces.air import relative_room
from cape.forces.base import Acting, Force
from cape.forces.elastic import damping_times
from cape.kernels.program import Use
from cape.kernels.tearing.strays import (
    StrayAir,
    StrayAirForces,
    StrayForces,
    StraySprings,
    stray_air,
    stray_springs,
)
from cape.scene.scene import Scene

SPRINGS_A_CELL, BENDS_A_CELL, TRIANGLES_A_CELL = 6, 5, 2  # that a cell adds to at most; a bend belongs to two of them


class DampedStrays(NamedTuple):
    """Stray springs, with damping times of springs and bend springs [s], None for none."""

    springs: StraySprings
    damping: float | None
    bend_damping: float | None


class BlownStrays(NamedTuple):
    """The air on stray triangles, and room for velocities against it (3, N), None where wind is everywhere alike."""

    air: StrayAir
    relative: NDArray[np.floating] | None


class Strays(Force):
    """Springs and bend springs of a grid that lead to vertices which have split off; their energy is `Elastic`'s."""

    name: ClassVar[str] = "strays"
    account: ClassVar[Literal["elastic", "air", "hold"]] = "elastic"

    @staticmethod
    def acts(scene: Scene) -> bool:
        """Where a grid may split."""
        return scene.tearing is not None and isinstance(scene.cloth, GridCloth)

    @staticmethod
    def arrays(assembly: Assembly, dtype: type[np.floating]) -> DampedStrays:
        """Room for what all cells add, and in it what is astray."""
        cells = len(_split_grid(assembly).corners)
        n, m = SPRINGS_A_CELL * cells, BENDS_A_CELL * cells
        springs = StraySprings(
            np.zeros(2, np.int64), np.zeros((2, n), np.uint32), np.zeros(n, dtype), np.ones(n, dtype),
            np.zeros((4, m), np.uint32), np.zeros((4, m), dtype), np.zeros(m, dtype),
        )  # fmt: skip
        fill_springs(springs, _split_springs(assembly))
        return DampedStrays(springs, *damping_times(assembly.cloth.fabric, assembly.springs))

    @staticmethod
    def uses(acting: Acting, arrays: DampedStrays) -> list[Use]:
        """One unit."""
        return [Use(stray_springs, StrayForces(acting.state, *arrays, acting.forces))]


class StraysInAir(Force):
    """Drag and lift of the air on triangles of a grid with corners that have split off."""

    name: ClassVar[str] = "air on strays"
    account: ClassVar[Literal["elastic", "air", "hold"]] = "air"

    @staticmethod
    def acts(scene: Scene) -> bool:
        """Where there is air, and a grid may split."""
        return scene.wind is not None and Strays.acts(scene)

    @staticmethod
    def arrays(assembly: Assembly, dtype: type[np.floating]) -> BlownStrays:
        """Room for all triangles, and in it those that are astray."""
        wind = assembly.scene.wind
        assert wind is not None
        corners = np.zeros((3, TRIANGLES_A_CELL * len(_split_grid(assembly).corners)), np.uint32)
        numbers = (wind.density * wind.drag / 12.0, wind.density * wind.lift / 12.0)
        air = StrayAir(assembly.wind, *numbers, np.zeros(1, np.int64), corners)
        fill_air(air, _split_grid(assembly))
        return BlownStrays(air, relative_room(assembly, dtype))

    @staticmethod
    def uses(acting: Acting, arrays: BlownStrays) -> list[Use]:
        """One unit, after one for velocities against a stream."""
        seen, uses = acting.against(arrays.relative)
        return [*uses, Use(stray_air, StrayAirForces(seen.state, arrays.air, seen.forces))]


def fill_springs(room: StraySprings, springs: SplitSprings) -> None:
    """Put the stray springs of a grid into their room."""
    strays, bends = np.flatnonzero(~springs.home), np.flatnonzero(~springs.bends_home & (springs.bend_stiffness > 0.0))
    n, m = room.counts[:] = len(strays), len(bends)
    room.ends[0, :n], room.ends[1, :n] = springs.first[strays], springs.second[strays]
    room.stiffness[:n], room.rest[:n] = springs.stiffness[strays], springs.rest[strays]
    room.bent[:, :m], room.weights[:, :m] = springs.bend_vertices[bends].T, springs.bend_coefficients[bends].T
    room.bend_stiffness[:m] = springs.bend_stiffness[bends]


def fill_air(room: StrayAir, grid: SplitGrid) -> None:
    """Put the stray triangles of a grid into their room."""
    corner, right, across, down = grid.corners[(grid.corners != grid.whole_cells).any(axis=1)].T
    count = room.counts[0] = 2 * len(corner)
    room.corners[:, :count:2], room.corners[:, 1:count:2] = (corner, down, right), (across, right, down)


def _split_grid(assembly: Assembly) -> SplitGrid:
    cloth = assembly.cloth
    if not isinstance(cloth, SplitGrid):
        raise TypeError("only a grid with room to split has strays")
    return cloth


def _split_springs(assembly: Assembly) -> SplitSprings:
    springs = assembly.springs
    if not isinstance(springs, SplitSprings):
        raise TypeError("only the springs of a grid with room to split go astray")
    return springs
