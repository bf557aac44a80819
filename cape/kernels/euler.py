"""Symplectic Euler: one call is one frame, for one thread or each of a team."""

from cape.kernels.bones import move_bones, start_motion
from cape.kernels.forces import compute_forces
from cape.kernels.frame import collide, hold_attached
from cape.kernels.jit import driver, kernel
from cape.kernels.team import meet, span


@kernel
def advance(dt, gravity_x, gravity_y, gravity_z, inverse_mass, fx, fy, fz, x, y, z, vx, vy, vz):
    """One step: v += dt a, then x += dt v with the new v."""
    for i in range(x.size):
        a = dt * inverse_mass[i]
        vx[i] += a * fx[i] + dt * gravity_x
        vy[i] += a * fy[i] + dt * gravity_y
        vz[i] += a * fz[i] + dt * gravity_z
        x[i] += dt * vx[i]
        y[i] += dt * vy[i]
        z[i] += dt * vz[i]


@driver
def euler_frame(
    s, model, inertia, forces, room, motion, m, attached, free, thickness, capsules, planes, boxes,
    substeps, duration, team,
):  # fmt: skip
    """Advance the state `s` by `duration` [s] in `substeps` steps: forces, integration, contact, attachments.

    `forces` (3, N) is shared room, `room` the forces' scratch and `m` a MotionRoom of this thread; `attached`,
    `capsules`, `planes`, `boxes`, `team` and the parts of `model` are None where there are none, and then pruned.
    """
    lo, hi = span(s.x.size, team)
    step = duration / substeps
    dtype = s.x.dtype.type
    fx, fy, fz = forces[0], forces[1], forces[2]
    gx, gy, gz = dtype(inertia.gravity[0]), dtype(inertia.gravity[1]), dtype(inertia.gravity[2])
    start_motion(
        motion.position0, motion.rotation0, motion.position1, motion.rotation1, duration, substeps,
        m.matrices, m.turns, m.velocity, m.spin,
    )  # fmt: skip
    for substep in range(substeps):
        compute_forces(lo, hi, s, model, fx, fy, fz, room, team)
        meet(team)
        advance(
            dtype(step), gx, gy, gz, inertia.inverse_mass[lo:hi], fx[lo:hi], fy[lo:hi], fz[lo:hi],
            s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
        )  # fmt: skip
        move_bones(motion.position0, m.velocity, m.turns, (substep + 1) * step, m.positions, m.matrices)
        collide(lo, hi, s, free, thickness, capsules, planes, boxes, m, substep, step)
        hold_attached(lo, hi, s, attached, m, step)
        meet(team)
