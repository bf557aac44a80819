"""Contact of vertices with moving colliders, with Coulomb friction.

A vertex that a step takes within the thickness of a shape is stopped there: its velocity relative to the shape's own
surface loses what points inwards, friction takes at most mu times as much of what slides, and the step is redone with
the corrected velocity. What is still too deep is moved out along the normal, no faster than `EXIT`, without any change
of velocity: a vertex at rest stays at rest, depth never turns into speed, and a start inside ends in a walk outside.

Where a vertex may pass a shape's middle within one step, its whole way against the shape is followed. As all shapes are
convex, the nearest distance tells how far it can go before it may touch (conservative advancement: Mirtich 1996,
"Impulse-based dynamic simulation of rigid body systems", section 2.3); it is stopped at the plane that it hits.
"""

import math

from cape.kernels.bones import velocity_at
from cape.kernels.contact.pinch import hold_pinched, note
from cape.kernels.contact.shapes import DUE, direction_to_world, distance_to, into_shape, nearest, place
from cape.kernels.contact.watch import (
    GAIN,
    JOLT,
    LONGEST,
    TILE,
    alarm,
    approach,
    is_alarmed,
    look,
    nap,
    spread_of,
    tiles,
    were_alarmed,
)
from cape.kernels.jit import driver, inlined

EXIT = 3.0  # m/s at which a vertex that is inside leaves
PASSES = 6  # around the colliders that a vertex is between
GRAZE = 1e-6  # m, depth that later passes leave alone
NEAR = 2.0  # steps in which a tile may come to a collider, to be led around it
DEEP = 0.5  # of a collider's core, beyond which a vertex may be drawn past its middle in a step
SKIN = 0.25  # share of the thickness in which a way is stopped
ADVANCES = 32  # along a way
ARRIVED = 1e-5  # m from the skin


@inlined
def stopped(rx, ry, rz, nx, ny, nz, friction):
    """Velocity r relative to a surface [m/s] without what points into it, slowed by friction; and that inward speed.

    Kept as it is where it does not point inwards.
    """
    inwards = -(rx * nx + ry * ny + rz * nz)
    if inwards > 0.0:
        rx, ry, rz = rx + inwards * nx, ry + inwards * ny, rz + inwards * nz
        if friction > 0.0:
            slide = math.sqrt(rx * rx + ry * ry + rz * rz)
            kept = max(0.0, 1.0 - friction * inwards / slide) if slide > 0.0 else 0.0
            rx, ry, rz = kept * rx, kept * ry, kept * rz
    return rx, ry, rz, inwards


@inlined
def respond(i, depth, nx, ny, nz, bone, friction, step, most, m, s):
    """Stop vertex i, `depth` [m] too deep along the unit normal n, at the surface that moves with `bone`.

    Its position changes by what its velocity does, times the `step` [s], and by at most `most` [m] for the depth that
    is left. Returns the speed [m/s] that it had into the surface.
    """
    sx, sy, sz = velocity_at(bone, s.x[i], s.y[i], s.z[i], m)
    rx, ry, rz, inwards = stopped(s.vx[i] - sx, s.vy[i] - sy, s.vz[i] - sz, nx, ny, nz, friction)
    if inwards > 0.0:
        ux, uy, uz = sx + rx, sy + ry, sz + rz
        mx, my, mz = step * (ux - s.vx[i]), step * (uy - s.vy[i]), step * (uz - s.vz[i])
        s.vx[i], s.vy[i], s.vz[i] = ux, uy, uz
        s.x[i] += mx
        s.y[i] += my
        s.z[i] += mz
        depth -= mx * nx + my * ny + mz * nz
    depth = min(depth, most)
    if depth > 0.0:
        s.x[i] += depth * nx
        s.y[i] += depth * ny
        s.z[i] += depth * nz
    return inwards


@inlined
def leave(start, end, free, s, earlier, shapes, c, thickness, step, most, m, noting):
    """Stop the free ones of vertices start to end that are within `thickness` [m] of collider c, as `gaps` tells.

    One that is deep leaves by the side on which it was when the step began: strained springs may draw it past the
    middle in every step, to and fro. With `noting`, `pinch.note` is told of each.

    Returns the highest speed [m/s] into the surface, 0 where they move out of it, and -1 where none is as near.
    """
    hardest = -1.0
    collider = shapes.colliders[c]
    for i in range(start, end):
        if shapes.gaps[i - start] < 0.0 and free[i] and not shapes.pinched[i]:
            if noting:
                note(shapes, s, i, i - start)
            distance, nx, ny, nz = distance_to(shapes, c, s.x[i], s.y[i], s.z[i])
            if distance < -DEEP * collider.core:
                distance, nx, ny, nz = from_where_it_came(i, s, earlier, shapes, c, step, m)
            speed = respond(
                i, thickness - distance, nx, ny, nz, collider.bone, collider.friction, step, most, m, s
            )  # fmt: skip
            hardest = max(hardest, max(speed, 0.0))
    return hardest


@inlined
def from_where_it_came(i, s, earlier, shapes, c, step, m):
    """Distance of vertex i from the plane by which it was nearest to collider c's outside when the step began.

    Less than nothing as deep as it is behind that plane; returns the normal there, too.
    """
    b, r = shapes.colliders[c].bone, shapes.colliders[c].placed
    x, y, z = at_start(i, s, earlier, b, r, turn_of(b, step, m), step, m)
    distance, nx, ny, nz = nearest(shapes, c, x, y, z)
    ex, ey, ez = into_shape(r, s.x[i], s.y[i], s.z[i])
    distance += nx * (ex - x) + ny * (ey - y) + nz * (ez - z)
    nx, ny, nz = direction_to_world(r, nx, ny, nz)
    return distance, nx, ny, nz


@inlined
def before(s, i, step, earlier):
    """Where vertex i was at the start of the step [m]."""
    if earlier is None:
        return s.x[i] - step * s.vx[i], s.y[i] - step * s.vy[i], s.z[i] - step * s.vz[i]
    return earlier[0, i], earlier[1, i], earlier[2, i]


@inlined
def turn_of(bone, step, m):
    """Sine and cosine of the angle by which a bone turns in a step, and the unit axis, zero for none."""
    wx, wy, wz = m.spin[bone, 0], m.spin[bone, 1], m.spin[bone, 2]
    spin = math.sqrt(wx * wx + wy * wy + wz * wz)
    scale = 1.0 / spin if spin > 1e-12 else 0.0
    return math.sin(spin * step), math.cos(spin * step), scale * wx, scale * wy, scale * wz


@inlined
def carried(x, y, z, bone, sine, cosine, wx, wy, wz, step, m):
    """Where a point at the start of a step [m] would be at its end, moved and turned (`turn_of`) along with a bone."""
    ox, oy, oz = m.positions[bone, 0], m.positions[bone, 1], m.positions[bone, 2]
    x = x - (ox - step * m.velocity[bone, 0])
    y = y - (oy - step * m.velocity[bone, 1])
    z = z - (oz - step * m.velocity[bone, 2])
    along = (1.0 - cosine) * (wx * x + wy * y + wz * z)
    return (
        ox + cosine * x + sine * (wy * z - wz * y) + along * wx,
        oy + cosine * y + sine * (wz * x - wx * z) + along * wy,
        oz + cosine * z + sine * (wx * y - wy * x) + along * wz,
    )


@inlined
def at_start(i, s, earlier, bone, placed, turned, step, m):
    """Where vertex i was at the start of the step in the frame that a shape had then, `turned` by `turn_of` since."""
    sine, cosine, wx, wy, wz = turned
    x, y, z = before(s, i, step, earlier)
    x, y, z = carried(x, y, z, bone, sine, cosine, wx, wy, wz, step, m)
    return into_shape(placed, x, y, z)


@inlined
def hit(shapes, c, x, y, z, dx, dy, dz, way, skin):
    """Share of a way from (x, y, z) along d, `way` [m] long, at which it comes within `skin` of collider c's surface.

    In the collider's frame; returns the share, above 1 where it does not, and the normal there.
    """
    share = 0.0
    distance, nx, ny, nz = nearest(shapes, c, x, y, z)
    if distance <= skin:
        return 2.0, nx, ny, nz
    for _ in range(ADVANCES):
        share += (distance - skin) / way
        if share >= 1.0 or distance - skin < ARRIVED:
            break
        distance, nx, ny, nz = nearest(shapes, c, x + share * dx, y + share * dy, z + share * dz)
    return share, nx, ny, nz


@inlined
def is_fast(way, core):
    """Tell whether what moves against a collider by `way` [m] at once must be followed on its way."""
    return way > 0.5 * core


@driver
def sweep(start, end, free, s, earlier, shapes, c, thickness, step, m):
    """Stop the free ones of vertices start to end whose way through this step enters collider c, where they enter.

    Returns as `leave` does.
    """
    hardest = -1.0
    b, r = shapes.colliders[c].bone, shapes.colliders[c].placed
    turned = turn_of(b, step, m)
    skin = SKIN * thickness
    for i in range(start, end):
        if not free[i]:
            continue
        x, y, z = at_start(i, s, earlier, b, r, turned, step, m)
        ex, ey, ez = into_shape(r, s.x[i], s.y[i], s.z[i])
        dx, dy, dz = ex - x, ey - y, ez - z
        way = math.sqrt(dx * dx + dy * dy + dz * dz)
        if not is_fast(way, shapes.colliders[c].core):
            continue
        share, nx, ny, nz = hit(shapes, c, x, y, z, dx, dy, dz, way, skin)
        if share >= 1.0:
            continue
        x, y, z = x + share * dx, y + share * dy, z + share * dz
        plane = x * nx + y * ny + z * nz
        gx, gy, gz = direction_to_world(r, nx, ny, nz)
        speed = respond(i, 0.0, gx, gy, gz, b, shapes.colliders[c].friction, step, 0.0, m, s)
        hardest = max(hardest, max(speed, 0.0))
        ex, ey, ez = into_shape(r, s.x[i], s.y[i], s.z[i])
        behind = plane - (ex * nx + ey * ny + ez * nz)
        if behind > 0.0:
            s.x[i] += behind * gx
            s.y[i] += behind * gy
            s.z[i] += behind * gz
    return hardest


@driver
def collide(lo, hi, free, s, earlier, shapes, m, share, turn, step):
    """Keep the free ones of vertices lo to hi out of all colliders of a kind, which move with the bones `m`.

    It is the `turn`th time in this frame, `step` [s] after the one before. `earlier` are the positions then (at least
    3, N), None where they are x - step v; `share` of the thickness is kept. Where colliders overlap, leaving one may
    mean entering another: a tile is led around all those that it touches until none is violated, or `PASSES` times.
    """
    most = EXIT * step
    hot = shapes.hot
    hit = were_alarmed(shapes, turn)
    due = turn + LONGEST
    first, last = tiles(lo, hi)
    for tile in range(first, last):
        alarmed = hit and is_alarmed(shapes, tile, turn)
        if shapes.next[tile] > turn and not alarmed:
            due = min(due, shapes.next[tile])
            continue
        start = tile * TILE
        end = min(start + TILE, hi)
        mid = (start + end) // 2
        far, fast = spread_of(shapes.spreads, tile, s, start, end)
        soonest, hardest = turn + LONGEST, -1.0
        hot[0], touched, rapid, between = 0, 0, False, shapes.between[tile]
        shapes.pinched[start:end] = False
        for k in range(1, shapes.active[0] + 1):
            if shapes.wake[tile, k - 1] > turn and not alarmed:
                soonest = min(soonest, shapes.wake[tile, k - 1])
                continue
            c = shapes.active[k]
            place(shapes, c, m.positions, m.matrices)
            speed = approach(s, mid, far, fast, shapes.colliders[c].bone, m)
            thickness = share * shapes.colliders[c].thickness
            if is_fast(speed * step, shapes.colliders[c].core):
                rapid = True
                hardest = max(hardest, sweep(start, end, free, s, earlier, shapes, c, thickness, step, m))
            gap = look(shapes, c, s, start, end, thickness)
            if gap < NEAR * (speed + GAIN) * step:
                hot[0] += 1
                hot[hot[0]] = c
            if gap < 0.0:
                touched += 1
                if touched == 1 and between:
                    shapes.touches[:] = 0
                inwards = leave(start, end, free, s, earlier, shapes, c, thickness, step, most, m, between)
                hardest = max(hardest, inwards)
            # Contact forces, where there are any, begin at the whole thickness.
            wake = turn + nap(gap + thickness - shapes.colliders[c].thickness, speed, step)
            shapes.wake[tile, k - 1] = wake
            soonest = min(soonest, wake)
        shapes.next[tile] = soonest
        due = min(due, soonest)
        if hardest >= 0.0 and hot[0] > 1:
            if touched > 1 and between and not rapid:
                hold_pinched(start, end, s, shapes, share, step, most, m)
            lead_out(start, end, free, s, earlier, shapes, share, step, most, m)
        shapes.between[tile] = touched > 1
        if hardest > JOLT:
            alarm(shapes, tile, turn)
    shapes.clock[DUE] = due


@driver
def lead_out(start, end, free, s, earlier, shapes, share, step, most, m):
    """Lead vertices start to end around all hot colliders."""
    hot = shapes.hot
    for _ in range(PASSES):
        clear = True
        for k in range(1, hot[0] + 1):
            c = hot[k]
            thickness = share * shapes.colliders[c].thickness - GRAZE
            if look(shapes, c, s, start, end, thickness) >= 0.0:
                continue
            if leave(start, end, free, s, earlier, shapes, c, thickness, step, most, m, False) >= 0.0:
                clear = False
        if clear:
            break
