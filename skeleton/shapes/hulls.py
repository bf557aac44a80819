"""Convex hulls of balls, which many shapes are: of one, of two, of the eight corners of a box."""

import math
from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from skeleton.shapes.base import Bounded, lengths

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class HullOfBalls(Bounded):
    """A solid that is the convex hull of its `balls`."""

    @abstractmethod
    def balls(self) -> tuple[FloatArray, FloatArray]:
        """Balls whose convex hull is the solid: centres in the bone's frame [m], (n, 3), and radii [m], (n,)."""

    def support(self, directions: FloatArray) -> FloatArray:
        """How far the solid extends along unit vectors (N, 3) in the bone's frame, from its origin [m], shape (N,)."""
        centers, radii = self.balls()
        return (directions @ centers.T + radii).max(axis=1)

    def lowest(self, positions: FloatArray, rotations_wxyz: FloatArray) -> FloatArray:
        """Height of the lowest point with the bone at positions (F, 3) [m] and bone_to_world (F, 4) [m], shape (F,)."""
        centers, radii = self.balls()
        in_world = positions[:, None] + quaternions.rotate(rotations_wxyz[:, None], centers)
        return (in_world[..., 2] - radii).min(axis=1)


def distance_from_hull(points: FloatArray, start: FloatArray, end: FloatArray, first: float, last: float) -> FloatArray:
    """Signed distance of points (N, 3) from the convex hull of two spheres [m], shape (N,).

    It is that from the sphere between them whose surface is nearest. Spheres along the axis have radii that fall by
    sin(a) per length, where `a` is the angle between the cone's surface and its axis; the surface's normal leans by `a`
    towards the smaller end. A point at height t along the axis and r off it therefore belongs to the sphere at
    t - r tan(a), as far as there is one.

    Args:
        points: where from [m].
        start: centre of the first sphere [m], shape (3,).
        end: centre of the second sphere [m], shape (3,).
        first: radius of the first sphere [m].
        last: radius of the second sphere [m].
    """
    axis = end - start
    length = float(np.linalg.norm(axis))
    if length <= abs(first - last):  # one of the spheres is inside the other
        return lengths(points - (start if first >= last else end)) - max(first, last)
    direction, sine = axis / length, (first - last) / length
    from_start = points - start
    along = from_start @ direction
    off_axis = lengths(from_start - along[:, None] * direction)
    share = np.clip((along - off_axis * sine / np.sqrt(1.0 - sine * sine)) / length, 0.0, 1.0)
    return lengths(from_start - share[:, None] * axis) - (first + share * (last - first))


def hull_of_spheres_volume(length: float, first: float, last: float) -> float:
    """Volume of the convex hull of two spheres [m^3].

    A cone touches both along circles; a normal of it leans by `a` from the axis' normal plane towards the smaller
    sphere, sin a = (first - last) / length. Cut at the circles the hull is a spherical cap of height first (1 + sin a),
    one of height last (1 - sin a), and between them a conical frustum of radii first cos a and last cos a and height
    length cos^2 a. With the volumes pi h^2 (3 R - h) / 3 of a cap and pi h (R^2 + R r + r^2) / 3 of a frustum
    (Weisstein, MathWorld, "Spherical Cap" and "Conical Frustum") their sum is the result.

    Args:
        length: distance of the centres [m].
        first: radius of the first sphere [m].
        last: radius of the second sphere [m].
    """
    if length <= abs(first - last):  # one of the spheres is inside the other
        return 4.0 / 3.0 * math.pi * max(first, last) ** 3
    sine = (first - last) / length
    frustum = length * (1.0 - sine * sine) ** 2 * (first * first + first * last + last * last)
    caps = first**3 * (1.0 + sine) ** 2 * (2.0 - sine) + last**3 * (1.0 - sine) ** 2 * (2.0 + sine)
    return math.pi / 3.0 * (frustum + caps)
