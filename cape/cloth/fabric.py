"""What a cloth is made of: its properties in SI units, independent of any mesh."""

from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

from motions.border import checked
from motions.errors import ValueRangeError

PerThread = float | tuple[float, float]
PER_THREAD = ("stretch", "bend", "strain_limit")  # what may be a pair

WOVEN = 0.04  # strain that woven threads don't go beyond
DROP = 1.2  # m of cloth that hang by a thread
GRAVITY = 9.81  # m/s2


MOST = 1e15  # of any property in its unit, and one over the least: beyond it products overflow
MOST_DAMPING_TIME = 10.0  # s: cloth that takes so long to give way is none


@checked
@dataclass(frozen=True, kw_only=True)
class Fabric:
    """What a cloth is made of.

    Where a property may differ between the threads it is one number for both, or a pair (warp, weft); it reads back as
    it was given. On a grid the columns are warp and the rows weft; on a mesh the pattern's second axis is warp, its
    first weft.

    Cloth is made of springs here, whose sums obey the relation of Cauchy: what couples both threads, C1122, is always
    the shear stiffness, so that a fabric has no ratio of Poisson of its own to choose. Pulled along one thread and free
    across, a cloth narrows by shear / stretch of the thread across, and resists with that much less: along the warp
    with stretch_warp - shear^2 / stretch_weft. A mesh whose edges let no springs be the fabric resists as a membrane of
    the same numbers (`cape.assembly.membrane`).

    The default values are no measured fabric's but those that figures of cape have been made with. They are about twice
    as stiff along the threads and in bending as the cloth of a real cape, `FABRICS["worsted"]`, and eight times in
    shear: 200 N/m are more than any fabric was found to have whose measurement is quoted here; the nearest is a firm
    denim's 191 N/m (Kumari and Khurana 2016, Journal of Textiles, 4614168, table 5, 3.398 gf/cm/degree).

    Attributes:
        density: mass per area [kg/m2].
        stretch: tension per width and strain along the threads [N/m], one number or (warp, weft).
        shear: tension per width and shear angle [N/m].
        bend: bending moment per width and curvature along the threads [N m], one number or (warp, weft).
        damping_time: ratio of damping to stiffness of the springs [s]: a mode of angular frequency w is damped at the
            ratio damping_time w / 2, so that the shape of the motion stays and only the rattle of the threads goes.
        bend_damping_time: the same for bending [s]; like any force on second differences it also brakes, a little, a
            bent cloth that turns as a whole.
        strain_limit: what no thread is strained beyond in a scene that limits strain, one number or (warp, weft); None
            for `WOVEN`, or twice what a drop of 1.2 m strains by its own weight where that is more.
    """

    density: float = 0.2
    stretch: PerThread = 2000.0
    shear: float = 200.0
    bend: PerThread = 1e-5
    damping_time: float = 1e-5
    bend_damping_time: float = 2e-3
    strain_limit: PerThread | None = None

    def __post_init__(self) -> None:
        """Refuse values that no fabric has, and make a pair a tuple of two floats.

        Raises:
            ValueRangeError: a value is negative, not finite, or zero where it must not be, or no number nor such a
                pair as may stand there.
        """
        for name in PER_THREAD:
            if np.ndim(given := getattr(self, name)) > 0:
                object.__setattr__(self, name, _pair(name, given))
        for name in ("density", "stretch"):
            if not all(0.0 < value < float("inf") for value in self._numbers(name)):
                raise ValueRangeError(f"fabric {name} must be positive and finite, not {getattr(self, name)}")
            if not all(value >= 1.0 / MOST for value in self._numbers(name)):
                raise ValueRangeError(f"fabric {name} must be {1.0 / MOST:g} or more, not {getattr(self, name)}")
        for name in ("shear", "bend", "damping_time", "bend_damping_time"):
            if not all(0.0 <= value < float("inf") for value in self._numbers(name)):
                raise ValueRangeError(f"fabric {name} must be zero or more and finite, not {getattr(self, name)}")
        for name in ("density", "stretch", "shear", "bend"):
            if not all(value <= MOST for value in self._numbers(name)):
                raise ValueRangeError(f"fabric {name} must be {MOST:g} at most, not {getattr(self, name)}")
        for name in ("damping_time", "bend_damping_time"):
            if self._numbers(name)[0] > MOST_DAMPING_TIME:
                raise ValueRangeError(
                    f"fabric {name} must be {MOST_DAMPING_TIME:g} s at most, not {getattr(self, name)}"
                )
        if self.strain_limit is not None and not all(0.0 < v < float("inf") for v in self._numbers("strain_limit")):
            raise ValueRangeError(f"fabric strain_limit must be positive and finite, not {self.strain_limit}")

    def _numbers(self, name: str) -> tuple[float, ...]:
        """A property as a tuple of floats.

        Raises:
            ValueRangeError: it is something else.
        """
        given: Any = getattr(self, name)
        if name in PER_THREAD and np.ndim(given) > 0:
            return given
        try:
            return (float(given + 0.0),)
        except TypeError:
            raise ValueRangeError(f"fabric {name} must be one number, not {given!r}") from None

    @property
    def stretch_warp(self) -> float:
        """Tension per width and strain along the warp [N/m]."""
        return _of_threads(self.stretch)[0]

    @property
    def stretch_weft(self) -> float:
        """Tension per width and strain along the weft [N/m]."""
        return _of_threads(self.stretch)[1]

    @property
    def limit_warp(self) -> float:
        """Strain that no thread along the warp goes beyond, where a scene limits it."""
        return self._usual_limit(self.stretch_warp) if self.strain_limit is None else _of_threads(self.strain_limit)[0]

    @property
    def limit_weft(self) -> float:
        """Strain that no thread along the weft goes beyond, where a scene limits it."""
        return self._usual_limit(self.stretch_weft) if self.strain_limit is None else _of_threads(self.strain_limit)[1]

    def _usual_limit(self, stretch: float) -> float:
        return max(WOVEN, 2.0 * self.density * GRAVITY * DROP / stretch)

    @property
    def bend_warp(self) -> float:
        """Bending moment per width and curvature along the warp [N m]."""
        return _of_threads(self.bend)[0]

    @property
    def bend_weft(self) -> float:
        """Bending moment per width and curvature along the weft [N m]."""
        return _of_threads(self.bend)[1]

    @property
    def bend_bias(self) -> float:
        """Bending moment per width and curvature at 45 degrees to the threads [N m]: `bend_along` with half of each."""
        return float(self.bend_along(0.5)) if isinstance(self.bend, tuple) else self.bend

    def bend_along(self, weft_share: Any) -> Any:
        """Bending moment per width and curvature [N m] along directions with these cos^2 of the angle to the weft.

        B_weft c^4 + 2 sqrt(B_weft B_warp) c^2 s^2 + B_warp s^4, by algebra, of an orthotropic plate whose stiffness
        against twist is the geometric mean of both threads: Huber's approximation of 1923 for plates of which two
        stiffnesses are known. On the bias it is then a little above that mean, where woven fabrics lie.
        """
        warp, weft = _of_threads(self.bend)
        return (sqrt(weft) * weft_share + sqrt(warp) * (1.0 - weft_share)) ** 2


def _of_threads(value: PerThread) -> tuple[float, float]:
    """A property along warp and weft."""
    return value if isinstance(value, tuple) else (value, value)


def _pair(name: str, given: Any) -> tuple[float, float]:
    """A pair (warp, weft) as floats.

    Raises:
        ValueRangeError: it is no pair of numbers.
    """
    try:
        warp, weft = (float(value + 0.0) for value in given)
    except (TypeError, ValueError):
        raise ValueRangeError(f"fabric {name} must be one number or a pair (warp, weft), not {given!r}") from None
    return warp, weft
