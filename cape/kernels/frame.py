"""What every solver does in a substep besides its own integration: contact and attachments."""

from cape.kernels.bones import hold
from cape.kernels.contact import collide_boxes, collide_capsules, collide_planes, find_near, place_capsules
from cape.kernels.jit import driver

NEAR_EVERY = 16  # substeps between two searches for near capsules
SLACK = 0.01  # m that a vertex may move in that time beyond what its speed at the search tells


@driver
def collide(lo, hi, s, free, thickness, capsules, planes, boxes, m, substep, step):
    """Keep the free ones of vertices lo to hi out of all colliders, which are where `m` has moved them.

    `lo` is a multiple of `contact.BLOCK`. Groups that are None are pruned at compile time, which works for arguments,
    not for fields of a record.
    """
    if capsules is not None:
        place_capsules(capsules.bones, capsules.starts, capsules.ends, m.positions, m.matrices, capsules.placed)
        if substep % NEAR_EVERY == 0:
            find_near(
                lo, hi, s.x, s.y, s.z, s.vx, s.vy, s.vz, capsules.placed, capsules.radius, thickness,
                capsules.bones, m.positions, m.velocity, m.spin, NEAR_EVERY * step, SLACK, capsules.near,
            )  # fmt: skip
        collide_capsules(
            lo, hi, free, s.x, s.y, s.z, s.vx, s.vy, s.vz, capsules.near, capsules.touched, capsules.bones,
            capsules.placed, capsules.radius, capsules.friction, thickness, step, m.positions, m.velocity, m.spin,
        )  # fmt: skip
    if boxes is not None:
        collide_boxes(
            lo, hi, free, s.x, s.y, s.z, s.vx, s.vy, s.vz, boxes.bones, boxes.centers, boxes.halves, boxes.frames,
            boxes.room, boxes.friction, thickness, step, m.positions, m.matrices, m.velocity, m.spin,
        )  # fmt: skip
    if planes is not None:
        collide_planes(
            lo, hi, free, s.x, s.y, s.z, s.vx, s.vy, s.vz, planes.bones, planes.points, planes.normals,
            planes.friction, thickness, step, m.positions, m.matrices, m.velocity, m.spin,
        )  # fmt: skip


@driver
def hold_attached(lo, hi, s, attached, m, step):
    """Put the attached ones of vertices lo to hi where their bones hold them."""
    if attached is not None:
        hold(
            lo, hi, attached.vertices, attached.bones, attached.points, step, m.positions, m.matrices,
            s.x, s.y, s.z, s.vx, s.vy, s.vz,
        )  # fmt: skip
