"""Implicit steps: backward Euler and TR-BDF2, one call is one frame, for one thread or each of a team.

Every stage finds positions x with v = (x - xt) / b and M (v - vt) / b = f(x, v) + M g:

    backward Euler   b = h,  xt = x0,  vt = v0
    TR-BDF2          b = gamma h / 2,  gamma = 2 - 2^1/2, for both stages
      to t + gamma h   xt = x0 + b v0,  vt = v0 + b a0        trapezoidal rule, a0 the acceleration at the start
      to t + h         xt = c1 x1 - c0 x0,  vt = c1 v1 - c0 v0,  c1 = 1 / (gamma (2 - gamma)),  c0 = c1 - 1

Bank et al. 1985, "Transient simulation of silicon devices and circuits"; Hosea and Shampine 1996, "Analysis and
implementation of TR-BDF2". Contact is left out of a0: its force at the start, large and gone a moment later, would be
thrown in again as if it lasted. What a resting vertex needs of it, the stage itself finds.

Newton's method with a line search on the directional derivative alone, since neither damping, air nor friction has an
energy: a step is taken if the derivative at its end is below that at its start in size (the curvature condition of
Nocedal and Wright 2006, eq. 3.7b), otherwise the zero of the derivative is approached by the secant.
"""

import math

from cape.kernels.bones import fill_matrix, start_motion, to_world
from cape.kernels.conjugate import CHUNK, dot_terms, solve_linear, sum_all
from cape.kernels.forces import compute_forces
from cape.kernels.frame import collide
from cape.kernels.jit import driver, kernel
from cape.kernels.stiffness import copy, prepare
from cape.kernels.team import meet, span

GAMMA = 2.0 - math.sqrt(2.0)
SLOPE = 0.9  # share of the first directional derivative up to which a step may overshoot
TRIES = 6  # of the line search
UNSOLVED, NEWTON, LINEAR, SHORTENED = 0, 1, 2, 3  # what is counted: stages not solved, iterations, shortened steps
NARROWEST, WIDEST = 0.1, 0.9  # share of the step at hand that the next try takes


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
def begin_trapezoid(b, acceleration, x, y, z, vx, vy, vz, start, target):
    """Keep the start, set xt and vt, and guess x at the end of the trapezoidal rule's 2 b seconds."""
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
        x[i], y[i], z[i] = xt[i] + b * vx[i], yt[i] + b * vy[i], zt[i] + b * vz[i]


@kernel
def begin_bdf2(c0, c1, rest, x, y, z, vx, vy, vz, start, target):
    """Set xt and vt from the start and the first stage, and guess x at the end of the `rest` of the step [s]."""
    x0, y0, z0, u0, v0, w0 = start[0], start[1], start[2], start[3], start[4], start[5]
    xt, yt, zt, ut, vt, wt = target[0], target[1], target[2], target[3], target[4], target[5]
    for i in range(x.size):
        # x1 + c0 (x1 - x0), as c1 - c0 = 1: far from the origin nothing is lost.
        xt[i] = x[i] + c0 * (x[i] - x0[i])
        yt[i] = y[i] + c0 * (y[i] - y0[i])
        zt[i] = z[i] + c0 * (z[i] - z0[i])
        ut[i], vt[i], wt[i] = c1 * vx[i] - c0 * u0[i], c1 * vy[i] - c0 * v0[i], c1 * vz[i] - c0 * w0[i]
        x[i] += rest * vx[i]
        y[i] += rest * vy[i]
        z[i] += rest * vz[i]


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


@driver
def place_at(time, position0, rotation0, velocity, spin, positions, matrices):
    """Fill the bones' `positions` and `matrices`, bone_to_world, `time` [s] after the frame's start."""
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


@driver
def hold_rigidly(lo, hi, attached, m, b, s, target):
    """Put the attached ones of vertices lo to hi where their bones are, with xt so that v is that of their bones."""
    if attached is not None:
        for k in range(attached.vertices.size):
            i, bone = attached.vertices[k], attached.bones[k]
            if i < lo or i >= hi:
                continue
            point = attached.points[k]
            x, y, z = to_world(bone, point[0], point[1], point[2], m.positions, m.matrices)
            lx, ly, lz = x - m.positions[bone, 0], y - m.positions[bone, 1], z - m.positions[bone, 2]
            spin, velocity = m.spin[bone], m.velocity[bone]
            vx = velocity[0] + spin[1] * lz - spin[2] * ly
            vy = velocity[1] + spin[2] * lx - spin[0] * lz
            vz = velocity[2] + spin[0] * ly - spin[1] * lx
            s.x[i], s.y[i], s.z[i] = x, y, z
            s.vx[i], s.vy[i], s.vz[i] = vx, vy, vz
            target[0, i], target[1, i], target[2, i] = x - b * vx, y - b * vy, z - b * vz


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


@driver
def longest(d, lo, hi):
    """Length of the longest of the vectors lo to hi [m]."""
    squared = 0.0
    for i in range(lo, hi):
        squared = max(squared, d[0, i] * d[0, i] + d[1, i] * d[1, i] + d[2, i] * d[2, i])
    return math.sqrt(squared)


@driver
def evaluate(lo, hi, s, model, inertia, scratch, work, matrix, b, team):
    """Set velocities and residual that belong to the positions of vertices lo to hi."""
    dtype = s.x.dtype.type
    rate = dtype(1.0 / b)
    t, f, a, e = work.target, work.forces, matrix.front + lo, matrix.front + hi
    r = work.vectors[1]
    follow(
        rate, t[0, lo:hi], t[1, lo:hi], t[2, lo:hi], s.x[lo:hi], s.y[lo:hi], s.z[lo:hi],
        s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
    )  # fmt: skip
    meet(team)
    compute_forces(lo, hi, s, model, f[0], f[1], f[2], scratch, team)
    subtract_inertia(
        rate, dtype(inertia.gravity[0]), dtype(inertia.gravity[1]), dtype(inertia.gravity[2]), inertia.free[lo:hi], inertia.mass[lo:hi],
        t[3, lo:hi], t[4, lo:hi], t[5, lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
        f[0, lo:hi], f[1, lo:hi], f[2, lo:hi], r[0, a:e], r[1, a:e], r[2, a:e],
    )  # fmt: skip


@driver
def step_along(lo, hi, share, s, front, work):
    """Move the vertices lo to hi a share of the Newton step from where it began."""
    o, d, a, e = work.old, work.vectors[0], front + lo, front + hi
    move(
        s.x.dtype.type(share), o[0, lo:hi], o[1, lo:hi], o[2, lo:hi], d[0, a:e], d[1, a:e], d[2, a:e],
        s.x[lo:hi], s.y[lo:hi], s.z[lo:hi],
    )  # fmt: skip


@driver
def slope_here(lo, hi, front, work, team):
    """Minus the directional derivative along the Newton step at the current residual [J]."""
    d, r, a, e = work.vectors[0], work.vectors[1], front + lo, front + hi
    dot_terms(d[0, a:e], d[1, a:e], d[2, a:e], r[0, a:e], r[1, a:e], r[2, a:e], work.terms[a:e])
    return sum_all(lo, hi, front, work.terms, work.sums[2], team)


@driver
def solve_stage(lo, hi, s, model, inertia, scratch, work, matrix, b, settings, counts, team):
    """Solve a stage by Newton's method from the positions at hand; returns the length of the last correction [m]."""
    front = matrix.front
    correction = 0.0
    evaluate(lo, hi, s, model, inertia, scratch, work, matrix, b, team)
    for _ in range(settings.iterations):
        prepare(lo, hi, s, model, b, matrix, work.inverse, team)
        iterations, slope = solve_linear(
            lo, hi, model, matrix, b, work.scratch, work.inverse, work.vectors, work.terms, work.sums,
            settings.forcing, settings.linear_iterations, team,
        )  # fmt: skip
        counts[NEWTON] += 1
        counts[LINEAR] += iterations
        copy(s.x[lo:hi], work.old[0, lo:hi])
        copy(s.y[lo:hi], work.old[1, lo:hi])
        copy(s.z[lo:hi], work.old[2, lo:hi])
        share, here = 1.0, 0.0
        for attempt in range(TRIES):
            if attempt > 0:
                share *= min(max(slope / (slope - here), NARROWEST), WIDEST)
                counts[SHORTENED] += 1
            step_along(lo, hi, share, s, front, work)
            evaluate(lo, hi, s, model, inertia, scratch, work, matrix, b, team)
            here = slope_here(lo, hi, front, work, team)
            if here >= -SLOPE * slope:
                break
        work.largest[lo // CHUNK : (hi + CHUNK - 1) // CHUNK] = 0.0
        if lo < hi:
            work.largest[lo // CHUNK] = share * longest(work.vectors[0], front + lo, front + hi)
        meet(team)
        correction = 0.0
        for k in range(work.largest.size):
            correction = max(correction, work.largest[k])
        if correction < settings.tolerance:
            break
    return correction


@driver
def accelerate(lo, hi, s, model, inertia, scratch, work, matrix, b, settings, counts, team):
    """Find the accelerations at the start of a frame from A a = (f + M g) / b^2.

    Those of modes slower than the step are what f and M say, to second order in the step. The others, which that would
    make huge from the last digits of the positions, are bounded.
    """
    dtype = s.x.dtype.type
    front = matrix.front
    stand(
        dtype(b), s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], work.target[:, lo:hi]
    )
    evaluate(lo, hi, s, model, inertia, scratch, work, matrix, b, team)
    prepare(lo, hi, s, model, b, matrix, work.inverse, team)
    iterations, _ = solve_linear(
        lo, hi, model, matrix, b, work.scratch, work.inverse, work.vectors, work.terms, work.sums,
        settings.forcing**3, settings.linear_iterations, team,
    )  # fmt: skip
    counts[LINEAR] += iterations
    d, a, e = work.vectors[0], front + lo, front + hi
    scale(dtype(1.0 / (b * b)), d[0, a:e], d[1, a:e], d[2, a:e], work.acceleration[:, lo:hi])


@driver
def begin_frame(motion, m, duration):
    """Find the velocities at which the bones move through the frame."""
    start_motion(
        motion.position0, motion.rotation0, motion.position1, motion.rotation1, duration, 1,
        m.matrices, m.turns, m.velocity, m.spin,
    )  # fmt: skip


@driver
def place_bones(time, motion, m):
    """Place the bones `time` [s] after the frame's start."""
    place_at(time, motion.position0, motion.rotation0, m.velocity, m.spin, m.positions, m.matrices)


@driver
def count_unsolved(correction, settings, counts):
    """Note a stage that was left with a correction [m] above the tolerance."""
    if not correction < settings.tolerance:
        counts[UNSOLVED] += 1


@driver
def backward_euler_frame(
    s, model, inertia, scratch, matrix, work, settings, counts, motion, m, attached,
    free, thickness, capsules, planes, boxes, substeps, duration, team,
):  # fmt: skip
    """Advance the state `s` by `duration` [s] in `substeps` steps of backward Euler.

    `scratch`, `work.scratch`, `counts`, `m` and the colliders are this thread's own, the rest is shared.
    """
    lo, hi = span(s.x.size, team)
    h = duration / substeps
    begin_frame(motion, m, duration)
    for substep in range(substeps):
        begin_euler(
            s.x.dtype.type(h), s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
            work.target[:, lo:hi],
        )  # fmt: skip
        place_bones((substep + 1) * h, motion, m)
        hold_rigidly(lo, hi, attached, m, h, s, work.target)
        correction = solve_stage(lo, hi, s, model, inertia, scratch, work, matrix, h, settings, counts, team)
        count_unsolved(correction, settings, counts)
        collide(lo, hi, s, free, thickness, capsules, planes, boxes, m, substep, h)


@driver
def tr_bdf2_frame(
    s, model, inertia, scratch, matrix, work, settings, counts, motion, m, attached,
    free, thickness, capsules, planes, boxes, substeps, duration, team,
):  # fmt: skip
    """Advance the state `s` by `duration` [s] in `substeps` steps of TR-BDF2; arguments as for backward Euler."""
    lo, hi = span(s.x.size, team)
    h = duration / substeps
    b, dtype = 0.5 * GAMMA * h, s.x.dtype.type
    c1 = 1.0 / (GAMMA * (2.0 - GAMMA))
    begin_frame(motion, m, duration)
    for substep in range(substeps):
        place_bones(substep * h, motion, m)
        hold_rigidly(lo, hi, attached, m, b, s, work.target)
        if substep == 0:
            accelerate(lo, hi, s, model, inertia, scratch, work, matrix, b, settings, counts, team)
        begin_trapezoid(
            dtype(b), work.acceleration[:, lo:hi], s.x[lo:hi], s.y[lo:hi], s.z[lo:hi],
            s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], work.start[:, lo:hi], work.target[:, lo:hi],
        )  # fmt: skip
        place_bones((substep + GAMMA) * h, motion, m)
        hold_rigidly(lo, hi, attached, m, b, s, work.target)
        correction = solve_stage(lo, hi, s, model, inertia, scratch, work, matrix, b, settings, counts, team)
        count_unsolved(correction, settings, counts)
        begin_bdf2(
            dtype(c1 - 1.0), dtype(c1), dtype((1.0 - GAMMA) * h), s.x[lo:hi], s.y[lo:hi], s.z[lo:hi],
            s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], work.start[:, lo:hi], work.target[:, lo:hi],
        )  # fmt: skip
        place_bones((substep + 1) * h, motion, m)
        hold_rigidly(lo, hi, attached, m, b, s, work.target)
        correction = solve_stage(lo, hi, s, model, inertia, scratch, work, matrix, b, settings, counts, team)
        count_unsolved(correction, settings, counts)
        note_acceleration(
            dtype(1.0 / b), s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], work.target[:, lo:hi], work.acceleration[:, lo:hi]
        )
        collide(lo, hi, s, free, thickness, capsules, planes, boxes, m, substep, h)
