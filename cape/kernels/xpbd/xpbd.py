"""XPBD with small steps.

Velocities are the unknowns, as `xpbd.formulas` tells: predicted from external forces, changed by the constraints, then
used once to advance the positions.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import kernel, unit
from cape.kernels.state import Inertia, State


class Falling(NamedTuple):
    """A cloth with its weight."""

    state: State
    inertia: Inertia


class Blown(NamedTuple):
    """A cloth in the air, whose forces (3, N) [N] are cleared once they have acted."""

    state: State
    inertia: Inertia
    forces: NDArray[np.floating]


@unit
def fall_all(g, team, substep, substeps, step):
    """Add what gravity gives to the velocities of a thread's vertices."""
    s, lo, hi, gravity = g.state, team.lo, team.hi, g.inertia.gravity
    dtype = s.x.dtype.type
    fall(
        dtype(step * gravity[0]), dtype(step * gravity[1]), dtype(step * gravity[2]),
        s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
    )  # fmt: skip


@unit
def blow_all(g, team, substep, substeps, step):
    """Let the air's forces act on the velocities of a thread's vertices."""
    s, lo, hi, f = g.state, team.lo, team.hi, g.forces
    blow(
        s.x.dtype.type(step), g.inertia.inverse_mass[lo:hi], f[0, lo:hi], f[1, lo:hi], f[2, lo:hi],
        s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
    )  # fmt: skip


@unit
def drift_all(g, team, substep, substeps, step):
    """Advance the positions of a thread's vertices."""
    lo, hi = team.lo, team.hi
    drift(g.x.dtype.type(step), g.x[lo:hi], g.y[lo:hi], g.z[lo:hi], g.vx[lo:hi], g.vy[lo:hi], g.vz[lo:hi])


@kernel
def fall(gain_x, gain_y, gain_z, vx, vy, vz):
    """Add what gravity gives to all velocities [m/s] in a step."""
    for i in range(vx.size):
        vx[i] += gain_x
        vy[i] += gain_y
        vz[i] += gain_z


@kernel
def blow(step, inverse_mass, fx, fy, fz, vx, vy, vz):
    """Add what forces give to velocities in a step. Clears the forces."""
    for i in range(vx.size):
        a = step * inverse_mass[i]
        vx[i] += a * fx[i]
        vy[i] += a * fy[i]
        vz[i] += a * fz[i]
        fx[i] = 0
        fy[i] = 0
        fz[i] = 0


@kernel
def drift(step, x, y, z, vx, vy, vz):
    """Advance positions by a step at constant velocity."""
    for i in range(x.size):
        x[i] += step * vx[i]
        y[i] += step * vy[i]
        z[i] += step * vz[i]
