"""What bones hold, led out of colliders without tearing the cloth between.

Each held vertex would leave a collider by the shortest way. Neighbours on either side of a limb would so be led apart,
and what hangs on them torn. So threads between held vertices draw these together again, as those of `strain_limit` do,
each end by half: to their longest, or to what the bones themselves have drawn them to. Both is done in turn, and the
threads have the last word; what is held spreads what one vertex needs over all around it.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.bones import Motion, MotionRoom, set_pose, turned, turned_back
from cape.kernels.contact.contact import EXIT
from cape.kernels.contact.shapes import Colliders, distance_to, forget_places, place
from cape.kernels.jit import routine, unit
from cape.kernels.solve.attachments import Attached, carried, heaviest

Array = NDArray[np.floating]
Indices = NDArray[np.int64]

PASSES = 4  # around the colliders that a held vertex is between
ROUNDS = 16  # out of colliders and back together
SWEEPS = 64  # over all threads in a round
# And in the end. What is too long all along a chain of N threads takes N^2 / pi^2 sweeps to fall to 1/e: 300 of a
# collar with 55 columns. Where all are short they end at once.
LAST_SWEEPS = 1500
SLACK = 1e-3  # of its longest, by which a thread may stay too long


class Ties(NamedTuple):
    """E threads between two of n held vertices, by their places among these: `first` and `second` (E,), and how long
    each may get by being led out of colliders, `longest` [m] (E,).

    `carried` and `goals` [m] (n, 3) are room for where bones carry the vertices, and where they are to be held.
    """

    first: Indices
    second: Indices
    longest: Array
    carried: Array
    goals: Array


class Lifted(NamedTuple):
    """Which vertices bones hold, and what those are kept out of; `colliders` is None where there are none."""

    attached: Attached
    ties: Ties
    colliders: Colliders | None
    motion: Motion
    bones: MotionRoom
    duration: Array


@unit
def lift_attached(g, team, substep, substeps, step):
    """Let all attached vertices drift to where they are out of all colliders at the frame's end."""
    lift_held(g.attached, g.ties, g.colliders, g.motion, g.bones, g.duration[0])


@routine
def lift_held(attached, ties, colliders, motion, m, duration):
    """Let attached vertices drift to where they are out of all colliders at the frame's end, and not torn apart.

    No faster than `contact.EXIT`. Leaves the bones `m` at the frame's end.
    """
    set_pose(motion.position1, motion.rotation1, m)
    forget_places(colliders)
    places, goals = ties.carried, ties.goals
    lifted = False
    for k in range(attached.vertices.size):
        x, y, z = carried(attached, attached.blend, k, 0.0, 0.0, 0.0, m)
        places[k, 0], places[k, 1], places[k, 2] = x, y, z
        goals[k, 0], goals[k, 1], goals[k, 2] = x, y, z
        lifted = lead_out(attached, k, goals, places, colliders, m, duration) or lifted
    if lifted:
        for _ in range(ROUNDS):
            if not draw_together(ties, SWEEPS):
                break
            for k in range(attached.vertices.size):
                lead_out(attached, k, goals, places, colliders, m, duration)
        draw_together(ties, LAST_SWEEPS)
    farthest = 0.0
    for k in range(attached.vertices.size):
        lift, drift, bone = attached.lift[k], attached.drift[k], heaviest(attached, attached.blend, k)
        x, y, z = goals[k, 0] - places[k, 0], goals[k, 1] - places[k, 1], goals[k, 2] - places[k, 2]
        x, y, z = turned_back(bone, x, y, z, m.matrices)
        drift[0], drift[1], drift[2] = (x - lift[0]) / duration, (y - lift[1]) / duration, (z - lift[2]) / duration
        farthest = max(farthest, math.sqrt(drift[0] * drift[0] + drift[1] * drift[1] + drift[2] * drift[2]))
    # Some may be taken along faster than they would go by themselves. On a share of the way no thread is longer.
    if farthest > EXIT:
        for k in range(attached.vertices.size):
            for axis in range(3):
                attached.drift[k, axis] *= EXIT / farthest


@routine
def lead_out(attached, k, goals, places, colliders, m, duration):
    """Lead the goal of attachment k out of all colliders, no farther from where it is held now than it may drift.

    Tells whether it is held off where bones carry it.
    """
    x, y, z = clear(goals[k, 0], goals[k, 1], goals[k, 2], colliders, m)
    bone = heaviest(attached, attached.blend, k)
    lift, most = attached.lift[k], EXIT * duration
    ox, oy, oz = turned(bone, lift[0], lift[1], lift[2], m.matrices)
    ox, oy, oz = places[k, 0] + ox, places[k, 1] + oy, places[k, 2] + oz
    x, y, z = x - ox, y - oy, z - oz
    way = math.sqrt(x * x + y * y + z * z)
    share = most / way if way > most else 1.0
    goals[k, 0], goals[k, 1], goals[k, 2] = ox + share * x, oy + share * y, oz + share * z
    return goals[k, 0] != places[k, 0] or goals[k, 1] != places[k, 1] or goals[k, 2] != places[k, 2]


@routine
def draw_together(ties, sweeps):
    """Bring the goals of what threads are too long between together, in so many sweeps at most.

    Tells whether there was any such thread.
    """
    p, q = ties.goals, ties.carried
    acted = False
    for _ in range(sweeps):
        clear = True
        for e in range(ties.first.size):
            i, j = ties.first[e], ties.second[e]
            x, y, z = p[j, 0] - p[i, 0], p[j, 1] - p[i, 1], p[j, 2] - p[i, 2]
            u, v, w = q[j, 0] - q[i, 0], q[j, 1] - q[i, 1], q[j, 2] - q[i, 2]
            longest = max(ties.longest[e], math.sqrt(u * u + v * v + w * w))
            length = math.sqrt(x * x + y * y + z * z)
            if length <= (1.0 + SLACK) * longest:
                continue
            clear = False
            share = 0.5 * (length - longest) / length
            x, y, z = share * x, share * y, share * z
            p[i, 0], p[i, 1], p[i, 2] = p[i, 0] + x, p[i, 1] + y, p[i, 2] + z
            p[j, 0], p[j, 1], p[j, 2] = p[j, 0] - x, p[j, 1] - y, p[j, 2] - z
        if clear:
            break
        acted = True
    return acted


@routine
def clear(x, y, z, colliders, m):
    """The point led out of the thickness of all active colliders [m]; as it is for None."""
    if colliders is not None:
        for _ in range(PASSES):
            found = False
            for k in range(1, colliders.active[0] + 1):
                c = colliders.active[k]
                place(colliders, c, m)
                distance, nx, ny, nz = distance_to(colliders, c, x, y, z)
                depth = colliders.records[c].thickness - distance
                if depth > 0.0:
                    found = True
                    x, y, z = x + depth * nx, y + depth * ny, z + depth * nz
            if not found:
                break
    return x, y, z
