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
from cape.kernels.jit import inlined, kernel, routine
from cape.kernels.team import meet, share

Array = NDArray[np.floating]


class MembraneConstraints(NamedTuple):
    """Edges of a membrane sorted by colour, each of which goes from its place in `starts` to the next.

    `vertices` (E, 4): both ends, the third corner of one triangle and of the other, the first again where there is
    none. `slopes` [1/m] (E, 2, 4): of either triangle from the first end: along weft and warp for the second end, then
    for its third corner. `shares` (E, 2) of the triangles in the edge's strain, `area` [m2] (E,), `impulse` [N s]
    (E, 3) where a step has several sweeps.
    """

    tension: Tension
    vertices: NDArray[np.uint32]
    slopes: Array
    shares: Array
    area: Array
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
def stretch_membrane(c, step, damping, w, s, team):
    """Go through all edges of a membrane, if there is one, colour by colour."""
    if c is not None:
        number, t = s.x.dtype.type, c.tension
        for colour in range(c.starts.size - 1):
            lo, hi = share(c.starts[colour], c.starts[colour + 1], team)
            stretch_edges(
                lo, hi, c.vertices, c.slopes, c.shares, c.area, step, damping_of(damping, s.x), number(t.weft),
                number(t.warp), number(t.coupling), number(t.shear), number(0.5), c.impulse, w,
                s.x, s.y, s.z, s.vx, s.vy, s.vz,
            )  # fmt: skip
            meet(team)


@kernel
def stretch_edges(
    lo, hi, vertices, slopes, shares, area, step, damping, weft, warp, coupling, shear, half, impulse, w,
    x, y, z, vx, vy, vz,
):  # fmt: skip
    """Solve edges lo to hi one after the other."""
    for k in range(lo, hi):
        one = half + half
        i, j, m, n = vertices[k, 0], vertices[k, 1], vertices[k, 2], vertices[k, 3]
        b = apart(i, j, step, x, y, z, vx, vy, vz)
        c = apart(i, m, step, x, y, z, vx, vy, vz)
        d = apart(i, n, step, x, y, z, vx, vy, vz)
        p, q = shares[k, 0], shares[k, 1]
        g, f = slopes[k, 0], slopes[k, 1]
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
        ub, uc, ud = rate(i, j, vx, vy, vz), rate(i, m, vx, vy, vz), rate(i, n, vx, vy, vz)
        e0 += damping * (dot(b0, ub) + dot(c0, uc) + dot(d0, ud))
        e1 += damping * (dot(b1, ub) + dot(c1, uc) + dot(d1, ud))
        e2 += damping * (dot(b2, ub) + dot(c2, uc) + dot(d2, ud))

        wa, wb, wc, wd = w[i], w[j], w[m], w[n]
        g00 = wa * dot(a0, a0) + wb * dot(b0, b0) + wc * dot(c0, c0) + wd * dot(d0, d0)
        g11 = wa * dot(a1, a1) + wb * dot(b1, b1) + wc * dot(c1, c1) + wd * dot(d1, d1)
        g22 = wa * dot(a2, a2) + wb * dot(b2, b2) + wc * dot(c2, c2) + wd * dot(d2, d2)
        g01 = wa * dot(a0, a1) + wb * dot(b0, b1) + wc * dot(c0, c1) + wd * dot(d0, d1)
        g02 = wa * dot(a0, a2) + wb * dot(b0, b2) + wc * dot(c0, c2) + wd * dot(d0, d2)
        g12 = wa * dot(a1, a2) + wb * dot(b1, b2) + wc * dot(c1, c2) + wd * dot(d1, d2)

        pull = step * area[k]
        k0, k1, k01, k2 = pull * weft, pull * warp, pull * coupling, pull * shear
        r0, r1, r2 = k0 * e0 + k01 * e1, k01 * e0 + k1 * e1, k2 * e2
        if impulse is not None:
            r0, r1, r2 = r0 - impulse[k, 0], r1 - impulse[k, 1], r2 - impulse[k, 2]
        time = step + damping
        s0, s1, s2 = solved(
            one + time * (k0 * g00 + k01 * g01), time * (k0 * g01 + k01 * g11), time * (k0 * g02 + k01 * g12),
            time * (k01 * g00 + k1 * g01), one + time * (k01 * g01 + k1 * g11), time * (k01 * g02 + k1 * g12),
            time * k2 * g02, time * k2 * g12, one + time * k2 * g22, r0, r1, r2, one,
        )  # fmt: skip
        if impulse is not None:
            impulse[k, 0] += s0
            impulse[k, 1] += s1
            impulse[k, 2] += s2
        push(i, wa, combined3(s0, a0, s1, a1, s2, a2), vx, vy, vz)
        push(j, wb, combined3(s0, b0, s1, b1, s2, b2), vx, vy, vz)
        push(m, wc, combined3(s0, c0, s1, c1, s2, c2), vx, vy, vz)
        push(n, wd, combined3(s0, d0, s1, d1, s2, d2), vx, vy, vz)


@inlined
def apart(i, j, step, x, y, z, vx, vy, vz):
    """From vertex i to vertex j at the step's end [m]."""
    return (
        x[j] - x[i] + step * (vx[j] - vx[i]),
        y[j] - y[i] + step * (vy[j] - vy[i]),
        z[j] - z[i] + step * (vz[j] - vz[i]),
    )


@inlined
def rate(i, j, vx, vy, vz):
    """Velocity of vertex j against vertex i [m/s]."""
    return vx[j] - vx[i], vy[j] - vy[i], vz[j] - vz[i]


@inlined
def push(i, weight, change, vx, vy, vz):
    """Take an impulse from a vertex; one that stands for none may be the same as another, so its velocity is read
    anew."""
    vx[i] = vx[i] - weight * change[0]
    vy[i] = vy[i] - weight * change[1]
    vz[i] = vz[i] - weight * change[2]


@inlined
def dot(a, b):
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


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
    return p * a[0] + q * b[0], p * a[1] + q * b[1], p * a[2] + q * b[2]


@inlined
def combined3(p, a, q, b, r, c):
    """The vector p a + q b + r c."""
    return (
        p * a[0] + q * b[0] + r * c[0],
        p * a[1] + q * b[1] + r * c[1],
        p * a[2] + q * b[2] + r * c[2],
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
