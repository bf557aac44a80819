"""XPBD with small steps: one call is one frame.

Macklin, Mueller, Chentanez 2016, "XPBD", eq. 18 (multiplier update) and eq. 26 (damping), with the small steps of
Macklin et al. 2019. Constraints come sorted by colour; no two of one colour share a vertex.
"""

import math

from cape.kernels.bones import move_bones, start_motion
from cape.kernels.frame import add_air, collide, hold_attached
from cape.kernels.jit import driver, kernel


@kernel
def predict(dt, gravity_x, gravity_y, gravity_z, inverse_mass, fx, fy, fz, x, y, z, vx, vy, vz, ox, oy, oz):
    """Keep where the vertices were in `o` and advance them by external forces alone. Clears the forces."""
    for i in range(x.size):
        a = dt * inverse_mass[i]
        vx[i] += a * fx[i] + dt * gravity_x
        vy[i] += a * fy[i] + dt * gravity_y
        vz[i] += a * fz[i] + dt * gravity_z
        ox[i], oy[i], oz[i] = x[i], y[i], z[i]
        x[i] += dt * vx[i]
        y[i] += dt * vy[i]
        z[i] += dt * vz[i]
        fx[i] = 0
        fy[i] = 0
        fz[i] = 0


@kernel
def update_velocity(dt, ox, oy, oz, x, y, z, vx, vy, vz):
    """Velocity from the change of position over the step."""
    inverse = 1 / dt
    for i in range(x.size):
        vx[i] = (x[i] - ox[i]) * inverse
        vy[i] = (y[i] - oy[i]) * inverse
        vz[i] = (z[i] - oz[i]) * inverse


@kernel
def solve_stretch(first, second, rest, compliance, weight, damping, step, lagrange, x, y, z, ox, oy, oz):
    """C(x) = |x1 - x0| - l0 = 0 with compliance [m/N] and damping time [s]; weights are inverse masses."""
    for k in range(first.size):
        i, j = first[k], second[k]
        total = weight[i] + weight[j]
        if total == 0:
            continue
        dx, dy, dz = x[j] - x[i], y[j] - y[i], z[j] - z[i]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        if length == 0:
            continue
        dx, dy, dz = dx / length, dy / length, dz / length
        alpha = compliance[k] / (step * step)
        gamma = damping / step
        moved = (
            dx * (x[j] - ox[j] - x[i] + ox[i]) + dy * (y[j] - oy[j] - y[i] + oy[i]) + dz * (z[j] - oz[j] - z[i] + oz[i])
        )
        change = (-(length - rest[k]) - alpha * lagrange[k] - gamma * moved) / ((1 + gamma) * total + alpha)
        lagrange[k] += change
        x[i] -= weight[i] * change * dx
        y[i] -= weight[i] * change * dy
        z[i] -= weight[i] * change * dz
        x[j] += weight[j] * change * dx
        y[j] += weight[j] * change * dy
        z[j] += weight[j] * change * dz


@kernel
def solve_bend(first, middle, last, compliance, weight, damping, step, lagrange, p, o):
    """C(p) = p0 - 2 p1 + p2 = 0 along one coordinate, with compliance [m/N] and damping time [s]."""
    for k in range(first.size):
        i, j, l = first[k], middle[k], last[k]  # noqa: E741
        total = weight[i] + 4 * weight[j] + weight[l]
        if total == 0:
            continue
        alpha = compliance[k] / (step * step)
        gamma = damping / step
        bend = p[i] - p[j] - p[j] + p[l]
        moved = bend - (o[i] - o[j] - o[j] + o[l])
        change = (-bend - alpha * lagrange[k] - gamma * moved) / ((1 + gamma) * total + alpha)
        lagrange[k] += change
        p[i] += weight[i] * change
        p[j] -= 2 * weight[j] * change
        p[l] += weight[l] * change


@driver
def xpbd_frame(
    s, c, forces, old, motion, m, attached, air, free, thickness, capsules, planes, boxes,
    substeps, iterations, duration,
):  # fmt: skip
    """Advance the state `s` by `duration` [s] in `substeps` steps of `iterations` sweeps over the constraints `c`.

    `forces` and `old` (3, N) are room; `m` is a MotionRoom; `attached`, `air`, `capsules`,
    `planes` and `boxes` are None where the scene has none, and then pruned with the code that serves them.
    """
    step = duration / substeps
    dtype = s.x.dtype.type
    h = dtype(step)
    fx, fy, fz = forces[0], forces[1], forces[2]
    ox, oy, oz = old[0], old[1], old[2]
    gx, gy, gz = dtype(c.gravity[0]), dtype(c.gravity[1]), dtype(c.gravity[2])
    damping, bend_damping = dtype(c.damping_time), dtype(c.bend_damping_time)
    start_motion(
        motion.position0, motion.rotation0, motion.position1, motion.rotation1, duration, substeps,
        m.matrices, m.turns, m.velocity, m.spin,
    )  # fmt: skip
    for substep in range(substeps):
        if air is not None:
            add_air(s, air, fx, fy, fz)
        predict(h, gx, gy, gz, c.inverse_mass, fx, fy, fz, s.x, s.y, s.z, s.vx, s.vy, s.vz, ox, oy, oz)
        move_bones(motion.position0, m.velocity, m.turns, (substep + 1) * step, m.positions, m.matrices)
        if attached is not None:
            hold_attached(s, attached, m, step)
        c.lagrange[:] = 0
        c.bend_lagrange[:] = 0
        for _ in range(iterations):
            solve_stretch(
                c.first, c.second, c.rest, c.compliance, c.inverse_mass, damping, h, c.lagrange,
                s.x, s.y, s.z, ox, oy, oz,
            )  # fmt: skip
            for axis in range(3):
                p = s.x if axis == 0 else (s.y if axis == 1 else s.z)
                solve_bend(
                    c.bend_first, c.bend_middle, c.bend_last, c.bend_compliance, c.inverse_mass, bend_damping, h,
                    c.bend_lagrange[axis], p, old[axis],
                )  # fmt: skip
        update_velocity(h, ox, oy, oz, s.x, s.y, s.z, s.vx, s.vy, s.vz)
        collide(s, free, thickness, capsules, planes, boxes, m, substep, step)
