"""Products with the stiffness of a membrane, triangle by triangle as in `kernels.cloth.membrane`.

With B the derivative of a triangle's strains with respect to the positions, the matrix is

    sum over t of a_t B_t' (1 + tau/b) C (P B)_t + a_t S+_t on the slopes of each coordinate,

S+ being the tension without what is negative in it: a compressed membrane has no negative stiffness across, as Choi and
Ko 2002, section 4, have it of springs. Its triangles are found at a state in the solver's precision, and kept in that
of the matrix: F, six numbers each, and S+, three.

The block diagonal leaves out how a vertex's triangles are coupled to each other by the smoothing, and counts a third of
their shares with each one's own: about two thirds of a triangle's own stiffness on regular meshes, either way.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.cloth.membrane import SHAPE, MembraneForces, MeshMembrane, depth_of, find_strains, smooth_row, spread
from cape.kernels.cloth.mesh import BLOCK, ENDS, collect, pack
from cape.kernels.implicit.stiffness import Matrix, damped
from cape.kernels.jit import inlined, kernel, routine, unit
from cape.kernels.team import meet

Array = NDArray[np.floating]


class MembraneStiffness(NamedTuple):
    """The matrix of a membrane: `still` finds its strains without damping, `inner` is the membrane in the precision of
    the matrix, whose `shape` is kept; `tension` is S+ times the area [N], three components for each row of triangles,
    and `change` is room as `shape`."""

    still: MembraneForces
    inner: MeshMembrane
    matrix: Matrix
    tension: Array
    change: Array


@unit
def linearise_membrane(g, team, substep, substeps, b):
    """Find F and S+ of a thread's triangles."""
    s, m, lo, hi = g.still.state, g.still.membrane, team.lo, team.hi
    c, dtype = m.tension, s.x.dtype.type
    pack(lo, hi, s.x, s.y, s.z, s.vx, s.vy, s.vz, m.words)
    meet(team)
    find_strains(g.still, lo, hi)
    meet(team)
    tighten(
        lo, hi, m.neighbours, m.smoothing, m.shape, m.strains, dtype(c.weft), dtype(c.warp), dtype(c.coupling),
        dtype(c.shear), dtype(0.5), m.room, m.used, g.inner.shape, g.tension,
    )  # fmt: skip


@unit
def multiply_membrane(g, team, substep, substeps, b):
    """Add the product of p with a membrane to q."""
    p, q, m, lo, hi = g.matrix.vectors[3], g.matrix.vectors[4], g.inner, team.lo, team.hi
    strain_by(lo, hi, m.second, m.third, p[0], p[1], p[2], m.slopes, m.shape, m.room, m.used, g.change, m.strains)
    meet(team)
    _resist(g, lo, hi, damped(g.matrix.damping, b), q)
    meet(team)
    collect(lo, hi, m.sorted_vertices, m.start, m.incoming, m.forces, q[0], q[1], q[2])


@routine
def _resist(g, lo, hi, scale, q):
    m, c, dtype = g.inner, g.inner.tension, q.dtype.type
    resist(
        lo, hi, m.slopes, m.neighbours, m.smoothing, m.shape, g.change, m.strains, g.tension, dtype(-scale * c.weft),
        dtype(-scale * c.warp), dtype(-scale * c.coupling), dtype(-scale * c.shear), m.room, m.used, m.forces,
        q[0], q[1], q[2],
    )  # fmt: skip


@unit
def add_membrane_diagonal(g, team, substep, substeps, b):
    """Add a membrane to the block diagonal."""
    m, blocks, lo, hi, scale = g.inner, g.matrix.inverse, team.lo, team.hi, damped(g.matrix.damping, b)
    _keep(g, lo, hi, scale, None, blocks[0], blocks[1], blocks[2])
    meet(team)
    collect(lo, hi, m.sorted_vertices, m.start, m.incoming, m.forces, blocks[0], blocks[1], blocks[2])
    meet(team)
    _keep(g, lo, hi, scale, True, blocks[3], blocks[4], blocks[5])
    meet(team)
    collect(lo, hi, m.sorted_vertices, m.start, m.incoming, m.forces, blocks[3], blocks[4], blocks[5])
    meet(team)


@routine
def _keep(g, lo, hi, scale, mixed, a, b, c):
    m, t, dtype = g.inner, g.inner.tension, a.dtype.type
    keep_corners(
        lo, hi, m.slopes, m.smoothing, m.shape, g.tension, dtype(scale * t.weft), dtype(scale * t.warp),
        dtype(scale * t.coupling), dtype(scale * t.shear), dtype(1.0 / 3.0), mixed, m.used, m.forces, a, b, c,
    )  # fmt: skip


@kernel
def tighten(
    lo, hi, neighbours, smoothing, shape, strains, weft, warp, coupling, shear, half, room, used, kept_shape, tension
):  # fmt: skip
    """Keep F, and set S+ times the area of the triangles that vertices lo to hi own."""
    smooth = room[lo // BLOCK].view(strains.dtype)
    rows = neighbours.shape[1]
    zero = half - half
    for block in range((lo + BLOCK - 1) // BLOCK, (hi + BLOCK - 1) // BLOCK):
        for d in range(depth_of(used, block, rows)):
            row = block * rows + d
            kept, found, s = kept_shape[row * SHAPE :], shape[row * SHAPE :], tension[row * ENDS :]
            for i in range(SHAPE):
                kept[i] = found[i]
            smooth_row(neighbours[block, d], smoothing[block, d], row * ENDS, strains, smooth)
            for i in range(BLOCK):
                e, f = smooth[i], smooth[BLOCK + i]
                along, across, mixed = weft * e + coupling * f, warp * f + coupling * e, shear * smooth[2 * BLOCK + i]
                # Principal tensions: mean plus and minus radius. Of S the part that is not negative.
                mean, apart = half * (along + across), half * (along - across)
                radius = math.sqrt(apart * apart + mixed * mixed)
                high, low = max(mean + radius, zero), max(mean - radius, zero)
                middle = half * (high + low)
                share = zero
                if radius > zero:
                    share = half * (high - low) / radius
                s[i], s[BLOCK + i], s[2 * BLOCK + i] = middle + share * apart, middle - share * apart, share * mixed


@kernel
def strain_by(lo, hi, second, third, px, py, pz, slopes, shape, room, used, change, strains):
    """Set what vectors p change in F and in the strains of the triangles that vertices lo to hi own."""
    numbers = room[lo // BLOCK].view(px.dtype)
    others = numbers[ENDS:]
    rows = second.shape[1]
    for block in range((lo + BLOCK - 1) // BLOCK, (hi + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        ox, oy, oz = px[start:], py[start:], pz[start:]
        for d in range(depth_of(used, block, rows)):
            fetch_vectors(second[block, d], px, py, pz, numbers)
            fetch_vectors(third[block, d], px, py, pz, others)
            row = block * rows + d
            f, g, h, e = shape[row * SHAPE :], slopes[block, d], change[row * SHAPE :], strains[row * ENDS :]
            for i in range(BLOCK):
                p, q, r, s = g[0, i], g[1, i], g[2, i], g[3, i]
                ax, ay, az = numbers[i] - ox[i], numbers[BLOCK + i] - oy[i], numbers[2 * BLOCK + i] - oz[i]
                bx, by, bz = others[i] - ox[i], others[BLOCK + i] - oy[i], others[2 * BLOCK + i] - oz[i]
                ux, uy, uz = p * ax + r * bx, p * ay + r * by, p * az + r * bz
                wx, wy, wz = q * ax + s * bx, q * ay + s * by, q * az + s * bz
                h[i], h[BLOCK + i], h[2 * BLOCK + i] = ux, uy, uz
                h[3 * BLOCK + i], h[4 * BLOCK + i], h[5 * BLOCK + i] = wx, wy, wz
                fx, fy, fz = f[i], f[BLOCK + i], f[2 * BLOCK + i]
                gx, gy, gz = f[3 * BLOCK + i], f[4 * BLOCK + i], f[5 * BLOCK + i]
                e[i] = fx * ux + fy * uy + fz * uz
                e[BLOCK + i] = gx * wx + gy * wy + gz * wz
                e[2 * BLOCK + i] = (fx * wx + fy * wy + fz * wz) + (gx * ux + gy * uy + gz * uz)


@inlined
def fetch_vectors(others, x, y, z, to):
    """Copy the vectors of the BLOCK given vertices behind one another, coordinate by coordinate."""
    for k in range(BLOCK):
        j = others[k]
        to[k], to[BLOCK + k], to[2 * BLOCK + k] = x[j], y[j], z[j]


@kernel
def resist(
    lo, hi, slopes, neighbours, smoothing, shape, change, strains, tension, weft, warp, coupling, shear, room, used,
    forces, qx, qy, qz,
):  # fmt: skip
    """Add to q minus the forces on the owners of the triangles of vertices lo to hi, keep those on other corners.

    The entries of C are minus what they stand for, scaled by damping.
    """
    smooth = room[lo // BLOCK].view(strains.dtype)
    total = smooth[ENDS:]
    rows = slopes.shape[1]
    for block in range((lo + BLOCK - 1) // BLOCK, (hi + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        for i in range(3 * BLOCK):
            total[i] = 0
        for d in range(depth_of(used, block, rows)):
            row = block * rows + d
            smooth_row(neighbours[block, d], smoothing[block, d], row * ENDS, strains, smooth)
            f, h, s = shape[row * SHAPE :], change[row * SHAPE :], tension[row * ENDS :]
            kept, g = forces[2 * row * ENDS :], slopes[block, d]
            for i in range(BLOCK):
                a, c, m = s[i], s[BLOCK + i], s[2 * BLOCK + i]
                e, k = smooth[i], smooth[BLOCK + i]
                along, across, mixed = weft * e + coupling * k, warp * k + coupling * e, shear * smooth[2 * BLOCK + i]
                ux, uy, uz = f[i], f[BLOCK + i], f[2 * BLOCK + i]
                wx, wy, wz = f[3 * BLOCK + i], f[4 * BLOCK + i], f[5 * BLOCK + i]
                hx, hy, hz = h[i], h[BLOCK + i], h[2 * BLOCK + i]
                jx, jy, jz = h[3 * BLOCK + i], h[4 * BLOCK + i], h[5 * BLOCK + i]
                spread(
                    i, g, along * ux + mixed * wx - a * hx - m * jx, along * uy + mixed * wy - a * hy - m * jy,
                    along * uz + mixed * wz - a * hz - m * jz, across * wx + mixed * ux - c * jx - m * hx,
                    across * wy + mixed * uy - c * jy - m * hy, across * wz + mixed * uz - c * jz - m * hz, kept, total,
                )  # fmt: skip
        for i in range(min(BLOCK, hi - start)):
            qx[start + i] += total[i]
            qy[start + i] += total[BLOCK + i]
            qz[start + i] += total[2 * BLOCK + i]


@kernel
def keep_corners(
    lo, hi, slopes, smoothing, shape, tension, weft, warp, coupling, shear, third, mixed, used, forces, a, b, c
):  # fmt: skip
    """Add three entries of the blocks of the triangles of vertices lo to hi there, keep them for other corners."""
    rows = slopes.shape[1]
    for block in range((lo + BLOCK - 1) // BLOCK, (hi + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        own_a, own_b, own_c = a[start:], b[start:], c[start:]
        n = min(BLOCK, hi - start)
        for d in range(depth_of(used, block, rows)):
            row = block * rows + d
            f, s, kept = shape[row * SHAPE :], tension[row * ENDS :], forces[2 * row * ENDS :]
            g, w = slopes[block, d], smoothing[block, d]
            for i in range(BLOCK):
                area = w[0, i] + third * (w[1, i] + w[2, i] + w[3, i])
                p, q, r, t = g[0, i], g[1, i], g[2, i], g[3, i]
                u = f[i], f[BLOCK + i], f[2 * BLOCK + i]
                v = f[3 * BLOCK + i], f[4 * BLOCK + i], f[5 * BLOCK + i]
                k = s[i], s[BLOCK + i], s[2 * BLOCK + i]
                x, y, z = corner(p, q, u, v, k, area, weft, warp, coupling, shear, mixed)
                kept[i], kept[BLOCK + i], kept[2 * BLOCK + i] = x, y, z
                x, y, z = corner(r, t, u, v, k, area, weft, warp, coupling, shear, mixed)
                kept[ENDS + i], kept[ENDS + BLOCK + i], kept[ENDS + 2 * BLOCK + i] = x, y, z
            for i in range(n):
                area = w[0, i] + third * (w[1, i] + w[2, i] + w[3, i])
                p, q = -(g[0, i] + g[2, i]), -(g[1, i] + g[3, i])
                u = f[i], f[BLOCK + i], f[2 * BLOCK + i]
                v = f[3 * BLOCK + i], f[4 * BLOCK + i], f[5 * BLOCK + i]
                k = s[i], s[BLOCK + i], s[2 * BLOCK + i]
                x, y, z = corner(p, q, u, v, k, area, weft, warp, coupling, shear, mixed)
                own_a[i] += x
                own_b[i] += y
                own_c[i] += z


@inlined
def corner(p, q, u, v, k, area, weft, warp, coupling, shear, mixed):
    """Three entries of the block of a corner whose slopes are p and q, F's columns being u and v, and S+ k."""
    pp, qq, pq = p * p, q * q, p * q
    a, c, m = area * (weft * pp + shear * qq), area * (warp * qq + shear * pp), area * (coupling + shear) * pq
    if mixed is None:
        tight = k[0] * pp + k[1] * qq + (k[2] + k[2]) * pq
        return (
            a * u[0] * u[0] + c * v[0] * v[0] + (m + m) * u[0] * v[0] + tight,
            a * u[1] * u[1] + c * v[1] * v[1] + (m + m) * u[1] * v[1] + tight,
            a * u[2] * u[2] + c * v[2] * v[2] + (m + m) * u[2] * v[2] + tight,
        )
    return (
        a * u[0] * u[1] + c * v[0] * v[1] + m * (u[0] * v[1] + u[1] * v[0]),
        a * u[0] * u[2] + c * v[0] * v[2] + m * (u[0] * v[2] + u[2] * v[0]),
        a * u[1] * u[2] + c * v[1] * v[2] + m * (u[1] * v[2] + u[2] * v[1]),
    )
