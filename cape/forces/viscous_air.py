"""Air that sticks to a cloth."""

from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.assembly.fabrics import of_vertices
from cape.forces.air import relative_room
from cape.forces.base import Acting, Force
from cape.kernels.cloth.skin import Skin, SkinForces, skin_drag
from cape.kernels.program import Use
from cape.scene.scene import Scene


class Sticking(NamedTuple):
    """Air that sticks, and room for velocities against it (3, N), None where the wind is everywhere alike."""

    skin: Skin
    relative: NDArray[np.floating] | None


class ViscousAir(Force):
    """A force per area and speed against the air; see `cape.Wind`."""

    name: ClassVar[str] = "viscous air"
    account: ClassVar[Literal["elastic", "air", "hold"]] = "air"

    @staticmethod
    def acts(scene: Scene) -> bool:
        """Where there is air of some viscosity."""
        return scene.wind is not None and scene.wind.viscous > 0.0

    @staticmethod
    def arrays(assembly: Assembly, dtype: type[np.floating]) -> Sticking:
        """The force per speed on each vertex."""
        wind = assembly.scene.wind
        assert wind is not None
        areas = assembly.mass / of_vertices(assembly.cloth, lambda fabric: fabric.density)
        skin = Skin(assembly.wind, (wind.viscous * areas).astype(dtype))
        return Sticking(skin, relative_room(assembly, dtype))

    @staticmethod
    def uses(acting: Acting, arrays: Sticking) -> list[Use]:
        """One unit for any cloth, after one for velocities against a stream."""
        seen, uses = acting.against(arrays.relative)
        return [*uses, Use(skin_drag, SkinForces(seen.state, arrays.skin, seen.forces))]
