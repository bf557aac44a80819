"""Forces that are a constant matrix times the positions, as bending is on a mesh: row after row of the matrix.

The matrix is symmetric and its rows are zero in sum, so that the force on vertex i is the sum over others j of
weight_ij (q_j - q_i), which loses no digits to how far from the origin a cloth is. Every row has all its entries,
about 36 others, though each is there twice: to fetch three coordinates that lie side by side costs less than to keep
and collect what half of the links give to their other ends.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.absent import typed
from cape.kernels.jit import kernel, unit
from cape.kernels.state import State
from cape.kernels.team import meet

Array = NDArray[np.floating]

SIDE = 4  # numbers from one vertex to the next in `packed`, a power of two


class MeshBends(NamedTuple):
    """Rows of the matrix: `others` and `weight` [N/m] of vertex i stand from `start[i]` on; `start` (N + 1,).

    Rows have an even number of others, filled up with the vertex itself, so that two sums are made at once. `packed` (4 N,) is room for what the matrix is multiplied with.
    """

    start: NDArray[np.int64]
    others: NDArray[np.uint32]
    weight: Array
    packed: Array


class MeshBendForces(NamedTuple):
    """Bending of a mesh, which adds to `forces` (3, N) [N]; `damping` is its damping time [s], None for none."""

    state: State
    bends: MeshBends
    damping: float | None
    forces: Array


@unit
def mesh_bends(g, team, substep, substeps, step):
    """Add the forces of bending to the forces on a thread's vertices."""
    s, b, f, lo, hi = g.state, g.bends, g.forces, team.lo, team.hi
    pack_moved(lo, hi, s.x, s.y, s.z, s.vx, s.vy, s.vz, typed(g.damping, s.x), b.packed)
    meet(team)
    add_rows(lo, hi, s.x.dtype.type(1.0), b.start, b.others, b.weight, b.packed, f[0], f[1], f[2])


@kernel
def pack_moved(lo, hi, x, y, z, vx, vy, vz, time, packed):
    """Write positions [m] as they are after `time` [s], unless that is None, of vertices lo to hi side by side."""
    for i in range(lo, hi):
        at = SIDE * i
        if time is None:
            packed[at], packed[at + 1], packed[at + 2] = x[i], y[i], z[i]
        else:
            packed[at], packed[at + 1], packed[at + 2] = x[i] + time * vx[i], y[i] + time * vy[i], z[i] + time * vz[i]


@kernel
def pack_vectors(lo, hi, x, y, z, packed):
    """Write three coordinates of vertices lo to hi side by side."""
    for i in range(lo, hi):
        at = SIDE * i
        packed[at], packed[at + 1], packed[at + 2] = x[i], y[i], z[i]


@kernel
def add_rows(lo, hi, scale, start, others, weight, packed, fx, fy, fz):
    """Add `scale` times the sums of weight (q_j - q_i) over the others of vertices lo to hi, q being what is packed."""
    for i in range(lo, hi):
        at = np.uint64(SIDE * i)
        x, y, z = packed[at], packed[at + np.uint64(1)], packed[at + np.uint64(2)]
        ax = ay = az = bx = by = bz = type(scale)(0.0)
        for pair in range(start[i] // 2, start[i + 1] // 2):
            k = np.uint64(2 * pair)
            j, w = np.uint64(others[k]) * np.uint64(SIDE), weight[k]
            ax += w * (packed[j] - x)
            ay += w * (packed[j + np.uint64(1)] - y)
            az += w * (packed[j + np.uint64(2)] - z)
            j, w = np.uint64(others[k + np.uint64(1)]) * np.uint64(SIDE), weight[k + np.uint64(1)]
            bx += w * (packed[j] - x)
            by += w * (packed[j + np.uint64(1)] - y)
            bz += w * (packed[j + np.uint64(2)] - z)
        fx[i] += scale * (ax + bx)
        fy[i] += scale * (ay + by)
        fz[i] += scale * (az + bz)
