"""Poses of bones within a frame: positions move in a straight line, rotations at a constant angular velocity."""

import math

import numpy as np

from cape.kernels.jit import driver, inlined


@driver
def start_motion(position0, rotation0, position1, rotation1, duration, substeps, matrices, turns, velocity, spin):
    """Prepare the motion of B bones from one pose to the next [s, m, m/s, rad/s].

    Positions have shape (B, 3), rotations bone_to_world wxyz (B, 4). Filled: `matrices` (B, 3, 3) bone_to_world at the
    start, `turns` (B, 3, 3) the rotation of one substep in the world, `velocity` and `spin` (B, 3) in the world.
    """
    for b in range(position0.shape[0]):
        fill_matrix(rotation0[b, 0], rotation0[b, 1], rotation0[b, 2], rotation0[b, 3], matrices[b])
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


@driver
def fill_matrix(w, x, y, z, out):
    """Write the rotation matrix of a unit quaternion into `out`, shape (3, 3)."""
    out[0, 0], out[0, 1], out[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    out[1, 0], out[1, 1], out[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    out[2, 0], out[2, 1], out[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@driver
def move_bones(position0, velocity, turns, time, positions, matrices):
    """Advance all bones by a substep: `positions` to those `time` after the frame's start, `matrices` by a turn."""
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


@driver
def hold(lo, hi, vertices, bones, points, step, positions, matrices, x, y, z, vx, vy, vz):
    """Put the attached ones of vertices lo to hi where their bones hold them.

    Their velocity is the one that brings them there in one step. `points` are in the bones' frames [m], shape (n, 3).
    """
    inverse_step = 1.0 / step
    for k in range(vertices.size):
        i = vertices[k]
        if i < lo or i >= hi:
            continue
        px, py, pz = to_world(bones[k], points[k, 0], points[k, 1], points[k, 2], positions, matrices)
        # advance() has moved the vertex with last step's velocity; undo it to know where the vertex was.
        vx[i] = (px - (x[i] - step * vx[i])) * inverse_step
        vy[i] = (py - (y[i] - step * vy[i])) * inverse_step
        vz[i] = (pz - (z[i] - step * vz[i])) * inverse_step
        x[i], y[i], z[i] = px, py, pz


def blank_motion(count):
    """What `start_motion` and `move_bones` fill for `count` bones: matrices, turns, velocity, spin, positions."""
    shapes = ((count, 3, 3), (count, 3, 3), (count, 3), (count, 3), (count, 3))
    return tuple(np.zeros(shape) for shape in shapes)
