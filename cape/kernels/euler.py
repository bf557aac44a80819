"""Symplectic Euler on a grid of springs: one call is one frame."""

from cape.kernels.bones import move_bones, start_motion
from cape.kernels.frame import add_air, collide, hold_attached
from cape.kernels.grid import add_bend_forces, add_spring_forces, advance, spring_forces
from cape.kernels.jit import driver


@driver
def euler_frame(
    s, springs, forces, spring_room, motion, m, attached, air, free, thickness, capsules, planes, boxes,
    substeps, duration,
):  # fmt: skip
    """Advance the state `s` by `duration` [s] in `substeps` steps: forces, integration, contact, attachments.

    `forces` and `spring_room` (3, N) are room; `m` is a MotionRoom; `attached`, `air`, `capsules`,
    `planes` and `boxes` are None where the scene has none, and then pruned with the code that serves them.
    """
    step = duration / substeps
    dtype = s.x.dtype.type
    fx, fy, fz = forces[0], forces[1], forces[2]
    sx, sy, sz = spring_room[0], spring_room[1], spring_room[2]
    gx, gy, gz = dtype(springs.gravity[0]), dtype(springs.gravity[1]), dtype(springs.gravity[2])
    damping, bend_damping = dtype(springs.damping_time), dtype(springs.bend_damping_time)
    start_motion(
        motion.position0, motion.rotation0, motion.position1, motion.rotation1, duration, substeps,
        m.matrices, m.turns, m.velocity, m.spin,
    )  # fmt: skip
    for substep in range(substeps):
        for family in range(springs.offsets.size):
            offset = springs.offsets[family]
            spring_forces(
                offset, s.x, s.y, s.z, s.vx, s.vy, s.vz, springs.stiffness[family], springs.rest[family],
                damping, dtype(1e-18), sx, sy, sz,
            )  # fmt: skip
            add_spring_forces(offset, sx, sy, sz, fx, fy, fz)
        for family in range(springs.bend_offsets.size):
            offset, stiffness = springs.bend_offsets[family], springs.bend_stiffness[family]
            add_bend_forces(offset, s.x, s.vx, stiffness, bend_damping, sx, fx)
            add_bend_forces(offset, s.y, s.vy, stiffness, bend_damping, sx, fy)
            add_bend_forces(offset, s.z, s.vz, stiffness, bend_damping, sx, fz)
        if air is not None:
            add_air(s, air, fx, fy, fz)
        advance(dtype(step), gx, gy, gz, springs.inverse_mass, fx, fy, fz, s.x, s.y, s.z, s.vx, s.vy, s.vz)
        move_bones(motion.position0, m.velocity, m.turns, (substep + 1) * step, m.positions, m.matrices)
        collide(s, free, thickness, capsules, planes, boxes, m, substep, step)
        if attached is not None:
            hold_attached(s, attached, m, step)
