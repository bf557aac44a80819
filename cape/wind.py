"""The air around a cloth."""

from dataclasses import dataclass

import numpy as np

from motions.errors import ValueRangeError

AIR_DENSITY = 1.2  # kg/m3, dry air at 20 degrees Celsius and sea level


@dataclass(frozen=True, kw_only=True)
class Wind:
    """Uniform air, still or moving.

    The force on a triangle of area A and unit normal n (turned along u), with u the air's velocity relative to it, is
    rho/2 A (n.u) (drag u + lift (|u| n - (n.u/|u|) u)).

    Attributes:
        velocity: of the air in the world [m/s].
        density: of the air [kg/m3].
        drag: coefficient of the force along the relative wind, for the projected area.
        lift: coefficient of the force across it.
    """

    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    density: float = AIR_DENSITY
    drag: float = 1.2
    lift: float = 0.6

    def __post_init__(self) -> None:
        """Refuse what is no air.

        Raises:
            ValueRangeError: a value is negative or not finite, or the velocity is not three numbers.
        """
        if len(self.velocity) != 3 or not np.isfinite(self.velocity).all():
            raise ValueRangeError(f"wind velocity must be three finite numbers, not {self.velocity}")
        for name in ("density", "drag", "lift"):
            if not 0.0 <= getattr(self, name) < float("inf"):
                raise ValueRangeError(f"wind {name} must be zero or more and finite, not {getattr(self, name)}")
