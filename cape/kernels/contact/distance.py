"""Signed distances of a point from shapes in their own frames, with the unit normal out of the shape.

Each function takes a point and the shape's four sizes [m] and returns (distance, normal x, y, z): the distance [m] from
the surface, negative inside, and the direction in which it grows. Every shape is convex. There are no branches but
choices of a value, so that loops over points vectorise. After Ericson, Real-Time Collision Detection, 5.1.2 (segment)
and 5.1.4 (box); the tapered capsule is the convex hull of two spheres.
"""

import math

TINY = 1e-12  # m


def to_capsule(x, y, z, length, radius, _2, _3):
    """Capsule around the segment from the origin to `length` on +Z; no length makes it a sphere.

    A point on the axis has no nearest surface point; the normal is then +X.
    """
    z -= min(max(z, 0.0), length)
    off = math.sqrt(x * x + y * y + z * z)
    scale = 1.0 / max(off, TINY)
    clear = off > TINY
    return off - radius, (x * scale if clear else 1.0), (y * scale if clear else 0.0), (z * scale if clear else 0.0)


def to_tapered_capsule(x, y, z, length, radius, sine, tangent):
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


def to_box(x, y, z, half_x, half_y, half_z, _3):
    """Box of the given half sizes around the origin.

    Inside, the nearest face gives the normal; of faces at equal depth the first in the order x, y, z.
    """
    qx, qy, qz = abs(x) - half_x, abs(y) - half_y, abs(z) - half_z
    sx, sy, sz = math.copysign(1.0, x), math.copysign(1.0, y), math.copysign(1.0, z)
    depth = max(qx, max(qy, qz))
    ox, oy, oz = max(qx, 0.0), max(qy, 0.0), max(qz, 0.0)
    off = math.sqrt(ox * ox + oy * oy + oz * oz)
    scale = 1.0 / max(off, TINY)
    outside = off > TINY
    first = qx >= depth
    second = (qy >= depth) & (not first)
    third = not (first | second)
    return (
        off + min(depth, 0.0),
        sx * (ox * scale if outside else (1.0 if first else 0.0)),
        sy * (oy * scale if outside else (1.0 if second else 0.0)),
        sz * (oz * scale if outside else (1.0 if third else 0.0)),
    )


def to_plane(x, y, z, _0, _1, _2, _3):
    """Half-space below the plane through the origin across +Z."""
    return z, 0.0, 0.0, 1.0
