"""Fabrics by their measured properties, in SI units, independent of any mesh."""

from dataclasses import dataclass
from typing import Final

from motions.errors import UnknownNameError, ValueRangeError


@dataclass(frozen=True, kw_only=True)
class Fabric:
    """What a cloth is made of.

    Attributes:
        density: mass per area [kg/m2].
        stretch: tension per width and strain along the threads [N/m].
        shear: tension per width and shear angle [N/m].
        bend: bending moment per width and curvature [N m].
        damping_time: ratio of damping to stiffness of the springs [s]: a mode of angular frequency w is damped at the
            ratio damping_time w / 2, so that the shape of the motion stays and only the rattle of the threads goes.
        bend_damping_time: the same for bending [s]; like any force on second differences it also brakes, a little, a
            bent cloth that turns as a whole.
    """

    density: float = 0.2
    stretch: float = 2000.0
    shear: float = 200.0
    bend: float = 1e-5
    damping_time: float = 1e-5
    bend_damping_time: float = 2e-3

    def __post_init__(self) -> None:
        """Refuse values that no fabric has.

        Raises:
            ValueRangeError: a value is negative, not finite, or zero where it must not be.
        """
        for name in ("density", "stretch"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise ValueRangeError(f"fabric {name} must be positive and finite, not {getattr(self, name)}")
        for name in ("shear", "bend", "damping_time", "bend_damping_time"):
            if not 0.0 <= getattr(self, name) < float("inf"):
                raise ValueRangeError(f"fabric {name} must be zero or more and finite, not {getattr(self, name)}")


# Densities, and stretch, shear and bend as averages over directions at small strain, from the measurements of
# Wang, O'Brien and Ramamoorthi 2011, "Data-driven elastic models for cloth", as published with ARCSim; the name of the
# sample stands behind each. "cape" is no measured sample: the stretch of a woven cloth, softer in bending than most.
FABRICS: Final[dict[str, Fabric]] = {
    "cape": Fabric(),
    "denim": Fabric(density=0.324, stretch=640.0, shear=69.0, bend=7e-5),  # 11oz-black-denim
    "jersey": Fabric(density=0.187, stretch=154.0, shear=37.0, bend=2.3e-5),  # gray-interlock
    "ponte": Fabric(density=0.284, stretch=174.0, shear=32.0, bend=3.5e-5),  # camel-ponte-roma
    "tablecloth": Fabric(density=0.128, stretch=2015.0, shear=19.0, bend=3.3e-5),  # white-dots-on-blk
    "twill": Fabric(density=0.220, stretch=2026.0, shear=105.0, bend=1.6e-4),  # royal-target
}


def fabric(name: str) -> Fabric:
    """Give the fabric of that name.

    Raises:
        UnknownNameError: there is no such fabric.
    """
    if name not in FABRICS:
        raise UnknownNameError("fabric", name, sorted(FABRICS))
    return FABRICS[name]
