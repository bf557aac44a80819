"""Half-spaces."""

# Coal lies in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.border import checked
from skeleton.shapes.base import Layout, Shape, along
from skeleton.shapes.outlines import PatchOutline

FloatArray = NDArray[np.float64]


def nearest(_x, _y, z, _e, _f, _g, _h):
    """Half-space below the plane through the origin across +Z."""
    return z, 0.0, 0.0, 1.0


@checked
@dataclass(frozen=True, eq=False, kw_only=True)
class Plane(Shape):
    """The half-space behind a plane.

    Attributes:
        name: unique name.
        bone: name of the bone that carries it, None for one that stands still in the world.
        point: a point of the plane in the bone's frame [m], shape (3,).
        normal: out of the solid, in the bone's frame, of any length, shape (3,).
        friction: Coulomb coefficient against cloth, None for the scene's default.
        thickness: distance from the surface at which cloth is stopped [m], None for the scene's default.

    Raises:
        ValueRangeError: a value is out of range.
    """

    name: str = "plane"
    point: FloatArray = field(default_factory=lambda: np.zeros(3))
    normal: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    numbers: ClassVar[Mapping[str, int]] = {"point": 3, "normal": 3}
    nearest = staticmethod(nearest)

    def _check(self) -> None:
        self._require(np.linalg.norm(self.normal) > 0.0, "the normal must not be zero", self.normal)

    def describe(self) -> str:
        """Kind."""
        return self.kind()

    def layout(self) -> Layout:
        """From the point, +Z along the normal; there are no sizes."""
        return Layout(self.point, along(self.normal)[0], (), math.inf, math.inf)

    def distances(self, points: FloatArray) -> FloatArray:
        """Heights of points (N, 3) in the bone's frame above the plane [m], negative inside, shape (N,)."""
        return (points - self.point) @ (self.normal / np.linalg.norm(self.normal))

    def volume(self) -> float:
        """Infinite."""
        return math.inf

    def grown(self, thickness: float) -> Self:
        """The same, so much further out [m]."""
        return replace(self, point=self.point + thickness * (self.normal / np.linalg.norm(self.normal)))

    def core(self, share: float) -> None:
        """None: a half-space has no middle."""

    def outline(self) -> PatchOutline:
        """The plane itself."""
        return PatchOutline(self.point, self.normal)

    def collision_geometry(self) -> tuple[Any, FloatArray, FloatArray]:
        """`coal.Halfspace` below its z axis; turn and place in the bone's frame."""
        import coal

        return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0), quaternions.from_z_axis(self.normal), self.point
