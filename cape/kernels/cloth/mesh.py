"""Forces on a cloth that is any triangle mesh.

Gathering and scattering are what a mesh costs, and arithmetic vectorises only on what lies in a row. So each link, a
pair of vertices with a spring between them, belongs to one of its two ends, and link d of vertex i is number
i of row d: its own end needs no index, and its force is added to that end in a row. Nothing is scattered:

1. `pull`: for a block of vertices, row after row, fetch the other ends into contiguous room, compute, keep the forces;
2. `collect`: each vertex adds the forces of the links that others own, through a list of fixed order.

What belongs to a block lies together, in the order in which it is read: the links' constants as (blocks, D, BLOCK), the
forces as (blocks, D, 3, BLOCK). All is padded with links of vertex 0 to nobody, so that every loop over a block has the
same length, known to the compiler, and no remainder. Each coordinate is fetched with its velocity as one word, which
halves the loads. Triangles in the air belong to one of their corners in the same way.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.cloth.grid import triangle_air_force
from cape.kernels.jit import inlined, kernel, routine, unit
from cape.kernels.state import State
from cape.kernels.team import meet

Array = NDArray[np.floating]
Indices = NDArray[np.int64]

BLOCK = 64  # vertices whose links are computed in one go; ranks start at multiples of it
SLICE = 8  # vertices with equally long lists: longer slices have more padding, shorter ones more mispredicted loops
ENDS = 3 * BLOCK  # words that a row of other ends fills, numbers that its forces fill
NEXT = np.uint64(BLOCK)  # from one component of a force to the next


class MeshSprings(NamedTuple):
    """Links between vertices of a mesh, each owned by one end: D rows for each block of vertices.

    `rows` (blocks,) of them are used; `second`, the other ends, `stiffness` [N/m] and `rest` [m] of their springs, 0
    and 1 for no spring, (blocks, D, BLOCK); `sorted_vertices` (N,), those of each block by the number of links that
    others own, `start` (slices + 1,) and `incoming`, for each of them in slices the places of those links in `forces`.
    Room: `words` for coordinates with their velocities (3, N); `room` for a block's own ends, other ends and sums, each
    rank using the line of its first block; `forces` on the other ends [N], flat, three components of BLOCK for each row
    of each block and of a row of zeros, for padding.
    """

    rows: Indices
    second: NDArray[np.uint32]
    stiffness: Array
    rest: Array
    sorted_vertices: NDArray[np.uint32]
    start: Indices
    incoming: NDArray[np.uint32]
    words: NDArray[np.generic]
    room: NDArray[np.generic]
    forces: Array


class MeshAir(NamedTuple):
    """Uniform wind [m/s] (3,), rho Cd / 12 and rho Cl / 12 [kg/m3], on triangles that one corner owns, D rows a block.

    `second` and `third` (blocks, D, BLOCK) are the other corners; the rest as in MeshSprings.
    """

    wind: Array
    drag: float
    lift: float
    second: NDArray[np.uint32]
    third: NDArray[np.uint32]
    sorted_vertices: NDArray[np.uint32]
    start: Indices
    incoming: NDArray[np.uint32]
    words: NDArray[np.generic]
    room: NDArray[np.generic]
    forces: Array


class MeshForces(NamedTuple):
    """Springs of a mesh, which set `forces` (3, N) [N]; `damping` is their damping time [s], None for none."""

    state: State
    springs: MeshSprings
    damping: float | None
    forces: Array


class MeshAirForces(NamedTuple):
    """Air around a mesh, which adds to `forces` (3, N) [N]."""

    state: State
    air: MeshAir
    forces: Array


class Added(NamedTuple):
    """Forces of a piece of a mesh, and those that they are added to, (3, N) [N] each."""

    piece: Array
    forces: Array


@unit
def mesh_springs(g, team, substep, substeps, step):
    """Set the forces on a thread's vertices to those of the springs."""
    s, springs = g.state, g.springs
    lo, hi, fx, fy, fz = team.lo, team.hi, g.forces[0], g.forces[1], g.forces[2]
    pack(lo, hi, s.x, s.y, s.z, s.vx, s.vy, s.vz, springs.words)
    meet(team)
    pull_all(g, g.damping, lo, hi)
    meet(team)
    collect(lo, hi, springs.sorted_vertices, springs.start, springs.incoming, springs.forces, fx, fy, fz)


@routine
def pull_all(g, damping, lo, hi):
    """Pass on what `pull` needs."""
    s, springs, f = g.state, g.springs, g.forces
    pull(
        lo, hi, s.x, s.y, s.z, s.vx, s.vy, s.vz, springs.words, springs.rows, springs.second, springs.stiffness,
        springs.rest, damping_of(damping, s.x), s.x.dtype.type(1e-18), springs.room, springs.forces, f[0], f[1], f[2],
    )  # fmt: skip


@inlined
def damping_of(damping, array):
    """A damping time in the precision of an array; none is a zero.

    Left out, LLVM would load every other number by vector gathers, which cost more (14 ns instead of 12 for a vertex).
    """
    if damping is None:
        return array.dtype.type(0.0)
    return array.dtype.type(damping)


@unit
def mesh_air(g, team, substep, substeps, step):
    """Add the forces of the air on the triangles to the forces on a thread's vertices."""
    s, air = g.state, g.air
    lo, hi, fx, fy, fz = team.lo, team.hi, g.forces[0], g.forces[1], g.forces[2]
    dtype = s.x.dtype.type
    pack(lo, hi, s.x, s.y, s.z, s.vx, s.vy, s.vz, air.words)
    meet(team)
    push(
        lo, hi, s.x, s.y, s.z, s.vx, s.vy, s.vz, air.words, air.second, air.third,
        dtype(air.wind[0]), dtype(air.wind[1]), dtype(air.wind[2]),
        dtype(1.0 / 3.0), dtype(air.drag), dtype(air.lift), air.room, air.forces, fx, fy, fz,
    )  # fmt: skip
    meet(team)
    collect(lo, hi, air.sorted_vertices, air.start, air.incoming, air.forces, fx, fy, fz)


@unit
def add_forces(g, team, substep, substeps, step):
    """Add the forces of a piece to those on a thread's vertices."""
    lo, hi = team.lo, team.hi
    for k in range(3):
        add_row(g.piece[k, lo:hi], g.forces[k, lo:hi])


@kernel
def add_row(piece, forces):
    """Add one coordinate of some forces to another's."""
    add(forces.size, piece, forces)


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
        k = np.uint64(2 * i)
        packed[k], packed[k + np.uint64(1)] = p[i], v[i]


@kernel
def pull(
    lo, hi, x, y, z, vx, vy, vz, words, used, second, stiffness, rest, damping, tiny, room, forces, fx, fy, fz
):  # fmt: skip
    """Compute the links of vertices lo to hi: set `f` to the forces on their owners, `forces` on the other ends [N]."""
    ends = room[lo // BLOCK]
    numbers = ends.view(x.dtype)
    own = numbers[2 * ENDS :]
    total = own[6 * BLOCK :]
    rows = second.shape[1]
    for block in range((lo + BLOCK - 1) // BLOCK, (hi + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        n = min(BLOCK, hi - start)
        take(n, x[start:], y[start:], z[start:], own)
        take(n, vx[start:], vy[start:], vz[start:], own[3 * BLOCK :])
        for i in range(3 * BLOCK):
            total[i] = 0
        for d in range(used[block]):
            fetch(second[block, d], words[0], words[1], words[2], ends)
            pull_row(
                numbers, own, stiffness[block, d], rest[block, d], damping, tiny,
                forces[(block * rows + d) * ENDS :], total,
            )  # fmt: skip
        copy(n, total, fx[start:])
        copy(n, total[BLOCK:], fy[start:])
        copy(n, total[2 * BLOCK :], fz[start:])


@inlined
def take(n, a, b, c, to):
    """Copy n entries of three arrays behind one another, BLOCK apart."""
    copy(n, a, to)
    copy(n, b, to[BLOCK:])
    copy(n, c, to[2 * BLOCK :])


@inlined
def copy(n, numbers, to):
    """Copy n numbers; in a loop over several arrays LLVM asks of each number whether it is counted from the end."""
    for i in range(n):
        to[i] = numbers[i]


@inlined
def add(n, numbers, to):
    """Add n numbers to others."""
    for i in range(n):
        to[i] += numbers[i]


@inlined
def fetch(others, a, b, c, to):
    """Copy the entries of three arrays with the BLOCK given indices behind one another."""
    for k in range(BLOCK):
        j = others[k]
        to[k], to[BLOCK + k], to[2 * BLOCK + k] = a[j], b[j], c[j]


@inlined
def pull_row(ends, own, stiffness, rest, damping, tiny, forces, total):
    """One row of links: `ends` holds the other ends' coordinates and velocities in turns."""
    for i in range(BLOCK):
        x, y, z = 2 * i, 2 * (BLOCK + i), 2 * (2 * BLOCK + i)
        dx, dy, dz = ends[x] - own[i], ends[y] - own[BLOCK + i], ends[z] - own[2 * BLOCK + i]
        ux, uy, uz = (
            ends[x + 1] - own[3 * BLOCK + i],
            ends[y + 1] - own[4 * BLOCK + i],
            ends[z + 1] - own[5 * BLOCK + i],
        )
        squared = dx * dx + dy * dy + dz * dz + tiny
        stretched = squared - rest[i] * math.sqrt(squared) + damping * (ux * dx + uy * dy + uz * dz)
        along = stiffness[i] * stretched / squared
        px, py, pz = along * dx, along * dy, along * dz
        total[i] += px
        total[BLOCK + i] += py
        total[2 * BLOCK + i] += pz
        forces[i], forces[BLOCK + i], forces[2 * BLOCK + i] = -px, -py, -pz


@kernel
def push(
    lo, hi, x, y, z, vx, vy, vz, words, second, third, wind_x, wind_y, wind_z, share, drag, lift, room, forces,
    fx, fy, fz,
):  # fmt: skip
    """Add a third of the air's force on the triangles of vertices lo to hi to their owners, keep it for other corners.

    `drag` and `lift` as in `grid.triangle_air_force`; `share` is 1/3.
    """
    ends = room[lo // BLOCK]
    corners = ends.view(x.dtype)
    own, others = corners[4 * ENDS :], ends[ENDS:]
    rows = second.shape[1]
    for block in range((lo + BLOCK - 1) // BLOCK, (hi + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        n = min(BLOCK, hi - start)
        take(n, x[start:], y[start:], z[start:], own)
        take(n, vx[start:], vy[start:], vz[start:], own[3 * BLOCK :])
        total = own[6 * BLOCK :]
        for i in range(3 * BLOCK):
            total[i] = 0
        for d in range(rows):
            fetch(second[block, d], words[0], words[1], words[2], ends)
            fetch(third[block, d], words[0], words[1], words[2], others)
            push_row(
                corners, corners[2 * ENDS :], own, wind_x, wind_y, wind_z, share, drag, lift,
                forces[(block * rows + d) * ENDS :], total,
            )  # fmt: skip
        add(n, total, fx[start:])
        add(n, total[BLOCK:], fy[start:])
        add(n, total[2 * BLOCK :], fz[start:])


@inlined
def push_row(a, b, own, wind_x, wind_y, wind_z, share, drag, lift, forces, total):
    """One row of triangles: `a` and `b` hold the other corners' coordinates and velocities in turns."""
    for i in range(BLOCK):
        x, y, z = 2 * i, 2 * (BLOCK + i), 2 * (2 * BLOCK + i)
        px, py, pz = triangle_air_force(
            a[x] - own[i],
            a[y] - own[BLOCK + i],
            a[z] - own[2 * BLOCK + i],
            b[x] - own[i],
            b[y] - own[BLOCK + i],
            b[z] - own[2 * BLOCK + i],
            wind_x - share * (own[3 * BLOCK + i] + a[x + 1] + b[x + 1]),
            wind_y - share * (own[4 * BLOCK + i] + a[y + 1] + b[y + 1]),
            wind_z - share * (own[5 * BLOCK + i] + a[z + 1] + b[z + 1]),
            type(share)(1.0),
            drag,
            lift,
        )
        total[i] += px
        total[BLOCK + i] += py
        total[2 * BLOCK + i] += pz
        forces[i], forces[BLOCK + i], forces[2 * BLOCK + i] = px, py, pz


@kernel
def collect(lo, hi, sorted_vertices, start, incoming, forces, fx, fy, fz):
    """Add to each vertex lo to hi the forces that others' links or triangles keep for it [N].

    `sorted_vertices` (N,) are those of each block by the length of their lists; `start` (slices + 1,) says where in
    `incoming` the lists of the next SLICE of them begin, all equally long.
    """
    for piece in range((lo + SLICE - 1) // SLICE, (hi + SLICE - 1) // SLICE):
        first = piece * SLICE
        width = np.uint64((start[piece + 1] - start[piece]) // SLICE)
        vertices, lists = sorted_vertices[first:], incoming[start[piece] :]
        k = np.uint64(0)
        for i in range(min(SLICE, hi - first)):
            v = vertices[i]
            ax, ay, az = fx[v], fy[v], fz[v]
            for _ in range(width):
                e = np.uint64(lists[k])
                k += np.uint64(1)
                ax, ay, az = ax + forces[e], ay + forces[e + NEXT], az + forces[e + NEXT + NEXT]
            fx[v], fy[v], fz[v] = ax, ay, az
