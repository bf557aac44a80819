"""Measures of a cloth at one instant, in double precision, apart from what the solvers use to decide."""

import math

from cape.kernels.bones import fill_matrix, to_world
from cape.kernels.distance import to_box, to_capsule, to_plane
from cape.kernels.jit import driver

BINS = 4096  # of the histogram of strain
WIDEST = 0.4096  # strain at which the histogram ends; what lies above is counted in the last bin


@driver
def strain(x, y, z, first, second, rest, histogram):
    """Largest strain of the given springs; adds all of them to the histogram, compression to its first bin."""
    largest = -1.0
    for k in range(first.size):
        i, j = first[k], second[k]
        dx, dy, dz = float(x[j]) - x[i], float(y[j]) - y[i], float(z[j]) - z[i]
        value = math.sqrt(dx * dx + dy * dy + dz * dz) / rest[k] - 1.0
        largest = max(largest, value)
        histogram[int(min(max(value, 0.0) * (BINS / WIDEST), BINS - 1.0))] += 1
    return largest


@driver
def whereabouts(x, y, z, vx, vy, vz, farthest, fastest):
    """Mean position [m] of the vertices, and whether all coordinates [m] and velocities [m/s] are below the bounds.

    What is not a number is below no bound.
    """
    sound = True
    sum_x, sum_y, sum_z = 0.0, 0.0, 0.0
    for i in range(x.size):
        sum_x += x[i]
        sum_y += y[i]
        sum_z += z[i]
        near = abs(x[i]) < farthest and abs(y[i]) < farthest and abs(z[i]) < farthest
        slow = abs(vx[i]) < fastest and abs(vy[i]) < fastest and abs(vz[i]) < fastest
        sound = sound and near and slow
    return sum_x / x.size, sum_y / x.size, sum_z / x.size, sound


@driver
def kinetic_energy(mass, vx, vy, vz):
    """Kinetic energy of the vertices [J]."""
    total = 0.0
    for i in range(mass.size):
        total += 0.5 * mass[i] * (float(vx[i]) * vx[i] + float(vy[i]) * vy[i] + float(vz[i]) * vz[i])
    return total


@driver
def place_bones(positions, rotations, matrices):
    """Fill `matrices` (B, 3, 3) bone_to_world from unit quaternions wxyz (B, 4)."""
    for b in range(positions.shape[0]):
        fill_matrix(rotations[b, 0], rotations[b, 1], rotations[b, 2], rotations[b, 3], matrices[b])


@driver
def depth_in_capsules(x, y, z, counted, capsules, margin, positions, matrices):
    """Deepest penetration of the counted vertices into shapes grown by a margin [m], and the capsule, -1 for none."""
    deepest, which = 0.0, -1
    for c in range(capsules.bones.size):
        b = capsules.bones[c]
        ax, ay, az = to_world(
            b, capsules.starts[c, 0], capsules.starts[c, 1], capsules.starts[c, 2], positions, matrices
        )
        ex, ey, ez = to_world(b, capsules.ends[c, 0], capsules.ends[c, 1], capsules.ends[c, 2], positions, matrices)
        for i in range(x.size):
            if counted[i]:
                distance, _, _, _ = to_capsule(x[i], y[i], z[i], ax, ay, az, ex, ey, ez, capsules.radius[c])
                if margin - distance > deepest:
                    deepest, which = margin - distance, c
    return deepest, which


@driver
def depth_in_planes(x, y, z, counted, planes, margin, positions, matrices):
    """Deepest penetration of the counted vertices into shapes grown by a margin [m], and the plane, -1 for none."""
    deepest, which = 0.0, -1
    for p in range(planes.bones.size):
        b = planes.bones[p]
        ox, oy, oz = to_world(b, planes.points[p, 0], planes.points[p, 1], planes.points[p, 2], positions, matrices)
        m, n = matrices[b], planes.normals[p]
        nx = m[0, 0] * n[0] + m[0, 1] * n[1] + m[0, 2] * n[2]
        ny = m[1, 0] * n[0] + m[1, 1] * n[1] + m[1, 2] * n[2]
        nz = m[2, 0] * n[0] + m[2, 1] * n[1] + m[2, 2] * n[2]
        for i in range(x.size):
            if counted[i]:
                distance, _, _, _ = to_plane(x[i], y[i], z[i], ox, oy, oz, nx, ny, nz)
                if margin - distance > deepest:
                    deepest, which = margin - distance, p
    return deepest, which


@driver
def depth_in_boxes(x, y, z, counted, boxes, margin, positions, matrices):
    """Deepest penetration of the counted vertices into shapes grown by a margin [m], and the box, -1 for none."""
    deepest, which = 0.0, -1
    for k in range(boxes.bones.size):
        b = boxes.bones[k]
        m, frame = matrices[b], boxes.frames[k]
        cx, cy, cz = to_world(b, boxes.centers[k, 0], boxes.centers[k, 1], boxes.centers[k, 2], positions, matrices)
        for i in range(x.size):
            if not counted[i]:
                continue
            wx, wy, wz = x[i] - cx, y[i] - cy, z[i] - cz
            bx = m[0, 0] * wx + m[1, 0] * wy + m[2, 0] * wz
            by = m[0, 1] * wx + m[1, 1] * wy + m[2, 1] * wz
            bz = m[0, 2] * wx + m[1, 2] * wy + m[2, 2] * wz
            distance, _, _, _ = to_box(
                frame[0, 0] * bx + frame[1, 0] * by + frame[2, 0] * bz,
                frame[0, 1] * bx + frame[1, 1] * by + frame[2, 1] * bz,
                frame[0, 2] * bx + frame[1, 2] * by + frame[2, 2] * bz,
                boxes.halves[k, 0],
                boxes.halves[k, 1],
                boxes.halves[k, 2],
            )
            if margin - distance > deepest:
                deepest, which = margin - distance, k
    return deepest, which
