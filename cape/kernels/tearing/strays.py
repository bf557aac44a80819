"""Forces of what a grid has no place for: springs and triangles at vertices that have split off.

They are few, and share vertices in any way: one thread of the team computes them all, in the order of their lists, so
that results have the same bits on any number of threads. The others go on when it has come to the next meeting.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.cloth.grid import triangle_air_force
from cape.kernels.cloth.mesh import damping_of
from cape.kernels.jit import kernel, unit
from cape.kernels.state import State
from cape.kernels.team import meet

Array = NDArray[np.floating]


class StraySprings(NamedTuple):
    """Springs between two vertices, and bend springs, of which the first `counts` (2,) of each are there.

    `ends` (2, n), `stiffness` [N/m] and `rest` [m] (n,); `bent` vertices and `weights` (4, m), `bend_stiffness` [N/m]
    (m,).
    """

    counts: NDArray[np.int64]
    ends: NDArray[np.uint32]
    stiffness: Array
    rest: Array
    bent: NDArray[np.uint32]
    weights: Array
    bend_stiffness: Array


class StrayForces(NamedTuple):
    """Such springs, which add to `forces` (3, N) [N]; `damping` and `bend_damping` are times [s], None for none."""

    state: State
    springs: StraySprings
    damping: float | None
    bend_damping: float | None
    forces: Array


class StrayAir(NamedTuple):
    """Uniform wind [m/s] (3,), rho Cd / 12 and rho Cl / 12 [kg/m3], on the first `counts` (1,) triangles (3, n)."""

    wind: Array
    drag: float
    lift: float
    counts: NDArray[np.int64]
    corners: NDArray[np.uint32]


class StrayAirForces(NamedTuple):
    """Air on such triangles, which adds to `forces` (3, N) [N]."""

    state: State
    air: StrayAir
    forces: Array


@unit
def stray_springs(g, team, substep, substeps, step):
    """Add the forces of stray springs and bend springs."""
    meet(team)
    if team.rank == 0:
        s, springs, f = g.state, g.springs, g.forces
        pull_strays(
            springs.counts[0], s.x, s.y, s.z, s.vx, s.vy, s.vz, springs.ends, springs.stiffness, springs.rest,
            damping_of(g.damping, s.x), s.x.dtype.type(1e-18), f[0], f[1], f[2],
        )  # fmt: skip
        bend_strays(
            springs.counts[1], s.x, s.y, s.z, s.vx, s.vy, s.vz, springs.bent, springs.weights, springs.bend_stiffness,
            damping_of(g.bend_damping, s.x), f[0], f[1], f[2],
        )  # fmt: skip


@unit
def stray_air(g, team, substep, substeps, step):
    """Add the forces of the air on stray triangles."""
    meet(team)
    if team.rank == 0:
        s, air, f, dtype = g.state, g.air, g.forces, g.state.x.dtype.type
        blow_strays(
            air.counts[0], s.x, s.y, s.z, s.vx, s.vy, s.vz, air.corners, dtype(air.wind[0]), dtype(air.wind[1]),
            dtype(air.wind[2]), dtype(1.0 / 3.0), dtype(1.0), dtype(air.drag), dtype(air.lift), f[0], f[1], f[2],
        )  # fmt: skip


@kernel
def pull_strays(count, x, y, z, vx, vy, vz, ends, stiffness, rest, damping, tiny, fx, fy, fz):
    """Add the forces k (l - l0 + tau dl/dt) u of springs, as `grid.spring_force` has them."""
    for e in range(count):
        i, j = ends[0, e], ends[1, e]
        dx, dy, dz = x[j] - x[i], y[j] - y[i], z[j] - z[i]
        squared = dx * dx + dy * dy + dz * dz + tiny
        rate = (vx[j] - vx[i]) * dx + (vy[j] - vy[i]) * dy + (vz[j] - vz[i]) * dz
        along = stiffness[e] * (squared - rest[e] * math.sqrt(squared) + damping * rate) / squared
        fx[i] += along * dx
        fy[i] += along * dy
        fz[i] += along * dz
        fx[j] -= along * dx
        fy[j] -= along * dy
        fz[j] -= along * dz


@kernel
def bend_strays(count, x, y, z, vx, vy, vz, bent, weights, stiffness, damping, fx, fy, fz):
    """Add the forces -k c (sum c q) of bend springs, q = p + tau v."""
    for e in range(count):
        qx, qy, qz = x[0] - x[0], y[0] - y[0], z[0] - z[0]
        for a in range(4):
            i, c = bent[a, e], weights[a, e]
            qx += c * (x[i] + damping * vx[i])
            qy += c * (y[i] + damping * vy[i])
            qz += c * (z[i] + damping * vz[i])
        for a in range(4):
            i, pull = bent[a, e], stiffness[e] * weights[a, e]
            fx[i] -= pull * qx
            fy[i] -= pull * qy
            fz[i] -= pull * qz


@kernel
def blow_strays(
    count, x, y, z, vx, vy, vz, corners, wind_x, wind_y, wind_z, third, present, drag, lift, fx, fy, fz
):  # fmt: skip
    """Add a third of the air's force on each triangle to its corners."""
    for e in range(count):
        i, j, k = corners[0, e], corners[1, e], corners[2, e]
        ax, ay, az = triangle_air_force(
            x[j] - x[i], y[j] - y[i], z[j] - z[i], x[k] - x[i], y[k] - y[i], z[k] - z[i],
            wind_x - third * (vx[i] + vx[j] + vx[k]), wind_y - third * (vy[i] + vy[j] + vy[k]),
            wind_z - third * (vz[i] + vz[j] + vz[k]), present, drag, lift,
        )  # fmt: skip
        for v in (i, j, k):
            fx[v] += ax
            fy[v] += ay
            fz[v] += az
