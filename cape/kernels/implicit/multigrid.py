"""A multigrid preconditioner for the matrix of a Newton step, on the levels of `cape.assembly.multigrid.coarsening`.

Conjugate gradients with the block diagonal D alone take more iterations the finer the cloth: in a step of b seconds a
wave of speed c crosses c b / spacing vertices, and each iteration carries news by one. So z = D^-1 r is corrected by
what the nodes of a first level can do about r,

    z = D^-1 r + P C P^T r

with P the weights by which nodes move vertices, and C one V-cycle on their own matrix, see `levels`: a symmetric
preconditioner, as conjugate gradients need it (Tatebe 1993, "The multigrid preconditioned conjugate gradient method").
Coarse levels alone, a ninth of the vertices or less, take a step before and after their correction. On the vertices
themselves these would need two more products with A in each iteration, for half as many iterations: no gain.

D^-1 A of a level has no eigenvalue above 2, as (z_i - z_j) B (z_i - z_j) <= 2 z_i B z_i + 2 z_j B z_j. So damped Jacobi
steps converge whatever the cloth does, and need no estimate of eigenvalues.
"""

from typing import NamedTuple

from cape.kernels.cloth.mesh_bending import SIDE, pack_vectors, row_sum
from cape.kernels.implicit.levels import sum_lists
from cape.kernels.jit import kernel, routine, unit
from cape.kernels.program import Program, run
from cape.kernels.team import Team, meet, share

DAMPING = 0.75  # of Jacobi steps: what serves eigenvalues from 2/3 to 2 best, by algebra


class ByOne(NamedTuple):
    """What a single thread does, alone."""

    program: Program
    team: Team


@unit
def by_one(g, team, substep, substeps, b):
    """Let the first thread do what is too little to share."""
    if team.rank == 0:
        run(g.program, g.team, substep, substeps, b)
    meet(team)


# -- the cycle --


@unit
def pull_left(g, team, substep, substeps, b):
    """Begin a level with what is left of the finer one's residual."""
    level, moving = g.level, g.level.moving
    sum_lists(
        level.own.shape[1], g.finer.left, moving.start, moving.members, moving.weights, level.residual
    )  # fmt: skip
    begin(0, level.own.shape[1], level)


@unit
def find_left(g, team, substep, substeps, b):
    """Find what a level's first step leaves of its residual."""
    lo, hi = share(0, g.own.shape[1], team)
    leave(lo, hi, g)


@unit
def push_back(g, team, substep, substeps, b):
    """Correct the finer level by what came out of this one."""
    finer, level = g.finer, g.level
    lo, hi = share(0, finer.own.shape[1], team)
    nodes, weights, moved = level.nodes, level.weights, finer.moved
    for axis in range(3):
        push_nodes(
            nodes[0, lo:hi], nodes[1, lo:hi], nodes[2, lo:hi], weights[0, lo:hi], weights[1, lo:hi], weights[2, lo:hi],
            level.result[axis], moved[axis, lo:hi],
        )  # fmt: skip


@unit
def finish(g, team, substep, substeps, b):
    """Another step on a level, which gives its result."""
    lo, hi = share(0, g.own.shape[1], team)
    leave(lo, hi, g)
    m, t, z, out = g.inverse, g.left, g.moved, g.result
    relax(
        z.dtype.type(DAMPING), m[0, lo:hi], m[1, lo:hi], m[2, lo:hi], m[3, lo:hi], m[4, lo:hi], m[5, lo:hi],
        t[0, lo:hi], t[1, lo:hi], t[2, lo:hi], z[0, lo:hi], z[1, lo:hi], z[2, lo:hi],
        out[0, lo:hi], out[1, lo:hi], out[2, lo:hi],
    )  # fmt: skip


@routine
def begin(lo, hi, level):
    """Take a first step on nodes lo to hi, from 0."""
    m, r, z = level.inverse, level.residual, level.moved
    step(
        z.dtype.type(DAMPING), m[0, lo:hi], m[1, lo:hi], m[2, lo:hi], m[3, lo:hi], m[4, lo:hi], m[5, lo:hi],
        r[0, lo:hi], r[1, lo:hi], r[2, lo:hi], z[0, lo:hi], z[1, lo:hi], z[2, lo:hi],
    )  # fmt: skip


@routine
def leave(lo, hi, level):
    """Set what is left of the residual of nodes lo to hi: r - A z."""
    m, r, z, t = level.diagonal, level.residual, level.moved, level.left
    subtract_diagonal(
        m[0, lo:hi], m[1, lo:hi], m[2, lo:hi], m[3, lo:hi], m[4, lo:hi], m[5, lo:hi], r[0, lo:hi], r[1, lo:hi],
        r[2, lo:hi], z[0, lo:hi], z[1, lo:hi], z[2, lo:hi], t[0, lo:hi], t[1, lo:hi], t[2, lo:hi],
    )  # fmt: skip
    for k in range(level.neighbours.shape[0]):
        n = level.beside[k]
        add_neighbours(
            level.neighbours[k, lo:hi], n[0, lo:hi], n[1, lo:hi], n[2, lo:hi], n[3, lo:hi], n[4, lo:hi], n[5, lo:hi],
            z[0], z[1], z[2], t[0, lo:hi], t[1, lo:hi], t[2, lo:hi],
        )  # fmt: skip


@kernel
def step(damping, xx, yy, zz, xy, xz, yz, rx, ry, rz, zx, zy, zz_):
    """A damped Jacobi step from 0."""
    for i in range(rx.size):
        x, y, z = rx[i], ry[i], rz[i]
        zx[i] = damping * (xx[i] * x + xy[i] * y + xz[i] * z)
        zy[i] = damping * (xy[i] * x + yy[i] * y + yz[i] * z)
        zz_[i] = damping * (xz[i] * x + yz[i] * y + zz[i] * z)


@kernel
def relax(damping, xx, yy, zz, xy, xz, yz, tx, ty, tz, zx, zy, zz_, ox, oy, oz):
    """A damped Jacobi step from z, where t is left of the residual."""
    for i in range(tx.size):
        x, y, z = tx[i], ty[i], tz[i]
        ox[i] = zx[i] + damping * (xx[i] * x + xy[i] * y + xz[i] * z)
        oy[i] = zy[i] + damping * (xy[i] * x + yy[i] * y + yz[i] * z)
        oz[i] = zz_[i] + damping * (xz[i] * x + yz[i] * y + zz[i] * z)


@kernel
def subtract_diagonal(xx, yy, zz, xy, xz, yz, rx, ry, rz, zx, zy, zz_, tx, ty, tz):
    """Set t to r without the product of the diagonal with z."""
    for i in range(tx.size):
        x, y, z = zx[i], zy[i], zz_[i]
        tx[i] = rx[i] - (xx[i] * x + xy[i] * y + xz[i] * z)
        ty[i] = ry[i] - (xy[i] * x + yy[i] * y + yz[i] * z)
        tz[i] = rz[i] - (xz[i] * x + yz[i] * y + zz[i] * z)


@kernel
def add_neighbours(neighbours, xx, yy, zz, xy, xz, yz, zx, zy, zz_, tx, ty, tz):
    """Add the product of one block of each node with z of that neighbour."""
    for i in range(tx.size):
        j = neighbours[i]
        x, y, z = zx[j], zy[j], zz_[j]
        tx[i] += xx[i] * x + xy[i] * y + xz[i] * z
        ty[i] += xy[i] * x + yy[i] * y + yz[i] * z
        tz[i] += xz[i] * x + yz[i] * y + zz[i] * z


@kernel
def push_nodes(a, b, c, u, v, w, result, moved):
    """Add to one coordinate of finer nodes what those that move them do."""
    for i in range(moved.size):
        moved[i] += u[i] * result[a[i]] + v[i] * result[b[i]] + w[i] * result[c[i]]


# -- from vertices to the first level and back --


@unit
def pack_residual(g, team, substep, substeps, b):
    """Lay the residual of a mesh's vertices side by side."""
    r, lo, hi, front = g.matrix.vectors[1], team.lo, team.hi, g.matrix.front
    pack_vectors(lo, hi, r[0, front:], r[1, front:], r[2, front:], g.packed)


@unit
def pull_mesh(g, team, substep, substeps, b):
    """Begin the first level of a mesh with what the packed residual of the vertices asks of its nodes."""
    level, moving = g.level, g.level.moving
    lo, hi = share(0, level.own.shape[1], team)
    pull_vertices(
        lo, hi, moving.start, moving.members, moving.weights, g.packed, level.residual[0], level.residual[1],
        level.residual[2],
    )  # fmt: skip
    begin(lo, hi, level)


@unit
def push_mesh(g, team, substep, substeps, b):
    """Correct z of a mesh's vertices by what came out of the first level, and find the terms of r . z."""
    level, vectors, lo, hi = g.level, g.matrix.vectors, team.lo, team.hi
    r, z, out, a, e = vectors[1], vectors[2], level.result, g.matrix.front + lo, g.matrix.front + hi
    nodes, weights = level.nodes, level.weights
    push_vertices(
        nodes[0, lo:hi], nodes[1, lo:hi], nodes[2, lo:hi], weights[0, lo:hi], weights[1, lo:hi], weights[2, lo:hi],
        out[0], out[1], out[2], r[0, a:e], r[1, a:e], r[2, a:e], z[0, a:e], z[1, a:e], z[2, a:e], g.terms[a:e],
    )  # fmt: skip


@unit
def pull_grid(g, team, substep, substeps, b):
    """Begin the first level of a grid with what the residual of the vertices asks of its nodes."""
    level, between, r, front = g.level, g.between, g.matrix.vectors[1], g.matrix.front
    rows, across, width, count = between.rows, between.columns, between.width, between.columns.first.size
    room = between.room[team.rank]
    lo, hi = share(0, between.begin.size, team)
    for block in range(lo, hi):
        for axis in range(3):
            clear(room[axis])
        for row in range(between.begin[block], between.end[block]):
            a, w = front + row * count, rows.weight[row]
            if rows.first[row] != block:
                w = room.dtype.type(1) - w
            add_row(
                w, g.matrix.free[a : a + count], r[0, a : a + count], r[1, a : a + count], r[2, a : a + count],
                room[0], room[1], room[2],
            )  # fmt: skip
        for axis in range(3):
            out = level.residual[axis, block * width : (block + 1) * width]
            clear(out)
            pull_row(across.first, across.second, across.weight, room[axis], out)
    begin(lo * width, hi * width, level)


@unit
def push_grid(g, team, substep, substeps, b):
    """Correct z of a grid's vertices by what came out of the first level, and find the terms of r . z."""
    between, vectors, m, lo, hi = g.between, g.matrix.vectors, g.matrix, team.lo, team.hi
    rows, across, width, count = between.rows, between.columns, between.width, between.columns.first.size
    r, z, room = vectors[1], vectors[2], between.room[team.rank]
    # A row of blocks is in the first half of the room or in the second, by its number.
    known = -1
    for row in range(lo // count, (hi + count - 1) // count):
        first, second = rows.first[row], rows.second[row]
        for block in range(max(first, known + 1), second + 1):
            known = block
            for axis in range(3):
                push_row(
                    across.first, across.second, across.weight,
                    g.level.result[axis, block * width : (block + 1) * width], room[3 * (block % 2) + axis],
                )  # fmt: skip
        begin, end = max(lo, row * count), min(hi, (row + 1) * count)
        x0, x1, a, e = begin - row * count, end - row * count, m.front + begin, m.front + end
        i, j, w = 3 * (first % 2), 3 * (second % 2), rows.weight[row]
        correct_row(
            w, m.free[a:e], room[i, x0:x1], room[i + 1, x0:x1], room[i + 2, x0:x1],
            room[j, x0:x1], room[j + 1, x0:x1], room[j + 2, x0:x1],
            r[0, a:e], r[1, a:e], r[2, a:e], z[0, a:e], z[1, a:e], z[2, a:e], g.terms[a:e],
        )  # fmt: skip


@kernel
def clear(out):
    """Set all to 0."""
    for i in range(out.size):
        out[i] = 0


@kernel
def add_row(w, free, rx, ry, rz, ox, oy, oz):
    """Add a row of free vertices, times a weight: what is left over at held ones does not count."""
    for i in range(ox.size):
        u = free[i] * w
        ox[i] += u * rx[i]
        oy[i] += u * ry[i]
        oz[i] += u * rz[i]


@kernel
def pull_row(first, second, weight, values, out):
    """Gather a row of values into a row of blocks."""
    one = weight.dtype.type(1)
    for i in range(values.size):
        out[first[i]] += weight[i] * values[i]
        out[second[i]] += (one - weight[i]) * values[i]


@kernel
def push_row(first, second, weight, values, out):
    """Interpolate a row of blocks."""
    one = weight.dtype.type(1)
    for i in range(out.size):
        out[i] = weight[i] * values[first[i]] + (one - weight[i]) * values[second[i]]


@kernel
def correct_row(w, free, ax, ay, az, bx, by, bz, rx, ry, rz, zx, zy, zz, terms):
    """Add to z of a row of vertices what lies between two interpolated rows of blocks; the terms of r . z.

    Both rows may be the same one, which is only read.
    """
    one = free.dtype.type(1)
    for i in range(terms.size):
        u, v = free[i] * w, free[i] * (one - w)
        zx[i] += u * ax[i] + v * bx[i]
        zy[i] += u * ay[i] + v * by[i]
        zz[i] += u * az[i] + v * bz[i]
        terms[i] = rx[i] * zx[i] + ry[i] * zy[i] + rz[i] * zz[i]


@kernel
def pull_vertices(lo, hi, start, members, weights, packed, ox, oy, oz):
    """Sum what the vertices that each node moves leave over: what is packed, less its last point, which is 0."""
    nothing = packed.size - SIDE
    for node in range(lo, hi):
        ox[node], oy[node], oz[node] = row_sum(members, weights, packed, start[node], start[node + 1], nothing)


@kernel
def push_vertices(a, b, c, u, v, w, ox, oy, oz, rx, ry, rz, zx, zy, zz, terms):
    """Add to z of the vertices what the nodes that move them do; the terms of r . z."""
    for i in range(terms.size):
        j, k, m = a[i], b[i], c[i]
        zx[i] += u[i] * ox[j] + v[i] * ox[k] + w[i] * ox[m]
        zy[i] += u[i] * oy[j] + v[i] * oy[k] + w[i] * oy[m]
        zz[i] += u[i] * oz[j] + v[i] * oz[k] + w[i] * oz[m]
        terms[i] = rx[i] * zx[i] + ry[i] * zy[i] + rz[i] * zz[i]
