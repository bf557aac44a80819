"""Vertices that two colliders pinch between them.

Where colliders overlap and face each other, whoever leaves one gets deeper into the other. Led out of both in spite of
that, cloth is torn from its neighbours, and springs back around one of the limbs: it stays hooked there. So what is
pinched is held midway between both surfaces, and comes out by its own side as they part, after the flypapering of
Baraff, Witkin and Kass 2003, "Untangling cloth", section 5. Unlike there it may slide, and is squeezed to where the
overlap ends, as far as the cloth lets it.
"""

import math

from cape.kernels.bones import velocity_at
from cape.kernels.contact.drawn import note_stopped
from cape.kernels.contact.shapes import distance_to
from cape.kernels.jit import inlined, routine

FACING = 0.5  # most of a cosine between the normals of colliders that pinch: more, and out is not far
SQUEEZE = 5e3  # m/s2: strains cloth between limbs by 8 %; 2e3 by 5, but leaves some vertices of clips inside
LEVEL = 1e-3  # sum of two normals that has no direction


@inlined
def note(colliders, s, i, k):
    """Note that a collider touches vertex i, the k'th of its tile, and at first where it is and how fast."""
    if colliders.touches[k] == 0:
        b = colliders.before
        b[0, k], b[1, k], b[2, k], b[3, k], b[4, k], b[5, k] = s.x[i], s.y[i], s.z[i], s.vx[i], s.vy[i], s.vz[i]
    colliders.touches[k] += 1


@inlined
def gap_of(colliders, c, x, y, z, share):
    """How far a point of the world is out of a `share` of the thickness of collider c [m], and the normal there."""
    distance, nx, ny, nz = distance_to(colliders, c, x, y, z)
    return distance - share * colliders.records[c].thickness, nx, ny, nz


@inlined
def pinching(colliders, x, y, z, share):
    """The two hot colliders that pinch a point, each with its gap [m] and normal there.

    The second is -1 where there is none: where no two overlap that face each other.
    """
    hot = colliders.hot
    a, first, nx, ny, nz = 0, math.inf, 0.0, 0.0, 0.0
    for n in range(1, hot[0] + 1):
        gap, mx, my, mz = gap_of(colliders, hot[n], x, y, z, share)
        if gap < first:
            a, first, nx, ny, nz = hot[n], gap, mx, my, mz
    b, second, ox, oy, oz = -1, -first, 0.0, 0.0, 0.0
    if first < 0.0:
        for n in range(1, hot[0] + 1):
            if hot[n] != a:
                gap, mx, my, mz = gap_of(colliders, hot[n], x, y, z, share)
                if gap < second and nx * mx + ny * my + nz * mz < FACING:
                    b, second, ox, oy, oz = hot[n], gap, mx, my, mz
    return a, first, nx, ny, nz, b, second, ox, oy, oz


@routine
def hold_pinched(contact, start, end, step, most):
    """Hold those of vertices start to end that two hot colliders pinch, and note which.

    They move with the mean of both surfaces, and by at most `most` [m] in this step towards the middle between them.
    """
    s, colliders, share, m = contact.state, contact.colliders, contact.share, contact.bones
    for i in range(start, end):
        k = i - start
        if colliders.touches[k] < 2:
            continue
        x, y, z = colliders.before[0, k], colliders.before[1, k], colliders.before[2, k]
        a, first, nx, ny, nz, b, second, ox, oy, oz = pinching(colliders, x, y, z, share)
        colliders.pinched[i] = b >= 0
        if b < 0:
            continue
        gx, gy, gz = nx + ox, ny + oy, nz + oz
        nx, ny, nz = nx - ox, ny - oy, nz - oz
        twice = math.sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx / twice, ny / twice, nz / twice
        sx, sy, sz = velocity_at(colliders.records[a].bone, x, y, z, m)
        tx, ty, tz = velocity_at(colliders.records[b].bone, x, y, z, m)
        sx, sy, sz = 0.5 * (sx + tx), 0.5 * (sy + ty), 0.5 * (sz + tz)
        u, v, w = colliders.before[3, k], colliders.before[4, k], colliders.before[5, k]
        rx, ry, rz = u - sx, v - sy, w - sz
        across = rx * nx + ry * ny + rz * nz
        rx, ry, rz = rx - across * nx, ry - across * ny, rz - across * nz
        wide = math.sqrt(gx * gx + gy * gy + gz * gz)
        if wide > LEVEL:
            leaving = (rx * gx + ry * gy + rz * gz) / wide
            needed = -(first + second) / (wide * step)
            push = max(min(SQUEEZE * step, min(needed, most / step) - leaving), 0.0) / wide
            rx, ry, rz = rx + push * gx, ry + push * gy, rz + push * gz
        s.vx[i], s.vy[i], s.vz[i] = sx + rx, sy + ry, sz + rz
        mx, my, mz = step * (s.vx[i] - u), step * (s.vy[i] - v), step * (s.vz[i] - w)
        off = (second - first) / twice - (mx * nx + my * ny + mz * nz)
        off = min(max(off, -most), most)
        note_stopped(contact.drawn, colliders, i, nx, ny, nz, 0.0)
        s.x[i], s.y[i], s.z[i] = x + mx + off * nx, y + my + off * ny, z + mz + off * nz
