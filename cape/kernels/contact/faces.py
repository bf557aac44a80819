"""Contact of triangles with colliders so thin, or with such sharp edges, that they would poke through between vertices.

On a convex shape the signed distance is a convex function, with a single valley on a triangle. Projected steps towards
the shape's core find it: to the point of the core behind the present one, then to the triangle's point nearest to
that (for a capsule these are alternating projections onto axis and triangle). What the point needs, its corners get by
their barycentric weights w: dv_i = w_i / m_i / sum(w_k^2 / m_k) du.
"""

import math

from cape.kernels.bones import velocity_at
from cape.kernels.contact.contact import EXIT, GRAZE, PASSES, at_start, is_fast, stopped, turn_of
from cape.kernels.contact.shapes import direction_to_world, into_shape, nearest, numbers_of, place, signed_distance
from cape.kernels.contact.watch import (
    GAIN,
    JOLT,
    LONGEST,
    TILE,
    alarm,
    approach,
    from_order,
    is_alarmed,
    nap,
    spread_of,
    to_order,
    were_alarmed,
)
from cape.kernels.jit import driver, inlined

GROUP = 8  # triangles that are watched together
SEEN = 10 * GROUP  # numbers noted of one
CHUNK = 16  # groups
THIRD = 1.0 / 3.0
SHARE = 0.5  # of the thickness: vertices at all of it hold most triangles off without any help
STEPS = 80  # of a search at most: four are usual, with boxes eleven
SETTLED = 1e-7  # m that a search's step must promise
PIERCED = 0.8  # of the core: deeper in, the normal tells no way out
LEVER = 2.0  # times as far as the point that is moved a corner may be
SLOWER = 0.5  # share of the vertices' own speed, at which a triangle that is inside leaves
STRIDE = 0.45  # of the longest edge that a thin collider may come past it in a step: at 1.3 threads get through
FEWEST, MOST = 2, 24  # looks at a triangle's way: for each core's length, and at most


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


@driver
def deepest_on_triangle(shapes, c, ax, ay, az, bx, by, bz, cx, cy, cz):
    """The point of a triangle deepest in collider c, all in the collider's frame [m].

    A proximal bundle method with one aggregate (Kiwiel 1990, "Proximity control in bundle methods for convex
    nondifferentiable minimization"), as a box has edges: there, and on the triangle's own edges, the normal at hand
    leads nowhere. A step that gets less than a tenth as deep as the tangent plane promised is not taken; the mean of
    this plane and the one where it led that promises least then leads on. A plane's `lag` [m] is how far it is below
    the distance here; one that lags much tells of places too far away.

    Returns its signed distance [m], the normal there and its barycentric weights.
    """
    ex, ey, ez, fx, fy, fz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    hx, hy, hz = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
    area = hx * hx + hy * hy + hz * hz
    flat = 1.0 / area if area > 0.0 else 0.0
    u = v = w = 1.0 / 3.0
    x, y, z = (ax + bx + cx) / 3.0, (ay + by + cy) / 3.0, (az + bz + cz) / 3.0
    distance, nx, ny, nz = nearest(shapes, c, x, y, z)
    core = shapes.colliders[c].core
    way = max(distance + core, 0.1 * core)
    dx, dy, dz, lag = nx, ny, nz, 0.0
    for _ in range(STEPS):
        p, q, r = weights_of_nearest(x - way * dx, y - way * dy, z - way * dz, ax, ay, az, bx, by, bz, cx, cy, cz)
        tx, ty, tz = p * ax + q * bx + r * cx, p * ay + q * by + r * cy, p * az + q * bz + r * cz
        gx, gy, gz = x - tx, y - ty, z - tz
        promised = dx * gx + dy * gy + dz * gz + lag
        if promised < SETTLED:
            break
        there, mx, my, mz = nearest(shapes, c, tx, ty, tz)
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
    return distance, nx, ny, nz, u, v, w


@driver
def respond_on_triangle(s, inverse_mass, i, j, k, u, v, w, depth, nx, ny, nz, bone, friction, step, most, m):
    """Stop a point of the triangle i, j, k, as `contact.respond` does a vertex, and return its speed as that does."""
    a, b, c = u * inverse_mass[i], v * inverse_mass[j], w * inverse_mass[k]
    mobility = u * a + v * b + w * c
    if mobility <= 0.0:
        return 0.0
    # Near a corner that is held the others would have to swing out far.
    mobility = max(mobility, max(a, max(b, c)) / LEVER)
    a, b, c = a / mobility, b / mobility, c / mobility
    x = u * s.x[i] + v * s.x[j] + w * s.x[k]
    y = u * s.y[i] + v * s.y[j] + w * s.y[k]
    z = u * s.z[i] + v * s.z[j] + w * s.z[k]
    sx, sy, sz = velocity_at(bone, x, y, z, m)
    rx = u * s.vx[i] + v * s.vx[j] + w * s.vx[k] - sx
    ry = u * s.vy[i] + v * s.vy[j] + w * s.vy[k] - sy
    rz = u * s.vz[i] + v * s.vz[j] + w * s.vz[k] - sz
    ux, uy, uz, inwards = stopped(rx, ry, rz, nx, ny, nz, friction)
    ux, uy, uz = ux - rx, uy - ry, uz - rz
    depth -= step * (ux * nx + uy * ny + uz * nz)
    depth = min(max(depth, 0.0), most)
    px, py, pz = step * ux + depth * nx, step * uy + depth * ny, step * uz + depth * nz
    s.vx[i] += a * ux
    s.vy[i] += a * uy
    s.vz[i] += a * uz
    s.vx[j] += b * ux
    s.vy[j] += b * uy
    s.vz[j] += b * uz
    s.vx[k] += c * ux
    s.vy[k] += c * uy
    s.vz[k] += c * uz
    s.x[i] += a * px
    s.y[i] += a * py
    s.z[i] += a * pz
    s.x[j] += b * px
    s.y[j] += b * py
    s.z[j] += b * pz
    s.x[k] += c * px
    s.y[k] += c * py
    s.z[k] += c * pz
    return inwards


@driver
def collide_faces(s, inverse_mass, earlier, faces, m, share, turn, step):
    """Keep all triangles out of the thin ones among a kind of colliders; arguments as for `contact.collide`.

    Triangles sleep as long as the vertices of the tile that they hang on, but for the time that their far corners take.
    What one triangle is given moves its neighbours: those that are awake are gone through again until none touches, or
    `PASSES` times.
    """
    shapes, groups = faces.shapes, faces.next.size
    ahead = 1 + int(faces.longest / (GAIN * step))
    hit = were_alarmed(shapes, turn)
    for attempt in range(1 + PASSES):
        touched = False
        limit = turn + min(attempt, 1)
        for chunk in range(faces.due.size):
            if faces.due[chunk] > limit and not hit:
                continue
            first_due = turn + LONGEST
            for group in range(chunk * CHUNK, min(chunk * CHUNK + CHUNK, groups)):
                tile = faces.tiles[group]
                alarmed = hit and is_alarmed(shapes, tile, turn)
                if faces.next[group] <= limit or alarmed:
                    soonest = turn + LONGEST
                    for n in range(1, shapes.active[0] + 1):
                        c = shapes.active[n]
                        if not shapes.colliders[c].thin:
                            continue
                        wake = faces.wake[group, n - 1]
                        if attempt == 0 and wake <= turn:
                            wake = shapes.wake[tile, n - 1] - ahead
                        if wake <= limit or alarmed:
                            gap, speed, hardest = collide_group(
                                s, inverse_mass, earlier, faces, group, c, m, share, step
                            )
                            if gap < -GRAZE:
                                touched = True
                                if LEVER * hardest > JOLT or is_fast(speed * step, shapes.colliders[c].core):
                                    alarm_corners(faces, group, turn)
                            wake = turn + nap(gap, speed, step)
                        faces.wake[group, n - 1] = wake
                        soonest = min(soonest, wake)
                    faces.next[group] = soonest
                first_due = min(first_due, faces.next[group])
            faces.due[chunk] = first_due
        if not touched:
            break
        faces.pushed[0] = turn


@inlined
def alarm_corners(faces, group, turn):
    """Note that the corners of a group of triangles were hit hard, or put far away."""
    for f in range(faces.starts[group], faces.starts[group + 1]):
        for k in range(3):
            alarm(faces.shapes, faces.corners[k, f] // TILE, turn)


@inlined
def collide_group(s, inverse_mass, earlier, faces, group, c, m, share, step):
    """Keep a group of triangles out of collider c.

    Returns the least of the gaps before [m], the highest speed [m/s] at which the triangles move against it, and the
    highest at which a point of one that touches moved into its surface.
    """
    shapes = faces.shapes
    tile = faces.tiles[group]
    place(shapes, c, m.positions, m.matrices)
    thickness = SHARE * share * shapes.colliders[c].thickness
    end = min(tile * TILE + TILE, s.x.size)
    mid = (tile * TILE + end) // 2
    far, fast = spread_of(shapes.spreads, tile, s, tile * TILE, end)
    speed = approach(s, mid, far + faces.longest, 2.0 * fast, shapes.colliders[c].bone, m)
    start, end = faces.starts[group], faces.starts[group + 1]
    most = SLOWER * EXIT * step / (1 + PASSES)
    gap = look_at_group(faces, start, end, s, shapes, c, thickness)
    follow = is_fast(speed * step, shapes.colliders[c].core)
    if follow:
        past = step * approach(s, mid, 0.0, 0.0, shapes.colliders[c].bone, m)
        if gap < past:
            faces.haste[0] = max(faces.haste[0], past / max(shapes.colliders[c].core, STRIDE * faces.longest))
    hardest = 0.0
    if gap < 0.0 or follow:
        gap = math.inf
        for f in range(start, end):
            least = faces.seen[f - start]
            if least < 0.0 and is_pinched(f, faces):
                least = 0.0
            elif least < 0.0 or follow:
                least, inwards = collide_face(
                    f, s, inverse_mass, earlier, faces.corners, shapes, c, thickness, m, step, most, follow
                )  # fmt: skip
                hardest = max(hardest, inwards)
            gap = min(gap, least)
    return gap, speed, hardest


@inlined
def is_pinched(f, faces):
    """Tell whether two colliders pinch a corner of triangle f, which then gets as deep as it does."""
    pinched, corners = faces.shapes.pinched, faces.corners
    return pinched[corners[0, f]] or pinched[corners[1, f]] or pinched[corners[2, f]]


@inlined
def look_at_group(faces, start, end, s, shapes, c, thickness):
    """Look at triangles start to end as `watch.look` does at vertices, but for bounds from below of their gaps.

    A convex function lies above its tangents: here the one at a triangle's middle.
    """
    corners, seen = faces.corners, faces.seen
    x, y, z = s.x, s.y, s.z
    placed, (e, f, g, h) = numbers_of(shapes, c)
    # Vector units gather slowly, but work on a whole group at once: its last triangle stands in for those it lacks.
    for k in range(GROUP):
        t = min(start + k, end - 1)
        i, j, n = corners[0, t], corners[1, t], corners[2, t]
        mx, my, mz = (x[i] + x[j] + x[n]) * THIRD, (y[i] + y[j] + y[n]) * THIRD, (z[i] + z[j] + z[n]) * THIRD
        seen[GROUP + k], seen[2 * GROUP + k], seen[3 * GROUP + k] = mx, my, mz
        seen[4 * GROUP + k], seen[5 * GROUP + k], seen[6 * GROUP + k] = x[i] - mx, y[i] - my, z[i] - mz
        seen[7 * GROUP + k], seen[8 * GROUP + k], seen[9 * GROUP + k] = x[j] - mx, y[j] - my, z[j] - mz
    least = to_order(math.inf)
    for k in range(GROUP):
        px, py, pz = into_shape(placed, seen[GROUP + k], seen[2 * GROUP + k], seen[3 * GROUP + k])
        distance, nx, ny, nz = signed_distance(shapes, px, py, pz, e, f, g, h)
        nx, ny, nz = direction_to_world(placed, nx, ny, nz)
        first = nx * seen[4 * GROUP + k] + ny * seen[5 * GROUP + k] + nz * seen[6 * GROUP + k]
        second = nx * seen[7 * GROUP + k] + ny * seen[8 * GROUP + k] + nz * seen[9 * GROUP + k]
        gap = distance + min(first, min(second, -first - second)) - thickness
        seen[k] = gap
        least = min(least, to_order(gap))
    return from_order(least)


@driver
def collide_face(f, s, inverse_mass, earlier, corners, shapes, c, thickness, m, step, most, follow):
    """Keep triangle f out of collider c, at the step's end and, to `follow` it, on its way there if that is long.

    Returns the gap [m] that it had, something negative where it touches, and the speed [m/s] into the surface.
    """
    r, b = shapes.colliders[c].placed, shapes.colliders[c].bone
    i, j, k = corners[0, f], corners[1, f], corners[2, f]
    ax, ay, az = into_shape(r, s.x[i], s.y[i], s.z[i])
    bx, by, bz = into_shape(r, s.x[j], s.y[j], s.z[j])
    cx, cy, cz = into_shape(r, s.x[k], s.y[k], s.z[k])
    if follow:
        turned = turn_of(b, step, m)
        px, py, pz = at_start(i, s, earlier, b, r, turned, step, m)
        qx, qy, qz = at_start(j, s, earlier, b, r, turned, step, m)
        rx, ry, rz = at_start(k, s, earlier, b, r, turned, step, m)
        way = length(ax - px, ay - py, az - pz)
        way = max(way, length(bx - qx, by - qy, bz - qz))
        way = max(way, length(cx - rx, cy - ry, cz - rz))
        core = shapes.colliders[c].core
        looks = 1 + int(min(FEWEST * way / core, MOST)) if is_fast(way, core) else 0
        for look in range(looks):
            t = look / looks
            ex, ey, ez = px + t * (ax - px), py + t * (ay - py), pz + t * (az - pz)
            fx, fy, fz = qx + t * (bx - qx), qy + t * (by - qy), qz + t * (bz - qz)
            gx, gy, gz = rx + t * (cx - rx), ry + t * (cy - ry), rz + t * (cz - rz)
            if clearance(shapes, c, ex, ey, ez, fx, fy, fz, gx, gy, gz) > thickness:
                continue
            distance, nx, ny, nz, u, v, w = deepest_on_triangle(shapes, c, ex, ey, ez, fx, fy, fz, gx, gy, gz)
            if distance > thickness or distance < -PIERCED * shapes.colliders[c].core:
                continue
            # Where it comes in is where it is to stay out: the depth at the step's end is that along this normal.
            along = (
                u * (nx * (ax - ex) + ny * (ay - ey) + nz * (az - ez))
                + v * (nx * (bx - fx) + ny * (by - fy) + nz * (bz - fz))
                + w * (nx * (cx - gx) + ny * (cy - gy) + nz * (cz - gz))
            )
            if along < 0.0:
                nx, ny, nz = direction_to_world(r, nx, ny, nz)
                inwards = respond_on_triangle(
                    s, inverse_mass, i, j, k, u, v, w, thickness - distance - along, nx, ny, nz, b,
                    shapes.colliders[c].friction, step, -along + most, m,
                )  # fmt: skip
                return -1.0, inwards
    distance, nx, ny, nz, u, v, w = deepest_on_triangle(shapes, c, ax, ay, az, bx, by, bz, cx, cy, cz)
    inwards = 0.0
    if -PIERCED * shapes.colliders[c].core <= distance < thickness:
        nx, ny, nz = direction_to_world(r, nx, ny, nz)
        inwards = respond_on_triangle(
            s, inverse_mass, i, j, k, u, v, w, thickness - distance, nx, ny, nz, b, shapes.colliders[c].friction,
            step, most, m,
        )  # fmt: skip
    return distance - thickness, inwards


@inlined
def length(x, y, z):
    """Length of a vector."""
    return math.sqrt(x * x + y * y + z * z)


@inlined
def clearance(shapes, c, ax, ay, az, bx, by, bz, cx, cy, cz):
    """A bound from below of a triangle's distance from collider c, in its frame [m].

    A convex function lies above its tangent: here the one at the middle.
    """
    x, y, z = (ax + bx + cx) / 3.0, (ay + by + cy) / 3.0, (az + bz + cz) / 3.0
    distance, nx, ny, nz = nearest(shapes, c, x, y, z)
    a = nx * (ax - x) + ny * (ay - y) + nz * (az - z)
    b = nx * (bx - x) + ny * (by - y) + nz * (bz - z)
    return distance + min(a, min(b, -a - b))
