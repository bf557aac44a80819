"""Forces on a cloth whose vertices are a grid, stored row after row in flat arrays.

A spring family joins each vertex i to i + offset, so that a whole family is one contiguous loop without any index
array. Springs that would leave the grid (from a row's end to the next row's start) have stiffness 0. Loops start at 0
over shifted views: an index of unknown sign costs a branch that keeps LLVM from vectorising.
"""

import math

from cape.kernels.jit import inlined, kernel


@kernel
def spring_forces(offset, x, y, z, vx, vy, vz, stiffness, rest, damping_time, tiny, sx, sy, sz):
    """Force of each spring of one family on its first end [N].

    f = k (l - l0 + tau dl/dt) u, with u the unit vector towards the second end, l its length and k tau the damping of
    Kelvin and Voigt. `tiny` [m2] keeps a spring of zero length from dividing by zero.
    """
    x1, y1, z1 = x[offset:], y[offset:], z[offset:]
    vx1, vy1, vz1 = vx[offset:], vy[offset:], vz[offset:]
    for i in range(x1.size):
        dx, dy, dz = x1[i] - x[i], y1[i] - y[i], z1[i] - z[i]
        squared = dx * dx + dy * dy + dz * dz + tiny
        approach = (vx1[i] - vx[i]) * dx + (vy1[i] - vy[i]) * dy + (vz1[i] - vz[i]) * dz
        s = stiffness[i] * (squared - rest[i] * math.sqrt(squared) + damping_time * approach) / squared
        sx[i], sy[i], sz[i] = s * dx, s * dy, s * dz


@kernel
def add_spring_forces(offset, sx, sy, sz, fx, fy, fz):
    """Add each spring's force to its first end, and the opposite to its second end."""
    n = fx.size
    for i in range(n - offset):
        fx[i] += sx[i]
        fy[i] += sy[i]
        fz[i] += sz[i]
    fx1, fy1, fz1 = fx[offset:], fy[offset:], fz[offset:]
    for i in range(n - offset):
        fx1[i] -= sx[i]
        fy1[i] -= sy[i]
        fz1[i] -= sz[i]


@kernel
def add_bend_forces(offset, p, v, stiffness, damping_time, b, f):
    """Add the force of bend springs along one coordinate: each draws a vertex to the midpoint of its two neighbours.

    The energy is 1/2 k |p0 - 2 p1 + p2|^2, the second difference of three vertices in a row: the flat-rest quadratic
    bending energy (Bergou 2006, eq. 4, on a regular grid). Linear, so each coordinate stands alone.
    """
    p1, p2 = p[offset:], p[2 * offset :]
    v1, v2 = v[offset:], v[2 * offset :]
    count = p2.size
    for i in range(count):
        b[i] = stiffness[i] * (p[i] - p1[i] - p1[i] + p2[i] + damping_time * (v[i] - v1[i] - v1[i] + v2[i]))
    for i in range(count):
        f[i] -= b[i]
    f1 = f[offset:]
    for i in range(count):
        f1[i] += b[i] + b[i]
    f2 = f[2 * offset :]
    for i in range(count):
        f2[i] -= b[i]


@inlined
def triangle_air_force(px, py, pz, qx, qy, qz, ux, uy, uz, drag, lift, tiny):
    """A third of the force of the air on a triangle with edges p and q from one corner, at relative wind u [N].

    F = rho/2 A (n.u) (Cd u + Cl (|u| n - (n.u/|u|) u)) with n the unit normal turned along u: drag on the projected
    area along u, lift across it. `drag` and `lift` are rho Cd / 12 and rho Cl / 12: a third, of a half, of half a cross
    product's length.
    """
    nx, ny, nz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    flow = nx * ux + ny * uy + nz * uz
    speed = math.sqrt(ux * ux + uy * uy + uz * uz + tiny)
    doubled_area = math.sqrt(nx * nx + ny * ny + nz * nz + tiny * tiny)
    along = abs(flow) * (drag - lift * abs(flow) / (doubled_area * speed))
    across = flow * lift * speed / doubled_area
    return along * ux + across * nx, along * uy + across * ny, along * uz + across * nz


@kernel
def air_forces(
    columns, x, y, z, vx, vy, vz, cells, wind_x, wind_y, wind_z, third, drag, lift, tiny, ax, ay, az, bx, by, bz
):
    """A third of the force of the air on the two triangles of each cell [N].

    The triangles are (i, i+1, i+columns) in `a` and (i+columns+1, i+columns, i+1) in `b`; `cells` is 1 where vertex i
    is the first corner of a cell, otherwise 0. `drag`, `lift` and `tiny` as in `triangle_air_force`; `third` is 1/3.
    """
    xr, yr, zr, vxr, vyr, vzr = x[1:], y[1:], z[1:], vx[1:], vy[1:], vz[1:]
    xd, yd, zd, vxd, vyd, vzd = x[columns:], y[columns:], z[columns:], vx[columns:], vy[columns:], vz[columns:]
    last = columns + 1
    xe, ye, ze, vxe, vye, vze = x[last:], y[last:], z[last:], vx[last:], vy[last:], vz[last:]
    for i in range(xe.size):
        shared_x, shared_y, shared_z = vxr[i] + vxd[i], vyr[i] + vyd[i], vzr[i] + vzd[i]
        fx, fy, fz = triangle_air_force(
            xr[i] - x[i],
            yr[i] - y[i],
            zr[i] - z[i],
            xd[i] - x[i],
            yd[i] - y[i],
            zd[i] - z[i],
            wind_x - third * (vx[i] + shared_x),
            wind_y - third * (vy[i] + shared_y),
            wind_z - third * (vz[i] + shared_z),
            drag,
            lift,
            tiny,
        )
        ax[i], ay[i], az[i] = cells[i] * fx, cells[i] * fy, cells[i] * fz
        fx, fy, fz = triangle_air_force(
            xd[i] - xe[i],
            yd[i] - ye[i],
            zd[i] - ze[i],
            xr[i] - xe[i],
            yr[i] - ye[i],
            zr[i] - ze[i],
            wind_x - third * (vxe[i] + shared_x),
            wind_y - third * (vye[i] + shared_y),
            wind_z - third * (vze[i] + shared_z),
            drag,
            lift,
            tiny,
        )
        bx[i], by[i], bz[i] = cells[i] * fx, cells[i] * fy, cells[i] * fz


@kernel
def add_air_forces(columns, a, b, f):
    """Give each corner of a cell's two triangles its third of the force, along one coordinate."""
    count = f.size - columns - 1
    for i in range(count):
        f[i] += a[i]
    right = f[1:]
    for i in range(count):
        right[i] += a[i] + b[i]
    down = f[columns:]
    for i in range(count):
        down[i] += a[i] + b[i]
    across = f[columns + 1 :]
    for i in range(count):
        across[i] += b[i]


@kernel
def advance(dt, gravity_x, gravity_y, gravity_z, inverse_mass, fx, fy, fz, x, y, z, vx, vy, vz):
    """One step of symplectic Euler: v += dt a, then x += dt v with the new v. Clears the forces."""
    for i in range(x.size):
        a = dt * inverse_mass[i]
        vx[i] += a * fx[i] + dt * gravity_x
        vy[i] += a * fy[i] + dt * gravity_y
        vz[i] += a * fz[i] + dt * gravity_z
        x[i] += dt * vx[i]
        y[i] += dt * vy[i]
        z[i] += dt * vz[i]
        fx[i] = 0
        fy[i] = 0
        fz[i] = 0
