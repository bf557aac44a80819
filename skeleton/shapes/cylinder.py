"""Cylinders with flat ends."""

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
from skeleton.shapes.base import TINY, Bounded, Layout, along, lengths
from skeleton.shapes.capsule import Capsule
from skeleton.shapes.outlines import MeshOutline
from skeleton.shapes.revolved import AROUND, strips

FloatArray = NDArray[np.float64]


def nearest(x, y, z, half_length, radius, _g, _h):
    """Cylinder around the z axis, its middle at the origin.

    Like a box, in the plane through the axis and the point. Outside, the nearest point is on the side, on an end, or on
    the edge between them; inside, the nearer of side and end gives the normal, the side where both are as near. A point
    on the axis that is nearest to the side has the normal +X, one midway between the ends that is nearest to them +Z.
    """
    around = math.sqrt(x * x + y * y)
    off_axis = around > TINY
    outwards = 1.0 / max(around, TINY)
    ux, uy = (x * outwards if off_axis else 1.0), (y * outwards if off_axis else 0.0)
    uz = math.copysign(1.0, z)
    side, end = around - radius, abs(z) - half_length
    beyond_side, beyond_end = max(side, 0.0), max(end, 0.0)
    off = math.sqrt(beyond_side * beyond_side + beyond_end * beyond_end)
    scale = 1.0 / max(off, TINY)
    outside = off > TINY
    by_side = side >= end
    across = beyond_side * scale if outside else (1.0 if by_side else 0.0)
    up = beyond_end * scale if outside else (0.0 if by_side else 1.0)
    return off + min(max(side, end), 0.0), ux * across, uy * across, uz * up


@checked
@dataclass(frozen=True, eq=False, kw_only=True)
class Cylinder(Bounded):
    """All points within `radius` of an axis, between two flat ends.

    Attributes:
        name: unique name.
        bone: name of the bone that carries it, None for one that stands still in the world.
        start: middle of the one end in the bone's frame [m], shape (3,).
        end: middle of the other end in the bone's frame [m], shape (3,).
        radius: [m].
        friction: Coulomb coefficient against cloth, None for the scene's default.
        thickness: distance from the surface at which cloth is stopped [m], None for the scene's default.

    Raises:
        ValueRangeError: a value is out of range, or the ends are in one place.
    """

    name: str = "cylinder"
    start: FloatArray = field(default_factory=lambda: np.zeros(3))
    end: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    radius: float = 0.1

    numbers: ClassVar[Mapping[str, int]] = {"start": 3, "end": 3, "radius": 0}
    nearest = staticmethod(nearest)

    def _check(self) -> None:
        self._require(0.0 < self.radius < math.inf, "the radius must be positive", self.radius)
        apart = 0.0 < np.linalg.norm(self.end - self.start) < math.inf
        self._require(apart, "start and end must be apart", self.start)

    @property
    def length(self) -> float:
        """Distance of the ends [m]."""
        return float(np.linalg.norm(self.end - self.start))

    def describe(self) -> str:
        """Kind, radius and length."""
        return f"{self.kind()} of {1000 * self.radius:.0f} mm, {1000 * self.length:.0f} mm long"

    def layout(self) -> Layout:
        """From the middle, +Z along the axis; sizes are half the length and the radius [m]."""
        rotation, length = along(self.end - self.start)
        middle, half = (self.start + self.end) / 2.0, length / 2.0
        return Layout(middle, rotation, (half, self.radius), min(half, self.radius), 0.0)

    def distances(self, points: FloatArray) -> FloatArray:
        """Distances of points (N, 3) in the bone's frame from the surface [m], negative inside, shape (N,).

        Outside the way to the nearest point of side and end, inside that to the nearer of them.
        """
        axis = (self.end - self.start) / self.length
        from_middle = points - (self.start + self.end) / 2.0
        height = from_middle @ axis
        side = lengths(from_middle - height[:, None] * axis) - self.radius
        end = np.abs(height) - self.length / 2.0
        return np.hypot(np.maximum(side, 0.0), np.maximum(end, 0.0)) + np.minimum(np.maximum(side, end), 0.0)

    def volume(self) -> float:
        """Volume [m^3]."""
        return math.pi * self.radius**2 * self.length

    def grown(self, thickness: float) -> Self:
        """The same with side and ends so much further out [m]; it keeps its sharp edges."""
        return self._with(self.radius + thickness, self.length / 2.0 + thickness)

    def core(self, share: float) -> Self:
        """What is deeper than all but a share of the radius, or of half the length where that is less."""
        depth = (1.0 - share) * min(self.radius, self.length / 2.0)
        return self._with(self.radius - depth, self.length / 2.0 - depth)

    def _with(self, radius: float, half_length: float) -> Self:
        """The same around its middle with other sizes [m]."""
        middle, axis = (self.start + self.end) / 2.0, (self.end - self.start) / self.length
        return replace(self, radius=radius, start=middle - half_length * axis, end=middle + half_length * axis)

    def outline(self) -> MeshOutline:
        """A mesh from the start, +Z along the axis."""
        # Middle and edge of the one end, both edges of the side, edge and middle of the other end.
        radii = self.radius * np.array([0.0, 1.0, 1.0, 1.0, 1.0, 0.0])
        heights = self.length * np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
        outwards, up = np.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0]), np.array([-1.0, -1.0, 0.0, 0.0, 1.0, 1.0])
        vertices, normals = radii[:, None, None] * AROUND, outwards[:, None, None] * AROUND
        vertices[..., 2], normals[..., 2] = heights[:, None], up[:, None]
        return MeshOutline(
            self.start,
            quaternions.from_z_axis(self.end - self.start),
            vertices.reshape(-1, 3).astype(np.float32),
            normals.reshape(-1, 3).astype(np.float32),
            strips(len(radii)),
            np.array([0.0, 0.0, self.length / 2.0]),
        )

    def collision_geometry(self) -> tuple[Any, FloatArray, FloatArray]:
        """`coal.Cylinder`; turn and place in the bone's frame."""
        import coal

        turn = quaternions.from_z_axis(self.end - self.start)
        return coal.Cylinder(float(self.radius), self.length), turn, (self.start + self.end) / 2.0

    def balls(self) -> tuple[FloatArray, FloatArray]:
        """Balls around both ends that hold it: centres in the bone's frame [m], (2, 3), and radii [m], (2,)."""
        return np.stack([self.start, self.end]), np.full(2, self.radius)

    def support(self, directions: FloatArray) -> FloatArray:
        """How far the solid extends along unit vectors (N, 3) in the bone's frame, from its origin [m], shape (N,)."""
        axis = (self.end - self.start) / self.length
        across = lengths(directions - (directions @ axis)[:, None] * axis)
        return np.maximum(directions @ self.start, directions @ self.end) + self.radius * across

    def as_capsule(self) -> Capsule:
        """The largest capsule in it around its axis."""
        radius = min(self.radius, self.length / 2.0)
        inwards = (self.end - self.start) * (radius / self.length)
        return Capsule(self.name, self.bone, self.start + inwards, self.end - inwards, radius)
