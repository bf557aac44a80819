"""Symplectic Euler."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.fused import fused
from cape.kernels.jit import kernel, unit
from cape.kernels.state import Inertia, State


class EulerStep(NamedTuple):
    """A cloth, and the forces on its vertices (3, N) [N]."""

    state: State
    inertia: Inertia
    forces: NDArray[np.floating]


@unit
def advance(g, team, substep, substeps, step):
    """Advance a thread's vertices by a step, as the forces and gravity tell."""
    s, f, lo, hi, gravity = g.state, g.forces, team.lo, team.hi, g.inertia.gravity
    dtype = s.x.dtype.type
    step_all(
        dtype(step), dtype(gravity[0]), dtype(gravity[1]), dtype(gravity[2]), g.inertia.inverse_mass[lo:hi],
        f[0, lo:hi], f[1, lo:hi], f[2, lo:hi],
        s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
    )  # fmt: skip


@kernel
def step_all(dt, gravity_x, gravity_y, gravity_z, inverse_mass, fx, fy, fz, x, y, z, vx, vy, vz):
    """One step: v += dt a, then x += dt v with the new v."""
    for i in range(x.size):
        a = dt * inverse_mass[i]
        vx[i] = fused(a, fx[i], fused(dt, gravity_x, vx[i]))
        vy[i] = fused(a, fy[i], fused(dt, gravity_y, vy[i]))
        vz[i] = fused(a, fz[i], fused(dt, gravity_z, vz[i]))
        x[i] = fused(dt, vx[i], x[i])
        y[i] = fused(dt, vy[i], y[i])
        z[i] = fused(dt, vz[i], z[i])
