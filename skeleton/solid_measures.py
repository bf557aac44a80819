"""How far points are from a solid, and how much room it takes; in double precision, nothing shared with the solvers."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from skeleton.shapes import Bounded, Box, Capsule, Plane, Shape, Sphere, balls_of

FloatArray = NDArray[np.float64]


def signed_distance(solid: Shape, points: FloatArray) -> FloatArray:
    """Distances of points (N, 3), in the frame of the solid's bone, from its surface [m], negative inside, shape (N,).

    All solids are convex, so the distance is a convex function of the point that changes no faster than the point
    moves.
    """
    if isinstance(solid, Plane):
        return (points - solid.point) @ (solid.normal / np.linalg.norm(solid.normal))
    if isinstance(solid, Box):
        return _from_box((points - solid.center) @ quaternions.to_matrix(solid.rotation_wxyz), solid.half_sizes)
    if isinstance(solid, Sphere):
        return _length(points - solid.center) - solid.radius
    if isinstance(solid, Capsule):
        return _from_hull(points, solid.start, solid.end, solid.radius, solid.radius)
    return _from_hull(points, solid.start, solid.end, solid.start_radius, solid.end_radius)


def volume(solid: Shape) -> float:
    """Volume of a solid [m^3], infinite for a half-space."""
    if isinstance(solid, Plane):
        return math.inf
    if isinstance(solid, Box):
        return float(8.0 * np.prod(solid.half_sizes))
    if isinstance(solid, Sphere):
        return hull_of_spheres_volume(0.0, solid.radius, solid.radius)
    length = float(np.linalg.norm(solid.end - solid.start))
    if isinstance(solid, Capsule):
        return hull_of_spheres_volume(length, solid.radius, solid.radius)
    return hull_of_spheres_volume(length, solid.start_radius, solid.end_radius)


def union_volume(solids: Sequence[Bounded], *, across: int = 24) -> float:
    """Volume of the union of solids in one frame [m^3], from a grid of so many points across the box around them.

    A single solid's is exact. Of each cell that the surface cuts, half is wrong at most: with 24 points across, the
    error stays below 5 % for solids that fill a third of their box.
    """
    if len(solids) == 1:
        return volume(solids[0])
    corners = [_bounds(solid) for solid in solids]
    low, high = np.min([low for low, _ in corners], axis=0), np.max([high for _, high in corners], axis=0)
    shares = (np.arange(across) + 0.5) / across
    grid = low + np.stack(np.meshgrid(shares, shares, shares), axis=-1).reshape(-1, 3) * (high - low)
    inside = np.min([signed_distance(solid, grid) for solid in solids], axis=0) <= 0.0
    return float(inside.mean() * np.prod(high - low))


def _bounds(solid: Bounded) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest corner of the upright box around a solid [m], each of shape (3,)."""
    centers, radii = balls_of(solid)
    return (centers - radii[:, None]).min(axis=0), (centers + radii[:, None]).max(axis=0)


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


def _from_box(points: FloatArray, half_sizes: FloatArray) -> FloatArray:
    """From a cuboid around the origin: the way to its nearest point outside, to the nearest of its faces inside."""
    beyond = np.abs(points) - half_sizes
    return _length(np.maximum(beyond, 0.0)) + np.minimum(beyond.max(axis=1), 0.0)


def _from_hull(points: FloatArray, start: FloatArray, end: FloatArray, first: float, last: float) -> FloatArray:
    """From the convex hull of two spheres: from the sphere between them whose surface is nearest.

    Spheres along the axis have radii that fall by sin(a) per length, where `a` is the angle between the cone's
    surface and its axis; the surface's normal leans by `a` towards the smaller end. A point at height t along the axis
    and r off it therefore belongs to the sphere at t - r tan(a), as far as there is one.
    """
    axis = end - start
    length = float(np.linalg.norm(axis))
    if length <= abs(first - last):  # one of the spheres is inside the other
        return _length(points - (start if first >= last else end)) - max(first, last)
    direction, sine = axis / length, (first - last) / length
    from_start = points - start
    along = from_start @ direction
    off_axis = _length(from_start - along[:, None] * direction)
    share = np.clip((along - off_axis * sine / np.sqrt(1.0 - sine * sine)) / length, 0.0, 1.0)
    return _length(from_start - share[:, None] * axis) - (first + share * (last - first))


def _length(vectors: FloatArray) -> FloatArray:
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
