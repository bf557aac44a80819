"""XPBD with small steps: one call is one frame, for one thread or each of a team.

Velocities are the unknowns, as `formulas` tells: predicted from external forces, changed by the constraints, then
used once to advance the positions.
"""

from cape.kernels.absent import typed
from cape.kernels.bones import move_bones
from cape.kernels.cloth.forces import compute_forces
from cape.kernels.jit import driver, kernel
from cape.kernels.self_contact.self_contact import keep_apart, press
from cape.kernels.solve.attachments import aim
from cape.kernels.solve.frame import begin_frame, keep_out
from cape.kernels.solve.journal import note_end, note_integrated
from cape.kernels.team import meet, span
from cape.kernels.xpbd.grid import prepare_grid, solve_grid
from cape.kernels.xpbd.mesh import prepare_mesh, solve_mesh


@kernel
def fall(gain_x, gain_y, gain_z, vx, vy, vz):
    """Add what gravity gives to all velocities [m/s] in a step."""
    for i in range(vx.size):
        vx[i] += gain_x
        vy[i] += gain_y
        vz[i] += gain_z


@kernel
def blow(step, inverse_mass, fx, fy, fz, vx, vy, vz):
    """Add what forces give to velocities in a step. Clears the forces."""
    for i in range(vx.size):
        a = step * inverse_mass[i]
        vx[i] += a * fx[i]
        vy[i] += a * fy[i]
        vz[i] += a * fz[i]
        fx[i] = 0
        fy[i] = 0
        fz[i] = 0


@kernel
def drift(step, x, y, z, vx, vy, vz):
    """Advance positions by a step at constant velocity."""
    for i in range(x.size):
        x[i] += step * vx[i]
        y[i] += step * vy[i]
        z[i] += step * vz[i]


@driver
def blow_all(lo, hi, s, model, forces, room, inverse_mass, step, team):
    """Let the air act on vertices lo to hi; nothing at all where `model` is None."""
    if model is not None:
        fx, fy, fz = forces[0], forces[1], forces[2]
        compute_forces(lo, hi, s, model, fx, fy, fz, room, team)
        meet(team)
        blow(step, inverse_mass[lo:hi], fx[lo:hi], fy[lo:hi], fz[lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi])


@driver
def xpbd_frame(
    s, grid, mesh, damping, bend_damping, model, inertia, forces, room, motion, m, attached,
    contacts, iterations, substeps, duration, journal, team,
):  # fmt: skip
    """Advance the state `s` by `duration` [s] in `substeps` steps of `iterations` sweeps over all constraints.

    `model` has the air alone, `forces` (3, N) is shared room of zeros; `room`, the forces' scratch, `m`, a MotionRoom,
    and `contacts` are this thread's. `grid` or `mesh`, `damping`, `bend_damping`, `model`, `attached`, `journal`,
    `team` and the parts of `contacts` are None where there are none, and then pruned.
    """
    lo, hi = span(s.x.size, team)
    step = duration / substeps
    h = typed(step, s.x)
    tau, bend_tau = typed(damping, s.x), typed(bend_damping, s.x)
    gravity = inertia.gravity
    begin_frame(lo, hi, s, attached, contacts.groups, contacts.faces, motion, m, duration, substeps, team)
    prepare_grid(grid, s.x.size, h, tau, bend_tau, team)
    prepare_mesh(mesh, h, tau, bend_tau, team)
    for substep in range(substeps):
        blow_all(lo, hi, s, model, forces, room, inertia.inverse_mass, h, team)
        fall(
            typed(step * gravity[0], s.x), typed(step * gravity[1], s.x), typed(step * gravity[2], s.x),
            s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
        )  # fmt: skip
        move_bones(motion, m, (substep + 1) * step)
        aim(lo, hi, s, attached, m, (substep + 1) * step, step)
        meet(team)
        solve_grid(s, grid, iterations, h, tau, bend_tau, team)
        solve_mesh(s, mesh, inertia.inverse_mass, iterations, h, tau, bend_tau, team)
        meet(team)
        drift(h, s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi])
        note_integrated(lo, hi, s, journal, substep)
        press(lo, hi, s, contacts.pressure, step)
        keep_out(
            lo, hi, s, inertia.inverse_mass, None, contacts.free, contacts.groups, contacts.faces, m, 1.0, substep,
            step, team,
        )  # fmt: skip
        keep_apart(s, contacts.layers, inertia.inverse_mass, substep, substeps - 1 - substep, step, team)
        note_end(lo, hi, s, journal, substep)
        meet(team)
