"""Contact of triangles with colliders so thin, or with such sharp edges, that they would poke through between vertices.

What a triangle's deepest point needs (`contact.deepest`), its corners get by their barycentric weights w:
dv_i = w_i / m_i / sum(w_k^2 / m_k) du. A corner that two colliders pinch stays where it is: the others give way alone,
and the point no farther than to midway between two colliders that pinch it as well.
"""

import math
from typing import NamedTuple

from cape.kernels.bones import velocity_at
from cape.kernels.contact.contact import EXIT, GRAZE, PASSES, Contact, at_start, is_fast, stopped, turn_of
from cape.kernels.contact.deepest import deepest_on_triangle
from cape.kernels.contact.order import from_order, to_order
from cape.kernels.contact.pinch import FACING, gap_of
from cape.kernels.contact.shapes import Faces, direction_to_world, into_shape, nearest, numbers_of, place, planes_by
from cape.kernels.contact.slip import is_let_go
from cape.kernels.contact.watch import (
    GAIN,
    JOLT,
    LONGEST,
    TILE,
    alarm,
    approach,
    is_alarmed,
    nap,
    spread_of,
    were_alarmed,
)
from cape.kernels.jit import inlined, kernel, routine

GROUP = 8  # triangles that are watched together
SEEN = 6  # numbers noted of each, besides its middle
CHUNK = 16  # groups
THIRD = 1.0 / 3.0
SHARE = 0.5  # of the thickness: vertices at all of it hold most triangles off without any help
PIERCED = 0.8  # of the core: deeper in, the normal tells no way out
LEVER = 2.0  # times as far as the point that is moved a corner may be
SLOWER = 0.5  # share of the vertices' own speed, at which a triangle that is inside leaves
STRIDE = 0.45  # of the longest edge that a thin collider may come past it in a step: at 1.3 threads get through
FEWEST, MOST = 2, 24  # looks at a triangle's way: for each core's length, and at most


class FaceContact(NamedTuple):
    """The triangles of a cloth that thin colliders could poke through, and what the whole of it can't enter."""

    contact: Contact
    faces: Faces


@inlined
def spared(outwards, change, fastest):
    """The share of a change of speed [m/s] after which a corner that moves `outwards` is not faster than that."""
    if change <= 0.0 or outwards + change <= fastest:
        return 1.0
    return max(fastest - outwards, 0.0) / change


@routine
def respond_on_triangle(contact, c, corners, weights, depth, normal, step, most):
    """Stop a point of a triangle at collider c, as `contact.respond` does a vertex; returns what that does."""
    s, inverse_mass, record = contact.state, contact.inverse_mass, contact.colliders.records[c]
    i, j, k = corners
    u, v, w = weights
    nx, ny, nz = normal
    # What two colliders pinch stays in the middle between them.
    pinched = contact.colliders.pinched
    a = 0.0 if pinched[i] else u * inverse_mass[i]
    b = 0.0 if pinched[j] else v * inverse_mass[j]
    o = 0.0 if pinched[k] else w * inverse_mass[k]
    mobility = u * a + v * b + w * o
    if mobility <= 0.0:
        return 0.0
    # Near a corner that is held the others would have to swing out far.
    mobility = max(mobility, max(a, max(b, o)) / LEVER)
    a, b, o = a / mobility, b / mobility, o / mobility
    x = u * s.x[i] + v * s.x[j] + w * s.x[k]
    y = u * s.y[i] + v * s.y[j] + w * s.y[k]
    z = u * s.z[i] + v * s.z[j] + w * s.z[k]
    sx, sy, sz = velocity_at(record.bone, x, y, z, contact.bones)
    rx = u * s.vx[i] + v * s.vx[j] + w * s.vx[k] - sx
    ry = u * s.vy[i] + v * s.vy[j] + w * s.vy[k] - sy
    rz = u * s.vz[i] + v * s.vz[j] + w * s.vz[k] - sz
    ux, uy, uz, inwards = stopped(rx, ry, rz, nx, ny, nz, record.friction)
    ux, uy, uz = ux - rx, uy - ry, uz - rz
    depth -= step * (ux * nx + uy * ny + uz * nz)
    depth = min(max(depth, 0.0), most)
    ta, tb, to = 1.0, 1.0, 1.0
    if pinched[i] or pinched[j] or pinched[k]:
        # Those that are free make good for the ones that are not, but aren't thrown off for their sake.
        p, q, r = (
            (s.vx[i] - sx) * nx + (s.vy[i] - sy) * ny + (s.vz[i] - sz) * nz,
            (s.vx[j] - sx) * nx + (s.vy[j] - sy) * ny + (s.vz[j] - sz) * nz,
            (s.vx[k] - sx) * nx + (s.vy[k] - sy) * ny + (s.vz[k] - sz) * nz,
        )
        held = (u * p if pinched[i] else 0.0) + (v * q if pinched[j] else 0.0) + (w * r if pinched[k] else 0.0)
        fastest, change = LEVER * min(max(-held, 0.0), EXIT), ux * nx + uy * ny + uz * nz
        ta, tb, to = spared(p, a * change, fastest), spared(q, b * change, fastest), spared(r, o * change, fastest)
    s.vx[i] += a * ta * ux
    s.vy[i] += a * ta * uy
    s.vz[i] += a * ta * uz
    s.vx[j] += b * tb * ux
    s.vy[j] += b * tb * uy
    s.vz[j] += b * tb * uz
    s.vx[k] += o * to * ux
    s.vy[k] += o * to * uy
    s.vz[k] += o * to * uz
    s.x[i] += a * (ta * step * ux + depth * nx)
    s.y[i] += a * (ta * step * uy + depth * ny)
    s.z[i] += a * (ta * step * uz + depth * nz)
    s.x[j] += b * (tb * step * ux + depth * nx)
    s.y[j] += b * (tb * step * uy + depth * ny)
    s.z[j] += b * (tb * step * uz + depth * nz)
    s.x[k] += o * (to * step * ux + depth * nx)
    s.y[k] += o * (to * step * uy + depth * ny)
    s.z[k] += o * (to * step * uz + depth * nz)
    return inwards


@routine
def collide_faces(face_contact, turn, step):
    """Keep all triangles out of the thin ones among the colliders; turns as for `contact.collide`.

    Triangles sleep as long as the vertices of the tile that they hang on, but for the time that their far corners take.
    What one triangle is given moves its neighbours: those that are awake are gone through again until none touches, or
    `PASSES` times.
    """
    contact, faces = face_contact.contact, face_contact.faces
    colliders, groups = contact.colliders, faces.next.size
    ahead = 1 + int(faces.longest / (GAIN * step))
    hit = were_alarmed(colliders, turn)
    for attempt in range(1 + PASSES):
        touched = False
        limit = turn + min(attempt, 1)
        for chunk in range(faces.due.size):
            if faces.due[chunk] > limit and not hit:
                continue
            first_due = turn + LONGEST
            for group in range(chunk * CHUNK, min(chunk * CHUNK + CHUNK, groups)):
                tile = faces.tiles[group]
                alarmed = hit and is_alarmed(colliders, tile, turn)
                if faces.next[group] <= limit or alarmed:
                    soonest = turn + LONGEST
                    for n in range(1, colliders.active[0] + 1):
                        c = colliders.active[n]
                        if not faces.exposed[group, c]:
                            continue
                        wake = faces.wake[group, n - 1]
                        if attempt == 0 and wake <= turn:
                            wake = colliders.wake[tile, n - 1] - ahead
                        if wake <= limit or alarmed:
                            gap, speed, hardest = collide_group(contact, faces, group, c, step)
                            if gap < -GRAZE:
                                touched = True
                                if LEVER * hardest > JOLT or is_fast(speed * step, colliders.records[c].core):
                                    alarm_corners(colliders, faces, group, turn)
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
def alarm_corners(colliders, faces, group, turn):
    """Note that the corners of a group of triangles were hit hard, or put far away."""
    for f in range(faces.starts[group], faces.starts[group + 1]):
        for k in range(3):
            alarm(colliders, faces.corners[k, f] // TILE, turn)


@routine
def collide_group(contact, faces, group, c, step):
    """Keep a group of triangles out of collider c.

    Returns the least of the gaps before [m], the highest speed [m/s] at which the triangles move against it, and the
    highest at which a point of one that touches moved into its surface.
    """
    s, colliders, m = contact.state, contact.colliders, contact.bones
    record = colliders.records[c]
    tile = faces.tiles[group]
    place(colliders, c, m)
    thickness = SHARE * contact.share * record.thickness
    end = min(tile * TILE + TILE, s.x.size)
    mid = (tile * TILE + end) // 2
    far, fast = spread_of(colliders.spreads, tile, s, tile * TILE, end)
    speed = approach(s, mid, far + faces.longest, 2.0 * fast, record.bone, m)
    start, end = faces.starts[group], faces.starts[group + 1]
    gap = look_at_group(contact, faces, start, end, c, thickness)
    follow = is_fast(speed * step, record.core)
    if follow:
        past = step * approach(s, mid, 0.0, 0.0, record.bone, m)
        if gap < past:
            faces.haste[0] = max(faces.haste[0], past / max(record.core, STRIDE * faces.longest))
    hardest = 0.0
    if gap < 0.0 or follow:
        gap = math.inf
        for f in range(start, end):
            least = faces.middles.gaps[f - start]
            if slips_off(colliders, faces, f, c):
                continue
            if least < 0.0 or follow:
                follows = follow and not is_pinched(colliders, faces, f)
                least, inwards = collide_face(contact, faces, f, c, thickness, step, follows)
                hardest = max(hardest, inwards)
            gap = min(gap, least)
    return gap, speed, hardest


@inlined
def is_pinched(colliders, faces, f):
    """Tell whether two colliders pinch a corner of triangle f, which then stays where it is between them."""
    pinched, corners = colliders.pinched, faces.corners
    return pinched[corners[0, f]] or pinched[corners[1, f]] or pinched[corners[2, f]]


@routine
def to_the_middle(contact, c, corners, weights, depth, normal):
    """How far a point of a triangle, `depth` [m] too deep in collider c along a normal, may leave that.

    That is to midway between this and another one that faces it, below zero where it is deeper in the other.
    """
    s, colliders = contact.state, contact.colliders
    i, j, k = corners
    u, v, w = weights
    nx, ny, nz = normal
    x, y, z = (
        u * s.x[i] + v * s.x[j] + w * s.x[k],
        u * s.y[i] + v * s.y[j] + w * s.y[k],
        u * s.z[i] + v * s.z[j] + w * s.z[k],
    )
    room = math.inf
    for n in range(1, colliders.active[0] + 1):
        other = colliders.active[n]
        if other != c:
            place(colliders, other, contact.bones)
            gap, mx, my, mz = gap_of(colliders, other, x, y, z, SHARE * contact.share)
            if nx * mx + ny * my + nz * mz < FACING:
                room = min(room, 0.5 * (gap + depth))
    return room


@inlined
def slips_off(colliders, faces, f, c):
    """Tell whether a corner of triangle f slips off collider c."""
    corners = faces.corners
    first, second, third = corners[0, f], corners[1, f], corners[2, f]
    return is_let_go(colliders, c, first) or is_let_go(colliders, c, second) or is_let_go(colliders, c, third)


@routine
def look_at_group(contact, faces, start, end, c, thickness):
    """Look at triangles start to end as `watch.look` does at vertices, but for bounds from below of their gaps.

    A convex function lies above its tangents: here the one at a triangle's middle.
    """
    s, record, middles = contact.state, contact.colliders.records[c], faces.middles
    placed, sizes = numbers_of(record.placed), record.sizes
    take_middles(
        start, end, faces.corners[0], faces.corners[1], faces.corners[2], s.x, s.y, s.z, placed, faces.seen,
        middles.x, middles.y, middles.z,
    )  # fmt: skip
    planes_by(record.planes, middles, GROUP, sizes[0], sizes[1], sizes[2], sizes[3])
    return least_gap(placed, thickness, faces.seen, middles.nx, middles.ny, middles.nz, middles.gaps)


@kernel
def take_middles(start, end, first, second, third, x, y, z, placed, seen, mx, my, mz):
    """Middles of triangles start to end in a collider's frame, and in the world two corners of each from there.

    Vector units gather slowly, but work on a whole group at once: its last triangle stands in for those it lacks.
    """
    for k in range(GROUP):
        t = min(start + k, end - 1)
        i, j, n = first[t], second[t], third[t]
        cx, cy, cz = (x[i] + x[j] + x[n]) * THIRD, (y[i] + y[j] + y[n]) * THIRD, (z[i] + z[j] + z[n]) * THIRD
        mx[k], my[k], mz[k] = into_shape(placed, cx, cy, cz)
        seen[0, k], seen[1, k], seen[2, k] = x[i] - cx, y[i] - cy, z[i] - cz
        seen[3, k], seen[4, k], seen[5, k] = x[j] - cx, y[j] - cy, z[j] - cz


@kernel
def least_gap(placed, thickness, seen, nx, ny, nz, gaps):
    """Turn distances of triangles' middles into bounds of the triangles' gaps [m]; returns the least."""
    least = to_order(math.inf)
    for k in range(GROUP):
        mx, my, mz = direction_to_world(placed, nx[k], ny[k], nz[k])
        first = mx * seen[0, k] + my * seen[1, k] + mz * seen[2, k]
        second = mx * seen[3, k] + my * seen[4, k] + mz * seen[5, k]
        gap = gaps[k] + min(first, min(second, -first - second)) - thickness
        gaps[k] = gap
        least = min(least, to_order(gap))
    return from_order(least)


@inlined
def known_gap(faces, f, c, first, second, third):
    """A bound from below of triangle f's distance from collider c [m], from the last time that it was searched for.

    No point of it has moved by more than that corner which has moved farthest, nor has its distance changed by more.
    """
    if faces.known_of[f] != c:
        return -math.inf
    k = faces.known[f]
    moved = distance_between((k[1], k[2], k[3]), first)
    moved = max(moved, distance_between((k[4], k[5], k[6]), second))
    return k[0] - max(moved, distance_between((k[7], k[8], k[9]), third))


@inlined
def remember_gap(faces, f, c, first, second, third, bound):
    """Note a bound of triangle f's distance from collider c [m], and where its corners were."""
    faces.known_of[f] = c
    k = faces.known[f]
    k[0] = bound
    k[1], k[2], k[3] = first
    k[4], k[5], k[6] = second
    k[7], k[8], k[9] = third


@inlined
def between(t, start, end):
    """The point a share t of the way from one to another."""
    return (
        start[0] + t * (end[0] - start[0]),
        start[1] + t * (end[1] - start[1]),
        start[2] + t * (end[2] - start[2]),
    )


@inlined
def distance_between(p, q):
    """Distance of two points."""
    return length(q[0] - p[0], q[1] - p[1], q[2] - p[2])


@inlined
def change_along(weight, normal, start, end):
    """What a weighted way from one point to another is along a normal."""
    return weight * (
        normal[0] * (end[0] - start[0]) + normal[1] * (end[1] - start[1]) + normal[2] * (end[2] - start[2])
    )


@routine
def collide_face(contact, faces, f, c, thickness, step, follow):
    """Keep triangle f out of collider c, at the step's end and, to `follow` it, on its way there if that is long.

    Returns the gap [m] that it had, something negative where it touches, and the speed [m/s] into the surface.
    """
    s, colliders = contact.state, contact.colliders
    record, most = colliders.records[c], SLOWER * EXIT * step / (1 + PASSES)
    r, core = record.placed, record.core
    corners = faces.corners[0, f], faces.corners[1, f], faces.corners[2, f]
    i, j, k = corners
    first = into_shape(r, s.x[i], s.y[i], s.z[i])
    second = into_shape(r, s.x[j], s.y[j], s.z[j])
    third = into_shape(r, s.x[k], s.y[k], s.z[k])
    if follow:
        turned = turn_of(record.bone, step, contact.bones)
        p = at_start(contact, c, i, turned, step)
        q = at_start(contact, c, j, turned, step)
        o = at_start(contact, c, k, turned, step)
        way = max(max(distance_between(p, first), distance_between(q, second)), distance_between(o, third))
        looks = 1 + int(min(FEWEST * way / core, MOST)) if is_fast(way, core) else 0
        for look in range(looks):
            t = look / looks
            a, b, d = between(t, p, first), between(t, q, second), between(t, o, third)
            if clearance(colliders, c, a, b, d) > thickness:
                continue
            distance, nx, ny, nz, u, v, w, _ = deepest_on_triangle(colliders, c, a, b, d, thickness)
            if distance > thickness or distance < -PIERCED * core:
                continue
            # Where it comes in is where it is to stay out: the depth at the step's end is that along this normal.
            n = nx, ny, nz
            along = change_along(u, n, a, first) + change_along(v, n, b, second) + change_along(w, n, d, third)
            if along < 0.0:
                inwards = respond_on_triangle(
                    contact, c, corners, (u, v, w), thickness - distance - along, direction_to_world(r, nx, ny, nz),
                    step, -along + most,
                )  # fmt: skip
                return -1.0, inwards
    known = known_gap(faces, f, c, first, second, third) - thickness
    if known >= 0.0:
        return known, 0.0
    distance, nx, ny, nz, u, v, w, bound = deepest_on_triangle(colliders, c, first, second, third, thickness)
    remember_gap(faces, f, c, first, second, third, bound)
    inwards = 0.0
    if -PIERCED * core <= distance < thickness:
        normal, depth = direction_to_world(r, nx, ny, nz), thickness - distance
        if is_pinched(colliders, faces, f):
            depth = min(depth, to_the_middle(contact, c, corners, (u, v, w), depth, normal))
            if depth <= 0.0:
                return 0.0, 0.0
        inwards = respond_on_triangle(contact, c, corners, (u, v, w), depth, normal, step, most)
    # Within the thickness the bound is lower than the distance by as much as the search leaves open: that is no depth.
    return min(distance, max(bound, thickness)) - thickness, inwards


@inlined
def length(x, y, z):
    """Length of a vector."""
    return math.sqrt(x * x + y * y + z * z)


@inlined
def clearance(colliders, c, first, second, third):
    """A bound from below of a triangle's distance from collider c, in its frame [m].

    A convex function lies above its tangent: here the one at the middle.
    """
    x, y, z = (
        (first[0] + second[0] + third[0]) / 3.0,
        (first[1] + second[1] + third[1]) / 3.0,
        (first[2] + second[2] + third[2]) / 3.0,
    )
    distance, nx, ny, nz = nearest(colliders, c, x, y, z)
    a = nx * (first[0] - x) + ny * (first[1] - y) + nz * (first[2] - z)
    b = nx * (second[0] - x) + ny * (second[1] - y) + nz * (second[2] - z)
    return distance + min(a, min(b, -a - b))
