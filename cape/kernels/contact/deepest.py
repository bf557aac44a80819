"""The point of a triangle that is deepest in a collider.

On a convex shape the signed distance is a convex function, with a single valley on a triangle. Projected steps towards
the shape's core find it: to the point of the core behind the present one, then to the triangle's point nearest to
that (for a capsule these are alternating projections onto axis and triangle).
"""

import math

from cape.kernels.contact.shapes import nearest
from cape.kernels.jit import inlined, routine

STEPS = 80  # of a search at most: four are usual, with boxes eleven
SETTLED = 1e-7  # m that a search's step must promise
SURE = 0.5  # of what a triangle is off a limit, that must be sure for a search to end


@inlined
def weights_of_nearest(px, py, pz, ax, ay, az, bx, by, bz, cx, cy, cz):
    """Barycentric weights of a triangle's point nearest to p (Ericson, Real-Time Collision Detection, 5.1.5).

    Not `closest.on_triangle`, whose roundings let a sheet creep that lies on a cube, equally near at many points.
    """
    ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    x, y, z = px - ax, py - ay, pz - az
    d1, d2 = ux * x + uy * y + uz * z, vx * x + vy * y + vz * z
    if d1 <= 0.0 and d2 <= 0.0:
        return 1.0, 0.0, 0.0
    x, y, z = px - bx, py - by, pz - bz
    d3, d4 = ux * x + uy * y + uz * z, vx * x + vy * y + vz * z
    if d3 >= 0.0 and d4 <= d3:
        return 0.0, 1.0, 0.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0 and d1 > d3:
        t = d1 / (d1 - d3)
        return 1.0 - t, t, 0.0
    x, y, z = px - cx, py - cy, pz - cz
    d5, d6 = ux * x + uy * y + uz * z, vx * x + vy * y + vz * z
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 0.0, 1.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0 and d2 > d6:
        t = d2 / (d2 - d6)
        return 1.0 - t, 0.0, t
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        side = (d4 - d3) + (d5 - d6)
        t = (d4 - d3) / side if side > 0.0 else 0.0
        return 0.0, 1.0 - t, t
    total = va + vb + vc
    if total <= 0.0:
        return 1.0, 0.0, 0.0
    return va / total, vb / total, vc / total


@routine
def deepest_on_triangle(colliders, c, first, second, third, limit):
    """The point of a triangle deepest in collider c, all in the collider's frame [m].

    A proximal bundle method with one aggregate (Kiwiel 1990, "Proximity control in bundle methods for convex
    nondifferentiable minimization"), as a box has edges: there, and on the triangle's own edges, the normal at hand
    leads nowhere. A step that gets less than a tenth as deep as the tangent plane promised is not taken; the mean of
    this plane and the one where it led that promises least then leads on. A plane's `lag` [m] is how far it is below
    the distance here; one that lags much tells of places too far away.

    Where no point of the triangle is within `limit` [m] of the surface, the search ends as soon as that is sure: as the
    distance is convex, it lies above the planes, and these are lowest at a corner.

    Returns its signed distance [m], the normal there, its barycentric weights, and a bound from below of the distance.
    """
    ax, ay, az = first
    bx, by, bz = second
    cx, cy, cz = third
    ex, ey, ez, fx, fy, fz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    hx, hy, hz = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
    area = hx * hx + hy * hy + hz * hz
    flat = 1.0 / area if area > 0.0 else 0.0
    u = v = w = 1.0 / 3.0
    x, y, z = (ax + bx + cx) / 3.0, (ay + by + cy) / 3.0, (az + bz + cz) / 3.0
    distance, nx, ny, nz = nearest(colliders, c, x, y, z)
    core = colliders.records[c].core
    way = max(distance + core, 0.1 * core)
    dx, dy, dz, lag = nx, ny, nz, 0.0
    bound = -math.inf
    for _ in range(STEPS):
        lowest = min(dx * ax + dy * ay + dz * az, min(dx * bx + dy * by + dz * bz, dx * cx + dy * cy + dz * cz))
        bound = max(bound, distance - lag + lowest - (dx * x + dy * y + dz * z))
        if distance > limit and bound - limit > SURE * (distance - limit):
            return distance, nx, ny, nz, u, v, w, bound
        p, q, r = weights_of_nearest(x - way * dx, y - way * dy, z - way * dz, ax, ay, az, bx, by, bz, cx, cy, cz)
        tx, ty, tz = p * ax + q * bx + r * cx, p * ay + q * by + r * cy, p * az + q * bz + r * cz
        gx, gy, gz = x - tx, y - ty, z - tz
        promised = dx * gx + dy * gy + dz * gz + lag
        if promised < SETTLED:
            break
        there, mx, my, mz = nearest(colliders, c, tx, ty, tz)
        if there < distance - 0.1 * promised:
            u, v, w, x, y, z = p, q, r, tx, ty, tz
            distance, nx, ny, nz = there, mx, my, mz
            dx, dy, dz, lag = nx, ny, nz, 0.0
            way = min(1.5 * way, max(distance + core, 0.1 * core))
            continue
        other = distance - there - (mx * gx + my * gy + mz * gz)
        # The step itself, as a slope, is the normal without what the triangle's plane and edges take of it.
        rate = 1.0 / way
        dx, dy, dz = rate * gx, rate * gy, rate * gz
        lag = promised - (dx * gx + dy * gy + dz * gz)
        off = flat * (mx * hx + my * hy + mz * hz)
        mx, my, mz = mx - off * hx - dx, my - off * hy - dy, mz - off * hz - dz
        if other > 0.2 * promised:
            way *= 0.6
        apart = way * (mx * mx + my * my + mz * mz)
        share = lag - other - way * (dx * mx + dy * my + dz * mz)
        share = min(max(share / apart, 0.0), 1.0) if apart > 0.0 else 0.0
        dx, dy, dz, lag = dx + share * mx, dy + share * my, dz + share * mz, lag + share * (other - lag)
    return distance, nx, ny, nz, u, v, w, distance
