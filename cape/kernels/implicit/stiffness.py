"""Products with the matrix of a Newton step, without ever storing it, and its block diagonal.

The matrix is A = M/b^2 + K, with K a positive semidefinite stand-in for minus the derivative of the forces with respect
to the positions, where velocities follow these as v = (x - xt)/b:

    spring:   k (1 + tau/b) u u^T + k max(0, 1 - l0/l) (I - u u^T)    Choi and Ko 2002, section 4: a compressed spring
                                                                     has no negative stiffness across
            = w w^T + c I  with  c = k max(0, 1 - l0/l),  w = (k (1 + tau/b) - c)^1/2 u
    bend:     k (1 + tau_b/b) times the outer product of its coefficients, exactly
    own:      a symmetric 3x3 block of each vertex: mass, diagonal of the bends, air, contact, soft attachments

Vectors have shape (3, L): `front` zeros, the N vertices, zeros to a multiple of 64, `front` zeros, so that a stencil
never leaves the array. Blocks are stored as the rows xx, yy, zz, xy, xz, yz.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.cloth.grid import GridBends, GridSprings
from cape.kernels.implicit.linearise import linearised
from cape.kernels.jit import inlined, kernel, routine, unit
from cape.kernels.solve.soft import Pull
from cape.kernels.state import State

Array = NDArray[np.floating]


class Matrix(NamedTuple):
    """What the matrix of a Newton step is made of, whatever the springs: vectors and rows of length L.

    `bend_diagonal` [N/m], `mass` [kg] and `free`, 0 for attached vertices, (L,); `own` blocks (6, L), and the `inverse`
    of A's block diagonal (6, L). Of `vectors` (5, 3, L) the products are of the fourth, into the last. `damping` and
    `bend_damping` are damping times [s], 0 for none.
    """

    front: int
    bend_diagonal: Array
    mass: Array
    free: Array
    own: Array
    inverse: Array
    vectors: Array
    damping: float
    bend_damping: float


class Blocks(NamedTuple):
    """The matrix, and what contact adds to its own blocks [N/m] (6, N)."""

    matrix: Matrix
    contact: Array


class PullBlocks(NamedTuple):
    """The matrix of an implicit stage, to which springs are added."""

    pull: Pull
    matrix: Matrix


class GridStiffness(NamedTuple):
    """The matrix of a grid cloth.

    `coefficients` holds w and c of each spring (4 F, L). `couplings` are those by bending [N/m] (5, L), None without
    any: of a vertex with the next and the second next along its row, the same down its column, and of the corners of
    its cell that face each other; `scratch` (3, L) is a thread's own.
    """

    state: State
    springs: GridSprings
    bends: GridBends | None
    matrix: Matrix
    coefficients: Array
    couplings: Array | None
    scratch: Array


# -- products: q = A p --


@unit
def multiply_own(g, team, substep, substeps, b):
    """Set q to the product of p with the own blocks of a thread's vertices."""
    m, p, q, a, e = g.own, g.vectors[3], g.vectors[4], g.front + team.lo, g.front + team.hi
    multiply_blocks(
        m[0, a:e], m[1, a:e], m[2, a:e], m[3, a:e], m[4, a:e], m[5, a:e], p[0, a:e], p[1, a:e], p[2, a:e],
        q[0, a:e], q[1, a:e], q[2, a:e],
    )  # fmt: skip


@unit
def multiply_grid(g, team, substep, substeps, b):
    """Add the product of p with a grid's springs and bend springs to q."""
    matrix = g.matrix
    p, q = matrix.vectors[3], matrix.vectors[4]
    add_grid_product(team.lo, team.hi, g.springs, matrix.front, g.coefficients, g.scratch, p, q)
    _add_bends(team.lo, team.hi, g, g.bends, damped(matrix.bend_damping, b), p, q)


@routine
def _add_bends(lo, hi, g, bends, scale, p, q):
    if bends is not None:
        add_grid_bend_product(lo, hi, bends, q.dtype.type(scale), g.matrix.front, g.couplings, p, q)


# -- linearising at a state --


@unit
def linearise_springs(g, team, substep, substeps, b):
    """Find w and c of a grid's springs."""
    s, matrix = g.state, g.matrix
    stretched = s.x.dtype.type(damped(matrix.damping, b))
    linearise_grid(team.lo, team.hi, s, g.springs, stretched, matrix.front, g.coefficients)


@unit
def set_own(g, team, substep, substeps, b):
    """Set the own blocks of a thread's vertices: masses and the diagonal of the bends."""
    m, a, e = g.own, g.front + team.lo, g.front + team.hi
    dtype = g.inverse.dtype.type
    set_blocks(
        dtype(1.0 / (b * b)), dtype(damped(g.bend_damping, b)), g.mass[a:e], g.bend_diagonal[a:e],
        m[0, a:e], m[1, a:e], m[2, a:e], m[3, a:e], m[4, a:e], m[5, a:e],
    )  # fmt: skip


@unit
def add_contact_blocks(g, team, substep, substeps, b):
    """Add contact to the own blocks of a thread's vertices."""
    lo, hi, front = team.lo, team.hi, g.matrix.front
    for row in range(6):
        add(g.contact[row, lo:hi], g.matrix.own[row, front + lo : front + hi])


@unit
def add_pull_blocks(g, team, substep, substeps, b):
    """Add springs to the own blocks of a thread's vertices."""
    pull, own, front = g.pull, g.matrix.own, g.matrix.front
    vertices = pull.attached.vertices
    for k in range(vertices.size):
        i = vertices[k]
        if i < team.lo or i >= team.hi:
            continue
        held = own.dtype.type(pull.stiffness[k] + pull.damping[k] / b)
        for row in range(3):
            own[row, front + i] += held


@unit
def start_diagonal(g, team, substep, substeps, b):
    """Begin the block diagonal of the matrix with the own blocks."""
    a, e = g.front + team.lo, g.front + team.hi
    for row in range(6):
        copy(g.own[row, a:e], g.inverse[row, a:e])


@unit
def add_grid_diagonal(g, team, substep, substeps, b):
    """Add a grid's springs to the block diagonal."""
    add_grid_blocks(team.lo, team.hi, g.springs, g.matrix.front, g.coefficients, g.matrix.inverse)


@unit
def invert_diagonal(g, team, substep, substeps, b):
    """Replace the blocks of the diagonal by their inverses."""
    n, a, e = g.inverse, g.front + team.lo, g.front + team.hi
    invert_blocks(g.free[a:e], n[0, a:e], n[1, a:e], n[2, a:e], n[3, a:e], n[4, a:e], n[5, a:e])


@kernel
def linearise_family(offset, stretched, tiny, x, y, z, stiffness, rest, wx, wy, wz, c):
    """Fill w and c of one family's springs, from vertex i to i + offset."""
    x1, y1, z1 = x[offset:], y[offset:], z[offset:]
    for i in range(wx.size):
        wx[i], wy[i], wz[i], c[i] = linearised(
            x1[i] - x[i], y1[i] - y[i], z1[i] - z[i], stiffness[i], rest[i], stretched, tiny
        )


@kernel
def add_family_product(offset, wx, wy, wz, c, px, py, pz, sx, sy, sz, qx, qy, qz):
    """Add the product of one family with p to q.

    q begins at the first vertex wanted; the springs and p begin `offset` before it, with those springs that end there.
    """
    count = qx.size
    p1x, p1y, p1z = px[offset:], py[offset:], pz[offset:]
    for i in range(count + offset):
        dx, dy, dz = px[i] - p1x[i], py[i] - p1y[i], pz[i] - p1z[i]
        along = wx[i] * dx + wy[i] * dy + wz[i] * dz
        sx[i] = along * wx[i] + c[i] * dx
        sy[i] = along * wy[i] + c[i] * dy
        sz[i] = along * wz[i] + c[i] * dz
    s1x, s1y, s1z = sx[offset:], sy[offset:], sz[offset:]
    for i in range(count):
        qx[i] += s1x[i] - sx[i]
        qy[i] += s1y[i] - sy[i]
        qz[i] += s1z[i] - sz[i]


@kernel
def add_bend_product(offset, scale, near, far, px, py, pz, qx, qy, qz):
    """Add the couplings of a vertex along a row or down a column: those with the next ones and the second next.

    q begins at the first vertex wanted, `near`, `far` and p two offsets before it.
    """
    near0, near1, far1 = near[offset:], near[2 * offset :], far[2 * offset :]
    x1, y1, z1 = px[offset:], py[offset:], pz[offset:]
    x3, y3, z3 = px[3 * offset :], py[3 * offset :], pz[3 * offset :]
    x4, y4, z4 = px[4 * offset :], py[4 * offset :], pz[4 * offset :]
    for i in range(qx.size):
        a, b, c, d = far[i], near0[i], near1[i], far1[i]
        qx[i] += scale * (a * px[i] + b * x1[i] + c * x3[i] + d * x4[i])
        qy[i] += scale * (a * py[i] + b * y1[i] + c * y3[i] + d * y4[i])
        qz[i] += scale * (a * pz[i] + b * z1[i] + c * z3[i] + d * z4[i])


@kernel
def add_twist_product(columns, scale, cells, px, py, pz, qx, qy, qz):
    """Add the couplings of opposite corners of the cells, of those that start from each vertex.

    q begins at the first vertex wanted, `cells` and p a row and a vertex before it.
    """
    above, left, own = cells[1:], cells[columns:], cells[columns + 1 :]
    x1, y1, z1 = px[2:], py[2:], pz[2:]
    x2, y2, z2 = px[2 * columns :], py[2 * columns :], pz[2 * columns :]
    x3, y3, z3 = px[2 * columns + 2 :], py[2 * columns + 2 :], pz[2 * columns + 2 :]
    for i in range(qx.size):
        a, b, c, d = cells[i], above[i], left[i], own[i]
        qx[i] += scale * (a * px[i] + b * x1[i] + c * x2[i] + d * x3[i])
        qy[i] += scale * (a * py[i] + b * y1[i] + c * y2[i] + d * y3[i])
        qz[i] += scale * (a * pz[i] + b * z1[i] + c * z2[i] + d * z3[i])


@kernel
def multiply_blocks(xx, yy, zz, xy, xz, yz, px, py, pz, qx, qy, qz):
    """Set q to the product of each vertex's block with p."""
    for i in range(qx.size):
        x, y, z = px[i], py[i], pz[i]
        qx[i] = xx[i] * x + xy[i] * y + xz[i] * z
        qy[i] = xy[i] * x + yy[i] * y + yz[i] * z
        qz[i] = xz[i] * x + yz[i] * y + zz[i] * z


@kernel
def add_family_blocks(offset, wx, wy, wz, c, xx, yy, zz, xy, xz, yz):
    """Add one family's springs to the blocks of both their ends; the springs begin `offset` before the blocks."""
    w1x, w1y, w1z, c1 = wx[offset:], wy[offset:], wz[offset:], c[offset:]
    for i in range(xx.size):
        both = c[i] + c1[i]
        xx[i] += wx[i] * wx[i] + w1x[i] * w1x[i] + both
        yy[i] += wy[i] * wy[i] + w1y[i] * w1y[i] + both
        zz[i] += wz[i] * wz[i] + w1z[i] * w1z[i] + both
        xy[i] += wx[i] * wy[i] + w1x[i] * w1y[i]
        xz[i] += wx[i] * wz[i] + w1x[i] * w1z[i]
        yz[i] += wy[i] * wz[i] + w1y[i] * w1z[i]


@kernel
def invert_blocks(free, xx, yy, zz, xy, xz, yz):
    """Replace each block by its inverse, by 0 where `free` is 0."""
    for i in range(xx.size):
        a, b, c, d, e, f = xx[i], yy[i], zz[i], xy[i], xz[i], yz[i]
        minor_x, minor_y, minor_z = b * c - f * f, e * f - d * c, d * f - b * e
        scale = free[i] / (a * minor_x + d * minor_y + e * minor_z)
        xx[i] = scale * minor_x
        xy[i] = scale * minor_y
        xz[i] = scale * minor_z
        yy[i] = scale * (a * c - e * e)
        yz[i] = scale * (d * e - a * f)
        zz[i] = scale * (a * b - d * d)


@kernel
def copy(values, out):
    """Set `out` to the values."""
    for i in range(out.size):
        out[i] = values[i]


@kernel
def add(values, out):
    """Add the values to `out`."""
    for i in range(out.size):
        out[i] += values[i]


@kernel
def set_blocks(mass_scale, bend_scale, mass, bend_diagonal, xx, yy, zz, xy, xz, yz):
    """Set the own blocks to mass/b^2 plus the diagonal of the bends; scaled by 1/b^2 and 1 + tau_b/b."""
    for i in range(xx.size):
        xx[i] = yy[i] = zz[i] = mass_scale * mass[i] + bend_scale * bend_diagonal[i]
        xy[i] = xz[i] = yz[i] = 0


@routine
def linearise_grid(lo, hi, s, springs, stretched, front, coefficients):
    """Fill w and c of the springs of a grid that start from vertices lo to hi."""
    dtype = s.x.dtype.type
    for family in range(springs.offsets.size):
        offset = springs.offsets[family]
        end = min(hi, s.x.size - offset)
        if end > lo:
            a, e = front + lo, front + end
            w = coefficients[4 * family : 4 * family + 4]
            linearise_family(
                offset, stretched, dtype(1e-18), s.x[lo:], s.y[lo:], s.z[lo:],
                springs.stiffness[family, lo:], springs.rest[family, lo:], w[0, a:e], w[1, a:e], w[2, a:e], w[3, a:e],
            )  # fmt: skip


@routine
def add_grid_product(lo, hi, springs, front, coefficients, scratch, p, q):
    """Add the product of a grid's springs with p to q on the vertices lo to hi; `scratch` is this thread's own."""
    a, e = front + lo, front + hi
    for family in range(springs.offsets.size):
        offset = springs.offsets[family]
        w, b = coefficients[4 * family : 4 * family + 4], a - offset
        add_family_product(
            offset, w[0, b:], w[1, b:], w[2, b:], w[3, b:], p[0, b:], p[1, b:], p[2, b:],
            scratch[0], scratch[1], scratch[2], q[0, a:e], q[1, a:e], q[2, a:e],
        )  # fmt: skip


@routine
def add_grid_bend_product(lo, hi, bends, scale, front, couplings, p, q):
    """Add the product of a grid's bend springs with p to q, without their diagonal, on the vertices lo to hi."""
    a, e = front + lo, front + hi
    for family in range(bends.offsets.size):
        offset = bends.offsets[family]
        b = a - 2 * offset
        add_bend_product(
            offset, scale, couplings[2 * family, b:], couplings[2 * family + 1, b:],
            p[0, b:], p[1, b:], p[2, b:], q[0, a:e], q[1, a:e], q[2, a:e],
        )  # fmt: skip
    b = a - bends.offsets[1] - 1
    add_twist_product(
        bends.offsets[1], scale, couplings[4, b:], p[0, b:], p[1, b:], p[2, b:], q[0, a:e], q[1, a:e], q[2, a:e]
    )


@routine
def add_grid_blocks(lo, hi, springs, front, coefficients, blocks):
    """Add a grid's springs to the blocks of the vertices lo to hi."""
    a, e = front + lo, front + hi
    for family in range(springs.offsets.size):
        offset = springs.offsets[family]
        w, b = coefficients[4 * family : 4 * family + 4], a - offset
        add_family_blocks(
            offset, w[0, b:], w[1, b:], w[2, b:], w[3, b:],
            blocks[0, a:e], blocks[1, a:e], blocks[2, a:e], blocks[3, a:e], blocks[4, a:e], blocks[5, a:e],
        )  # fmt: skip


@inlined
def damped(damping_time, b):
    """What damping multiplies a stiffness by: 1 + tau/b."""
    return 1.0 + damping_time / b
