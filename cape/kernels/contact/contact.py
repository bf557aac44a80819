"""Contact of vertices with moving colliders, with Coulomb friction.

A vertex that a step takes within the thickness of a shape is stopped there: its velocity relative to the shape's own
surface loses what points inwards, friction takes at most mu times as much of what slides, and the step is redone with
the corrected velocity. What is still too deep is moved out along the normal, no faster than `EXIT`, without any change
of velocity: a vertex at rest stays at rest, depth never turns into speed, and a start inside ends in a walk outside.
What a limit of strain has drawn it in by in the step before is given back in full: see `drawn`. What a limb has
gone through is led off that: see `slip`.

Where a vertex may pass a shape's middle within one step, its whole way against the shape is followed. As all shapes are
convex, the nearest distance tells how far it can go before it may touch (conservative advancement: Mirtich 1996,
"Impulse-based dynamic simulation of rigid body systems", section 2.3); it is stopped at the plane that it hits.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.bones import MotionRoom, velocity_at
from cape.kernels.contact.drawn import Drawn, drawn_in, note_stopped
from cape.kernels.contact.pinch import hold_pinched, note
from cape.kernels.contact.shapes import DUE, Colliders, direction_to_world, distance_to, into_shape, nearest, place
from cape.kernels.contact.slip import is_let_go
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
from cape.kernels.jit import inlined, routine
from cape.kernels.state import State

EXIT = 3.0  # m/s at which a vertex that is inside leaves
PASSES = 6  # around the colliders that a vertex is between
GRAZE = 1e-6  # m, depth that later passes leave alone
NEAR = 2.0  # steps in which a tile may come to a collider, to be led around it
DEEP = 0.5  # of a collider's core, beyond which a vertex may be drawn past its middle in a step
SKIN = 0.25  # share of the thickness in which a way is stopped
ADVANCES = 32  # along a way
ARRIVED = 1e-5  # m from the skin


class Contact(NamedTuple):
    """The cloth and what it can't enter.

    `inverse_mass` [1/kg] and `free`, False for attached vertices, (V,); `earlier` are the positions at a step's start
    (at least 3, V), unless those are x - step v, as `straight` says; `share` of the thickness is kept; `settled` (1,)
    is the last turn in which triangles left nothing to do for vertices; `drawn` is what threads do afterwards.
    """

    state: State
    inverse_mass: NDArray[np.floating]
    free: NDArray[np.bool_]
    earlier: NDArray[np.floating]
    straight: bool
    colliders: Colliders
    bones: MotionRoom
    share: float
    settled: NDArray[np.int64]
    drawn: Drawn


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
def respond(contact, c, i, depth, nx, ny, nz, step, most):
    """Stop vertex i, `depth` [m] too deep along the unit normal n, at the surface of collider c, which moves.

    Its position changes by what its velocity does, times the `step` [s], and by at most `most` [m], and what it was
    drawn in by, for the depth that is left. Returns the speed [m/s] that it had into the surface.
    """
    s, record = contact.state, contact.colliders.records[c]
    most += drawn_in(contact.drawn, i, nx, ny, nz)
    note_stopped(contact.drawn, contact.colliders, i, nx, ny, nz, contact.share * record.thickness)
    sx, sy, sz = velocity_at(record.bone, s.x[i], s.y[i], s.z[i], contact.bones)
    rx, ry, rz, inwards = stopped(s.vx[i] - sx, s.vy[i] - sy, s.vz[i] - sz, nx, ny, nz, record.friction)
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


@routine
def leave(contact, c, start, end, thickness, step, noting):
    """Stop the free ones of vertices start to end that are within `thickness` [m] of collider c, as `gaps` tells.

    One that is deep leaves by the side on which it was when the step began: strained springs may draw it past the
    middle in every step, to and fro. With `noting`, `pinch.note` is told of each.

    Returns the highest speed [m/s] into the surface, 0 where they move out of it, and -1 where none is as near.
    """
    s, colliders = contact.state, contact.colliders
    gaps, core, hardest, most = colliders.points.gaps, colliders.records[c].core, -1.0, EXIT * step
    for i in range(start, end):
        if gaps[i - start] < 0.0 and contact.free[i] and not colliders.pinched[i] and not is_let_go(colliders, c, i):
            if noting:
                note(colliders, s, i, i - start)
            distance, nx, ny, nz = distance_to(colliders, c, s.x[i], s.y[i], s.z[i])
            if distance < -DEEP * core:
                distance, nx, ny, nz = from_where_it_came(contact, c, i, step)
            speed = respond(contact, c, i, thickness - distance, nx, ny, nz, step, most)
            hardest = max(hardest, max(speed, 0.0))
    return hardest


@routine
def slip(contact, c, start, end, step, most):
    """Stop those of vertices start to end that slip off collider c, and are in it, along the limb that it surrounds.

    They are led towards the limb's tip by `most` [m].
    """
    colliders = contact.colliders
    record = colliders.records[c]
    tip = record.tip
    nx, ny, nz = direction_to_world(record.placed, tip[0], tip[1], tip[2])
    for i in range(start, end):
        if colliders.points.gaps[i - start] < 0.0 and is_let_go(colliders, c, i) and contact.free[i]:
            respond(contact, c, i, math.inf, nx, ny, nz, step, most)


@inlined
def from_where_it_came(contact, c, i, step):
    """Distance of vertex i from the plane by which it was nearest to collider c's outside when the step began.

    Less than nothing as deep as it is behind that plane; returns the normal there, too.
    """
    s, record = contact.state, contact.colliders.records[c]
    x, y, z = at_start(contact, c, i, turn_of(record.bone, step, contact.bones), step)
    distance, nx, ny, nz = nearest(contact.colliders, c, x, y, z)
    ex, ey, ez = into_shape(record.placed, s.x[i], s.y[i], s.z[i])
    distance += nx * (ex - x) + ny * (ey - y) + nz * (ez - z)
    nx, ny, nz = direction_to_world(record.placed, nx, ny, nz)
    return distance, nx, ny, nz


@inlined
def before(contact, i, step):
    """Where vertex i was at the start of the step, and would be had threads not been held short before that [m]."""
    s, earlier = contact.state, contact.earlier
    if contact.straight:
        x, y, z = s.x[i] - step * s.vx[i], s.y[i] - step * s.vy[i], s.z[i] - step * s.vz[i]
    else:
        x, y, z = np.float64(earlier[0, i]), np.float64(earlier[1, i]), np.float64(earlier[2, i])
    if contact.drawn.acts:
        by = contact.drawn.by
        x, y, z = x - by[0, i], y - by[1, i], z - by[2, i]
    return x, y, z


@inlined
def turn_of(bone, step, m):
    """Sine and cosine of the angle by which a bone turns in a step, and the unit axis, zero for none."""
    wx, wy, wz = m.spin[bone, 0], m.spin[bone, 1], m.spin[bone, 2]
    spin = math.sqrt(wx * wx + wy * wy + wz * wz)
    scale = 1.0 / spin if spin > 1e-12 else 0.0
    return math.sin(spin * step), math.cos(spin * step), scale * wx, scale * wy, scale * wz


@inlined
def carried(x, y, z, bone, turned, step, m):
    """Where a point at the start of a step [m] would be at its end, moved and turned (`turn_of`) along with a bone."""
    sine, cosine, wx, wy, wz = turned
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
def at_start(contact, c, i, turned, step):
    """Where vertex i was at the start of the step in the frame that collider c had then, `turned` since."""
    record = contact.colliders.records[c]
    x, y, z = before(contact, i, step)
    x, y, z = carried(x, y, z, record.bone, turned, step, contact.bones)
    return into_shape(record.placed, x, y, z)


@inlined
def hit(colliders, c, start, way, length, skin):
    """Share of a way from a point, `length` [m] long, at which it comes within `skin` of collider c's surface.

    In the collider's frame; returns the share, above 1 where it does not, and the normal there.
    """
    x, y, z = start
    dx, dy, dz = way
    share = 0.0
    distance, nx, ny, nz = nearest(colliders, c, x, y, z)
    if distance <= skin:
        return 2.0, nx, ny, nz
    for _ in range(ADVANCES):
        share += (distance - skin) / length
        if share >= 1.0 or distance - skin < ARRIVED:
            break
        distance, nx, ny, nz = nearest(colliders, c, x + share * dx, y + share * dy, z + share * dz)
    return share, nx, ny, nz


@inlined
def is_fast(way, core):
    """Tell whether what moves against a collider by `way` [m] at once must be followed on its way."""
    return way > 0.5 * core


@routine
def sweep(contact, c, start, end, thickness, step):
    """Stop the free ones of vertices start to end whose way through this step enters collider c, where they enter.

    Returns as `leave` does.
    """
    s, colliders = contact.state, contact.colliders
    hardest, record = -1.0, colliders.records[c]
    r = record.placed
    turned = turn_of(record.bone, step, contact.bones)
    skin = SKIN * thickness
    for i in range(start, end):
        if not contact.free[i] or is_let_go(colliders, c, i):
            continue
        x, y, z = at_start(contact, c, i, turned, step)
        ex, ey, ez = into_shape(r, s.x[i], s.y[i], s.z[i])
        dx, dy, dz = ex - x, ey - y, ez - z
        way = math.sqrt(dx * dx + dy * dy + dz * dz)
        if not is_fast(way, record.core):
            continue
        share, nx, ny, nz = hit(colliders, c, (x, y, z), (dx, dy, dz), way, skin)
        if share >= 1.0:
            continue
        x, y, z = x + share * dx, y + share * dy, z + share * dz
        plane = x * nx + y * ny + z * nz
        gx, gy, gz = direction_to_world(r, nx, ny, nz)
        speed = respond(contact, c, i, 0.0, gx, gy, gz, step, 0.0)
        hardest = max(hardest, max(speed, 0.0))
        ex, ey, ez = into_shape(r, s.x[i], s.y[i], s.z[i])
        behind = plane - (ex * nx + ey * ny + ez * nz)
        if behind > 0.0:
            s.x[i] += behind * gx
            s.y[i] += behind * gy
            s.z[i] += behind * gz
    return hardest


@routine
def collide(contact, lo, hi, turn, step):
    """Keep the free ones of vertices lo to hi out of all colliders, which move with the bones.

    It is the `turn`th time in this frame, `step` [s] after the one before. Where colliders overlap, leaving one may
    mean entering another: a tile is led around all those that it touches until none is violated, or `PASSES` times.
    """
    s, colliders, m, kept = contact.state, contact.colliders, contact.bones, contact.share
    most = EXIT * step
    hot = colliders.hot
    hit = were_alarmed(colliders, turn)
    due = turn + LONGEST
    first, last = tiles(lo, hi)
    for tile in range(first, last):
        alarmed = hit and is_alarmed(colliders, tile, turn)
        if colliders.next[tile] > turn and not alarmed:
            due = min(due, colliders.next[tile])
            continue
        start = tile * TILE
        end = min(start + TILE, hi)
        mid = (start + end) // 2
        far, fast = spread_of(colliders.spreads, tile, s, start, end)
        soonest, hardest = turn + LONGEST, -1.0
        hot[0], touched, rapid, between = 0, 0, False, colliders.between[tile]
        colliders.pinched[start:end] = False
        for k in range(1, colliders.active[0] + 1):
            if colliders.wake[tile, k - 1] > turn and not alarmed:
                soonest = min(soonest, colliders.wake[tile, k - 1])
                continue
            c = colliders.active[k]
            record = colliders.records[c]
            place(colliders, c, m)
            speed = approach(s, mid, far, fast, record.bone, m)
            thickness = kept * record.thickness
            if is_fast(speed * step, record.core):
                rapid = True
                hardest = max(hardest, sweep(contact, c, start, end, thickness, step))
            gap = look(colliders, c, s, start, end, thickness)
            if gap < NEAR * (speed + GAIN) * step:
                hot[0] += 1
                hot[hot[0]] = c
            if gap < 0.0:
                touched += 1
                if touched == 1 and between:
                    colliders.touches[:] = 0
                hardest = max(hardest, leave(contact, c, start, end, thickness, step, between))
                slip(contact, c, start, end, step, most)
            # Contact forces, where there are any, begin at the whole thickness.
            wake = turn + nap(gap + thickness - record.thickness, speed, step)
            colliders.wake[tile, k - 1] = wake
            soonest = min(soonest, wake)
        colliders.next[tile] = soonest
        due = min(due, soonest)
        if hardest >= 0.0 and hot[0] > 1:
            if touched > 1 and between and not rapid:
                hold_pinched(contact, start, end, step, most)
            lead_out(contact, start, end, step)
        colliders.between[tile] = touched > 1
        if hardest > JOLT:
            alarm(colliders, tile, turn)
    colliders.clock[DUE] = due


@routine
def lead_out(contact, start, end, step):
    """Lead vertices start to end around all hot colliders."""
    colliders = contact.colliders
    hot = colliders.hot
    for _ in range(PASSES):
        clear = True
        for k in range(1, hot[0] + 1):
            c = hot[k]
            thickness = contact.share * colliders.records[c].thickness - GRAZE
            if look(colliders, c, contact.state, start, end, thickness) >= 0.0:
                continue
            if leave(contact, c, start, end, thickness, step, False) >= 0.0:
                clear = False
        if clear:
            break
