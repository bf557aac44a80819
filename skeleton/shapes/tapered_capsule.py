"""Capsules that are thicker at one end."""

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
from skeleton.shapes.base import TINY, Layout, along, upright
from skeleton.shapes.capsule import Capsule
from skeleton.shapes.hulls import HullOfBalls, distance_from_hull, hull_of_spheres_volume
from skeleton.shapes.outlines import MeshOutline
from skeleton.shapes.revolved import AROUND, strips

FloatArray = NDArray[np.float64]

RINGS = 7  # of the drawn surface from a pole of a sphere to where the cone touches it


def nearest(x, y, z, length, radius, sine, tangent):
    """Convex hull of a sphere of `radius` at the origin and one at `length` on +Z, smaller by `sine` times the length.

    `sine` and `tangent` are those of the angle between axis and surface, negative where the second sphere is larger. A
    point on the axis has no nearest surface point; the normal is then the surface's above +X.
    """
    around = math.sqrt(x * x + y * y)
    along = min(max(z - tangent * around, 0.0), length)
    z -= along
    off = math.sqrt(x * x + y * y + z * z)
    scale = 1.0 / max(off, TINY)
    clear = off > TINY
    return (
        off - (radius - sine * along),
        (x * scale if clear else math.sqrt(1.0 - sine * sine)),
        (y * scale if clear else 0.0),
        (z * scale if clear else sine),
    )


@checked
@dataclass(frozen=True, eq=False, kw_only=True)
class TaperedCapsule(HullOfBalls):
    """The convex hull of two spheres: a capsule that is thicker at one end.

    Where one sphere holds the other, the shape is the larger sphere.

    Attributes:
        name: unique name.
        bone: name of the bone that carries it, None for one that stands still in the world.
        start: centre of the first sphere in the bone's frame [m], shape (3,).
        end: centre of the second sphere in the bone's frame [m], shape (3,).
        start_radius: of the first sphere [m].
        end_radius: of the second sphere [m].
        friction: Coulomb coefficient against cloth, None for the scene's default.
        thickness: distance from the surface at which cloth is stopped [m], None for the scene's default.

    Raises:
        ValueRangeError: a value is out of range.
    """

    name: str = "tapered capsule"
    start: FloatArray = field(default_factory=lambda: np.zeros(3))
    end: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    start_radius: float = 0.2
    end_radius: float = 0.1

    numbers: ClassVar[Mapping[str, int]] = {"start": 3, "end": 3, "start_radius": 0, "end_radius": 0}
    nearest = staticmethod(nearest)

    def _check(self) -> None:
        for label in ("start_radius", "end_radius"):
            radius = getattr(self, label)
            self._require(0.0 < radius < math.inf, f"{label} must be positive", radius)

    def describe(self) -> str:
        """Kind and both radii."""
        return f"{self.kind()} of {1000 * self.start_radius:.0f} to {1000 * self.end_radius:.0f} mm"

    def layout(self) -> Layout:
        """From the first sphere, +Z along the axis; sizes are length and radius [m], sine and tangent of the taper.

        Where one sphere holds the other, the sizes are those of the larger one.
        """
        rotation, length = along(self.end - self.start)
        start, end = self.start_radius, self.end_radius
        if length <= abs(start - end):  # one sphere holds the other
            origin = self.start if start >= end else self.end
            return Layout(origin, rotation, (0.0, max(start, end)), max(start, end), max(start, end))
        sine, least = (start - end) / length, min(start, end)
        return Layout(self.start, rotation, (length, start, sine, sine / math.sqrt(1.0 - sine**2)), least, least)

    def distances(self, points: FloatArray) -> FloatArray:
        """Distances of points (N, 3) in the bone's frame from the surface [m], negative inside, shape (N,)."""
        return distance_from_hull(points, self.start, self.end, self.start_radius, self.end_radius)

    def volume(self) -> float:
        """Volume [m^3]."""
        length = float(np.linalg.norm(self.end - self.start))
        return hull_of_spheres_volume(length, self.start_radius, self.end_radius)

    def grown(self, thickness: float) -> Self:
        """The same with its surface so much further out [m]."""
        return replace(self, start_radius=self.start_radius + thickness, end_radius=self.end_radius + thickness)

    def core(self, share: float) -> Self:
        """What is within a share of the radius of the axis, from the one end's to the other's."""
        return replace(self, start_radius=share * self.start_radius, end_radius=share * self.end_radius)

    def outline(self) -> MeshOutline:
        """A mesh from the first sphere, +Z along the axis."""
        axis = self.end - self.start
        length = float(np.linalg.norm(axis))
        vertices, normals, triangles = tapered_hull(length, self.start_radius, self.end_radius)
        middle = np.array([0.0, 0.0, length / 2.0])
        return MeshOutline(self.start, quaternions.from_z_axis(axis), vertices, normals, triangles, middle)

    def collision_geometry(self) -> tuple[Any, FloatArray, FloatArray]:
        """A `coal.Convex` that holds it and is nowhere farther out than 0.5 % of the larger radius: coal has no such
        shape. Its turn and place in the bone's frame."""
        import coal
        import trimesh

        ball = trimesh.creation.icosphere(subdivisions=3)
        # Every face of this polyhedron is at least as far out as the unit sphere.
        around = ball.vertices / np.einsum("ij,ij->i", ball.face_normals, ball.triangles_center).min()
        ends = (self.start_radius * around, self.end - self.start + self.end_radius * around)
        hull = trimesh.convex.convex_hull(np.concatenate(ends))
        corners, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        for corner in hull.vertices:
            corners.append(np.array(corner))
        for first, second, third in hull.faces.tolist():
            faces.append(coal.Triangle(first, second, third))
        return coal.Convex(corners, faces), upright(), self.start

    def balls(self) -> tuple[FloatArray, FloatArray]:
        """Both spheres: centres in the bone's frame [m], shape (2, 3), and radii [m], shape (2,)."""
        return np.stack([self.start, self.end]), np.array([self.start_radius, self.end_radius])

    def as_capsule(self) -> Capsule:
        """The capsule with the mean of both radii."""
        radius = float(np.mean([self.start_radius, self.end_radius]))
        return Capsule(self.name, self.bone, self.start, self.end, radius)


def tapered_hull(
    length: float, start_radius: float, end_radius: float
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint32]]:
    """The convex hull of a sphere at the origin and one at `length` on +Z [m], the larger one where it holds the other.

    Returns:
        Vertices [m] and unit normals, shape (N, 3), and triangles, counter-clockwise from outside, shape (T, 3).
    """
    latitudes, centers, radii = _profile(length, start_radius, end_radius)
    normals = np.cos(latitudes)[:, None, None] * AROUND
    normals[..., 2] += np.sin(latitudes)[:, None]
    vertices = radii[:, None, None] * normals
    vertices[..., 2] += centers[:, None]
    return (
        vertices.reshape(-1, 3).astype(np.float32),
        normals.reshape(-1, 3).astype(np.float32),
        strips(len(latitudes)),
    )


def _profile(length: float, start_radius: float, end_radius: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Latitudes of the normals [rad] up the outline, and the centre on the axis and the radius of the sphere of each.

    The cone touches both spheres where the normal has the sine (r0 - r1) / length.
    """
    if length <= abs(start_radius - end_radius):
        latitudes = np.linspace(-np.pi / 2.0, np.pi / 2.0, 2 * RINGS)
        center, radius = (0.0, start_radius) if start_radius >= end_radius else (length, end_radius)
        return latitudes, np.full(2 * RINGS, center), np.full(2 * RINGS, radius)
    touch = np.arcsin((start_radius - end_radius) / length)
    latitudes = np.concatenate([np.linspace(-np.pi / 2.0, touch, RINGS), np.linspace(touch, np.pi / 2.0, RINGS)])
    return latitudes, np.repeat([0.0, length], RINGS), np.repeat([start_radius, end_radius], RINGS)
