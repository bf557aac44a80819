"""The air around a cloth."""

from dataclasses import dataclass

import numpy as np

from motions.errors import ValueRangeError

AIR_DENSITY = 1.2  # kg/m3, dry air at 20 degrees Celsius and sea level


@dataclass(frozen=True, kw_only=True)
class Wind:
    """Uniform air, still or moving.

    The force on a triangle of area A and unit normal n (turned along u), with u the air's velocity relative to it, is
    rho/2 A (n.u) (drag u + lift (|u| n - (n.u/|u|) u)) + viscous A u.

    The first part is that of plates in a stream. It grows with the square of the speed, and would let a cloth in still
    air swing on for minutes; the last one ends that. Air of viscosity mu and kinematic viscosity nu that sticks to a
    plate which swings at the angular frequency w drags on each of its sides with mu (w / 2 nu)^1/2 u in phase with its
    velocity (Landau and Lifshitz, Fluid Mechanics, section 24): 0.02 Pa s/m for both at 1.5 Hz, 0.03 at 3.3 Hz.

    Attributes:
        velocity: of the air in the world [m/s].
        density: of the air [kg/m3].
        drag: coefficient of the force along the relative wind, for the projected area.
        lift: coefficient of the force across it.
        viscous: force per area and speed of the air that sticks to the cloth [Pa s/m].
    """

    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    density: float = AIR_DENSITY
    drag: float = 1.2
    lift: float = 0.6
    viscous: float = 0.025

    def __post_init__(self) -> None:
        """Refuse what is no air.

        Raises:
            ValueRangeError: a value is negative or not finite, or the velocity is not three numbers.
        """
        if len(self.velocity) != 3 or not np.isfinite(self.velocity).all():
            raise ValueRangeError(f"wind velocity must be three finite numbers, not {self.velocity}")
        for name in ("density", "drag", "lift", "viscous"):
            if not 0.0 <= getattr(self, name) < float("inf"):
                raise ValueRangeError(f"wind {name} must be zero or more and finite, not {getattr(self, name)}")
