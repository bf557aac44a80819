"""Signed distances of a point from shapes in their own frames, with the unit normal out of the shape, compiled.

Each function takes a point and the shape's four sizes [m] and returns (distance, normal x, y, z): the distance [m] from
the surface, negative inside, and the direction in which it grows. Every shape is convex. The formulas stand with the
shapes, in `skeleton.shapes`.
"""

from cape.kernels.jit import inlined
from skeleton.shapes import box, capsule, cylinder, ellipsoid, plane, tapered_capsule
from skeleton.shapes.base import TINY

__all__ = ["TINY", "to_box", "to_capsule", "to_cylinder", "to_ellipsoid", "to_plane", "to_tapered_capsule"]

to_capsule = inlined(capsule.nearest)
to_tapered_capsule = inlined(tapered_capsule.nearest)
to_box = inlined(box.nearest)
to_plane = inlined(plane.nearest)
to_cylinder = inlined(cylinder.nearest)
to_ellipsoid = inlined(ellipsoid.nearest)
