"""Spheres."""

# Coal lies in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from motions.border import checked
from skeleton.shapes import capsule
from skeleton.shapes.base import Layout, lengths, upright
from skeleton.shapes.capsule import Capsule
from skeleton.shapes.hulls import HullOfBalls, hull_of_spheres_volume
from skeleton.shapes.outlines import EllipsoidOutline

FloatArray = NDArray[np.float64]

nearest = capsule.nearest
"""A sphere is a capsule of no length, so that both are of one kind for the solvers."""


@checked
@dataclass(frozen=True, eq=False, kw_only=True)
class Sphere(HullOfBalls):
    """All points within `radius` of a centre.

    Attributes:
        name: unique name.
        bone: name of the bone that carries it, None for one that stands still in the world.
        center: in the bone's frame [m], shape (3,).
        radius: [m].
        friction: Coulomb coefficient against cloth, None for the scene's default.
        thickness: distance from the surface at which cloth is stopped [m], None for the scene's default.

    Raises:
        ValueRangeError: a value is out of range.
    """

    name: str = "sphere"
    center: FloatArray = field(default_factory=lambda: np.zeros(3))
    radius: float = 0.5

    numbers: ClassVar[Mapping[str, int]] = {"center": 3, "radius": 0}
    nearest = staticmethod(nearest)

    def _check(self) -> None:
        self._require(0.0 < self.radius < math.inf, "the radius must be positive", self.radius)

    def describe(self) -> str:
        """Kind and radius."""
        return f"{self.kind()} of {1000 * self.radius:.0f} mm"

    def layout(self) -> Layout:
        """From the centre; sizes are no length, and the radius [m]."""
        return Layout(self.center, np.eye(3), (0.0, self.radius), self.radius, self.radius)

    def distances(self, points: FloatArray) -> FloatArray:
        """Distances of points (N, 3) in the bone's frame from the surface [m], negative inside, shape (N,)."""
        return lengths(points - self.center) - self.radius

    def volume(self) -> float:
        """Volume [m^3]."""
        return hull_of_spheres_volume(0.0, self.radius, self.radius)

    def grown(self, thickness: float) -> Self:
        """The same with its surface so much further out [m]."""
        return replace(self, radius=self.radius + thickness)

    def core(self, share: float) -> Self:
        """What is within a share of the radius of the centre."""
        return replace(self, radius=share * self.radius)

    def outline(self) -> EllipsoidOutline:
        """An ellipsoid of three equal half sizes."""
        return EllipsoidOutline(self.center, np.full(3, self.radius), upright())

    def collision_geometry(self) -> tuple[Any, FloatArray, FloatArray]:
        """`coal.Sphere`; turn and place in the bone's frame."""
        import coal

        return coal.Sphere(float(self.radius)), upright(), self.center

    def balls(self) -> tuple[FloatArray, FloatArray]:
        """Itself: centre in the bone's frame [m], shape (1, 3), and radius [m], shape (1,)."""
        return self.center[None], np.array([self.radius])

    def as_capsule(self) -> Capsule:
        """A capsule of no length."""
        return Capsule(self.name, self.bone, self.center, self.center, float(self.radius))
