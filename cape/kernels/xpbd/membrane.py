"""XPBD on a membrane: the three strains of an edge at once, as they are coupled; see `cape.assembly.membrane`.

An edge's energy is A e'Ce / 2, with e the mean strain of its two triangles and A a third of their area. With J the
derivative of e with respect to the positions, W the inverse masses and K = A C the impulses p change, as in
`kernels.xpbd.formulas` but three at a time, by

    d p = (1 + h (h + tau) K J W J')^-1 (h K (e + tau de/dt) - p)

where the last term is none in a single sweep. Neither C nor its inverse need exist as a full matrix: a fabric may have
no shear stiffness at all.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.cloth.membrane import Tension
from cape.kernels.cloth.mesh import damping_of
from cape.kernels.fused import fused
from cape.kernels.jit import inlined, kernel, routine
from cape.kernels.team import meet, share
from cape.kernels.xpbd.packed import HALF, LANES, NEXT, VX, VY, VZ, W, X, Y, Z, fetch, put_back

Array = NDArray[np.floating]

SECOND, THIRD, FOURTH = NEXT, 2 * NEXT, 3 * NEXT  # where the rows of an edge's other vertices start
CORNERS, SHARES, AREA = (0, 4 * LANES), (8 * LANES, 9 * LANES), 10 * LANES  # and its numbers
NUMBERS = 11


class MembraneConstraints(NamedTuple):
    """Edges of a membrane sorted by colour and filled up to whole blocks of `LANES`; each colour goes from its block in
    `starts` to the next.

    `vertices` (B, 4 LANES): both ends, the third corner of one triangle and of the other, nobody where there is none.
    `numbers` (B, 11 LANES): slopes [1/m] of either triangle from the first end, four each: along weft and warp for the
    second end, then for its third corner; shares of the triangles in the edge's strain; area [m2]. `impulse` [N s] (B,
    3 LANES) where a step has several sweeps.
    """

    tension: Tension
    vertices: NDArray[np.uint32]
    numbers: Array
    starts: NDArray[np.int64]
    impulse: Array | None


@routine
def forget_membrane(c, team):
    """Set the impulses to zero, where they are kept at all."""
    if c is not None:
        forget_all(c.impulse, team)


@routine
def forget_all(impulse, team):
    """Set this thread's share of the impulses to zero; nothing for None."""
    if impulse is not None:
        lo, hi = share(0, impulse.shape[0], team)
        impulse[lo:hi] = 0


@routine
def stretch_membrane(c, step, damping, packed, rows, team):
    """Go through all edges of a membrane, if there is one, colour by colour; `rows` is this thread's own room."""
    if c is not None:
        number, t = packed.dtype.type, c.tension
        for colour in range(c.starts.size - 1):
            lo, hi = share(c.starts[colour], c.starts[colour + 1], team)
            stretch_edges(
                lo, hi, c.vertices, c.numbers, step, damping_of(damping, packed), number(t.weft), number(t.warp),
                number(t.coupling), number(t.shear), number(0.5), c.impulse, packed, rows,
            )  # fmt: skip
            meet(team)


@kernel
def stretch_edges(
    lo, hi, vertices, numbers, step, damping, weft, warp, coupling, shear, half, impulse, packed, rows
):  # fmt: skip
    """Solve the edges of blocks lo to hi."""
    for block in range(lo, hi):
        for k in range(4):
            for lane in range(0, LANES, HALF):
                fetch(packed, vertices[block], LANES * k + lane, rows, NEXT * k + lane)
        if impulse is None:
            solve_edges(numbers[block], step, damping, weft, warp, coupling, shear, half, None, rows)
        else:
            solve_edges(numbers[block], step, damping, weft, warp, coupling, shear, half, impulse[block], rows)
        for k in range(4):
            for lane in range(0, LANES, HALF):
                put_back(packed, vertices[block], LANES * k + lane, rows, NEXT * k + lane)


@inlined
def solve_edges(numbers, step, damping, weft, warp, coupling, shear, half, impulse, rows):
    """Solve the edges of a block, whose vertices have been fetched."""
    for i in range(LANES):
        one = half + half
        b, c, d = apart(rows, i, SECOND, step), apart(rows, i, THIRD, step), apart(rows, i, FOURTH, step)
        p, q = numbers[SHARES[0] + i], numbers[SHARES[1] + i]
        g, f = slopes_of(numbers, CORNERS[0] + i), slopes_of(numbers, CORNERS[1] + i)
        u, v = combined(g[0], b, g[2], c), combined(g[1], b, g[3], c)
        r, t = combined(f[0], b, f[2], d), combined(f[1], b, f[3], d)
        # Derivatives of the three strains with respect to the other three vertices; that of the first is minus the sum.
        b0 = combined(p * g[0], u, q * f[0], r)
        b1 = combined(p * g[1], v, q * f[1], t)
        b2 = added(combined(p * g[0], v, p * g[1], u), combined(q * f[0], t, q * f[1], r))
        c0, c1, c2 = scaled(p * g[2], u), scaled(p * g[3], v), combined(p * g[2], v, p * g[3], u)
        d0, d1, d2 = scaled(q * f[2], r), scaled(q * f[3], t), combined(q * f[2], t, q * f[3], r)
        a0, a1, a2 = less(b0, c0, d0), less(b1, c1, d1), less(b2, c2, d2)
        e0 = half * (p * (dot(u, u) - one) + q * (dot(r, r) - one))
        e1 = half * (p * (dot(v, v) - one) + q * (dot(t, t) - one))
        e2 = p * dot(u, v) + q * dot(r, t)
        ub, uc, ud = rate(rows, i, SECOND), rate(rows, i, THIRD), rate(rows, i, FOURTH)
        e0 += damping * (dot(b0, ub) + dot(c0, uc) + dot(d0, ud))
        e1 += damping * (dot(b1, ub) + dot(c1, uc) + dot(d1, ud))
        e2 += damping * (dot(b2, ub) + dot(c2, uc) + dot(d2, ud))

        wa, wb, wc, wd = rows[W + i], rows[W + SECOND + i], rows[W + THIRD + i], rows[W + FOURTH + i]
        w = wa, wb, wc, wd
        g00, g01, g02 = (
            gram(w, a0, b0, c0, d0, a0, b0, c0, d0),
            gram(w, a0, b0, c0, d0, a1, b1, c1, d1),
            gram(w, a0, b0, c0, d0, a2, b2, c2, d2),
        )
        g11, g12, g22 = (
            gram(w, a1, b1, c1, d1, a1, b1, c1, d1),
            gram(w, a1, b1, c1, d1, a2, b2, c2, d2),
            gram(w, a2, b2, c2, d2, a2, b2, c2, d2),
        )
        pull = step * numbers[AREA + i]
        k0, k1, k01, k2 = pull * weft, pull * warp, pull * coupling, pull * shear
        r0, r1, r2 = k0 * e0 + k01 * e1, k01 * e0 + k1 * e1, k2 * e2
        if impulse is not None:
            r0, r1, r2 = r0 - impulse[i], r1 - impulse[LANES + i], r2 - impulse[2 * LANES + i]
        time = step + damping
        s0, s1, s2 = solved(
            one + time * (k0 * g00 + k01 * g01), time * (k0 * g01 + k01 * g11), time * (k0 * g02 + k01 * g12),
            time * (k01 * g00 + k1 * g01), one + time * (k01 * g01 + k1 * g11), time * (k01 * g02 + k1 * g12),
            time * k2 * g02, time * k2 * g12, one + time * k2 * g22, r0, r1, r2, one,
        )  # fmt: skip
        if impulse is not None:
            impulse[i] += s0
            impulse[LANES + i] += s1
            impulse[2 * LANES + i] += s2
        push(rows, i, wa, combined3(s0, a0, s1, a1, s2, a2))
        push(rows, SECOND + i, wb, combined3(s0, b0, s1, b1, s2, b2))
        push(rows, THIRD + i, wc, combined3(s0, c0, s1, c1, s2, c2))
        push(rows, FOURTH + i, wd, combined3(s0, d0, s1, d1, s2, d2))


@inlined
def slopes_of(numbers, at):
    """Four slopes of a triangle."""
    return numbers[at], numbers[LANES + at], numbers[2 * LANES + at], numbers[3 * LANES + at]


@inlined
def apart(rows, i, other, step):
    """From an edge's first vertex to another at the step's end [m]."""
    ux, uy, uz = rate(rows, i, other)
    j = other + i
    return (
        fused(step, ux, rows[X + j] - rows[X + i]),
        fused(step, uy, rows[Y + j] - rows[Y + i]),
        fused(step, uz, rows[Z + j] - rows[Z + i]),
    )


@inlined
def rate(rows, i, other):
    """Velocity of another vertex against an edge's first [m/s]."""
    j = other + i
    return rows[VX + j] - rows[VX + i], rows[VY + j] - rows[VY + i], rows[VZ + j] - rows[VZ + i]


@inlined
def push(rows, i, weight, change):
    """Take an impulse from a vertex."""
    rows[VX + i] = fused(-weight, change[0], rows[VX + i])
    rows[VY + i] = fused(-weight, change[1], rows[VY + i])
    rows[VZ + i] = fused(-weight, change[2], rows[VZ + i])


@inlined
def dot(a, b):
    """Scalar product."""
    return fused(a[0], b[0], fused(a[1], b[1], a[2] * b[2]))


@inlined
def gram(w, a, b, c, d, e, f, g, h):
    """Sum over four vertices of w (a e), with vectors of two constraints at each."""
    return fused(w[0], dot(a, e), fused(w[1], dot(b, f), fused(w[2], dot(c, g), w[3] * dot(d, h))))


@inlined
def scaled(p, a):
    """The vector p a."""
    return p * a[0], p * a[1], p * a[2]


@inlined
def added(a, b):
    """The vector a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined
def less(a, b, c):
    """The vector -a - b - c."""
    return -(a[0] + b[0] + c[0]), -(a[1] + b[1] + c[1]), -(a[2] + b[2] + c[2])


@inlined
def combined(p, a, q, b):
    """The vector p a + q b."""
    return fused(p, a[0], q * b[0]), fused(p, a[1], q * b[1]), fused(p, a[2], q * b[2])


@inlined
def combined3(p, a, q, b, r, c):
    """The vector p a + q b + r c."""
    return (
        fused(p, a[0], fused(q, b[0], r * c[0])),
        fused(p, a[1], fused(q, b[1], r * c[1])),
        fused(p, a[2], fused(q, b[2], r * c[2])),
    )


@inlined
def solved(a, b, c, d, e, f, g, h, i, p, q, r, one):
    """Solution of three equations with the rows (a, b, c), (d, e, f), (g, h, i) and right sides p, q, r, by Cramer."""
    x, y, z = e * i - f * h, f * g - d * i, d * h - e * g
    scale = one / (a * x + b * y + c * z)
    return (
        scale * (x * p + (c * h - b * i) * q + (b * f - c * e) * r),
        scale * (y * p + (a * i - c * g) * q + (c * d - a * f) * r),
        scale * (z * p + (b * g - a * h) * q + (a * e - b * d) * r),
    )
