"""Vertices that slide along curves which bones carry: free along them, held across.

A curve is a row of cubic pieces (Hermite's): from a point a with a way w to the next, and tangents m and n at both,

    c(u) = a + u w + u (1 - u)^2 (m - w) - u^2 (1 - u) (n - w)

which is straight where m = n = w. Once a step h has moved a vertex x, with the velocity v, it is compared with the
nearest point c of its curve, where the bone moves at w and the curve goes along the unit tangent t:

    r = v - w,   v -= r - (r . t) t,   x -= h (r - (r . t) t)

which redoes the step without what leads across; at an end of the curve also without what leads beyond. What is then
left of x - c, which a bend leaves, is taken back without any velocity, no faster than contact moves vertices.

An implicit solver finds its stage with a spring across in place of this, as for contact: see `implicit.sliding`.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.bones import MotionRoom, to_world, turned, turned_back, velocity_at
from cape.kernels.contact.contact import EXIT
from cape.kernels.jit import inlined, routine, unit
from cape.kernels.solve.attachments import Attached
from cape.kernels.state import State

Array = NDArray[np.floating]
Indices = NDArray[np.int64]

REFINED = 3  # steps of Newton's method from the nearest point of the chords


class Rails(NamedTuple):
    """Curves for n vertices: the pieces from `first` to `last` (n,) of `pieces` (S, 12).

    A row is a, w, m - w and n - w of a piece [m], in the bone's frame.
    `attached` are the vertices with their bones; its points are not used here. `closed` (n,) curves have no ends.
    """

    attached: Attached
    pieces: Array
    first: Indices
    last: Indices
    closed: NDArray[np.bool_]


class Sliding(NamedTuple):
    """A cloth, and which of its vertices slide."""

    state: State
    rails: Rails
    bones: MotionRoom


@unit
def slide(g, team, substep, substeps, step):
    """Keep a thread's vertices on their curves."""
    slide_along(team.lo, team.hi, g.state, g.rails, g.bones, step)


@routine
def slide_along(lo, hi, s, rails, m, step):
    """Keep those of vertices lo to hi on their curves that slide."""
    attached = rails.attached
    for k in range(attached.vertices.size):
        i = attached.vertices[k]
        if i < lo or i >= hi:
            continue
        bone = attached.bones[k]
        j, u = nearest_on(rails, k, s.x[i], s.y[i], s.z[i], m)
        cx, cy, cz = point_on(rails, bone, j, u, m)
        tx, ty, tz = tangent_on(rails, bone, j, u, m)
        wx, wy, wz = velocity_at(bone, cx, cy, cz, m)
        rx, ry, rz = s.vx[i] - wx, s.vy[i] - wy, s.vz[i] - wz
        along = rx * tx + ry * ty + rz * tz
        if is_stopped(rails, k, j, u, along):
            along = 0.0
        rx, ry, rz = rx - along * tx, ry - along * ty, rz - along * tz
        s.vx[i] -= rx
        s.vy[i] -= ry
        s.vz[i] -= rz
        ex, ey, ez = cx - (s.x[i] - step * rx), cy - (s.y[i] - step * ry), cz - (s.z[i] - step * rz)
        off = math.sqrt(ex * ex + ey * ey + ez * ez)
        late = 1.0 - EXIT * step / off if off > EXIT * step else 0.0
        s.x[i], s.y[i], s.z[i] = cx - late * ex, cy - late * ey, cz - late * ez


@inlined
def is_stopped(rails, k, j, u, along):
    """Tell whether what moves `along` the curve from its nearest point leaves it by an end."""
    if rails.closed[k]:
        return False
    return (j == rails.first[k] and u == 0.0 and along < 0.0) or (j == rails.last[k] - 1 and u == 1.0 and along > 0.0)


@routine
def nearest_on(rails, k, x, y, z, m):
    """The piece of curve k that is nearest to a point of the world [m], and its u there."""
    bone, pieces = rails.attached.bones[k], rails.pieces
    x, y, z = turned_back(
        bone, x - m.positions[bone, 0], y - m.positions[bone, 1], z - m.positions[bone, 2], m.matrices
    )  # fmt: skip
    nearest, chosen, share = math.inf, rails.first[k], 0.0
    for j in range(rails.first[k], rails.last[k]):
        a = pieces[j]
        dx, dy, dz = x - a[0], y - a[1], z - a[2]
        wx, wy, wz = a[3], a[4], a[5]
        u = (dx * wx + dy * wy + dz * wz) / (wx * wx + wy * wy + wz * wz)
        u = min(max(u, 0.0), 1.0)
        dx, dy, dz = dx - u * wx, dy - u * wy, dz - u * wz
        squared = dx * dx + dy * dy + dz * dz
        if squared < nearest:
            nearest, chosen, share = squared, j, u
    a = pieces[chosen]
    for _ in range(REFINED):
        cx, cy, cz = place_in(a, share)
        tx, ty, tz = slope_in(a, share)
        share += ((x - cx) * tx + (y - cy) * ty + (z - cz) * tz) / (tx * tx + ty * ty + tz * tz)
        share = min(max(share, 0.0), 1.0)
    return chosen, share


@inlined
def place_in(a, u):
    """c(u) of a piece [m]."""
    p, q = u * (1.0 - u) * (1.0 - u), -u * u * (1.0 - u)
    return (
        a[0] + u * a[3] + p * a[6] + q * a[9],
        a[1] + u * a[4] + p * a[7] + q * a[10],
        a[2] + u * a[5] + p * a[8] + q * a[11],
    )


@inlined
def slope_in(a, u):
    """c'(u) of a piece [m]."""
    p, q = (1.0 - u) * (1.0 - 3.0 * u), u * (3.0 * u - 2.0)
    return a[3] + p * a[6] + q * a[9], a[4] + p * a[7] + q * a[10], a[5] + p * a[8] + q * a[11]


@inlined
def point_on(rails, bone, j, u, m):
    """c(u) of piece j, in the world [m]."""
    x, y, z = place_in(rails.pieces[j], u)
    return to_world(bone, x, y, z, m.positions, m.matrices)


@inlined
def tangent_on(rails, bone, j, u, m):
    """The unit tangent there, in the world."""
    x, y, z = slope_in(rails.pieces[j], u)
    scale = 1.0 / math.sqrt(x * x + y * y + z * z)
    return turned(bone, scale * x, scale * y, scale * z, m.matrices)
