"""Forces on a cloth whose vertices are a grid, stored row after row in flat arrays.

Every spring belongs to the vertex it starts from, so that springs of a family are one contiguous loop without any index
array; those that would leave the grid (from a row's end to the next row's start) have stiffness 0. A tile of vertices
takes three loops: `copy_state` looks at them and their neighbours, `set_fluxes` computes what each spring passes from
its first to its second end, `add_up` gives every vertex what leaves and what arrives.

The room's arrays lie `STRIDE` apart, a constant: all of them are then addressed by one register, where twenty pointers
would be reloaded from the stack in every iteration. Indices are unsigned: a sign would cost a branch that keeps LLVM
from vectorising.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from cape.kernels.absent import typed
from cape.kernels.fused import fused
from cape.kernels.jit import inlined, kernel, routine, unit
from cape.kernels.state import State, aligned

Array = NDArray[np.floating]
Indices = NDArray[np.int64]

LANES = 16  # floats in a vector; stores of a tile start on its border
STRIDE = 16384 + 3 * LANES  # no power of two: arrays would compete for the same lines of the cache
SMALL_TILE, LARGE_TILE = 2048, 8192  # vertices; the former for narrow grids
MOST_COLUMNS = (STRIDE - LARGE_TILE - 4 * LANES) // 3

ONE = np.uint64(1)
# Rows of the stiffness of bends.
BEND_ACROSS, BEND_DOWN, TWIST = range(3)
# Where each array starts: in the window of the state, and in the fluxes along x (y and z follow) of each family.
X, Y, Z, VX, VY, VZ, QX, QY, QZ = (np.uint64(k * STRIDE) for k in range(9))
RIGHT, DOWN, DIAGONAL, ANTIDIAGONAL = (np.uint64(3 * k * STRIDE) for k in range(4))
TO_Y, TO_Z = np.uint64(STRIDE), np.uint64(2 * STRIDE)
# The same room for the air: on a cell's first corner, on the two that its triangles share, and on the last.
FIRST, SHARED, LAST = RIGHT, DOWN, DIAGONAL


class GridSprings(NamedTuple):
    """Springs of a grid cloth by family, zero where a spring would leave the grid.

    `offsets` (4,) to the right, down and along both diagonals; `stiffness` [N/m] and `rest` [m] (4, N).
    """

    offsets: Indices
    stiffness: Array
    rest: Array


class GridBends(NamedTuple):
    """Bending of a grid cloth, see `grid_bends`: `offsets` (2,) of springs across and down, `stiffness` [N/m] of these
    and of the twist of cells (3, c + N), where a row of c vertices before the first starts nothing."""

    offsets: Indices
    stiffness: Array


class GridAir(NamedTuple):
    """Uniform wind [m/s] (3,), rho Cd / 12 and rho Cl / 12 [kg/m3], and 1 where a grid cell starts, (N,)."""

    wind: Array
    drag: float
    lift: float
    cells: Array
    columns: int


class GridRoom(NamedTuple):
    """Scratch of one thread: the state of a tile and its neighbours, and what springs or cells exert."""

    window: NDArray[np.floating]
    fluxes: NDArray[np.floating]


def grid_bends(springs: Array, twist: Array, columns: int, dtype: DTypeLike) -> GridBends:
    """Lay out bending as `grid_forces` reads it.

    The stiffness [N/m] of springs across and down, (2, N), and against the twist of cells, (N,), stands at the first
    vertex of each; it is zero where one would leave the grid.
    """
    stiffness = np.zeros((3, columns + len(twist)), dtype)
    stiffness[:TWIST, columns:], stiffness[TWIST, columns:] = springs, twist
    return GridBends(np.array([1, columns]), stiffness)


def grid_room(dtype: DTypeLike) -> GridRoom:
    """Make the scratch that `grid_forces` and `grid_air_forces` need, one for each thread."""
    return GridRoom(aligned(9 * STRIDE, dtype), aligned(12 * STRIDE, dtype))


class GridForces(NamedTuple):
    """Springs and bend springs of a grid cloth, which set `forces` (3, N) [N]; what it lacks is None.

    `damping` and `bend_damping` are damping times [s]; `room` is the scratch of a thread.
    """

    state: State
    springs: GridSprings
    bends: GridBends | None
    damping: float | None
    bend_damping: float | None
    forces: Array
    room: GridRoom


class GridAirForces(NamedTuple):
    """Air around a grid cloth, which adds to `forces` (3, N) [N]; `room` is the scratch of a thread."""

    state: State
    air: GridAir
    forces: Array
    room: GridRoom


@unit
def grid_springs(g, team, substep, substeps, step):
    """Set the forces on a thread's vertices to those of the springs."""
    grid_forces(g, team.lo, team.hi)


@unit
def grid_air(g, team, substep, substeps, step):
    """Add the forces of the air on a thread's vertices."""
    grid_air_forces(g, team.lo, team.hi)


@routine
def grid_forces(g, lo, hi):
    """Set the forces of `GridForces` on vertices lo to hi.

    Offsets of springs are (1, c, c + 1, c - 1) for c columns, 2 to `MOST_COLUMNS`. The bits of forces don't depend on
    where a range of vertices is split.
    """
    columns, fluxes = g.springs.offsets[1], g.room.fluxes
    fx, fy, fz = g.forces[0], g.forces[1], g.forces[2]
    reach = columns + 1
    tile = tile_size(columns)
    to = round_up(reach)
    # What arrives from vertices before lo, where there are any.
    start = max(lo - reach, 0)
    clear(np.uint64(to - reach), np.uint64(reach), fluxes)
    if start < lo:
        spring_tile(g, start, lo, to - (lo - start))
    for begin in range(lo, hi, tile):
        end = min(begin + tile, hi)
        spring_tile(g, begin, end, to)
        add_up(np.uint64(begin), np.uint64(end - begin), np.uint64(to), np.uint64(columns), fluxes, fx, fy, fz)
        if end < hi:
            keep_tail(np.uint64(to + tile - reach), np.uint64(to - reach), np.uint64(reach), fluxes)


@inlined
def tile_size(columns):
    """Vertices of a tile: many compared to those that its window adds, and still in the cache."""
    return min(max(SMALL_TILE, 8 * columns // LANES * LANES), LARGE_TILE)


@inlined
def round_up(count):
    """The next multiple of a vector's length."""
    return (count + LANES - 1) // LANES * LANES


@inlined
def stiffness_of(bends):
    """Stiffness of bend springs; None for none."""
    if bends is None:
        return None
    return bends.stiffness


@routine
def spring_tile(g, begin, end, to):
    """Fluxes of the springs that start from vertices begin to end, to the room's place `to`."""
    s, n, window, columns = g.state, g.state.x.size, g.room.window, g.springs.offsets[1]
    damping, bend_damping, bends = typed(g.damping, s.x), typed(g.bend_damping, s.x), stiffness_of(g.bends)
    at = round_up(columns)
    # Bend springs reach `columns` back and twice as far ahead. Where there is no vertex, the window has zeros.
    first, last = begin - at, end + round_up(2 * columns)
    if first < 0:
        clear(np.uint64(0), np.uint64(-first), window)
        first = 0
    if last > n:
        clear(np.uint64(at + n - begin), np.uint64(last - n), window)
        last = n
    copy_state(
        np.uint64(first), np.uint64(last - first), np.uint64(at + first - begin),
        s.x, s.y, s.z, s.vx, s.vy, s.vz, damping, bends, bend_damping, window,
    )  # fmt: skip
    set_fluxes(
        np.uint64(begin), np.uint64(end - begin), np.uint64(at), np.uint64(to), np.uint64(columns),
        window, g.springs.stiffness, g.springs.rest, damping, bends, g.room.fluxes,
    )  # fmt: skip


@kernel
def clear(start, count, room):
    """Set entries of all arrays of a window or of fluxes to zero."""
    for array in range(room.size // STRIDE):
        o = np.uint64(array * STRIDE) + start
        for k in range(count):
            room[o + k] = 0


@kernel
def keep_tail(start, to, count, fluxes):
    """Move the last fluxes of a tile to before the next one's."""
    for array in range(12):
        o = np.uint64(array * STRIDE)
        for k in range(count):
            fluxes[o + to + k] = fluxes[o + start + k]


@kernel
def copy_state(begin, count, at, x, y, z, vx, vy, vz, damping, bends, bend_damping, w):
    """Copy the state of vertices to the window and, where there are bends, q = p + tau v, in which these are linear."""
    for k in range(count):
        i, o = begin + k, at + k
        w[X + o], w[Y + o], w[Z + o] = x[i], y[i], z[i]
        if damping is not None:
            w[VX + o], w[VY + o], w[VZ + o] = vx[i], vy[i], vz[i]
        if bends is not None:
            if bend_damping is not None:
                w[QX + o] = fused(bend_damping, vx[i], x[i])
                w[QY + o] = fused(bend_damping, vy[i], y[i])
                w[QZ + o] = fused(bend_damping, vz[i], z[i])
            else:
                w[QX + o], w[QY + o], w[QZ + o] = x[i], y[i], z[i]


@kernel
def set_fluxes(begin, count, at, to, columns, w, stiffness, rest, damping, bends, fluxes):
    """What the springs that start from each vertex exert on it, and the opposite on their other ends [N].

    Vertices begin to begin + count are in the window `w` from `at` on, and their fluxes go to `to`. `bends` is their
    stiffness, of which that of vertex e stands at e + columns.
    """
    for k in range(count):
        i, e = at + k, begin + k
        right, down, own = i + ONE, i + columns, e + columns
        fx, fy, fz = spring_force(w, i, right, stiffness[0, e], rest[0, e], damping)
        if bends is not None:
            first, second = bends[BEND_ACROSS, own - ONE], bends[BEND_ACROSS, own]
            fx = bend_flux(fx, w, QX + i - ONE, QX + i, QX + right, QX + right + ONE, first, second)
            fy = bend_flux(fy, w, QY + i - ONE, QY + i, QY + right, QY + right + ONE, first, second)
            fz = bend_flux(fz, w, QZ + i - ONE, QZ + i, QZ + right, QZ + right + ONE, first, second)
        o = RIGHT + to + k
        fluxes[o], fluxes[o + TO_Y], fluxes[o + TO_Z] = fx, fy, fz

        fx, fy, fz = spring_force(w, i, down, stiffness[1, e], rest[1, e], damping)
        if bends is not None:
            up, below = i - columns, down + columns
            first, second = bends[BEND_DOWN, e], bends[BEND_DOWN, own]
            fx = bend_flux(fx, w, QX + up, QX + i, QX + down, QX + below, first, second)
            fy = bend_flux(fy, w, QY + up, QY + i, QY + down, QY + below, first, second)
            fz = bend_flux(fz, w, QZ + up, QZ + i, QZ + down, QZ + below, first, second)
            first, second = bends[TWIST, own - ONE], bends[TWIST, own]
            fx = twist_flux(fx, w, QX + i, QX + down, first, second)
            fy = twist_flux(fy, w, QY + i, QY + down, first, second)
            fz = twist_flux(fz, w, QZ + i, QZ + down, first, second)
        o = DOWN + to + k
        fluxes[o], fluxes[o + TO_Y], fluxes[o + TO_Z] = fx, fy, fz

        o = DIAGONAL + to + k
        fx, fy, fz = spring_force(w, i, down + ONE, stiffness[2, e], rest[2, e], damping)
        fluxes[o], fluxes[o + TO_Y], fluxes[o + TO_Z] = fx, fy, fz

        o = ANTIDIAGONAL + to + k
        fx, fy, fz = spring_force(w, i, down - ONE, stiffness[3, e], rest[3, e], damping)
        fluxes[o], fluxes[o + TO_Y], fluxes[o + TO_Z] = fx, fy, fz


@inlined
def spring_force(w, i, j, stiffness, rest, damping):
    """Force on i of a spring to j [N]: k (l - l0 + tau dl/dt) u, u the unit vector towards j (Kelvin and Voigt)."""
    dx, dy, dz = w[X + j] - w[X + i], w[Y + j] - w[Y + i], w[Z + j] - w[Z + i]
    # A square nanometre keeps a spring of no length from dividing by zero.
    squared = fused(dx, dx, fused(dy, dy, fused(dz, dz, w.dtype.type(1e-18))))
    excess = fused(-rest, math.sqrt(squared), squared)
    if damping is not None:
        vx, vy, vz = w[VX + j] - w[VX + i], w[VY + j] - w[VY + i], w[VZ + j] - w[VZ + i]
        excess = fused(damping, fused(vx, dx, fused(vy, dy, vz * dz)), excess)
    pull = stiffness * excess / squared
    return pull * dx, pull * dy, pull * dz


@inlined
def bend_flux(flux, w, before, i, j, after, first, second):
    """A flux and what bend springs pass from i to j along one coordinate [N], of four places in a row with two springs.

    A bend spring on a, b, c has the energy 1/2 k (q_a - 2 q_b + q_c)^2, the flat-rest quadratic bending energy (Bergou
    2006, eq. 4, on a regular grid). Its forces (-D, 2 D, -D), D = k (q_a - 2 q_b + q_c), are those of two opposite
    fluxes, -D from a to b and D from b to c.
    """
    step = w[j] - w[i]
    return fused(first, step - (w[i] - w[before]), fused(second, step - (w[after] - w[j]), flux))


@inlined
def twist_flux(flux, w, i, j, left, right):
    """A flux and what the cells on both sides of a thread pass down it from i to j along one coordinate [N].

    A cell has the energy 1/2 k (q_00 - q_10 - q_01 + q_11)^2. Its forces, with T = k (q_00 - q_10 - q_01 + q_11),
    are those of two opposite fluxes down its sides, -T on its left and T on its right one.
    """
    step = w[j] - w[i]
    return fused(left, step - (w[j - ONE] - w[i - ONE]), fused(right, step - (w[j + ONE] - w[i + ONE]), flux))


@kernel
def add_up(begin, count, to, columns, fluxes, fx, fy, fz):
    """Set the force on each vertex to what leaves it less what arrives at it [N]."""
    for k in range(count):
        i, o = begin + k, to + k
        fx[i] = net_flux(o, columns, fluxes)
        fy[i] = net_flux(o + TO_Y, columns, fluxes)
        fz[i] = net_flux(o + TO_Z, columns, fluxes)


@inlined
def net_flux(o, columns, fluxes):
    """What leaves a vertex less what arrives, along one coordinate [N]."""
    across = fluxes[RIGHT + o] - fluxes[RIGHT + o - ONE]
    along = fluxes[DOWN + o] - fluxes[DOWN + o - columns]
    diagonal = fluxes[DIAGONAL + o] - fluxes[DIAGONAL + o - columns - ONE]
    antidiagonal = fluxes[ANTIDIAGONAL + o] - fluxes[ANTIDIAGONAL + o - columns + ONE]
    return (across + along) + (diagonal + antidiagonal)


@routine
def grid_air_forces(g, lo, hi):
    """Add the forces of `GridAirForces` on vertices lo to hi; splits as `grid_forces`."""
    columns, fluxes = g.air.columns, g.room.fluxes
    fx, fy, fz = g.forces[0], g.forces[1], g.forces[2]
    reach = columns + 1
    tile = tile_size(columns)
    to = round_up(reach)
    start = max(lo - reach, 0)
    clear(np.uint64(to - reach), np.uint64(reach), fluxes)
    if start < lo:
        air_tile(g, start, lo, to - (lo - start))
    for begin in range(lo, hi, tile):
        end = min(begin + tile, hi)
        air_tile(g, begin, end, to)
        add_up_air(np.uint64(begin), np.uint64(end - begin), np.uint64(to), np.uint64(columns), fluxes, fx, fy, fz)
        if end < hi:
            keep_tail(np.uint64(to + tile - reach), np.uint64(to - reach), np.uint64(reach), fluxes)


@routine
def air_tile(g, begin, end, to):
    """Forces on the corners of the cells that start from vertices begin to end, to the room's place `to`."""
    s, air = g.state, g.air
    dtype, wind = s.x.dtype.type, air.wind
    # The last row starts no cells.
    last = max(begin, min(end, s.x.size - air.columns - 1))
    set_air_forces(
        np.uint64(begin), np.uint64(last - begin), np.uint64(to), np.uint64(air.columns),
        s.x, s.y, s.z, s.vx, s.vy, s.vz, air.cells, dtype(wind[0]), dtype(wind[1]), dtype(wind[2]),
        dtype(1.0 / 3.0), dtype(air.drag), dtype(air.lift), g.room.fluxes,
    )  # fmt: skip
    clear(np.uint64(to + last - begin), np.uint64(end - last), g.room.fluxes)


@kernel
def set_air_forces(
    begin, count, to, columns, x, y, z, vx, vy, vz, cells, wind_x, wind_y, wind_z, third, drag, lift, forces
):
    """A third of the air's forces on the triangles (first, right, down) and (last, down, right) of each cell [N]."""
    for k in range(count):
        i, o = begin + k, to + k
        r, d = i + ONE, i + columns
        e = d + ONE
        ux, uy, uz = vx[r] + vx[d], vy[r] + vy[d], vz[r] + vz[d]
        ax, ay, az = triangle_air_force(
            x[r] - x[i], y[r] - y[i], z[r] - z[i], x[d] - x[i], y[d] - y[i], z[d] - z[i],
            wind_x - third * (vx[i] + ux), wind_y - third * (vy[i] + uy), wind_z - third * (vz[i] + uz),
            cells[i], drag, lift,
        )  # fmt: skip
        bx, by, bz = triangle_air_force(
            x[d] - x[e], y[d] - y[e], z[d] - z[e], x[r] - x[e], y[r] - y[e], z[r] - z[e],
            wind_x - third * (vx[e] + ux), wind_y - third * (vy[e] + uy), wind_z - third * (vz[e] + uz),
            cells[i], drag, lift,
        )  # fmt: skip
        forces[FIRST + o], forces[FIRST + TO_Y + o], forces[FIRST + TO_Z + o] = ax, ay, az
        forces[SHARED + o], forces[SHARED + TO_Y + o], forces[SHARED + TO_Z + o] = ax + bx, ay + by, az + bz
        forces[LAST + o], forces[LAST + TO_Y + o], forces[LAST + TO_Z + o] = bx, by, bz


@inlined
def triangle_air_force(px, py, pz, qx, qy, qz, ux, uy, uz, present, drag, lift):
    """A third of the force of the air on a triangle with edges p and q from one corner, at relative wind u [N].

    F = rho/2 A (n.u) (Cd u + Cl (|u| n - (n.u/|u|) u)) with n the unit normal turned along u: drag on the projected
    area along u, lift across it. `drag` and `lift` are rho Cd / 12 and rho Cl / 12: a third, of a half, of half a cross
    product's length. `present` is 1, or 0 for no triangle.
    """
    nx, ny, nz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    flow = present * (nx * ux + ny * uy + nz * uz)
    squared = ux * ux + uy * uy + uz * uz
    # |n| |u|, never zero: without area or wind there is no flow either.
    product = math.sqrt((nx * nx + ny * ny + nz * nz) * squared + type(squared)(1e-30))
    share = lift * flow / product
    along, across = drag * abs(flow) - share * flow, share * squared
    return along * ux + across * nx, along * uy + across * ny, along * uz + across * nz


@kernel
def add_up_air(begin, count, to, columns, forces, fx, fy, fz):
    """Give each vertex its part of the forces on the four cells around it [N]."""
    for k in range(count):
        i, o = begin + k, to + k
        fx[i] += corner_sum(o, columns, forces)
        fy[i] += corner_sum(o + TO_Y, columns, forces)
        fz[i] += corner_sum(o + TO_Z, columns, forces)


@inlined
def corner_sum(o, columns, forces):
    """Sum over the four cells around a vertex, along one coordinate [N]."""
    shared = forces[SHARED + o - ONE] + forces[SHARED + o - columns]
    return (forces[FIRST + o] + forces[LAST + o - columns - ONE]) + shared
