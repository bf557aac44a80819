"""Closest points of a vertex and a triangle, and of two edges, whatever their shape.

Follows Ericson, Real-Time Collision Detection, 3.4 (barycentric coordinates), 5.1.2 (segment) and 5.1.9 (two segments).
All lengths in metres, all arithmetic in double precision.

Degenerate cases: a triangle without area is its three edges; an edge without length is its first end; of parallel edges
that overlap any two opposite points will do.
"""

import math

import numpy as np

from cape.kernels.jit import inlined

TINY = 1e-24  # m2; an edge with a shorter square has no length
FLAT = 1e-10  # squared sine of an angle below which a triangle has no area
PARALLEL = 1e-3  # squared sine of the angle (2 degrees) below which two edges count as parallel


@inlined
def on_segment(px, py, pz, dx, dy, dz):
    """Share of the segment from the origin along d, 0 to 1, at which it comes closest to p."""
    squared = dx * dx + dy * dy + dz * dz
    if squared <= TINY:
        return 0.0
    return min(max((px * dx + py * dy + pz * dz) / squared, 0.0), 1.0)


@inlined
def on_triangle(px, py, pz, ux, uy, uz, vx, vy, vz):
    """Weights of u and v in the point closest to p of the triangle of the origin, u and v.

    The third value tells whether p is above the triangle's inside, or below it.
    """
    uu = ux * ux + uy * uy + uz * uz
    uv = ux * vx + uy * vy + uz * vz
    vv = vx * vx + vy * vy + vz * vz
    pu = px * ux + py * uy + pz * uz
    pv = px * vx + py * vy + pz * vz
    squared = uu * vv - uv * uv
    if squared > FLAT * uu * vv:
        p, q = (vv * pu - uv * pv) / squared, (uu * pv - uv * pu) / squared
        if p >= 0.0 and q >= 0.0 and p + q <= 1.0:
            return p, q, True
    # Of the three edges, the closest.
    t = on_segment(px, py, pz, ux, uy, uz)
    rx, ry, rz = px - t * ux, py - t * uy, pz - t * uz
    best = rx * rx + ry * ry + rz * rz
    p, q = t, 0.0
    t = on_segment(px, py, pz, vx, vy, vz)
    rx, ry, rz = px - t * vx, py - t * vy, pz - t * vz
    other = rx * rx + ry * ry + rz * rz
    if other < best:
        best, p, q = other, 0.0, t
    wx, wy, wz = vx - ux, vy - uy, vz - uz
    t = on_segment(px - ux, py - uy, pz - uz, wx, wy, wz)
    rx, ry, rz = px - ux - t * wx, py - uy - t * wy, pz - uz - t * wz
    if rx * rx + ry * ry + rz * rz < best:
        p, q = 1.0 - t, t
    return p, q, False


@inlined
def on_segments(rx, ry, rz, dx, dy, dz, ex, ey, ez):
    """Shares of two segments, from r along d and from the origin along e, at their closest points.

    The third value tells whether both lie within the segments, which aren't parallel: there the segments cross when
    looked at along the line between the points.
    """
    a = dx * dx + dy * dy + dz * dz
    e = ex * ex + ey * ey + ez * ez
    if a <= TINY:
        return 0.0, on_segment(rx, ry, rz, ex, ey, ez), False
    if e <= TINY:
        return on_segment(-rx, -ry, -rz, dx, dy, dz), 0.0, False
    b = dx * ex + dy * ey + dz * ez
    c = dx * rx + dy * ry + dz * rz
    f = ex * rx + ey * ry + ez * rz
    squared = a * e - b * b
    crossing = squared > PARALLEL * a * e
    s = (b * f - c * e) / squared if squared > FLAT * a * e else 0.0
    if s < 0.0 or s > 1.0:
        s, crossing = min(max(s, 0.0), 1.0), False
    t = (b * s + f) / e
    if t < 0.0:
        t, s, crossing = 0.0, min(max(-c / a, 0.0), 1.0), False
    elif t > 1.0:
        t, s, crossing = 1.0, min(max((b - c) / a, 0.0), 1.0), False
    return s, t, crossing


@inlined
def from_triangle(i, a, b, c, x, y, z):
    """Vector from a triangle's closest point to vertex i [m], the corners' weights, and if i is over the inside."""
    ax, ay, az = np.float64(x[a]), np.float64(y[a]), np.float64(z[a])
    px, py, pz = np.float64(x[i]) - ax, np.float64(y[i]) - ay, np.float64(z[i]) - az
    ux, uy, uz = np.float64(x[b]) - ax, np.float64(y[b]) - ay, np.float64(z[b]) - az
    vx, vy, vz = np.float64(x[c]) - ax, np.float64(y[c]) - ay, np.float64(z[c]) - az
    p, q, over = on_triangle(px, py, pz, ux, uy, uz, vx, vy, vz)
    return px - p * ux - q * vx, py - p * uy - q * vy, pz - p * uz - q * vz, 1.0 - p - q, p, q, over


@inlined
def from_edge(a, b, c, d, x, y, z):
    """Vector from the closest point of edge cd to that of ab [m], their shares, and whether the edges cross there."""
    rx, ry, rz = np.float64(x[a]) - x[c], np.float64(y[a]) - y[c], np.float64(z[a]) - z[c]
    ux, uy, uz = np.float64(x[b]) - x[a], np.float64(y[b]) - y[a], np.float64(z[b]) - z[a]
    vx, vy, vz = np.float64(x[d]) - x[c], np.float64(y[d]) - y[c], np.float64(z[d]) - z[c]
    p, q, crossing = on_segments(rx, ry, rz, ux, uy, uz, vx, vy, vz)
    return rx + p * ux - q * vx, ry + p * uy - q * vy, rz + p * uz - q * vz, p, q, crossing


@inlined
def is_beyond_triangle(i, a, b, c, x, y, z, reach):
    """Tell that vertex i is further than `reach` [m] from a triangle, as seen along the line from its middle.

    That costs little, and holds for most that are: a distance along any line is no more than that in space.
    """
    px, py, pz = np.float64(x[i]), np.float64(y[i]), np.float64(z[i])
    ax, ay, az = px - x[a], py - y[a], pz - z[a]
    bx, by, bz = px - x[b], py - y[b], pz - z[b]
    cx, cy, cz = px - x[c], py - y[c], pz - z[c]
    mx, my, mz = ax + bx + cx, ay + by + cy, az + bz + cz
    nearest = min(ax * mx + ay * my + az * mz, min(bx * mx + by * my + bz * mz, cx * mx + cy * my + cz * mz))
    return nearest > 0.0 and nearest * nearest > reach * reach * (mx * mx + my * my + mz * mz)


@inlined
def is_beyond_edge(a, b, c, d, x, y, z, reach):
    """Tell that edges ab and cd are further than `reach` [m] apart, as seen along the line between their middles."""
    ax, ay, az, cx, cy, cz = (
        np.float64(x[a]), np.float64(y[a]), np.float64(z[a]), np.float64(x[c]), np.float64(y[c]), np.float64(z[c]),
    )  # fmt: skip
    ux, uy, uz = x[b] - ax, y[b] - ay, z[b] - az
    vx, vy, vz = x[d] - cx, y[d] - cy, z[d] - cz
    mx, my, mz = 2.0 * (ax - cx) + ux - vx, 2.0 * (ay - cy) + uy - vy, 2.0 * (az - cz) + uz - vz
    squared = mx * mx + my * my + mz * mz
    between = squared - abs(ux * mx + uy * my + uz * mz) - abs(vx * mx + vy * my + vz * mz)
    return between > 0.0 and between * between > 4.0 * reach * reach * squared


@inlined
def squared_speed(a, b, vx, vy, vz):
    """Of two vertices relative to each other [m2/s2]."""
    x, y, z = np.float64(vx[a]) - vx[b], np.float64(vy[a]) - vy[b], np.float64(vz[a]) - vz[b]
    return x * x + y * y + z * z


@inlined
def speed_to_triangle(i, a, b, c, vx, vy, vz):
    """Largest speed of vertex i relative to points of a triangle [m/s], or way [m] if v is that."""
    ab = max(squared_speed(i, a, vx, vy, vz), squared_speed(i, b, vx, vy, vz))
    return math.sqrt(max(ab, squared_speed(i, c, vx, vy, vz)))


@inlined
def speed_to_edge(a, b, c, d, vx, vy, vz):
    """Largest speed of points of edge ab relative to points of cd [m/s], or way [m] if v is that."""
    of_a = max(squared_speed(a, c, vx, vy, vz), squared_speed(a, d, vx, vy, vz))
    return math.sqrt(max(of_a, max(squared_speed(b, c, vx, vy, vz), squared_speed(b, d, vx, vy, vz))))
