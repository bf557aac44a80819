"""What every solver does in a substep besides its own integration: air, contact, attachments."""

from cape.kernels.bones import hold
from cape.kernels.contact import collide_boxes, collide_capsules, collide_planes, find_near, place_capsules
from cape.kernels.grid import add_air_forces, air_forces
from cape.kernels.jit import driver

NEAR_EVERY = 16  # substeps between two searches for near capsules
SLACK = 0.01  # m that a vertex may move in that time beyond what its speed at the search tells


@driver
def add_air(s, air, fx, fy, fz):
    """Add the forces of the air to the forces on the vertices [N]."""
    dtype = s.x.dtype.type
    room = air.room
    air_forces(
        air.columns, s.x, s.y, s.z, s.vx, s.vy, s.vz, air.cells,
        dtype(air.wind[0]), dtype(air.wind[1]), dtype(air.wind[2]),
        dtype(1.0 / 3.0), dtype(air.drag), dtype(air.lift), dtype(1e-12),
        room[0], room[1], room[2], room[3], room[4], room[5],
    )  # fmt: skip
    add_air_forces(air.columns, room[0], room[3], fx)
    add_air_forces(air.columns, room[1], room[4], fy)
    add_air_forces(air.columns, room[2], room[5], fz)


@driver
def collide(s, free, thickness, capsules, planes, boxes, m, substep, step):
    """Keep the free vertices out of all colliders, which are where `m` has moved them.

    Groups that are None are pruned at compile time, which works for arguments, not for fields of a record.
    """
    if capsules is not None:
        place_capsules(capsules.bones, capsules.starts, capsules.ends, m.positions, m.matrices, capsules.placed)
        if substep % NEAR_EVERY == 0:
            find_near(
                s.x, s.y, s.z, s.vx, s.vy, s.vz, capsules.placed, capsules.radius, thickness,
                capsules.bones, m.positions, m.velocity, m.spin, NEAR_EVERY * step, SLACK, capsules.near,
            )  # fmt: skip
        collide_capsules(
            free, s.x, s.y, s.z, s.vx, s.vy, s.vz, capsules.near, capsules.touched, capsules.bones, capsules.placed,
            capsules.radius, capsules.friction, thickness, step, m.positions, m.velocity, m.spin,
        )  # fmt: skip
    if boxes is not None:
        collide_boxes(
            free, s.x, s.y, s.z, s.vx, s.vy, s.vz, boxes.bones, boxes.centers, boxes.halves, boxes.frames, boxes.room,
            boxes.friction, thickness, step, m.positions, m.matrices, m.velocity, m.spin,
        )  # fmt: skip
    if planes is not None:
        collide_planes(
            free, s.x, s.y, s.z, s.vx, s.vy, s.vz, planes.bones, planes.points, planes.normals,
            planes.friction, thickness, step, m.positions, m.matrices, m.velocity, m.spin,
        )  # fmt: skip


@driver
def hold_attached(s, attached, m, step):
    """Put the attached vertices where their bones hold them."""
    hold(
        attached.vertices, attached.bones, attached.points, step, m.positions, m.matrices,
        s.x, s.y, s.z, s.vx, s.vy, s.vz,
    )  # fmt: skip
