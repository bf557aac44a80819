"""Products with the stiffness of a membrane, triangle by triangle as in `kernels.cloth.membrane`.

With B the derivative of a triangle's strains with respect to the positions, the matrix is

    sum over t of a_t B_t' (1 + tau/b) C (P B)_t + a_t S+_t on the slopes of each coordinate,

S+ being the tension without what is negative in it: a compressed membrane has no negative stiffness across, as Choi and
Ko 2002, section 4, have it of springs. F is what the forces at a state have found in the solver's precision; it is
kept in that of the matrix, six numbers of each triangle, and S+, three.

The block diagonal leaves out how a vertex's triangles are coupled to each other by the smoothing, and counts a third of
their shares with each one's own: about two thirds of a triangle's own stiffness on regular meshes, either way.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.cloth.membrane import SHAPE, MeshMembrane, depth_of, smooth_row
from cape.kernels.cloth.mesh import BLOCK, ENDS, SLICE
from cape.kernels.cloth.mesh_bending import SIDE, pack_vectors
from cape.kernels.fused import fused
from cape.kernels.implicit.points import fetch_row, keep_row, sum_points
from cape.kernels.implicit.stiffness import Matrix, damped
from cape.kernels.jit import inlined, kernel, routine, unit
from cape.kernels.team import meet

Array = NDArray[np.floating]
Indices = NDArray[np.int64]

STRETCH = 4 * BLOCK  # vertices whose triangles are seen to in one go, so that what they find stays in the second cache


class Points(NamedTuple):
    """What products with a membrane, and its block diagonal, fetch and keep as `kernels.implicit.points`.

    `packed` vectors (4 N,); the `strains` of each row of triangles (4 BLOCK,); their `forces` on the second corners and
    the third, with a row of zeros. Of the blocks of these corners `forces` are the diagonals, and `mixed` the rest.
    `second`, `third`, `neighbours` and `incoming` are those of the membrane as places of points. Of a
    stretch of vertices `since` is the first whose strains its triangles want, `until` the last that it or one before it
    wants, (stretches,). A thread has room of
    its own for what it has `fetched` (ranks, 9 BLOCK), and, of the row at hand, for what it keeps for the `seconds` and
    the `thirds` (ranks, 6 BLOCK), and for the owners, `total` (ranks, 3 BLOCK).
    """

    packed: Array
    strains: Array
    forces: Array
    mixed: Array
    second: NDArray[np.uint32]
    third: NDArray[np.uint32]
    neighbours: NDArray[np.uint32]
    incoming: NDArray[np.uint32]
    since: Indices
    until: Indices
    fetched: Array
    seconds: Array
    thirds: Array
    total: Array


class MembraneStiffness(NamedTuple):
    """The matrix of a membrane, whose `shape` is that of the state, and that is `inner` in the precision of the matrix,
    whose `shape` is kept; `tension` is S+ times the area [N], three components for each row of triangles, and `change`
    is room as `shape`."""

    membrane: MeshMembrane
    inner: MeshMembrane
    matrix: Matrix
    tension: Array
    change: Array
    points: Points


@unit
def linearise_membrane(g, team, substep, substeps, b):
    """Find S+ of a thread's triangles, and keep F, which the forces at the state have found."""
    inner, lo, hi = g.inner, team.lo, team.hi
    c, dtype = inner.tension, g.tension.dtype.type
    strain_again(
        lo,
        hi,
        inner.second.shape[1],
        g.membrane.shape,
        g.membrane.shape.dtype.type(0.5),
        inner.used,
        inner.shape,
        inner.strains,
    )
    meet(team)
    tighten(
        lo, hi, inner.neighbours, inner.smoothing, inner.strains, dtype(c.weft), dtype(c.warp), dtype(c.coupling),
        dtype(c.shear), dtype(0.5), inner.room, inner.used, g.tension,
    )  # fmt: skip


@unit
def multiply_membrane(g, team, substep, substeps, b):
    """Add the product of p with a membrane to q."""
    p, q, m, t, lo, hi = g.matrix.vectors[3], g.matrix.vectors[4], g.inner, g.points, team.lo, team.hi
    pack_vectors(lo, hi, p[0], p[1], p[2], t.packed)
    meet(team)
    # Triangles resist while what their neighbours have found is at hand, unless other threads find some of it.
    first, last, ready = lo // STRETCH, (hi + STRETCH - 1) // STRETCH, lo // STRETCH
    for stretch in range(first, last):
        _strain(g, team.rank, max(lo, stretch * STRETCH), min(hi, (stretch + 1) * STRETCH), p)
        while ready < last and t.until[ready] <= stretch:
            if is_own(t, ready, lo, hi, m.sorted_vertices.size):
                _resist(g, team.rank, max(lo, ready * STRETCH), min(hi, (ready + 1) * STRETCH), b, q)
            ready += 1
    meet(team)
    for stretch in range(first, last):
        if not is_own(t, stretch, lo, hi, m.sorted_vertices.size):
            _resist(g, team.rank, max(lo, stretch * STRETCH), min(hi, (stretch + 1) * STRETCH), b, q)
    meet(team)
    collect_points(lo, hi, m.sorted_vertices, m.start, t.incoming, t.forces, q[0], q[1], q[2])


@inlined
def is_own(points, stretch, lo, hi, vertices):
    """Tell whether all that a stretch of vertices wants to know is found by the thread that has vertices lo to hi."""
    end = min((points.until[stretch] + 1) * STRETCH, vertices)
    return points.since[stretch] * STRETCH >= lo and end <= hi


@routine
def _strain(g, rank, lo, hi, p):
    m, t = g.inner, g.points
    strain_by(
        lo, hi, t.second, t.third, t.packed, p[0], p[1], p[2], m.slopes, m.shape, m.used, t.fetched[rank],
        t.total[rank], g.change, m.strains, t.strains,
    )  # fmt: skip


@routine
def _resist(g, rank, lo, hi, b, q):
    m, t, c, dtype = g.inner, g.points, g.inner.tension, q.dtype.type
    scale = damped(g.matrix.damping, b)
    resist(
        lo, hi, m.slopes, t.neighbours, m.smoothing, m.shape, g.change, m.strains, t.strains, g.tension,
        dtype(-scale * c.weft), dtype(-scale * c.warp), dtype(-scale * c.coupling), dtype(-scale * c.shear), m.used,
        t.fetched[rank], t.seconds[rank], t.thirds[rank], t.total[rank], t.forces, q[0], q[1], q[2],
    )  # fmt: skip


@unit
def add_membrane_diagonal(g, team, substep, substeps, b):
    """Add a membrane to the block diagonal."""
    m, t, n, lo, hi, scale = g.inner, g.points, g.matrix.inverse, team.lo, team.hi, damped(g.matrix.damping, b)
    _keep(g, team.rank, lo, hi, scale, n)
    meet(team)
    collect_points(lo, hi, m.sorted_vertices, m.start, t.incoming, t.forces, n[0], n[1], n[2])
    collect_points(lo, hi, m.sorted_vertices, m.start, t.incoming, t.mixed, n[3], n[4], n[5])
    meet(team)


@routine
def _keep(g, rank, lo, hi, scale, n):
    m, t, c, dtype = g.inner, g.points, g.inner.tension, n.dtype.type
    keep_corners(
        lo, hi, m.slopes, m.smoothing, m.shape, g.tension, dtype(scale * c.weft), dtype(scale * c.warp),
        dtype(scale * c.coupling), dtype(scale * c.shear), dtype(1.0 / 3.0), m.used, t.seconds[rank], t.thirds[rank],
        t.forces, t.mixed, n[0], n[1], n[2], n[3], n[4], n[5],
    )  # fmt: skip


@kernel
def strain_again(lo, hi, rows, shape, half, used, kept_shape, strains):
    """Keep F of the triangles that vertices lo to hi own, and set their strains, without what damping adds to them.

    `half` is 1/2 in the precision of F.
    """
    for block in range((lo + BLOCK - 1) // BLOCK, (hi + BLOCK - 1) // BLOCK):
        for d in range(depth_of(used, block, rows)):
            row = block * rows + d
            f, kept, e = shape[row * SHAPE :], kept_shape[row * SHAPE :], strains[row * ENDS :]
            for i in range(BLOCK):
                ux, uy, uz = f[i], f[BLOCK + i], f[2 * BLOCK + i]
                wx, wy, wz = f[3 * BLOCK + i], f[4 * BLOCK + i], f[5 * BLOCK + i]
                kept[i], kept[BLOCK + i], kept[2 * BLOCK + i] = ux, uy, uz
                kept[3 * BLOCK + i], kept[4 * BLOCK + i], kept[5 * BLOCK + i] = wx, wy, wz
                e[i] = half * (ux * ux + uy * uy + uz * uz) - half
                e[BLOCK + i] = half * (wx * wx + wy * wy + wz * wz) - half
                e[2 * BLOCK + i] = ux * wx + uy * wy + uz * wz


@kernel
def tighten(
    lo, hi, neighbours, smoothing, strains, weft, warp, coupling, shear, half, room, used, tension
):  # fmt: skip
    """Set S+ times the area of the triangles that vertices lo to hi own."""
    smooth = room[lo // BLOCK].view(strains.dtype)
    rows = neighbours.shape[1]
    zero = half - half
    for block in range((lo + BLOCK - 1) // BLOCK, (hi + BLOCK - 1) // BLOCK):
        for d in range(depth_of(used, block, rows)):
            row = block * rows + d
            s = tension[row * ENDS :]
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
def strain_by(
    lo, hi, second, third, packed, px, py, pz, slopes, shape, used, numbers, found, change, strains, points
):  # fmt: skip
    """Set what vectors p change in F and in the strains of the triangles that vertices lo to hi own, these twice."""
    others = numbers[ENDS:]
    rows = second.shape[1]
    for block in range((lo + BLOCK - 1) // BLOCK, (hi + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        ox, oy, oz = px[start:], py[start:], pz[start:]
        for d in range(depth_of(used, block, rows)):
            fetch_row(second[block, d], packed, numbers)
            fetch_row(third[block, d], packed, others)
            row = block * rows + d
            f, g, h, e = shape[row * SHAPE :], slopes[block, d], change[row * SHAPE :], strains[row * ENDS :]
            for i in range(BLOCK):
                p, q, r, s = g[0, i], g[1, i], g[2, i], g[3, i]
                ax, ay, az = numbers[i] - ox[i], numbers[BLOCK + i] - oy[i], numbers[2 * BLOCK + i] - oz[i]
                bx, by, bz = others[i] - ox[i], others[BLOCK + i] - oy[i], others[2 * BLOCK + i] - oz[i]
                ux, uy, uz = fused(p, ax, r * bx), fused(p, ay, r * by), fused(p, az, r * bz)
                wx, wy, wz = fused(q, ax, s * bx), fused(q, ay, s * by), fused(q, az, s * bz)
                h[i], h[BLOCK + i], h[2 * BLOCK + i] = ux, uy, uz
                h[3 * BLOCK + i], h[4 * BLOCK + i], h[5 * BLOCK + i] = wx, wy, wz
                fx, fy, fz = f[i], f[BLOCK + i], f[2 * BLOCK + i]
                gx, gy, gz = f[3 * BLOCK + i], f[4 * BLOCK + i], f[5 * BLOCK + i]
                along = fused(fz, uz, fused(fy, uy, fx * ux))
                across = fused(gz, wz, fused(gy, wy, gx * wx))
                mixed = fused(fz, wz, fused(fy, wy, fx * wx)) + fused(gz, uz, fused(gy, uy, gx * ux))
                e[i], e[BLOCK + i], e[2 * BLOCK + i] = along, across, mixed
                found[i], found[BLOCK + i], found[2 * BLOCK + i] = along, across, mixed
            keep_row(found, points, row * SIDE * BLOCK)


@kernel
def resist(
    lo, hi, slopes, neighbours, smoothing, shape, change, strains, points, tension, weft, warp, coupling, shear, used,
    fetched, second, third, total, forces, qx, qy, qz,
):  # fmt: skip
    """Add to q minus the forces on the owners of the triangles of vertices lo to hi, keep those on other corners.

    The entries of C are minus what they stand for, scaled by damping.
    """
    rows = slopes.shape[1]
    for block in range((lo + BLOCK - 1) // BLOCK, (hi + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        for i in range(3 * BLOCK):
            total[i] = 0
        for d in range(depth_of(used, block, rows)):
            row = block * rows + d
            for k in range(3):
                fetch_row(neighbours[block, d, k], points, fetched[k * ENDS :])
            f, h = shape[row * SHAPE :], change[row * SHAPE :]
            s, own = tension[row * ENDS :], strains[row * ENDS :]
            resist_row(
                slopes[block, d], smoothing[block, d], f, h, s, own, fetched, weft, warp, coupling, shear, second,
                third, total,
            )  # fmt: skip
            keep_row(second, forces, 2 * row * SIDE * BLOCK)
            keep_row(third, forces, (2 * row + 1) * SIDE * BLOCK)
        for i in range(min(BLOCK, hi - start)):
            qx[start + i] += total[i]
            qy[start + i] += total[BLOCK + i]
            qz[start + i] += total[2 * BLOCK + i]


@inlined
def resist_row(g, w, f, h, s, own, beyond, weft, warp, coupling, shear, second, third, total):
    """The same of one row of triangles, whose strains are `own`, those of their neighbours `beyond`."""
    for i in range(BLOCK):
        e = smoothed(w, own, beyond, i, 0)
        k = smoothed(w, own, beyond, i, 1)
        m = shear * smoothed(w, own, beyond, i, 2)
        along, across = fused(weft, e, coupling * k), fused(warp, k, coupling * e)
        a, c, t = s[i], s[BLOCK + i], s[2 * BLOCK + i]
        for_x = pulls(along, across, m, a, c, t, f[i], f[3 * BLOCK + i], h[i], h[3 * BLOCK + i])
        for_y = pulls(along, across, m, a, c, t, f[BLOCK + i], f[4 * BLOCK + i], h[BLOCK + i], h[4 * BLOCK + i])
        for_z = pulls(along, across, m, a, c, t, f[2 * BLOCK + i], f[5 * BLOCK + i], h[2 * BLOCK + i], h[5 * BLOCK + i])
        p, q, r, v = g[0, i], g[1, i], g[2, i], g[3, i]
        bx, by, bz = (
            fused(p, for_x[0], q * for_x[1]),
            fused(p, for_y[0], q * for_y[1]),
            fused(p, for_z[0], q * for_z[1]),
        )
        dx, dy, dz = (
            fused(r, for_x[0], v * for_x[1]),
            fused(r, for_y[0], v * for_y[1]),
            fused(r, for_z[0], v * for_z[1]),
        )
        second[i], second[BLOCK + i], second[2 * BLOCK + i] = -bx, -by, -bz
        third[i], third[BLOCK + i], third[2 * BLOCK + i] = -dx, -dy, -dz
        total[i] += bx + dx
        total[BLOCK + i] += by + dy
        total[2 * BLOCK + i] += bz + dz


@inlined
def smoothed(w, own, beyond, i, k):
    """Smoothed strain times the area of triangle i, of which component k."""
    at = k * BLOCK + i
    first = fused(w[1, i], beyond[at], w[0, i] * own[at])
    return fused(w[3, i], beyond[2 * ENDS + at], fused(w[2, i], beyond[ENDS + at], first))


@inlined
def pulls(along, across, mixed, a, c, t, u, w, h, j):
    """Pulls on both slopes of one coordinate: of the tension's change on F's u and w, of S+ on the changes h and j."""
    return (
        fused(along, u, mixed * w) - fused(a, h, t * j),
        fused(across, w, mixed * u) - fused(c, j, t * h),
    )


@kernel
def collect_points(lo, hi, sorted_vertices, start, incoming, forces, qx, qy, qz):
    """Add to each vertex lo to hi the forces that others' triangles keep for it, as `mesh.collect` does."""
    for piece in range((lo + SLICE - 1) // SLICE, (hi + SLICE - 1) // SLICE):
        first, begin = piece * SLICE, start[piece]
        width = (start[piece + 1] - begin) // SLICE
        for i in range(min(SLICE, hi - first)):
            v = sorted_vertices[first + i]
            x, y, z = sum_points(incoming, forces, begin + i * width, begin + (i + 1) * width)
            qx[v] += x
            qy[v] += y
            qz[v] += z


@kernel
def keep_corners(
    lo, hi, slopes, smoothing, shape, tension, weft, warp, coupling, shear, third_part, used, second, third, forces,
    mixed, xx, yy, zz, xy, xz, yz,
):  # fmt: skip
    """Add the blocks of the triangles of vertices lo to hi there; keep them for other corners, in two points each."""
    rows = slopes.shape[1]
    for block in range((lo + BLOCK - 1) // BLOCK, (hi + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        a, b, c, ab, ac, bc = xx[start:], yy[start:], zz[start:], xy[start:], xz[start:], yz[start:]
        n = min(BLOCK, hi - start)
        for d in range(depth_of(used, block, rows)):
            row = block * rows + d
            f, s, g, w = shape[row * SHAPE :], tension[row * ENDS :], slopes[block, d], smoothing[block, d]
            for i in range(BLOCK):
                area = w[0, i] + third_part * (w[1, i] + w[2, i] + w[3, i])
                put_corner(i, g[0, i], g[1, i], f, s, area, weft, warp, coupling, shear, second)
                put_corner(i, g[2, i], g[3, i], f, s, area, weft, warp, coupling, shear, third)
            at = 2 * row * SIDE * BLOCK
            keep_row(second, forces, at)
            keep_row(second[ENDS:], mixed, at)
            keep_row(third, forces, at + SIDE * BLOCK)
            keep_row(third[ENDS:], mixed, at + SIDE * BLOCK)
            for i in range(n):
                area = w[0, i] + third_part * (w[1, i] + w[2, i] + w[3, i])
                p, q = -(g[0, i] + g[2, i]), -(g[1, i] + g[3, i])
                put_corner(i, p, q, f, s, area, weft, warp, coupling, shear, second)
            for i in range(n):
                a[i] += second[i]
                b[i] += second[BLOCK + i]
                c[i] += second[2 * BLOCK + i]
                ab[i] += second[ENDS + i]
                ac[i] += second[ENDS + BLOCK + i]
                bc[i] += second[ENDS + 2 * BLOCK + i]


@inlined
def put_corner(i, p, q, f, s, area, weft, warp, coupling, shear, out):
    """Write the block of a corner whose slopes are p and q, F's columns and S+ being those of triangle i."""
    pp, qq, pq = p * p, q * q, p * q
    a, c, m = area * (weft * pp + shear * qq), area * (warp * qq + shear * pp), area * (coupling + shear) * pq
    tight = s[i] * pp + s[BLOCK + i] * qq + (s[2 * BLOCK + i] + s[2 * BLOCK + i]) * pq
    ux, uy, uz = f[i], f[BLOCK + i], f[2 * BLOCK + i]
    vx, vy, vz = f[3 * BLOCK + i], f[4 * BLOCK + i], f[5 * BLOCK + i]
    # B' C B is a u u' + c v v' + m (u v' + v u').
    gx, gy, gz = a * ux + m * vx, a * uy + m * vy, a * uz + m * vz
    hx, hy, hz = c * vx + m * ux, c * vy + m * uy, c * vz + m * uz
    out[i], out[BLOCK + i], out[2 * BLOCK + i] = (
        gx * ux + hx * vx + tight, gy * uy + hy * vy + tight, gz * uz + hz * vz + tight
    )  # fmt: skip
    out[ENDS + i], out[ENDS + BLOCK + i], out[ENDS + 2 * BLOCK + i] = (
        gx * uy + hx * vy, gx * uz + hx * vz, gy * uz + hy * vz
    )  # fmt: skip
