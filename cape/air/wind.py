"""The wind that a scene is given."""

import operator
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cape.air.gusts import gusts_of
from cape.air.record import WindRecord
from cape.air.turbulence import eddies_of
from motions.border import checked_first
from motions.errors import ValueRangeError
from motions.limits import LARGEST_NUMBER

FloatArray = NDArray[np.float64]

AIR_DENSITY = 1.2  # kg/m3, dry air at 20 degrees Celsius and sea level


@checked_first
@dataclass(frozen=True, kw_only=True)
class Wind:
    """Air, still or moving: everywhere alike unless there is turbulence, shelter or a field.

    Its velocity in the world is (velocity + record) (1 + gusts), to which turbulence and field are added; what lies in
    the wake of a body is sheltered.

    The force on a triangle of area A and unit normal n (turned along u), with u the air's velocity relative to it, is
    rho/2 A (n.u) (drag u + lift (|u| n - (n.u/|u|) u)) + viscous A u.

    The first part is that of plates in a stream. It grows with the square of the speed, and would let a cloth in still
    air swing on for minutes; the last one ends that. Air of viscosity mu and kinematic viscosity nu that sticks to a
    plate which swings at the angular frequency w drags on each of its sides with mu (w / 2 nu)^1/2 u in phase with its
    velocity (Landau and Lifshitz, Fluid Mechanics, section 24): 0.02 Pa s/m for both at 1.5 Hz, 0.03 at 3.3 Hz.

    Attributes:
        velocity: mean velocity of the air in the world [m/s].
        density: of the air [kg/m3].
        drag: coefficient of the force along the relative wind, for the projected area.
        lift: coefficient of the force across it.
        viscous: force per area and speed of the air that sticks to the cloth [Pa s/m].
        gusts: root mean square of the share by which the wind is faster or slower than its mean.
        turbulence: root mean square of each component of the eddies' velocity [m/s].
        seed: of gusts and eddies; the same one gives the same wind, at any frame rate.
        record: a wind that was measured, whose time begins with the motion; see `cape.read_wind`. None for none.
        field: what tells more wind: `field(time, places)` gives velocities [m/s], shape (V, 3), at a time [s] from the
            start of the motion and at places in the world [m], shape (V, 3). None for none.
        shelter: whether what the bones carry, and solids in the world, keep the wind off what is behind them.
    """

    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    density: float = AIR_DENSITY
    drag: float = 1.2
    lift: float = 0.6
    viscous: float = 0.025
    gusts: float = 0.0
    turbulence: float = 0.0
    seed: int = 0
    record: WindRecord | None = None
    field: Callable[[float, FloatArray], FloatArray] | None = None
    shelter: bool = False

    def __post_init__(self) -> None:
        """Refuse what is no air.

        Raises:
            ValueRangeError: a value is negative or not finite, the velocity is not three numbers, the seed is no whole
                number, or gusts are asked for where there is no wind.
        """
        if len(self.velocity) != 3 or not (np.abs(self.velocity) <= LARGEST_NUMBER).all():
            raise ValueRangeError(f"wind velocity must be three finite numbers, not {self.velocity}")
        for name in ("density", "drag", "lift", "viscous", "gusts", "turbulence"):
            if not 0.0 <= getattr(self, name) <= LARGEST_NUMBER:
                raise ValueRangeError(f"wind {name} must be zero or more and finite, not {getattr(self, name)}")
        try:
            if operator.index(self.seed) < 0:
                raise TypeError
        except TypeError:
            raise ValueRangeError(f"wind seed must be a whole number from zero on, not {self.seed!r}") from None
        if self.gusts > 0.0 and self.record is None and not np.any(self.velocity):
            raise ValueRangeError("gusts are a share of the wind, and there is none: give a velocity or a record")

    @property
    def varies(self) -> bool:
        """Whether it is another one at other places or times."""
        return bool(self.gusts > 0.0 or self.turbulence > 0.0 or self.record is not None or self.field is not None) or (
            self.shelter and any(self.velocity)
        )

    def stream(self, time: float) -> FloatArray:
        """What is everywhere alike at a time from the start of the motion [s]: its velocity [m/s], shape (3,)."""
        mean = np.array(self.velocity, dtype=float)
        if self.record is not None:
            mean = mean + self.record.at(time)
        return mean * (1.0 + self.gusts * gusts_of(self.seed).at(time)) if self.gusts > 0.0 else mean

    def at(self, time: float, places: FloatArray) -> FloatArray:
        """Velocities of the air, without shelter.

        Args:
            time: from the start of the motion [s].
            places: in the world [m], shape (V, 3).

        Returns:
            The velocities in the world [m/s], shape (V, 3).

        Raises:
            ValueRangeError: the field gives another shape, or a number that is not finite.
        """
        found = np.broadcast_to(self.stream(time), places.shape)
        if self.turbulence > 0.0:
            # Eddies come along with the mean wind (G. I. Taylor, Proc. R. Soc. A 164, 1938, 476).
            upstream = places - time * np.array(self.velocity, dtype=float)
            found = found + eddies_of(self.seed).at(time, upstream, speed=self.turbulence)
        if self.field is not None:
            more = np.asarray(self.field(time, places.copy()), dtype=float)
            if more.shape != places.shape or not np.isfinite(more).all():
                raise ValueRangeError(
                    f"the field of a wind must give finite velocities of shape {places.shape}, not {more.shape}"
                    if more.shape != places.shape
                    else f"the field of a wind gives a velocity that is not finite at {time:g} s"
                )
            found = found + more
        return found
