"""Poses of bones within a frame: positions move in a straight line, rotations at a constant angular velocity."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import inlined, routine, unit

Array = NDArray[np.float64]


class Motion(NamedTuple):
    """Poses of the bones at a frame's start (positions [m] (B, 3), rotations bone_to_world wxyz (B, 4)) and its end."""

    position0: Array
    rotation0: Array
    position1: Array
    rotation1: Array


class MotionRoom(NamedTuple):
    """What `bones.start_motion` and `bones.move_bones` fill: see there."""

    matrices: Array
    turns: Array
    velocity: Array
    spin: Array
    positions: Array

    @classmethod
    def blank(cls, count: int) -> "MotionRoom":
        """Room for so many bones."""
        shapes = ((count, 3, 3), (count, 3, 3), (count, 3), (count, 3), (count, 3))
        return cls(*(np.zeros(shape) for shape in shapes))


class MovingBones(NamedTuple):
    """The bones' motion in a frame of `duration` (1,) [s], and where they are in it."""

    motion: Motion
    bones: MotionRoom
    duration: Array


@unit
def begin_motion(g, team, substep, substeps, step):
    """Put the bones at the frame's start, about to move."""
    start_motion(g.motion, g.bones, g.duration[0], substeps)


@unit
def move_on(g, team, substep, substeps, step):
    """Move the bones to where they are at a substep's end."""
    move_bones(g.motion, g.bones, (substep + 1) * step)


@routine
def start_motion(motion, m, duration, substeps):
    """Prepare the `motion` of B bones from one pose to the next in `duration` [s].

    Of `m` are filled: `positions` [m] (B, 3) and `matrices` bone_to_world (B, 3, 3) at the start, `turns` (B, 3, 3) the
    rotation of one substep in the world, `velocity` [m/s] and `spin` [rad/s] (B, 3) in the world.
    """
    position0, rotation0, position1, rotation1 = (
        motion.position0,
        motion.rotation0,
        motion.position1,
        motion.rotation1,
    )
    turns, velocity, spin = m.turns, m.velocity, m.spin
    set_pose(position0, rotation0, m)
    for b in range(position0.shape[0]):
        w0, x0, y0, z0 = rotation0[b, 0], rotation0[b, 1], rotation0[b, 2], rotation0[b, 3]
        w1, x1, y1, z1 = rotation1[b, 0], rotation1[b, 1], rotation1[b, 2], rotation1[b, 3]
        if w0 * w1 + x0 * x1 + y0 * y1 + z0 * z1 < 0.0:
            w1, x1, y1, z1 = -w1, -x1, -y1, -z1
        # The turn in the world: q1 times the conjugate of q0.
        w = w1 * w0 + x1 * x0 + y1 * y0 + z1 * z0
        x = -w1 * x0 + x1 * w0 - y1 * z0 + z1 * y0
        y = -w1 * y0 + x1 * z0 + y1 * w0 - z1 * x0
        z = -w1 * z0 - x1 * y0 + y1 * x0 + z1 * w0
        sine = math.sqrt(x * x + y * y + z * z)
        half = math.atan2(sine, w)
        scale = 2.0 * half / (sine * duration) if sine > 1e-12 else 2.0 / duration
        spin[b, 0], spin[b, 1], spin[b, 2] = scale * x, scale * y, scale * z
        step = math.sin(half / substeps) / sine if sine > 1e-12 else 1.0 / substeps
        fill_matrix(math.cos(half / substeps), step * x, step * y, step * z, turns[b])
        for k in range(3):
            velocity[b, k] = (position1[b, k] - position0[b, k]) / duration


@routine
def set_pose(positions, rotations, m):
    """Put the bones of `m` at positions [m] (B, 3) and rotations bone_to_world wxyz (B, 4)."""
    for b in range(positions.shape[0]):
        fill_matrix(rotations[b, 0], rotations[b, 1], rotations[b, 2], rotations[b, 3], m.matrices[b])
        for k in range(3):
            m.positions[b, k] = positions[b, k]


@routine
def fill_matrix(w, x, y, z, out):
    """Write the rotation matrix of a unit quaternion into `out`, shape (3, 3)."""
    out[0, 0], out[0, 1], out[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    out[1, 0], out[1, 1], out[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    out[2, 0], out[2, 1], out[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@routine
def move_bones(motion, m, time):
    """Advance all bones by a substep: their positions to those `time` after the frame's start, matrices by a turn."""
    position0 = motion.position0
    matrices, turns, velocity, positions = m.matrices, m.turns, m.velocity, m.positions
    for b in range(position0.shape[0]):
        for k in range(3):
            positions[b, k] = position0[b, k] + time * velocity[b, k]
        for k in range(3):
            m0, m1, m2 = matrices[b, 0, k], matrices[b, 1, k], matrices[b, 2, k]
            for r in range(3):
                matrices[b, r, k] = turns[b, r, 0] * m0 + turns[b, r, 1] * m1 + turns[b, r, 2] * m2


@inlined
def to_world(bone, px, py, pz, positions, matrices):
    """A point of a bone's frame, in the world [m]."""
    m = matrices[bone]
    return (
        positions[bone, 0] + m[0, 0] * px + m[0, 1] * py + m[0, 2] * pz,
        positions[bone, 1] + m[1, 0] * px + m[1, 1] * py + m[1, 2] * pz,
        positions[bone, 2] + m[2, 0] * px + m[2, 1] * py + m[2, 2] * pz,
    )


@inlined
def turned(bone, x, y, z, matrices):
    """A direction of a bone's frame in the world."""
    m = matrices[bone]
    return (
        m[0, 0] * x + m[0, 1] * y + m[0, 2] * z,
        m[1, 0] * x + m[1, 1] * y + m[1, 2] * z,
        m[2, 0] * x + m[2, 1] * y + m[2, 2] * z,
    )


@inlined
def turned_back(bone, x, y, z, matrices):
    """A direction of the world in a bone's frame."""
    m = matrices[bone]
    return (
        m[0, 0] * x + m[1, 0] * y + m[2, 0] * z,
        m[0, 1] * x + m[1, 1] * y + m[2, 1] * z,
        m[0, 2] * x + m[1, 2] * y + m[2, 2] * z,
    )


@inlined
def velocity_at(bone, x, y, z, m):
    """Velocity [m/s] of the point of a bone that is at a place in the world [m]."""
    lx, ly, lz = x - m.positions[bone, 0], y - m.positions[bone, 1], z - m.positions[bone, 2]
    velocity, spin = m.velocity[bone], m.spin[bone]
    return (
        velocity[0] + spin[1] * lz - spin[2] * ly,
        velocity[1] + spin[2] * lx - spin[0] * lz,
        velocity[2] + spin[0] * ly - spin[1] * lx,
    )
