"""Measures of a cloth at one instant, in double precision, apart from what the solvers use to decide."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.bones import MotionRoom, set_pose
from cape.kernels.contact.shapes import MOMENT, Colliders, distance_to, place
from cape.kernels.contact.watch import TILE, look
from cape.kernels.jit import routine
from cape.kernels.state import State

BINS = 4096  # of the histogram of strain
NEAR = 1e-4  # m beyond a collider's thickness at which a vertex still touches it: rounding, and what a step leaves
WIDEST = 0.4096  # strain at which the histogram ends; what lies above is counted in the last bin


@routine
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


@routine
def is_strained(x, y, z, first, second, rest, limit):
    """Tell whether any of the given springs is strained by more than the limit."""
    many = np.int64(0)
    for k in range(first.size):
        i, j = first[k], second[k]
        dx, dy, dz = x[j] - x[i], y[j] - y[i], z[j] - z[i]
        most = (1.0 + limit) * rest[k]
        many += 1 if dx * dx + dy * dy + dz * dz > most * most else 0
    return many > 0


@routine
def is_grid_strained(x, y, z, offsets, longest_squared):
    """Tell whether any spring of a grid is longer than it may be.

    The springs of family f go from vertex i to i + `offsets[f]`; `longest_squared` [m2] (F, N) stands at i, infinity
    for no spring.
    """
    many = np.int64(0)
    for f in range(offsets.size):
        offset = np.uint64(offsets[f])
        for i in range(np.uint64(x.size) - offset):
            dx, dy, dz = x[i + offset] - x[i], y[i + offset] - y[i], z[i + offset] - z[i]
            many += 1 if dx * dx + dy * dy + dz * dz > longest_squared[f, i] else 0
    return many > 0


@routine
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


@routine
def kinetic_energy(mass, vx, vy, vz):
    """Kinetic energy of the vertices [J]."""
    total = 0.0
    for i in range(mass.size):
        total += 0.5 * mass[i] * (float(vx[i]) * vx[i] + float(vy[i]) * vy[i] + float(vz[i]) * vz[i])
    return total


class Touch(NamedTuple):
    """Vertices of a cloth, of which some are `counted`, and colliders that they may touch.

    `positions` [m] (B, 3) and `rotations` bone_to_world wxyz (B, 4) are of the bones; `vertices` and `colliders` (R,)
    and `places` (R, 7) are room for contacts.
    """

    state: State
    counted: NDArray[np.bool_]
    shapes: Colliders
    bones: MotionRoom
    positions: NDArray[np.float64]
    rotations: NDArray[np.float64]
    vertices: NDArray[np.int64]
    colliders: NDArray[np.int64]
    places: NDArray[np.float64]


@routine
def touching(g):
    """Find the contacts of the counted vertices with colliders, and the deepest penetration; moves the bones there.

    A contact is a vertex within a collider's thickness or `NEAR` beyond it; as many as there is room for are written:
    the point on the surface [m], the normal, and the depth in the thickness [m].

    Returns the deepest penetration [m] and the collider, -1 for none, and how many contacts there are.
    """
    x, y, z, shapes, vertices, colliders = g.state.x, g.state.y, g.state.z, g.shapes, g.vertices, g.colliders
    set_pose(g.positions, g.rotations, g.bones)
    shapes.clock[MOMENT] += 1
    deepest, which, count = 0.0, -1, 0
    for c in range(shapes.records.size):
        place(shapes, c, g.bones)
        thickness = shapes.records[c].thickness
        for start in range(0, x.size, TILE):
            end = min(start + TILE, x.size)
            if look(shapes, c, g.state, start, end, max(thickness + NEAR, 0.0)) >= 0.0:
                continue
            for i in range(start, end):
                if g.counted[i] and shapes.points.gaps[i - start] < 0.0:
                    distance, nx, ny, nz = distance_to(shapes, c, x[i], y[i], z[i])
                    if -distance > deepest:
                        deepest, which = -distance, c
                    if count < vertices.size:
                        vertices[count], colliders[count] = i, c
                        row = g.places[count]
                        row[0], row[1], row[2] = x[i] - distance * nx, y[i] - distance * ny, z[i] - distance * nz
                        row[3], row[4], row[5], row[6] = nx, ny, nz, thickness - distance
                    count += 1
    return deepest, which, count
