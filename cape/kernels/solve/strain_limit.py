"""Threads of a grid that stretch no further than their fabric allows.

Provot 1995, "Deformation constraints in a mass-spring model to describe rigid cloth behavior", moves the ends of a
thread that is too long back to its longest; Bridson, Fedkiw and Anderson 2002, "Robust treatment of collisions, contact
and friction for cloth animation", section 4.2, take by impulses the velocity that makes it longer. Here both is done,
at the end of a step, after contact: the ends lose the velocity with which they part, as in an inelastic collision,
which keeps momentum and never adds kinetic energy; and what the thread is too long by is taken back without any
velocity. How far that may draw what limbs have stopped is told in `contact.drawn`.

Threads down the columns come first, row after row from where a garment is held, so that one sweep takes a tug at the
top to the hem, in all columns side by side. Threads along the rows follow, every other one first. What one thread gives
way by may make its neighbours too long: sweeps go on, over the rows where there was something to do, until nothing is.
A row in which all are short enough costs a look.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.fused import fused
from cape.kernels.jit import inlined, kernel, routine, unit
from cape.kernels.state import State
from cape.kernels.team import share

Array = NDArray[np.floating]

# A sweep leaves a chain of N threads that bear an acceleration a too long by a (N h)^2 (`assembly.chains.Chain.sag`), n
# of them by an n-th. So many are done that a load of LOAD, that of a spin with what hangs on neighbouring threads,
# leaves no more than LEFT; a stable step of Euler takes ten, whatever the spacing.
LOAD = 1e3  # m/s2
LEFT = 3.5e-3  # m
LEAST, MOST = 10, 100
RETURN = 30.0  # m/s at most at which a sweep takes a thread back: faster than limbs, yet no leap where cloth was torn
SLACK = 1e-4  # of its longest, by which a thread that is too long is left alone


class Limited(NamedTuple):
    """A grid cloth of so many `rows` and `columns`, whose threads are `longest` [m] (2, N): to the right, and down.

    `inverse_mass` [1/kg] (N,) is zero for attached vertices.
    """

    state: State
    inverse_mass: Array
    longest: Array
    rows: int
    columns: int


@inlined
def sweeps_over(links, step):
    """How many sweeps over chains of so many threads a step [s] takes at most."""
    return min(max(math.ceil(LOAD * (links * step) ** 2 / LEFT), LEAST), MOST)


@unit
def limit_down(g, team, substep, substeps, step):
    """Keep threads along a thread of the team's columns from getting too long, from the first row to the last."""
    lo, hi = share(0, g.columns, team)
    links = g.rows - 1
    first, last = 0, links
    for _ in range(sweeps_over(links, step)):
        begin, end, row = links, 0, first
        while row < last:
            start = row * g.columns
            if _exceeds(g, 1, start + lo, start + hi, g.columns):
                _shorten(g, 1, start + lo, start + hi, g.columns, RETURN * step)
                begin, end = min(begin, row), row + 1
                last = max(last, min(row + 2, links))
            row += 1
        if end == 0:
            break
        first, last = max(begin - 1, 0), min(end + 1, links)


@unit
def limit_across(g, team, substep, substeps, step):
    """Keep threads along a thread of the team's rows from getting too long."""
    lo, hi = share(0, g.rows, team)
    sweeps = sweeps_over(g.columns - 1, step)
    for row in range(lo, hi):
        start, end = row * g.columns, (row + 1) * g.columns - 1
        for sweep in range(sweeps):
            if not _exceeds(g, 0, start, end, 1):
                break
            _shorten_every_other(g, start, end, 1.0, RETURN * step)
            _shorten_every_other(g, start + 1, end, 1.0, RETURN * step)
            if sweep == sweeps - 1:
                # The second ones have all that the first lack: a taut row's threads share it.
                _shorten_every_other(g, start, end, 0.5, RETURN * step)


@routine
def _exceeds(g, family, start, end, offset):
    """Tell whether any thread of a family is too long that begins at vertices start to end, and ends `offset` on."""
    s, lo, hi = g.state, start + offset, end + offset
    return exceeds(
        s.x[start:end], s.y[start:end], s.z[start:end], s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], g.longest[family, start:end]
    )


@routine
def _shorten(g, family, start, end, offset, most):
    """Shorten threads of a family that begin at vertices start to end, and end `offset` on."""
    s, w, lo, hi = g.state, g.inverse_mass, start + offset, end + offset
    shorten(
        s.x[start:end], s.y[start:end], s.z[start:end], s.vx[start:end], s.vy[start:end], s.vz[start:end], w[start:end],
        s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], w[lo:hi],
        g.longest[family, start:end], 1.0, most,
    )  # fmt: skip


@routine
def _shorten_every_other(g, start, end, part, most):
    """Shorten every other thread to the right of those that begin at vertices start to end, by a part of what it is."""
    s, w, lo, hi = g.state, g.inverse_mass, start + 1, end + 1
    shorten(
        s.x[start:end:2], s.y[start:end:2], s.z[start:end:2],
        s.vx[start:end:2], s.vy[start:end:2], s.vz[start:end:2], w[start:end:2],
        s.x[lo:hi:2], s.y[lo:hi:2], s.z[lo:hi:2], s.vx[lo:hi:2], s.vy[lo:hi:2], s.vz[lo:hi:2], w[lo:hi:2],
        g.longest[0, start:end:2], part, most,
    )  # fmt: skip


@kernel
def exceeds(x0, y0, z0, x1, y1, z1, longest):
    """Tell whether any of the threads from 0 to 1 [m] is longer than its longest [m] and the slack."""
    bound = longest.dtype.type((1.0 + SLACK) ** 2)
    many = np.int64(0)
    for k in range(longest.size):
        dx, dy, dz = x1[k] - x0[k], y1[k] - y0[k], z1[k] - z0[k]
        many += 1 if dx * dx + dy * dy + dz * dz > bound * (longest[k] * longest[k]) else 0
    return many > 0


@kernel
def shorten(x0, y0, z0, vx0, vy0, vz0, w0, x1, y1, z1, vx1, vy1, vz1, w1, longest, part, most):
    """Bring threads from 0 to 1 [m] that are longer than their longest [m] back to that, and stop their stretching.

    Both is done by a part of it, 1 for all, and each is shortened by at most `most` [m]. Velocities [m/s] and inverse
    masses w [1/kg] are of their ends. What two held ends stretch stays as it is.
    """
    number = longest.dtype.type
    bound, one, none, far, much = number((1.0 + SLACK) ** 2), number(1.0), number(0.0), number(most), number(part)
    for k in range(longest.size):
        dx, dy, dz = x1[k] - x0[k], y1[k] - y0[k], z1[k] - z0[k]
        squared, both = dx * dx + dy * dy + dz * dz, w0[k] + w1[k]
        acts = squared > bound * (longest[k] * longest[k]) and both > none
        length = math.sqrt(squared)
        parting = max((vx1[k] - vx0[k]) * dx + (vy1[k] - vy0[k]) * dy + (vz1[k] - vz0[k]) * dz, none) / length
        # Of each end for its inverse mass, per length along the thread.
        scale = one / (both * length)
        moved, slowed = scale * min(much * (length - longest[k]), far), scale * much * parting
        m0, m1, s0, s1 = w0[k] * moved, -w1[k] * moved, w0[k] * slowed, -w1[k] * slowed
        x0[k] = fused(m0, dx, x0[k]) if acts else x0[k]
        y0[k] = fused(m0, dy, y0[k]) if acts else y0[k]
        z0[k] = fused(m0, dz, z0[k]) if acts else z0[k]
        x1[k] = fused(m1, dx, x1[k]) if acts else x1[k]
        y1[k] = fused(m1, dy, y1[k]) if acts else y1[k]
        z1[k] = fused(m1, dz, z1[k]) if acts else z1[k]
        vx0[k] = fused(s0, dx, vx0[k]) if acts else vx0[k]
        vy0[k] = fused(s0, dy, vy0[k]) if acts else vy0[k]
        vz0[k] = fused(s0, dz, vz0[k]) if acts else vz0[k]
        vx1[k] = fused(s1, dx, vx1[k]) if acts else vx1[k]
        vy1[k] = fused(s1, dy, vy1[k]) if acts else vy1[k]
        vz1[k] = fused(s1, dz, vz1[k]) if acts else vz1[k]
