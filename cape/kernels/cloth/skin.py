"""Air that sticks to a cloth: forces that are linear in the velocities against the wind."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import kernel, unit
from cape.kernels.state import State

Array = NDArray[np.floating]


class Skin(NamedTuple):
    """Uniform wind [m/s] (3,), and the force per speed against it of air that sticks to each vertex [N s/m] (N,)."""

    wind: Array
    drag: Array


class SkinForces(NamedTuple):
    """What the air's viscosity exerts, which adds to `forces` (3, N) [N]."""

    state: State
    skin: Skin
    forces: Array


@unit
def skin_drag(g, team, substep, substeps, step):
    """Add the forces of the air's viscosity on a thread's vertices."""
    s, lo, hi, wind, f = g.state, team.lo, team.hi, g.skin.wind, g.forces
    dtype = s.x.dtype.type
    brake(
        dtype(wind[0]), dtype(wind[1]), dtype(wind[2]), g.skin.drag[lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
        f[0, lo:hi], f[1, lo:hi], f[2, lo:hi],
    )  # fmt: skip


@kernel
def brake(wind_x, wind_y, wind_z, drag, vx, vy, vz, fx, fy, fz):
    """Add forces that are linear in the velocities against the wind."""
    for i in range(drag.size):
        fx[i] += drag[i] * (wind_x - vx[i])
        fy[i] += drag[i] * (wind_y - vy[i])
        fz[i] += drag[i] * (wind_z - vz[i])
