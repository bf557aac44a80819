"""Preconditioned conjugate gradients (Saad 2003, algorithm 9.1), for one thread or a team.

The preconditioner is the inverse of the block diagonal, and what a system's `precondition` adds to it.

Sums are taken in chunks of 64 vertices, each by whoever has it, and the chunks' sums one after the other by everyone:
the same bits for any number of threads.
"""

import math

import numpy as np

from cape.kernels.jit import kernel, routine
from cape.kernels.program import run
from cape.kernels.team import meet

CHUNK = 64  # vertices; the ranges of threads are multiples of it
LANES = np.uint64(8)
LEFT = 0.5  # of what may be left, to which steps of conjugate gradients shrink: those to come add up to about as much
ROUGHLY = 0.1  # forcing of steps that are as short as that
SURELY = 0.25  # of what may be left: steps are no four times as long as the preconditioned residual
FAINTEST = 1e-34  # squared residual; below it terms in single precision lose digits, and steps go anywhere


@kernel
def sum_chunks(terms, sums):
    """Set each sum to that of its 64 terms, in eight running sums that one vector register holds."""
    for chunk in range(sums.size):
        t = terms[chunk * CHUNK :]
        a, b, c, d, e, f, g, h = t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7]
        for k in range(LANES, np.uint64(CHUNK), LANES):
            a += t[k]
            b += t[k + np.uint64(1)]
            c += t[k + np.uint64(2)]
            d += t[k + np.uint64(3)]
            e += t[k + np.uint64(4)]
            f += t[k + np.uint64(5)]
            g += t[k + np.uint64(6)]
            h += t[k + np.uint64(7)]
        sums[chunk] = ((a + b) + (c + d)) + ((e + f) + (g + h))


@kernel
def dot_terms(px, py, pz, qx, qy, qz, terms):
    """Set what each vertex adds to the dot product of p and q."""
    for i in range(terms.size):
        terms[i] = px[i] * qx[i] + py[i] * qy[i] + pz[i] * qz[i]


@kernel
def share_terms(tolerated, rounded, px, py, pz, x, y, z, terms):
    """Set each vertex's squared length of p as a share of what is `tolerated` [m2], or of its distance from the origin
    squared times `rounded` if that is more."""
    for i in range(terms.size):
        least = max(tolerated, rounded * (x[i] * x[i] + y[i] * y[i] + z[i] * z[i]))
        terms[i] = (px[i] * px[i] + py[i] * py[i] + pz[i] * pz[i]) / least


@kernel
def set_out(xx, yy, zz, xy, xz, yz, rx, ry, rz, dx, dy, dz, zx, zy, zz_, terms):
    """Start from the solution 0: z is the residual times the inverse of the block diagonal."""
    for i in range(terms.size):
        a, b, c = rx[i], ry[i], rz[i]
        dx[i] = dy[i] = dz[i] = 0
        u = xx[i] * a + xy[i] * b + xz[i] * c
        v = xy[i] * a + yy[i] * b + yz[i] * c
        w = xz[i] * a + yz[i] * b + zz[i] * c
        zx[i], zy[i], zz_[i] = u, v, w
        terms[i] = a * u + b * v + c * w


@kernel
def head_for(zx, zy, zz, px, py, pz):
    """The first direction: p = z."""
    for i in range(px.size):
        px[i], py[i], pz[i] = zx[i], zy[i], zz[i]


@kernel
def descend(
    alpha, xx, yy, zz, xy, xz, yz, px, py, pz, qx, qy, qz, dx, dy, dz, rx, ry, rz, zx, zy, zz_, terms
):  # fmt: skip
    """Go along p: solution, residual, and this times the inverse of the block diagonal."""
    for i in range(terms.size):
        dx[i] += alpha * px[i]
        dy[i] += alpha * py[i]
        dz[i] += alpha * pz[i]
        a, b, c = rx[i] - alpha * qx[i], ry[i] - alpha * qy[i], rz[i] - alpha * qz[i]
        rx[i], ry[i], rz[i] = a, b, c
        u = xx[i] * a + xy[i] * b + xz[i] * c
        v = xy[i] * a + yy[i] * b + yz[i] * c
        w = xz[i] * a + yz[i] * b + zz[i] * c
        zx[i], zy[i], zz_[i] = u, v, w
        terms[i] = a * u + b * v + c * w


@kernel
def turn(beta, zx, zy, zz, px, py, pz):
    """The next direction: p = z + beta p."""
    for i in range(px.size):
        px[i] = zx[i] + beta * px[i]
        py[i] = zy[i] + beta * py[i]
        pz[i] = zz[i] + beta * pz[i]


@routine
def total(sums):
    """Sum of the chunks' sums, one after the other."""
    result = 0.0
    for chunk in range(sums.size):
        result += sums[chunk]
    return result


@routine
def sum_all(lo, hi, front, terms, sums, team):
    """Sum of the terms of all vertices, of which this thread has set those from lo to hi."""
    sum_chunks(terms[front + lo :], sums[lo // CHUNK : (hi + CHUNK - 1) // CHUNK])
    meet(team)
    return total(sums)


@routine
def solve_linear(system, b, forcing, tolerance, team):
    """Solve A d = r until the residual, in the norm of the preconditioner, is `forcing` times what it was.

    With a `tolerance` [m], unless it is 0, less will do, `ROUGHLY`, once a step of these gradients moves vertices by
    `LEFT` of it, root mean square; their lengths are compared in the norm of A, but for the first one.

    `vectors` (5, 3, L) of the matrix holds d, r, z, p, q; r becomes the residual. Returns the number of iterations, r .
    d of the given r, and how far the first one moves vertices, as a share of the tolerance or infinite without one.
    """
    return solve_unless(system, b, forcing, tolerance, False, team)


@routine
def solve_unless(system, b, forcing, tolerance, settled, team):
    """The same; but where the first step would move vertices by less than the tolerance and the equations may be
    `settled` as they are, it is not taken, and d is 0. Where the preconditioned residual itself is shorter than
    `SURELY` of the tolerance, no product is needed to see that."""
    matrix, terms, sums, lo, hi = system.matrix, system.work.terms, system.work.sums, team.lo, team.hi
    front, m, vectors = matrix.front, matrix.inverse, matrix.vectors
    dtype = vectors.dtype.type
    a, e = front + lo, front + hi
    d, r, z, p, q = vectors[0], vectors[1], vectors[2], vectors[3], vectors[4]
    set_out(
        m[0, a:e], m[1, a:e], m[2, a:e], m[3, a:e], m[4, a:e], m[5, a:e], r[0, a:e], r[1, a:e], r[2, a:e],
        d[0, a:e], d[1, a:e], d[2, a:e], z[0, a:e], z[1, a:e], z[2, a:e], terms[a:e],
    )  # fmt: skip
    run(system.precondition, team, 0, 1, b)
    head_for(z[0, a:e], z[1, a:e], z[2, a:e], p[0, a:e], p[1, a:e], p[2, a:e])
    squared = sum_all(lo, hi, front, terms, sums[0], team)
    ahead = 0.0
    if tolerance > 0.0:
        ahead = length_of(system, tolerance, p, team)
        if settled and ahead < SURELY:
            return 1, 0.0, ahead
    enough = max(forcing * forcing * squared, FAINTEST)
    rough = max(ROUGHLY * ROUGHLY * squared, FAINTEST)
    slope, first, least, gained = 0.0, math.inf, 0.0, math.inf
    most = system.settings.linear_iterations
    for iteration in range(most):
        if not squared > enough or (gained < least and not squared > rough):
            # Nothing to begin with: next to nothing is moved, or a NaN.
            return iteration, slope, first if iteration > 0 else squared
        run(system.product, team, 0, 1, b)
        dot_terms(p[0, a:e], p[1, a:e], p[2, a:e], q[0, a:e], q[1, a:e], q[2, a:e], terms[a:e])
        alpha = squared / sum_all(lo, hi, front, terms, sums[1], team)
        # p . r of the given r is the squared norm of the residual here, since the directions before are conjugate.
        gained = alpha * squared
        slope += gained
        if tolerance > 0.0 and iteration == 0:
            first = alpha * ahead
            if settled and first < 1.0:
                return 1, slope, first
            least = gained * (LEFT / first) ** 2
        descend(
            dtype(alpha), m[0, a:e], m[1, a:e], m[2, a:e], m[3, a:e], m[4, a:e], m[5, a:e],
            p[0, a:e], p[1, a:e], p[2, a:e], q[0, a:e], q[1, a:e], q[2, a:e], d[0, a:e], d[1, a:e], d[2, a:e],
            r[0, a:e], r[1, a:e], r[2, a:e], z[0, a:e], z[1, a:e], z[2, a:e], terms[a:e],
        )  # fmt: skip
        run(system.precondition, team, 0, 1, b)
        before = squared
        squared = sum_all(lo, hi, front, terms, sums[0], team)
        turn(dtype(squared / before), z[0, a:e], z[1, a:e], z[2, a:e], p[0, a:e], p[1, a:e], p[2, a:e])
        meet(team)
    return most, slope, first


@routine
def length_of(system, tolerance, p, team):
    """How far a direction moves vertices, root mean square, as a share of what each may be."""
    terms, lo, hi, s, front = system.work.terms, team.lo, team.hi, system.state, system.matrix.front
    a, e, digits = front + lo, front + hi, system.settings.digits
    share_terms(
        tolerance * tolerance, digits * digits, p[0, a:e], p[1, a:e], p[2, a:e], s.x[lo:hi], s.y[lo:hi], s.z[lo:hi],
        terms[a:e],
    )  # fmt: skip
    return math.sqrt(sum_all(lo, hi, front, terms, system.work.sums[2], team) / system.inertia.mass.size)


@routine
def largest_of_all(lo, hi, value, largest, team):
    """Largest of the values that the threads have; a NaN is larger than all."""
    largest[lo // CHUNK : (hi + CHUNK - 1) // CHUNK] = value
    meet(team)
    result = 0.0
    for chunk in range(largest.size):
        if math.isnan(largest[chunk]):
            return math.nan
        result = max(result, largest[chunk])
    return result
