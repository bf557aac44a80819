"""Drag and lift of the air on the triangles of a cloth."""

from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.cloth.cloth import GridCloth
from cape.cloth.split_mesh import SplitMesh
from cape.forces.base import Acting, Force
from cape.kernels.cloth.grid import GridAir, GridAirForces, grid_air
from cape.kernels.cloth.mesh import MeshAir, MeshAirForces, mesh_air
from cape.kernels.program import Use
from cape.scene.scene import Scene

if TYPE_CHECKING:
    from cape.assembly.mesh.split_records import Splits


class Blown(NamedTuple):
    """The air on a cloth, and room for velocities against it (3, N), None where the wind is everywhere alike.

    `splits` tells where the triangles of a mesh stand that may split.
    """

    air: GridAir | MeshAir
    relative: NDArray[np.floating] | None
    splits: "Splits | None" = None


def relative_room(assembly: Assembly, dtype: type[np.floating]) -> NDArray[np.floating] | None:
    """Room for velocities against a stream (3, N), None without one."""
    return None if assembly.stream is None else np.zeros((3, assembly.cloth.vertices), dtype)


class Air(Force):
    """The force of a stream on plates; see `cape.Wind`."""

    name: ClassVar[str] = "air"
    account: ClassVar[Literal["elastic", "air", "hold"]] = "air"

    @staticmethod
    def acts(scene: Scene) -> bool:
        """Where there is air."""
        return scene.wind is not None

    @staticmethod
    def arrays(assembly: Assembly, dtype: type[np.floating]) -> Blown:
        """The air on the cells of a grid, or on the triangles of a mesh."""
        relative = relative_room(assembly, dtype)
        cloth, wind = assembly.cloth, assembly.scene.wind
        assert wind is not None
        air = (assembly.wind, wind.density * wind.drag / 12.0, wind.density * wind.lift / 12.0)
        if isinstance(cloth, GridCloth):
            return Blown(GridAir(*air, cloth.cells_in_place.astype(dtype), cloth.columns), relative)
        if isinstance(cloth, SplitMesh) and assembly.springs.in_slots:
            from cape.assembly.mesh.split_records import split_air_record

            record, splits = split_air_record(cloth, *air, dtype)
            return Blown(record, relative, splits)
        from cape.assembly.mesh.links import mesh_air_record

        return Blown(mesh_air_record(cloth, *air, dtype), relative)

    @staticmethod
    def uses(acting: Acting, arrays: Blown) -> list[Use]:
        """One unit, for grids or for meshes, after one for velocities against a stream."""
        seen, uses = acting.against(arrays.relative)
        if isinstance(arrays.air, GridAir):
            assert seen.room is not None
            return [*uses, Use(grid_air, GridAirForces(seen.state, arrays.air, seen.forces, seen.room))]
        return [*uses, Use(mesh_air, MeshAirForces(seen.state, arrays.air, seen.forces))]
