"""The accelerations with which steps of TR-BDF2 begin.

As Hosea and Shampine 1996 advise, that is the acceleration of the stage before, (v - vt) / b, which needs no digits of
a stiff spring's length; a frame begins with one that is found. Contact enters as far as it holds back other forces: the
force of an impact is large and gone a moment later.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.contact.penalty import Penalty
from cape.kernels.implicit.stages import note_acceleration, scale, stand
from cape.kernels.jit import routine, unit
from cape.kernels.program import Program, run

Array = NDArray[np.floating]


class Balance(NamedTuple):
    """Accelerations (3, N) [m/s2], of which the forces of contact hold some back; `contact` finds those."""

    acceleration: Array
    inverse_mass: Array
    penalty: Penalty
    contact: Program
    share: float


@unit
def find_acceleration(g, team, substep, substeps, step):
    """Find the accelerations at the start of a frame from A a = (f + M g) / b^2, without contact.

    Those of modes slower than the step are what f and M say, to second order in the step. The others, which that would
    make huge from the last digits of the positions, are bounded.
    """
    if substep == 0:
        problem, b, lo, hi = g.problem, g.share * step, team.lo, team.hi
        system = problem.system
        s, work = system.state, system.work
        dtype = s.x.dtype.type
        stand(
            dtype(b), s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], work.target[:, lo:hi]
        )  # fmt: skip
        run(problem.evaluate, team, 0, 1, b)
        run(problem.aim, team, 0, 1, b)
        d, a, e = system.matrix.vectors[0], system.matrix.front + lo, system.matrix.front + hi
        scale(dtype(1.0 / (b * b)), d[0, a:e], d[1, a:e], d[2, a:e], work.acceleration[:, lo:hi])


@unit
def hold_back_at_start(g, team, substep, substeps, step):
    """Find the contact forces at the start of a frame, and what they hold back of the accelerations there."""
    if substep == 0:
        run(g.contact, team, substep, 1, g.share * step)
        balance(g, team.lo, team.hi)


@unit
def hold_back(g, team, substep, substeps, step):
    """Let contact forces hold back accelerations, as far as they act."""
    balance(g, team.lo, team.hi)


@routine
def balance(g, lo, hi):
    """Add the share of each vertex's contact force that brings its acceleration closest to zero, at most all of it.

    A vertex at rest keeps the force that it needs; one that has just been stopped is not thrown back.
    """
    a, f = g.acceleration, g.penalty.force
    for i in range(lo, hi):
        w = g.inverse_mass[i]
        squared = w * (f[0, i] * f[0, i] + f[1, i] * f[1, i] + f[2, i] * f[2, i])
        if squared > 0.0:
            share = -(a[0, i] * f[0, i] + a[1, i] * f[1, i] + a[2, i] * f[2, i]) / squared
            share = w * min(max(share, 0.0), 1.0)
            for axis in range(3):
                a[axis, i] += share * f[axis, i]


@unit
def keep_acceleration(g, team, substep, substeps, step):
    """Note the accelerations at the end of a step."""
    system, b, lo, hi = g.problem.system, g.share * step, team.lo, team.hi
    s, work = system.state, system.work
    note_acceleration(
        s.x.dtype.type(1.0 / b), s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], work.target[:, lo:hi],
        work.acceleration[:, lo:hi],
    )  # fmt: skip


@unit
def leave_out_contact(g, team, substep, substeps, step):
    """Take the forces of contact out of accelerations."""
    for axis in range(3):
        for i in range(team.lo, team.hi):
            g.acceleration[axis, i] -= g.inverse_mass[i] * g.penalty.force[axis, i]
