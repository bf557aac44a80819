"""Air that sticks to a cloth."""

from typing import ClassVar, Literal

import numpy as np

from cape.assembly.assemble import Assembly
from cape.forces.base import Acting, Force
from cape.kernels.cloth.skin import Skin, SkinForces, skin_drag
from cape.kernels.program import Use
from cape.scene.scene import Scene


class ViscousAir(Force):
    """A force per area and speed against the air; see `cape.Wind`."""

    name: ClassVar[str] = "viscous air"
    account: ClassVar[Literal["elastic", "air", "hold"]] = "air"

    @staticmethod
    def acts(scene: Scene) -> bool:
        """Where there is air of some viscosity."""
        return scene.wind is not None and scene.wind.viscous > 0.0

    @staticmethod
    def arrays(assembly: Assembly, dtype: type[np.floating]) -> Skin:
        """The force per speed on each vertex."""
        wind = assembly.scene.wind
        assert wind is not None
        areas = assembly.mass / assembly.cloth.fabric.density
        return Skin(assembly.wind, (wind.viscous * areas).astype(dtype))

    @staticmethod
    def uses(acting: Acting, arrays: Skin) -> list[Use]:
        """One unit for any cloth."""
        return [Use(skin_drag, SkinForces(acting.state, arrays, acting.forces))]
