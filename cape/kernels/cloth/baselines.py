"""Two yardsticks for the solvers' inner loops: the loop that anybody would write, and what the arithmetic alone costs.

Both take substeps of symplectic Euler with E distance springs, K bend springs of four vertices and N vertices, without
gravity, contact or air. A grid's bend springs of three vertices count as four, one of them with the coefficient 0.
"""

import math

from cape.kernels.jit import inlined, kernel, routine


@kernel
def scalar_step(
    substeps, step, inverse_mass, first, second, stiffness, rest, damping,
    bend_vertices, bend_coefficients, bend_stiffness, bend_damping, fx, fy, fz, x, y, z, vx, vy, vz,
):  # fmt: skip
    """Advance the state by substeps of `step` [s], one spring after the other.

    `first` and `second` (E,) are the ends of springs, `bend_vertices` and `bend_coefficients` have shape (K, 4); both
    are None without bending, as a damping time [s] is without damping. The forces f (N,) are room. Numbers are given in
    the precision of the state.
    """
    tiny = x.dtype.type(1e-18)
    for _ in range(substeps):
        for i in range(x.size):
            fx[i], fy[i], fz[i] = 0, 0, 0
        for k in range(first.size):
            i, j = first[k], second[k]
            dx, dy, dz = x[j] - x[i], y[j] - y[i], z[j] - z[i]
            squared = dx * dx + dy * dy + dz * dz + tiny
            excess = squared - rest[k] * math.sqrt(squared)
            if damping is not None:
                excess += damping * ((vx[j] - vx[i]) * dx + (vy[j] - vy[i]) * dy + (vz[j] - vz[i]) * dz)
            pull = stiffness[k] * excess / squared
            fx[i] += pull * dx
            fy[i] += pull * dy
            fz[i] += pull * dz
            fx[j] -= pull * dx
            fy[j] -= pull * dy
            fz[j] -= pull * dz
        if bend_vertices is not None:
            for k in range(bend_stiffness.size):
                bx = by = bz = x.dtype.type(0)
                for a in range(bend_vertices.shape[1]):
                    i, c = bend_vertices[k, a], bend_coefficients[k, a]
                    if bend_damping is not None:
                        bx += c * (x[i] + bend_damping * vx[i])
                        by += c * (y[i] + bend_damping * vy[i])
                        bz += c * (z[i] + bend_damping * vz[i])
                    else:
                        bx += c * x[i]
                        by += c * y[i]
                        bz += c * z[i]
                bx, by, bz = bend_stiffness[k] * bx, bend_stiffness[k] * by, bend_stiffness[k] * bz
                for a in range(bend_vertices.shape[1]):
                    i, c = bend_vertices[k, a], bend_coefficients[k, a]
                    fx[i] -= c * bx
                    fy[i] -= c * by
                    fz[i] -= c * bz
        move(step, inverse_mass, fx, fy, fz, x, y, z, vx, vy, vz)


@inlined
def move(step, inverse_mass, fx, fy, fz, x, y, z, vx, vy, vz):
    """Symplectic Euler: v += dt a, then x += dt v with the new v."""
    for i in range(inverse_mass.size):
        a = step * inverse_mass[i]
        vx[i] += a * fx[i]
        vy[i] += a * fy[i]
        vz[i] += a * fz[i]
        x[i] += step * vx[i]
        y[i] += step * vy[i]
        z[i] += step * vz[i]


@routine
def limit_step(
    substeps, step, inverse_mass, stiffness, rest, damping, bend_coefficients, bend_stiffness, bend_damping,
    forces, states,
):  # fmt: skip
    """Do the arithmetic of `scalar_step` on contiguous data: no index, no overlap, and the state stays in the cache.

    `states` (4, 6, n) and `forces` (4, 3, n) are those of four rows of n strangers, some 256: a spring joins vertex i
    of the first row to vertex i of the second, n springs a pass until all of `stiffness` (E,) are done; bend springs
    join one of each row, and the first row moves until all of `inverse_mass` (N,) are. Here `bend_coefficients` has
    shape (4, K). A layout that shares work between springs can fall below this.
    The numbers stand for no cloth.
    """
    s, t, u, v, n = states[0], states[1], states[2], states[3], states.shape[2]
    f, g, h, e = forces[0], forces[1], forces[2], forces[3]
    for _ in range(substeps):
        for begin in range(0, stiffness.size, n):
            end = begin + n
            limit_springs(
                stiffness[begin:end], rest[begin:end], damping,
                s[0], s[1], s[2], s[3], s[4], s[5], t[0], t[1], t[2], t[3], t[4], t[5],
                f[0], f[1], f[2], g[0], g[1], g[2],
            )  # fmt: skip
        if bend_coefficients is not None:
            for begin in range(0, bend_stiffness.size, n):
                end = begin + n
                k, c0, c1 = bend_stiffness[begin:end], bend_coefficients[0, begin:end], bend_coefficients[1, begin:end]
                c2, c3 = bend_coefficients[2, begin:end], bend_coefficients[3, begin:end]
                for a in range(3):
                    limit_bends(
                        k, c0, c1, c2, c3, bend_damping, s[a], s[3 + a], t[a], t[3 + a], u[a], u[3 + a],
                        v[a], v[3 + a], f[a], g[a], h[a], e[a],
                    )  # fmt: skip
        for begin in range(0, inverse_mass.size, n):
            limit_move(
                step, inverse_mass[begin : begin + n], f[0], f[1], f[2], s[0], s[1], s[2], s[3], s[4], s[5]
            )  # fmt: skip
        forces[:] = 0


@kernel
def limit_springs(
    stiffness, rest, damping, x, y, z, vx, vy, vz, x1, y1, z1, vx1, vy1, vz1, fx, fy, fz, gx, gy, gz
):  # fmt: skip
    """The arithmetic of springs between two rows of vertices."""
    tiny = x.dtype.type(1e-18)
    for i in range(stiffness.size):
        dx, dy, dz = x1[i] - x[i], y1[i] - y[i], z1[i] - z[i]
        squared = dx * dx + dy * dy + dz * dz + tiny
        excess = squared - rest[i] * math.sqrt(squared)
        if damping is not None:
            excess += damping * ((vx1[i] - vx[i]) * dx + (vy1[i] - vy[i]) * dy + (vz1[i] - vz[i]) * dz)
        pull = stiffness[i] * excess / squared
        fx[i] += pull * dx
        fy[i] += pull * dy
        fz[i] += pull * dz
        gx[i] -= pull * dx
        gy[i] -= pull * dy
        gz[i] -= pull * dz


@kernel
def limit_bends(
    stiffness, c0, c1, c2, c3, damping, p0, v0, p1, v1, p2, v2, p3, v3, f0, f1, f2, f3
):  # fmt: skip
    """The arithmetic of bend springs on four rows of vertices, along one coordinate."""
    for i in range(stiffness.size):
        if damping is not None:
            b = (
                c0[i] * (p0[i] + damping * v0[i])
                + c1[i] * (p1[i] + damping * v1[i])
                + c2[i] * (p2[i] + damping * v2[i])
                + c3[i] * (p3[i] + damping * v3[i])
            )
        else:
            b = c0[i] * p0[i] + c1[i] * p1[i] + c2[i] * p2[i] + c3[i] * p3[i]
        b *= stiffness[i]
        f0[i] -= c0[i] * b
        f1[i] -= c1[i] * b
        f2[i] -= c2[i] * b
        f3[i] -= c3[i] * b


@kernel
def limit_move(step, inverse_mass, fx, fy, fz, x, y, z, vx, vy, vz):
    """Symplectic Euler on contiguous data."""
    move(step, inverse_mass, fx, fy, fz, x, y, z, vx, vy, vz)
