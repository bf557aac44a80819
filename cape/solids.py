"""Signed distances of many points from colliders, in double precision; nothing here is shared with the solvers."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape import colliders
from cape.colliders import Box, Collider, Plane, Sphere
from motions import quaternions
from skeleton.shapes import Capsule

FloatArray = NDArray[np.float64]

CORE = 0.1  # of a solid's inner radius: how far its core reaches

# Convex hull of two spheres; a package without that shape has none of them.
_Tapered: Any = getattr(colliders, "TaperedCapsule", ())


def signed_distance(solid: Collider, points: FloatArray) -> FloatArray:
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
    return _from_hull(points, *_spheres(solid))


def core(solid: Collider) -> Collider | None:
    """What is deepest in a solid, one tenth of its inner radius around its middle; None for a half-space."""
    shape: Any = solid
    if isinstance(shape, Plane):
        return None
    if isinstance(shape, Box):
        return replace(shape, half_sizes=shape.half_sizes - (1.0 - CORE) * shape.half_sizes.min())
    if isinstance(shape, Sphere | Capsule):
        return replace(shape, radius=CORE * shape.radius)
    _, _, start_radius, end_radius = _spheres(shape)
    return replace(shape, start_radius=CORE * start_radius, end_radius=CORE * end_radius)


def _spheres(solid: Any) -> tuple[FloatArray, FloatArray, float, float]:
    """Centres and radii of the two spheres of a tapered capsule [m]."""
    if not isinstance(solid, _Tapered):
        raise TypeError(f"{type(solid).__name__} is no collider")
    return solid.start, solid.end, solid.start_radius, solid.end_radius


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
