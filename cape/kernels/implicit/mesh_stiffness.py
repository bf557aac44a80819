"""Products with the stiffness of a mesh's springs, link by link as in `kernels.cloth.mesh`, and of its bending.

See `stiffness` for the matrix. Each link holds w and c of its spring: `coefficients` has the rows wx, wy, wz, c of each
row of links, (blocks, D, 4, BLOCK); `ends` is room for what each link keeps for its other end, laid out as the forces
there. Bending is a constant matrix, scaled by damping: `kernels.cloth.mesh_bending`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.cloth.mesh import BLOCK, ENDS, MeshSprings, collect
from cape.kernels.cloth.mesh_bending import MeshBends, add_rows, pack_vectors
from cape.kernels.implicit.linearise import linearised
from cape.kernels.implicit.stiffness import Matrix, damped
from cape.kernels.jit import inlined, kernel, routine, unit
from cape.kernels.state import State
from cape.kernels.team import meet

Array = NDArray[np.floating]


class MeshStiffness(NamedTuple):
    """The matrix of a mesh's springs; `coefficients` and `ends` are as the module tells."""

    state: State
    springs: MeshSprings
    matrix: Matrix
    coefficients: Array
    ends: Array


class MeshBendStiffness(NamedTuple):
    """The matrix of a mesh's bending, in the precision of the whole, and its `diagonal` [N/m] (L,)."""

    bends: MeshBends
    matrix: Matrix
    diagonal: Array


@unit
def multiply_mesh_bends(g, team, substep, substeps, b):
    """Add the product of p with a mesh's bending to q."""
    p, bends = g.matrix.vectors[3], g.bends
    pack_vectors(team.lo, team.hi, p[0], p[1], p[2], bends.packed)
    meet(team)
    add_bend_product(g, team, b)


@unit
def multiply_packed_bends(g, team, substep, substeps, b):
    """The same where a membrane has packed p."""
    add_bend_product(g, team, b)


@routine
def add_bend_product(g, team, b):
    """Add the product of what is packed with a mesh's bending to q."""
    q, bends, lo, hi = g.matrix.vectors[4], g.bends, team.lo, team.hi
    scale = q.dtype.type(-damped(g.matrix.bend_damping, b))
    add_rows(lo, hi, scale, bends.start, bends.others, bends.weight, bends.packed, q[0], q[1], q[2])


@unit
def add_mesh_bend_diagonal(g, team, substep, substeps, b):
    """Add a mesh's bending to the block diagonal."""
    lo, hi, blocks = team.lo, team.hi, g.matrix.inverse
    scale = blocks.dtype.type(damped(g.matrix.bend_damping, b))
    for coordinate in range(3):
        add_scaled(scale, g.diagonal[lo:hi], blocks[coordinate, lo:hi])


@kernel
def add_scaled(scale, values, out):
    """Add some values to `out`, scaled."""
    for i in range(out.size):
        out[i] += scale * values[i]


@unit
def multiply_mesh(g, team, substep, substeps, b):
    """Add the product of p with a mesh's links to q."""
    p, q, lo, hi = g.matrix.vectors[3], g.matrix.vectors[4], team.lo, team.hi
    multiply_links(lo, hi, g.springs.rows, g.springs.second, g.coefficients, p[0], p[1], p[2], g.ends, q[0], q[1], q[2])
    meet(team)
    gather(lo, hi, g.springs, g.ends, q[0], q[1], q[2])


@unit
def linearise_mesh(g, team, substep, substeps, b):
    """Find w and c of a mesh's links."""
    s, links, dtype = g.state, g.springs, g.state.x.dtype.type
    linearise_links(
        team.lo, team.hi, s.x, s.y, s.z, links.rows, links.second, links.stiffness, links.rest,
        dtype(damped(g.matrix.damping, b)), dtype(1e-18), g.coefficients,
    )  # fmt: skip


@unit
def add_mesh_diagonal(g, team, substep, substeps, b):
    """Add a mesh's links to the block diagonal."""
    lo, hi, blocks = team.lo, team.hi, g.matrix.inverse
    keep_entries(lo, hi, g.springs.rows, g.coefficients, g.ends, None, blocks[0], blocks[1], blocks[2])
    meet(team)
    gather(lo, hi, g.springs, g.ends, blocks[0], blocks[1], blocks[2])
    meet(team)
    keep_entries(lo, hi, g.springs.rows, g.coefficients, g.ends, True, blocks[3], blocks[4], blocks[5])
    meet(team)
    gather(lo, hi, g.springs, g.ends, blocks[3], blocks[4], blocks[5])
    meet(team)


@kernel
def linearise_links(lo, hi, x, y, z, used, second, stiffness, rest, stretched, tiny, coefficients):
    """Fill w and c of the links that vertices lo to hi own."""
    for block in range((lo + BLOCK - 1) // BLOCK, (hi + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        own_x, own_y, own_z = x[start:], y[start:], z[start:]
        for d in range(used[block]):
            others, k, rests = second[block, d], stiffness[block, d], rest[block, d]
            w = coefficients[block, d]
            for i in range(min(BLOCK, hi - start)):
                j = others[i]
                w[0, i], w[1, i], w[2, i], w[3, i] = linearised(
                    x[j] - own_x[i], y[j] - own_y[i], z[j] - own_z[i], k[i], rests[i], stretched, tiny
                )


@kernel
def multiply_links(lo, hi, used, second, coefficients, px, py, pz, ends, qx, qy, qz):
    """Add the links of vertices lo to hi times p to q at their owners, keep the opposite for their other ends."""
    rows = second.shape[1]
    for block in range((lo + BLOCK - 1) // BLOCK, (hi + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        ox, oy, oz = px[start:], py[start:], pz[start:]
        sx, sy, sz = qx[start:], qy[start:], qz[start:]
        for d in range(used[block]):
            others, w, kept = second[block, d], coefficients[block, d], ends[(block * rows + d) * ENDS :]
            for i in range(BLOCK):
                j = others[i]
                dx, dy, dz = ox[i] - px[j], oy[i] - py[j], oz[i] - pz[j]
                along = w[0, i] * dx + w[1, i] * dy + w[2, i] * dz
                fx = along * w[0, i] + w[3, i] * dx
                fy = along * w[1, i] + w[3, i] * dy
                fz = along * w[2, i] + w[3, i] * dz
                kept[i], kept[BLOCK + i], kept[2 * BLOCK + i] = -fx, -fy, -fz
                sx[i] += fx
                sy[i] += fy
                sz[i] += fz


@kernel
def keep_entries(lo, hi, used, coefficients, ends, mixed, a, b, c):
    """Add three `entries` of the blocks of the links of vertices lo to hi there, and keep them for the other ends."""
    rows = coefficients.shape[1]
    for block in range((lo + BLOCK - 1) // BLOCK, (hi + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        own_a, own_b, own_c = a[start:], b[start:], c[start:]
        for d in range(used[block]):
            w, kept = coefficients[block, d], ends[(block * rows + d) * ENDS :]
            for i in range(BLOCK):
                x, y, z = entries(w[0, i], w[1, i], w[2, i], w[3, i], mixed)
                kept[i], kept[BLOCK + i], kept[2 * BLOCK + i] = x, y, z
                own_a[i] += x
                own_b[i] += y
                own_c[i] += z


@inlined
def entries(x, y, z, c, mixed):
    """The diagonal of w w' + c, w = (x, y, z); with `mixed`, unless it is None, xy, xz, yz, which c does not touch."""
    if mixed is None:
        return x * x + c, y * y + c, z * z + c
    return x * y, x * z, y * z


@routine
def gather(lo, hi, links, ends, a, b, c):
    """Add to each vertex lo to hi what the links of others keep for it."""
    collect(lo, hi, links.sorted_vertices, links.start, links.incoming, ends, a, b, c)
