"""When cloth may meet colliders: which to look at in a frame, and for how long they need not be looked at again.

Vertices are watched in tiles of consecutive ones. A tile that is `gap` from a collider cannot reach it before
gap / speed seconds have passed, at the speed at which it and the collider's surface move against each other now and
what that may gain (`GAIN`, `RISE`): for so long the pair sleeps. Which colliders a frame has at all is found from the
cloth's bounding sphere.
"""

import math

import numpy as np

from cape.kernels.bones import velocity_at
from cape.kernels.contact.order import from_order, to_order
from cape.kernels.contact.shapes import DUE, MOMENT, distance_to, gaps_by, into_shape, numbers_of, place
from cape.kernels.jit import inlined, kernel, routine

TILE = 32  # vertices: smaller tiles meet fewer colliders, larger ones cost fewer calls
GAIN = 4.0  # m/s that the speed between a tile and a collider may grow by while the pair sleeps,
RISE = 2e3  # m/s2 and how fast it may do so
LONGEST = 2**20  # steps that a pair may sleep
JOLT = 0.5 * GAIN  # m/s that a hit may take; after a harder one nothing around sleeps
NEVER = -2  # turn
STALE = 0.003  # s after which the spreads of all tiles are measured again


@inlined
def tiles(lo, hi):
    """First tile of the vertices lo to hi, lo a multiple of `TILE`, and the one after their last."""
    return lo // TILE, (hi + TILE - 1) // TILE


@inlined
def spread(s, lo, hi):
    """Largest distance [m] and difference in velocity [m/s] of the vertices lo to hi from the middle one of them."""
    mid = (lo + hi) // 2
    mx, my, mz, mu, mv, mw = s.x[mid], s.y[mid], s.z[mid], s.vx[mid], s.vy[mid], s.vz[mid]
    x, y, z, u, v, w = s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi]
    far = fast = np.int64(0)
    for i in range(hi - lo):
        dx, dy, dz, du, dv, dw = x[i] - mx, y[i] - my, z[i] - mz, u[i] - mu, v[i] - mv, w[i] - mw
        far = max(far, to_order(dx * dx + dy * dy + dz * dz))
        fast = max(fast, to_order(du * du + dv * dv + dw * dw))
    return math.sqrt(from_order(far)), math.sqrt(from_order(fast))


@inlined
def approach(s, mid, far, fast, bone, m):
    """Bound of the speed [m/s] at which vertices around the one in their middle move against the surface of a bone.

    `far` [m] and `fast` [m/s] are their `spread`.
    """
    sx, sy, sz = velocity_at(bone, s.x[mid], s.y[mid], s.z[mid], m)
    sx, sy, sz = s.vx[mid] - sx, s.vy[mid] - sy, s.vz[mid] - sz
    turn = abs(m.spin[bone, 0]) + abs(m.spin[bone, 1]) + abs(m.spin[bone, 2])
    return math.sqrt(sx * sx + sy * sy + sz * sz) + fast + turn * far


@routine
def begin(lo, hi, s, colliders, m, duration):
    """Note which colliders the cloth may meet within a frame of `duration` [s], at whose start the bones are.

    Reads all vertices: no thread may move its own before all have come here.
    """
    far, fast = spread(s, 0, s.x.size)
    mid = s.x.size // 2
    colliders.clock[MOMENT] += 1
    count = 0
    for c in range(colliders.records.size):
        place(colliders, c, m)
        distance, _, _, _ = distance_to(colliders, c, s.x[mid], s.y[mid], s.z[mid])
        speed = approach(s, mid, far, fast, colliders.records[c].bone, m) + GAIN
        if distance - colliders.records[c].thickness - far < speed * duration:
            count += 1
            colliders.active[count] = c
    colliders.active[0] = count
    first, end = tiles(lo, hi)
    colliders.clock[DUE] = 0
    colliders.next[first:end] = 0
    colliders.wake[first:end] = 0
    colliders.between[first:end] = True
    colliders.alarm[first:end] = NEVER
    colliders.alarm[-1] = NEVER


@routine
def look(colliders, c, s, start, end, thickness):
    """Tell how far the nearest of vertices start to end is beyond `thickness` [m] from collider c, below 0 within it.

    `colliders.points.gaps` are set to how far each is [m].
    """
    record, points = colliders.records[c], colliders.points
    to_frame(numbers_of(record.placed), s.x[start:end], s.y[start:end], s.z[start:end], points.x, points.y, points.z)
    sizes = record.sizes
    return gaps_by(record.gaps, points, end - start, thickness, sizes[0], sizes[1], sizes[2], sizes[3])


@kernel
def to_frame(placed, x, y, z, px, py, pz):
    """Points of the world in the frame of a shape."""
    for i in range(x.size):
        px[i], py[i], pz[i] = into_shape(placed, x[i], y[i], z[i])


@inlined
def nap(gap, speed, step):
    """How many steps of `step` [s] it takes what is `gap` [m] away to come, if its `speed` [m/s] is what it is now."""
    if gap <= 0.0:
        return 1
    # The root of speed t + RISE t^2 / 2 = gap, as one division.
    speeding_up = 2.0 / (speed + math.sqrt(speed * speed + 2.0 * RISE * gap))
    return 1 + int(min(gap * max(speeding_up, 1.0 / (speed + GAIN)) * (1.0 / step), LONGEST))


@inlined
def is_due(colliders, turn):
    """Tell whether any tile must be looked at."""
    return colliders.clock[DUE] <= turn or were_alarmed(colliders, turn)


@inlined
def were_alarmed(colliders, turn):
    """Tell whether any tile was hit hard just now."""
    return colliders.alarm[-1] >= turn - 1


@inlined
def is_alarmed(colliders, tile, turn):
    """Tell whether a tile was hit hard just now, by whatever kind of collider: it may be anywhere soon."""
    return colliders.alarm[tile] >= turn - 1


@inlined
def alarm(colliders, tile, turn):
    """Note that a tile was hit hard."""
    colliders.alarm[tile] = colliders.alarm[-1] = turn
    colliders.spreads[tile, 2] = 0


@inlined
def alarm_all(notes, turn):
    """Note that any tile may have been hit hard; `notes` have the `alarm` and `spreads` of `Colliders`."""
    notes.alarm[:] = turn
    notes.spreads[:, 2] = 0.0


@routine
def measure_tiles(lo, hi, s, spreads, turn, step):
    """Measure the tiles of vertices lo to hi where their spreads have become stale.

    All at once and at the same times whatever is near: what a tile meets never depends on what it does not meet.
    """
    if turn % max(int(STALE / step), 1) == 0:
        first, last = tiles(lo, hi)
        for tile in range(first, last):
            spreads[tile, 2] = 0.0
            spread_of(spreads, tile, s, tile * TILE, min(tile * TILE + TILE, hi))


@inlined
def spread_of(spreads, tile, s, start, end):
    """The `spread` of a tile, measured anew if it was hit hard since."""
    note = spreads[tile]
    if note[2] == 0.0:
        note[0], note[1] = spread(s, start, end)
        note[2] = 1.0
    return note[0], note[1]
