"""Symplectic Euler: one call is one frame, for one thread or each of a team."""

from cape.kernels.bones import move_bones
from cape.kernels.cloth.forces import compute_forces
from cape.kernels.jit import driver, kernel
from cape.kernels.self_contact.self_contact import keep_apart, press
from cape.kernels.solve.attachments import hold
from cape.kernels.solve.frame import begin_frame, keep_out
from cape.kernels.solve.journal import note_end, note_integrated
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
    s, model, inertia, forces, room, motion, m, attached, contacts, substeps, duration, journal, team
):  # fmt: skip
    """Advance the state `s` by `duration` [s] in `substeps` steps: forces, integration, contact, attachments.

    `forces` (3, N) is shared room, `room` the forces' scratch, `m` a MotionRoom and `contacts` those of this thread;
    `attached`, `journal`, `team` and the parts of `model` and `contacts` are None where there are none, and then
    pruned.
    """
    lo, hi = span(s.x.size, team)
    step = duration / substeps
    dtype = s.x.dtype.type
    fx, fy, fz = forces[0], forces[1], forces[2]
    gx, gy, gz = dtype(inertia.gravity[0]), dtype(inertia.gravity[1]), dtype(inertia.gravity[2])
    begin_frame(lo, hi, s, attached, contacts.groups, contacts.faces, motion, m, duration, substeps, team)
    for substep in range(substeps):
        compute_forces(lo, hi, s, model, fx, fy, fz, room, team)
        meet(team)
        advance(
            dtype(step), gx, gy, gz, inertia.inverse_mass[lo:hi], fx[lo:hi], fy[lo:hi], fz[lo:hi],
            s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
        )  # fmt: skip
        move_bones(motion, m, (substep + 1) * step)
        note_integrated(lo, hi, s, journal, substep)
        press(lo, hi, s, contacts.pressure, step)
        keep_out(
            lo, hi, s, inertia.inverse_mass, None, contacts.free, contacts.groups, contacts.faces, m, 1.0, substep,
            step, team,
        )  # fmt: skip
        hold(lo, hi, s, attached, m, (substep + 1) * step, step)
        keep_apart(s, contacts.layers, inertia.inverse_mass, substep, substeps - 1 - substep, step, team)
        note_end(lo, hi, s, journal, substep)
        meet(team)
