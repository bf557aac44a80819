"""Forces on a cloth that is any triangle mesh.

Gathering and scattering are what a mesh costs, and arithmetic vectorises only on what lies in a row. So each link, a
pair of vertices with a spring or bending between them, belongs to one of its two ends, and link d of vertex i is number
i of row d: its own end needs no index, and its force is added to that end in a row. Nothing is scattered:

1. `pull`: for a block of vertices, row after row, fetch the other ends into contiguous room, compute, keep the forces;
2. `collect`: each vertex adds the forces of the links that others own, through a list of fixed order.

Rows are padded with links from a vertex to itself without stiffness, and lists with the index of a zero.

With damping, each coordinate is fetched with its velocity as one word, which halves the loads. Triangles in the air
belong to one of their corners in the same way.
"""

import math

import numpy as np

from cape.kernels.grid import triangle_air_force
from cape.kernels.jit import driver, inlined, kernel
from cape.kernels.team import meet

BLOCK = 128  # vertices whose links are computed in one go; ranks start at multiples of 64, which may cut a block
SLICE = 16  # vertices with equally long lists: longer slices have more padding, shorter ones more mispredicted loops


@driver
def mesh_forces(lo, hi, s, springs, bends, damping, bend_damping, fx, fy, fz, team):
    """Set the forces on vertices lo to hi [N] to those of the springs, and of bending if `bends` is not None.

    `springs` and `bends` are records of the same links. Damping times [s] are None for no damping.
    """
    if damping is not None or bend_damping is not None:
        pack(lo, hi, s.x, s.y, s.z, s.vx, s.vy, s.vz, springs.words)
        meet(team)
        pull_all(lo, hi, s, springs, springs.words, bends, damping, bend_damping, fx, fy, fz)
    else:
        pull_all(lo, hi, s, springs, None, bends, None, None, fx, fy, fz)
    meet(team)
    collect(lo, hi, springs.start, springs.incoming, springs.forces, fx, fy, fz)


@driver
def pull_all(lo, hi, s, springs, words, bends, damping, bend_damping, fx, fy, fz):
    """Pass on what `pull` needs."""
    weight = None if bends is None else bends.weight
    pull(
        lo, hi, s.x, s.y, s.z, s.vx, s.vy, s.vz, words, springs.second, springs.stiffness, springs.rest, weight,
        damping, bend_damping, s.x.dtype.type(1e-18), springs.ends, springs.forces, fx, fy, fz,
    )  # fmt: skip


@driver
def mesh_air_forces(lo, hi, s, air, fx, fy, fz, team):
    """Add the forces of the air on the triangles to the forces on vertices lo to hi [N]."""
    pack(lo, hi, s.x, s.y, s.z, s.vx, s.vy, s.vz, air.words)
    meet(team)
    push_all(lo, hi, s, air, fx, fy, fz)
    meet(team)
    collect(lo, hi, air.start, air.incoming, air.forces, fx, fy, fz)


@driver
def push_all(lo, hi, s, air, fx, fy, fz):
    """Pass on what `push` needs."""
    dtype = s.x.dtype.type
    push(
        lo, hi, s.x, s.y, s.z, s.vx, s.vy, s.vz, air.words, air.second, air.third,
        dtype(air.wind[0]), dtype(air.wind[1]), dtype(air.wind[2]),
        dtype(1.0 / 3.0), dtype(1.0), dtype(air.drag), dtype(air.lift), air.ends, air.forces, fx, fy, fz,
    )  # fmt: skip


@kernel
def pack(lo, hi, x, y, z, vx, vy, vz, words):
    """Write each coordinate [m] and its velocity [m/s] of vertices lo to hi side by side."""
    packed = words.view(x.dtype)
    n = hi - lo
    interleave(n, x[lo:], vx[lo:], packed[0, 2 * lo :])
    interleave(n, y[lo:], vy[lo:], packed[1, 2 * lo :])
    interleave(n, z[lo:], vz[lo:], packed[2, 2 * lo :])


@inlined
def interleave(n, p, v, packed):
    """Write p and v in turns."""
    for i in range(n):
        packed[2 * i], packed[2 * i + 1] = p[i], v[i]


@kernel
def pull(
    lo, hi, x, y, z, vx, vy, vz, words, second, stiffness, rest, weight, damping, bend_damping, tiny, ends, forces,
    fx, fy, fz,
):  # fmt: skip
    """Compute the links of vertices lo to hi: set `f` to their forces on their owners, `forces` on the other ends [N].

    `words` is None when nothing is damped: then no velocity is fetched.
    """
    room = ends.view(x.dtype)
    count = x.size
    for start in range(lo, hi, BLOCK):
        n = min(BLOCK, hi - start)
        gx, gy, gz = fx[start:], fy[start:], fz[start:]
        for i in range(n):
            gx[i], gy[i], gz[i] = 0, 0, 0
        for d in range(second.shape[0]):
            others, at = second[d, start:], d * count + start
            sx, sy, sz = forces[0, at:], forces[1, at:], forces[2, at:]
            if words is not None:
                fetch(n, others, words[0], words[1], words[2], ends[0, lo:], ends[1, lo:], ends[2, lo:])
                pull_row(
                    n, x[start:], y[start:], z[start:], vx[start:], vy[start:], vz[start:],
                    room[0, 2 * lo:], room[1, 2 * lo:], room[2, 2 * lo:], stiffness[d, start:], rest[d, start:],
                    row(weight, d, start), damping, bend_damping, tiny, sx, sy, sz, gx, gy, gz,
                )  # fmt: skip
            else:
                fetch(n, others, x, y, z, room[0, 2 * lo :], room[1, 2 * lo :], room[2, 2 * lo :])
                pull_still_row(
                    n, x[start:], y[start:], z[start:], room[0, 2 * lo:], room[1, 2 * lo:], room[2, 2 * lo:],
                    stiffness[d, start:], rest[d, start:], row(weight, d, start), tiny, sx, sy, sz, gx, gy, gz,
                )  # fmt: skip


@inlined
def row(table, d, start):
    """Row d of a table from `start` on, None of None."""
    if table is None:
        return None
    return table[d, start:]


@inlined
def fetch(n, others, a, b, c, to_a, to_b, to_c):
    """Copy the entries of three arrays with the given indices."""
    for k in range(n):
        j = others[k]
        to_a[k], to_b[k], to_c[k] = a[j], b[j], c[j]


@inlined
def pull_row(
    n, x, y, z, vx, vy, vz, ex, ey, ez, stiffness, rest, weight, damping, bend_damping, tiny, sx, sy, sz, fx, fy, fz
):
    """One row of links: `e` holds the other ends' coordinates and velocities in turns."""
    for i in range(n):
        dx, dy, dz = ex[2 * i] - x[i], ey[2 * i] - y[i], ez[2 * i] - z[i]
        ux, uy, uz = ex[2 * i + 1] - vx[i], ey[2 * i + 1] - vy[i], ez[2 * i + 1] - vz[i]
        squared = dx * dx + dy * dy + dz * dz + tiny
        stretched = squared - rest[i] * math.sqrt(squared)
        if damping is not None:
            stretched += damping * (ux * dx + uy * dy + uz * dz)
        along = stiffness[i] * stretched / squared
        if weight is not None:
            along += weight[i]
        px, py, pz = along * dx, along * dy, along * dz
        if weight is not None and bend_damping is not None:
            braked = weight[i] * bend_damping
            px, py, pz = px + braked * ux, py + braked * uy, pz + braked * uz
        fx[i], fy[i], fz[i] = fx[i] + px, fy[i] + py, fz[i] + pz
        sx[i], sy[i], sz[i] = -px, -py, -pz


@inlined
def pull_still_row(n, x, y, z, ex, ey, ez, stiffness, rest, weight, tiny, sx, sy, sz, fx, fy, fz):
    """One row of links without damping: `e` holds the other ends' coordinates."""
    for i in range(n):
        dx, dy, dz = ex[i] - x[i], ey[i] - y[i], ez[i] - z[i]
        squared = dx * dx + dy * dy + dz * dz + tiny
        along = stiffness[i] * (squared - rest[i] * math.sqrt(squared)) / squared
        if weight is not None:
            along += weight[i]
        px, py, pz = along * dx, along * dy, along * dz
        fx[i], fy[i], fz[i] = fx[i] + px, fy[i] + py, fz[i] + pz
        sx[i], sy[i], sz[i] = -px, -py, -pz


@kernel
def push(
    lo, hi, x, y, z, vx, vy, vz, words, second, third, wind_x, wind_y, wind_z, share, present, drag, lift, ends, forces,
    fx, fy, fz,
):  # fmt: skip
    """Add a third of the air's force on the triangles of vertices lo to hi to their owners, keep it for other corners.

    `present` (1), `drag` and `lift` as in `grid.triangle_air_force`; `share` is 1/3.
    """
    room = ends.view(x.dtype)
    count = x.size
    for start in range(lo, hi, BLOCK):
        n = min(BLOCK, hi - start)
        for d in range(second.shape[0]):
            at = d * count + start
            fetch(n, second[d, start:], words[0], words[1], words[2], ends[0, lo:], ends[1, lo:], ends[2, lo:])
            fetch(n, third[d, start:], words[0], words[1], words[2], ends[3, lo:], ends[4, lo:], ends[5, lo:])
            push_row(
                n, x[start:], y[start:], z[start:], vx[start:], vy[start:], vz[start:],
                room[0, 2 * lo:], room[1, 2 * lo:], room[2, 2 * lo:],
                room[3, 2 * lo:], room[4, 2 * lo:], room[5, 2 * lo:],
                wind_x, wind_y, wind_z, share, present, drag, lift,
                forces[0, at:], forces[1, at:], forces[2, at:], fx[start:], fy[start:], fz[start:],
            )  # fmt: skip


@inlined
def push_row(
    n, x, y, z, vx, vy, vz, ax, ay, az, bx, by, bz, wind_x, wind_y, wind_z, share, present, drag, lift,
    sx, sy, sz, fx, fy, fz,
):  # fmt: skip
    """One row of triangles: `a` and `b` hold the other corners' coordinates and velocities in turns."""
    for i in range(n):
        px, py, pz = triangle_air_force(
            ax[2 * i] - x[i],
            ay[2 * i] - y[i],
            az[2 * i] - z[i],
            bx[2 * i] - x[i],
            by[2 * i] - y[i],
            bz[2 * i] - z[i],
            wind_x - share * (vx[i] + ax[2 * i + 1] + bx[2 * i + 1]),
            wind_y - share * (vy[i] + ay[2 * i + 1] + by[2 * i + 1]),
            wind_z - share * (vz[i] + az[2 * i + 1] + bz[2 * i + 1]),
            present,
            drag,
            lift,
        )
        fx[i], fy[i], fz[i] = fx[i] + px, fy[i] + py, fz[i] + pz
        sx[i], sy[i], sz[i] = px, py, pz


@kernel
def collect(lo, hi, start, incoming, forces, fx, fy, fz):
    """Add to each vertex lo to hi the forces that others' links or triangles keep for it [N].

    `start` (slices + 1,) says where in `incoming` the lists of the vertices of a slice begin.
    """
    sx, sy, sz = forces[0], forces[1], forces[2]
    for piece in range((lo + SLICE - 1) // SLICE, (hi + SLICE - 1) // SLICE):
        first = piece * SLICE
        width = np.uint64((start[piece + 1] - start[piece]) // SLICE)
        lists = incoming[start[piece] :]
        gx, gy, gz = fx[first:], fy[first:], fz[first:]
        k = np.uint64(0)
        for i in range(min(SLICE, hi - first)):
            ax, ay, az = gx[i], gy[i], gz[i]
            for _ in range(width):
                e = lists[k]
                k += np.uint64(1)
                ax, ay, az = ax + sx[e], ay + sy[e], az + sz[e]
            gx[i], gy[i], gz[i] = ax, ay, az
