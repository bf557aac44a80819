"""Tethers: vertices that may get no farther than a length from where bones hold another.

After Kim, Chentanez and Müller-Fischer 2012, "Long Range Attachments". A vertex x that a step of h takes beyond length
l of its anchor a, which moves at u, is put back onto the sphere, and loses what of its velocity leads out of it:

    n = (x - a) / |x - a|,   e = |x - a| - l,   x -= e n,   v -= min(max((v - u) . n, 0), e / h) n

The sphere is convex and the step has begun in it, so that seen from the anchor a vertex is never the faster for it.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.bones import MotionRoom
from cape.kernels.jit import routine, unit
from cape.kernels.solve.attachments import Attached, carrying_velocity, goal
from cape.kernels.state import State

Array = NDArray[np.floating]


class Tethers(NamedTuple):
    """For each vertex (N,) the attachment that it is tethered to, -1 for none, and the `length` [m] of the tether."""

    anchor: NDArray[np.int64]
    length: Array


class Tethered(NamedTuple):
    """A cloth on tethers; `anchors` (n, 6) is a thread's own room for where its attachments are [m], and how fast
    [m/s]."""

    state: State
    attached: Attached
    tethers: Tethers
    bones: MotionRoom
    anchors: Array


@unit
def keep_tethered(g, team, substep, substeps, step):
    """Keep a thread's vertices within the length of their tethers."""
    find_anchors(g.attached, g.bones, (substep + 1) * step, g.anchors)
    draw_in(team.lo, team.hi, g.state, g.tethers, g.anchors, step)


@routine
def find_anchors(attached, m, time, anchors):
    """Find where all attachments are `time` [s] after the frame's start."""
    for k in range(attached.vertices.size):
        x, y, z = goal(attached, k, m, time)
        u, v, w = carrying_velocity(attached, attached.blend, k, x, y, z, m)
        anchors[k, 0], anchors[k, 1], anchors[k, 2] = x, y, z
        anchors[k, 3], anchors[k, 4], anchors[k, 5] = u, v, w


@routine
def draw_in(lo, hi, s, tethers, anchors, step):
    """Put the vertices lo to hi back to where their tethers reach."""
    for i in range(lo, hi):
        k, length = tethers.anchor[i], tethers.length[i]
        if k < 0:
            continue
        x, y, z = s.x[i] - anchors[k, 0], s.y[i] - anchors[k, 1], s.z[i] - anchors[k, 2]
        squared = x * x + y * y + z * z
        if squared <= length * length:
            continue
        distance = math.sqrt(squared)
        x, y, z, beyond = x / distance, y / distance, z / distance, distance - length
        away = (s.vx[i] - anchors[k, 3]) * x + (s.vy[i] - anchors[k, 4]) * y + (s.vz[i] - anchors[k, 5]) * z
        lost = min(max(away, 0.0), beyond / step)
        s.x[i] -= beyond * x
        s.y[i] -= beyond * y
        s.z[i] -= beyond * z
        s.vx[i] -= lost * x
        s.vy[i] -= lost * y
        s.vz[i] -= lost * z
