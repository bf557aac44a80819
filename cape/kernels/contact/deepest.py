"""The point of a triangle that is deepest in a collider.

The signed distance from a convex shape is a convex function: it lies above each of its tangent planes. Two kinds of
steps look for its least value on a triangle. Projected ones lead to the core behind the present point and from there to
the triangle's nearest (for a capsule these are alternating projections onto axis and triangle), in a few looks where
the surface is round. Where it has edges, cutting planes do better (Kelley 1960, "The cutting-plane method for solving
convex programs"): to the lowest point of all planes so far, `contact.lowest`.
"""

from cape.kernels.contact.lowest import entered, lowest_of, lowest_of_one
from cape.kernels.contact.shapes import nearest
from cape.kernels.jit import inlined, routine

STEPS = 80  # of a search at most: three are usual, one in a hundred takes ten
SETTLED = 1e-6  # m that the point found may be off the deepest at most, as far as the planes tell
STILL = 1e-7  # m that a projected step must promise: points that are as good as equal are not worth the way
BEHIND = 0.02  # of what the planes leave open, that a projected step must promise to be better than one to their lowest
SURE = 0.5  # of what a triangle is off a limit, that must be sure for a search to end
PROJECTING, MEETING, CUTTING = 0, 1, 2


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


@inlined
def heights(distance, nx, ny, nz, x, y, z, first, second, third):
    """Heights of a tangent plane at a triangle's corners [m], where it has a distance and normal at a point."""
    a = distance + nx * (first[0] - x) + ny * (first[1] - y) + nz * (first[2] - z)
    b = distance + nx * (second[0] - x) + ny * (second[1] - y) + nz * (second[2] - z)
    c = distance + nx * (third[0] - x) + ny * (third[1] - y) + nz * (third[2] - z)
    return a, b, c


@routine
def deepest_on_triangle(colliders, c, first, second, third, limit):
    """The point of a triangle deepest in collider c, all in the collider's frame [m].

    Projected steps come first. One that does not get a tenth as deep as its plane promised has come across an edge: the
    next look is where its plane and that before meet on the way, in the middle of a triangle that lies on an edge. From
    then on each look is at the lowest point of the planes.

    Where no point of the triangle is within `limit` [m] of the surface, the search ends as soon as that is sure.

    Returns its signed distance [m], the normal there, its barycentric weights, and a bound from below of the distance.
    """
    ax, ay, az = first
    bx, by, bz = second
    cx, cy, cz = third
    u = v = w = 1.0 / 3.0
    x, y, z = (ax + bx + cx) / 3.0, (ay + by + cy) / 3.0, (az + bz + cz) / 3.0
    distance, nx, ny, nz = nearest(colliders, c, x, y, z)
    core = colliders.records[c].core
    way = max(distance + core, 0.1 * core)
    a, b, o = heights(distance, nx, ny, nz, x, y, z, first, second, third)
    planes, (low_u, low_v, bound) = lowest_of_one(a, b, o)
    turn, promised = PROJECTING, 0.0
    p, q, r = meet_u, meet_v, meet_w = u, v, w
    for _ in range(STEPS):
        if distance - bound < SETTLED or (distance > limit and bound - limit > SURE * (distance - limit)):
            break
        if turn == PROJECTING:
            p, q, r = weights_of_nearest(x - way * nx, y - way * ny, z - way * nz, ax, ay, az, bx, by, bz, cx, cy, cz)
            promised = distance - (p * a + q * b + r * o)
            if promised < STILL and distance < limit:
                break
            if promised < BEHIND * (distance - bound):
                turn = CUTTING
        elif turn == MEETING:
            p, q, r = meet_u, meet_v, meet_w
        if turn == CUTTING:
            p, q, r = low_u, low_v, max(1.0 - low_u - low_v, 0.0)
        tx, ty, tz = p * ax + q * bx + r * cx, p * ay + q * by + r * cy, p * az + q * bz + r * cz
        there, mx, my, mz = nearest(colliders, c, tx, ty, tz)
        d, e, f = heights(there, mx, my, mz, tx, ty, tz, first, second, third)
        if low_u * d + low_v * e + (1.0 - low_u - low_v) * f > bound + 0.01 * SETTLED:
            planes = entered(planes, d, e, f)
            planes, (low_u, low_v, lowest) = lowest_of(planes)
            bound = max(bound, lowest)
        if turn == MEETING:
            turn = CUTTING
        elif turn == PROJECTING and there > distance - 0.1 * promised:
            turn = MEETING
            below, above = distance - (u * d + v * e + w * f), there - (distance - promised)
            met = below / (below + above)
            meet_u, meet_v, meet_w = u + met * (p - u), v + met * (q - v), w + met * (r - w)
        if there < distance:
            u, v, w, x, y, z = p, q, r, tx, ty, tz
            distance, nx, ny, nz, a, b, o = there, mx, my, mz, d, e, f
            way = min(1.5 * way, max(distance + core, 0.1 * core))
    return distance, nx, ny, nz, u, v, w, min(bound, distance)
