"""Drag and lift of the air on the triangles of a cloth."""

from typing import ClassVar, Literal

import numpy as np

from cape.assembly.assemble import Assembly
from cape.cloth.cloth import GridCloth
from cape.forces.base import Acting, Force
from cape.kernels.cloth.grid import GridAir, GridAirForces, grid_air
from cape.kernels.cloth.mesh import MeshAir, MeshAirForces, mesh_air
from cape.kernels.program import Use
from cape.scene.scene import Scene


class Air(Force):
    """The force of a stream on plates; see `cape.Wind`."""

    name: ClassVar[str] = "air"
    account: ClassVar[Literal["elastic", "air", "hold"]] = "air"

    @staticmethod
    def acts(scene: Scene) -> bool:
        """Where there is air."""
        return scene.wind is not None

    @staticmethod
    def arrays(assembly: Assembly, dtype: type[np.floating]) -> GridAir | MeshAir:
        """The air on the cells of a grid, or on the triangles of a mesh."""
        cloth, wind = assembly.cloth, assembly.scene.wind
        assert wind is not None
        air = (assembly.wind, wind.density * wind.drag / 12.0, wind.density * wind.lift / 12.0)
        if isinstance(cloth, GridCloth):
            cells = np.zeros((cloth.rows, cloth.columns), dtype=dtype)
            cells[:-1, :-1] = 1.0
            return GridAir(*air, cells.ravel(), cloth.columns)
        from cape.assembly.mesh.links import mesh_air_record

        return mesh_air_record(cloth, *air, dtype)

    @staticmethod
    def uses(acting: Acting, arrays: GridAir | MeshAir) -> list[Use]:
        """One unit, for grids or for meshes."""
        if isinstance(arrays, GridAir):
            assert acting.room is not None
            return [Use(grid_air, GridAirForces(acting.state, arrays, acting.forces, acting.room))]
        return [Use(mesh_air, MeshAirForces(acting.state, arrays, acting.forces))]
