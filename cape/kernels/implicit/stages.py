"""The pieces of an implicit stage: what it aims at, where it starts, and what is left over in the equation of motion.

A stage finds positions x with velocities v = (x - xt) / b and M (v - vt) / b = f(x, v) + M g. `target` (6, N) holds xt
and vt, `start` (6, N) the positions and velocities that a step began with.
"""

import math

from cape.kernels.bones import fill_matrix
from cape.kernels.jit import kernel, routine


@kernel
def stand(b, x, y, z, vx, vy, vz, target):
    """Set xt and vt to where x and v are: no acceleration."""
    xt, yt, zt, ut, vt, wt = target[0], target[1], target[2], target[3], target[4], target[5]
    for i in range(x.size):
        xt[i], yt[i], zt[i] = x[i] - b * vx[i], y[i] - b * vy[i], z[i] - b * vz[i]
        ut[i], vt[i], wt[i] = vx[i], vy[i], vz[i]


@kernel
def scale(factor, dx, dy, dz, acceleration):
    """Accelerations from a solution."""
    ax, ay, az = acceleration[0], acceleration[1], acceleration[2]
    for i in range(ax.size):
        ax[i], ay[i], az[i] = factor * dx[i], factor * dy[i], factor * dz[i]


@kernel
def note_acceleration(rate, vx, vy, vz, target, acceleration):
    """Accelerations of a stage: (v - vt) / b, with `rate` 1/b."""
    ut, vt, wt = target[3], target[4], target[5]
    ax, ay, az = acceleration[0], acceleration[1], acceleration[2]
    for i in range(vx.size):
        ax[i], ay[i], az[i] = rate * (vx[i] - ut[i]), rate * (vy[i] - vt[i]), rate * (vz[i] - wt[i])


@kernel
def begin_trapezoid(b, ahead, acceleration, x, y, z, vx, vy, vz, start, target):
    """Keep the start, set xt and vt, and guess x at the end of the trapezoidal rule's 2 b seconds.

    `ahead` [s2] is what accelerations count for in the guess: half the square of that time, or 0.
    """
    x0, y0, z0, u0, v0, w0 = start[0], start[1], start[2], start[3], start[4], start[5]
    xt, yt, zt, ut, vt, wt = target[0], target[1], target[2], target[3], target[4], target[5]
    ax, ay, az = acceleration[0], acceleration[1], acceleration[2]
    for i in range(x.size):
        x0[i], y0[i], z0[i] = x[i], y[i], z[i]
        u0[i], v0[i], w0[i] = vx[i], vy[i], vz[i]
        xt[i], yt[i], zt[i] = x[i] + b * vx[i], y[i] + b * vy[i], z[i] + b * vz[i]
        ut[i] = vx[i] + b * ax[i]
        vt[i] = vy[i] + b * ay[i]
        wt[i] = vz[i] + b * az[i]
        x[i] = xt[i] + b * vx[i] + ahead * ax[i]
        y[i] = yt[i] + b * vy[i] + ahead * ay[i]
        z[i] = zt[i] + b * vz[i] + ahead * az[i]


@kernel
def begin_bdf2(c0, c1, rest, ahead, x, y, z, vx, vy, vz, start, target):
    """Set xt and vt from the start and the first stage, and guess x at the end of the `rest` of the step [s].

    `ahead` [s] is what the first stage's v - vt count for in the guess: half the square of that time over b, or 0.
    """
    x0, y0, z0, u0, v0, w0 = start[0], start[1], start[2], start[3], start[4], start[5]
    xt, yt, zt, ut, vt, wt = target[0], target[1], target[2], target[3], target[4], target[5]
    for i in range(x.size):
        # x1 + c0 (x1 - x0), as c1 - c0 = 1: far from the origin nothing is lost.
        xt[i] = x[i] + c0 * (x[i] - x0[i])
        yt[i] = y[i] + c0 * (y[i] - y0[i])
        zt[i] = z[i] + c0 * (z[i] - z0[i])
        x[i] += rest * vx[i] + ahead * (vx[i] - ut[i])
        y[i] += rest * vy[i] + ahead * (vy[i] - vt[i])
        z[i] += rest * vz[i] + ahead * (vz[i] - wt[i])
        ut[i], vt[i], wt[i] = c1 * vx[i] - c0 * u0[i], c1 * vy[i] - c0 * v0[i], c1 * vz[i] - c0 * w0[i]


@kernel
def begin_euler(h, x, y, z, vx, vy, vz, target):
    """Set xt and vt to the start, and guess x after `h` seconds."""
    xt, yt, zt, ut, vt, wt = target[0], target[1], target[2], target[3], target[4], target[5]
    for i in range(x.size):
        xt[i], yt[i], zt[i] = x[i], y[i], z[i]
        ut[i], vt[i], wt[i] = vx[i], vy[i], vz[i]
        x[i] += h * vx[i]
        y[i] += h * vy[i]
        z[i] += h * vz[i]


@routine
def place_at(time, motion, m):
    """Put the bones where they are `time` [s] after the frame's start."""
    position0, rotation0 = motion.position0, motion.rotation0
    velocity, spin, positions, matrices = m.velocity, m.spin, m.positions, m.matrices
    for bone in range(position0.shape[0]):
        for k in range(3):
            positions[bone, k] = position0[bone, k] + time * velocity[bone, k]
        x, y, z = 0.5 * time * spin[bone, 0], 0.5 * time * spin[bone, 1], 0.5 * time * spin[bone, 2]
        half = math.sqrt(x * x + y * y + z * z)
        scale = math.sin(half) / half if half > 1e-12 else 1.0
        w, x, y, z = math.cos(half), scale * x, scale * y, scale * z
        w0, x0, y0, z0 = rotation0[bone, 0], rotation0[bone, 1], rotation0[bone, 2], rotation0[bone, 3]
        fill_matrix(
            w * w0 - x * x0 - y * y0 - z * z0,
            w * x0 + x * w0 + y * z0 - z * y0,
            w * y0 - x * z0 + y * w0 + z * x0,
            w * z0 + x * y0 - y * x0 + z * w0,
            matrices[bone],
        )


@kernel
def follow(rate, xt, yt, zt, x, y, z, vx, vy, vz):
    """Velocities that belong to positions: v = (x - xt) / b, with `rate` 1/b."""
    for i in range(x.size):
        vx[i] = rate * (x[i] - xt[i])
        vy[i] = rate * (y[i] - yt[i])
        vz[i] = rate * (z[i] - zt[i])


@kernel
def move(share, ox, oy, oz, dx, dy, dz, x, y, z):
    """Positions a share of the way along a Newton step from the old ones."""
    for i in range(x.size):
        x[i] = ox[i] + share * dx[i]
        y[i] = oy[i] + share * dy[i]
        z[i] = oz[i] + share * dz[i]


@kernel
def subtract_inertia(rate, gx, gy, gz, free, mass, ut, vt, wt, vx, vy, vz, fx, fy, fz, rx, ry, rz):
    """What is left over in the equation of motion: f + M g - M (v - vt) / b, 0 for attached vertices."""
    for i in range(vx.size):
        m = mass[i]
        rx[i] = free[i] * (fx[i] + m * (gx - rate * (vx[i] - ut[i])))
        ry[i] = free[i] * (fy[i] + m * (gy - rate * (vy[i] - vt[i])))
        rz[i] = free[i] * (fz[i] + m * (gz - rate * (vz[i] - wt[i])))


@routine
def longest(d, lo, hi):
    """Length of the longest of the vectors lo to hi [m]; a NaN is longer than all."""
    squared = 0.0
    for i in range(lo, hi):
        value = d[0, i] * d[0, i] + d[1, i] * d[1, i] + d[2, i] * d[2, i]
        if math.isnan(value):
            return math.nan
        squared = max(squared, value)
    return math.sqrt(squared)


@routine
def longest_share(d, front, tolerance, digits, x, y, z):
    """Largest length of the vectors from `front` on, one for each vertex, as a share of what each may be.

    That is the tolerance [m], or the share `digits` of the vertex's distance from the origin. A NaN is larger than all.
    """
    squared, least, per_squared_metre = 0.0, tolerance * tolerance, digits * digits
    for i in range(x.size):
        k = front + i
        length = d[0, k] * d[0, k] + d[1, k] * d[1, k] + d[2, k] * d[2, k]
        if math.isnan(length):
            return math.nan
        squared = max(squared, length / max(least, per_squared_metre * (x[i] * x[i] + y[i] * y[i] + z[i] * z[i])))
    return math.sqrt(squared)
