"""A wind that is another one at each vertex: velocities against it, which the air's units take for velocities."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import kernel, unit
from cape.kernels.state import State
from cape.kernels.team import meet

Array = NDArray[np.floating]


class Stream(NamedTuple):
    """Velocities of the air at the vertices [m/s] at the begin and the end of a frame, and now, shape (3, N) each."""

    begin: Array
    end: Array
    now: Array


class Blowing(NamedTuple):
    """A stream, and to which share of a substep it is brought."""

    stream: Stream
    at: float


class Against(NamedTuple):
    """A cloth in a stream; `relative` (3, N) are its velocities against the air [m/s], in its precision."""

    state: State
    stream: Stream
    relative: Array


@unit
def blow_on(g, team, substep, substeps, step):
    """Bring the air at a thread's vertices to a share of a substep, straight from the frame's begin to its end."""
    lo, hi, b, e, now = team.lo, team.hi, g.stream.begin, g.stream.end, g.stream.now
    share = (substep + g.at) / substeps
    for k in range(3):
        go_between(share, b[k, lo:hi], e[k, lo:hi], now[k, lo:hi])


@unit
def against_stream(g, team, substep, substeps, step):
    """Set the velocities of a thread's vertices against the air as it is now."""
    s, lo, hi, now, r = g.state, team.lo, team.hi, g.stream.now, g.relative
    subtract(s.vx[lo:hi], now[0, lo:hi], r[0, lo:hi])
    subtract(s.vy[lo:hi], now[1, lo:hi], r[1, lo:hi])
    subtract(s.vz[lo:hi], now[2, lo:hi], r[2, lo:hi])
    meet(team)


@kernel
def go_between(share, begin, end, now):
    """Set `now` to what lies a share of the way from `begin` to `end`."""
    for i in range(now.size):
        now[i] = begin[i] + share * (end[i] - begin[i])


@kernel
def subtract(velocity, now, relative):
    """Velocities against another one."""
    for i in range(relative.size):
        relative[i] = velocity[i] - now[i]
