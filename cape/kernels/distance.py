"""Signed distances of a point from shapes, each with the unit normal out of the shape at the nearest surface point.

Follows Ericson, Real-Time Collision Detection, 5.1.2 (segment) and 5.1.4 (box). All lengths in metres. Each function
returns (distance, normal x, normal y, normal z), the distance negative inside.
"""

import math

from cape.kernels.jit import inlined

TINY = 1e-12


@inlined
def to_capsule(px, py, pz, ax, ay, az, bx, by, bz, radius):
    """Distance from the surface of a capsule around the segment from a to b; a equal to b is a sphere.

    A point on the axis has no nearest surface point: the normal is then any one across the axis (for a sphere, +Z).
    """
    dx, dy, dz = bx - ax, by - ay, bz - az
    squared = dx * dx + dy * dy + dz * dz
    t = 0.0
    if squared > TINY * TINY:
        t = ((px - ax) * dx + (py - ay) * dy + (pz - az) * dz) / squared
        t = min(max(t, 0.0), 1.0)
    nx, ny, nz = px - (ax + t * dx), py - (ay + t * dy), pz - (az + t * dz)
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if length > TINY:
        return length - radius, nx / length, ny / length, nz / length
    if dx * dx + dy * dy > TINY * TINY:
        across = math.sqrt(dx * dx + dy * dy)
        return -radius, dy / across, -dx / across, 0.0
    if squared > TINY * TINY:
        return -radius, 1.0, 0.0, 0.0
    return -radius, 0.0, 0.0, 1.0


@inlined
def to_box(px, py, pz, hx, hy, hz):
    """Distance from the surface of a box of half sizes h around the origin, in the box's own frame.

    Inside, the nearest face gives the normal; of faces at equal depth the first in the order x, y, z.
    """
    qx, qy, qz = abs(px) - hx, abs(py) - hy, abs(pz) - hz
    sx = 1.0 if px >= 0.0 else -1.0
    sy = 1.0 if py >= 0.0 else -1.0
    sz = 1.0 if pz >= 0.0 else -1.0
    if qx <= 0.0 and qy <= 0.0 and qz <= 0.0:
        if qx >= qy and qx >= qz:
            return qx, sx, 0.0, 0.0
        if qy >= qz:
            return qy, 0.0, sy, 0.0
        return qz, 0.0, 0.0, sz
    ox, oy, oz = max(qx, 0.0), max(qy, 0.0), max(qz, 0.0)
    length = math.sqrt(ox * ox + oy * oy + oz * oz)
    return length, sx * ox / length, sy * oy / length, sz * oz / length


@inlined
def to_plane(px, py, pz, ox, oy, oz, nx, ny, nz):
    """Distance from the plane through o with unit normal n."""
    return (px - ox) * nx + (py - oy) * ny + (pz - oz) * nz, nx, ny, nz
