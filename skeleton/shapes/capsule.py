"""Capsules."""

# Coal lies in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.border import checked
from skeleton.shapes.base import TINY, Layout, along, upright
from skeleton.shapes.hulls import HullOfBalls, distance_from_hull, hull_of_spheres_volume
from skeleton.shapes.outlines import CapsuleOutline

FloatArray = NDArray[np.float64]


def nearest(x, y, z, length, radius, _g, _h):
    """Capsule around the segment from the origin to `length` on +Z; no length makes it a sphere.

    A point on the axis has no nearest surface point; the normal is then +X. After Ericson, "Real-Time Collision
    Detection" (2005), 5.1.2.
    """
    z -= min(max(z, 0.0), length)
    off = math.sqrt(x * x + y * y + z * z)
    scale = 1.0 / max(off, TINY)
    clear = off > TINY
    return off - radius, (x * scale if clear else 1.0), (y * scale if clear else 0.0), (z * scale if clear else 0.0)


@checked
@dataclass(frozen=True, eq=False, init=False)
class Capsule(HullOfBalls):
    """All points within `radius` of a segment that moves with a bone.

    Attributes:
        name: unique name, the role where the bone plays one, otherwise the bone's own.
        bone: name of the bone that carries it, None for one that stands still in the world.
        start: one end of the segment in the bone's frame [m], shape (3,).
        end: the other end in the bone's frame [m], shape (3,).
        radius: [m].
        friction: Coulomb coefficient against cloth, None for the scene's default.
        thickness: distance from the surface at which cloth is stopped [m], None for the scene's default.

    Raises:
        ValueRangeError: a value is out of range.
    """

    start: FloatArray
    end: FloatArray
    radius: float

    numbers: ClassVar[Mapping[str, int]] = {"start": 3, "end": 3, "radius": 0}
    nearest = staticmethod(nearest)

    def __init__(
        self,
        name: str,
        bone: str | None,
        start: FloatArray,
        end: FloatArray,
        radius: float,
        friction: float | None = None,
        thickness: float | None = None,
    ) -> None:
        """Take the fields in this order, as other shapes don't."""
        given = {"name": name, "bone": bone, "start": start, "end": end, "radius": radius}
        for label, value in {**given, "friction": friction, "thickness": thickness}.items():
            object.__setattr__(self, label, value)
        self.__post_init__()

    def _check(self) -> None:
        self._require(0.0 < self.radius < math.inf, "the radius must be positive", self.radius)

    def describe(self) -> str:
        """Kind and radius."""
        return f"{self.kind()} of {1000 * self.radius:.0f} mm"

    def layout(self) -> Layout:
        """From the start, +Z along the axis; sizes are the length and the radius [m]."""
        rotation, length = along(self.end - self.start)
        return Layout(self.start, rotation, (length, self.radius), self.radius, self.radius)

    def distances(self, points: FloatArray) -> FloatArray:
        """Distances of points (N, 3) in the bone's frame from the surface [m], negative inside, shape (N,)."""
        return distance_from_hull(points, self.start, self.end, self.radius, self.radius)

    def volume(self) -> float:
        """Volume [m^3]."""
        return hull_of_spheres_volume(float(np.linalg.norm(self.end - self.start)), self.radius, self.radius)

    def grown(self, thickness: float) -> Self:
        """The same with its surface so much further out [m]."""
        return replace(self, radius=self.radius + thickness)

    def core(self, share: float) -> Self:
        """What is within a share of the radius of the axis."""
        return replace(self, radius=share * self.radius)

    def outline(self) -> CapsuleOutline:
        """The capsule itself."""
        return CapsuleOutline(self.start, self.end, self.radius)

    def collision_geometry(self) -> tuple[Any, FloatArray, FloatArray]:
        """`coal.Capsule`, a `coal.Sphere` for one of no length; turn and place in the bone's frame."""
        import coal

        axis = self.end - self.start
        length = float(np.linalg.norm(axis))
        if not length > 0.0:
            return coal.Sphere(float(self.radius)), upright(), self.start
        middle = (self.start + self.end) / 2.0
        return coal.Capsule(float(self.radius), length), quaternions.from_z_axis(axis), middle

    def balls(self) -> tuple[FloatArray, FloatArray]:
        """Both ends: centres in the bone's frame [m], shape (2, 3), and radii [m], shape (2,)."""
        return np.stack([self.start, self.end]), np.full(2, self.radius)

    def as_capsule(self) -> "Capsule":
        """Itself."""
        return self
