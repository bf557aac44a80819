"""Contact of vertices with moving capsules, boxes and planes, with Coulomb friction.

A vertex that a step takes within `thickness` of a shape is stopped there: its velocity relative to the shape's own
surface loses what points inwards, friction takes at most mu times as much of what slides, the step is redone with the
corrected velocity, and what is still too deep is moved out along the normal without any change of velocity. A vertex
at rest therefore stays at rest, and depth never turns into speed.

Vertices are handled in blocks of consecutive ones: `find_near` lists the capsules that a block may meet soon, and one
vectorised count per pair finds out whether any vertex of the block needs more.
"""

import math

import numpy as np

from cape.kernels.bones import to_world
from cape.kernels.distance import to_box, to_capsule, to_plane
from cape.kernels.jit import driver, inlined

BLOCK = 64  # vertices; smaller blocks meet fewer capsules, larger ones cost fewer calls
PASSES = 6  # around the capsules that a vertex is between
GRAZE = 1e-6  # m, depth that later passes leave alone


@driver
def place_capsules(bones, starts, ends, positions, matrices, placed):
    """Write the ends of all capsules in the world [m] to the first six columns of `placed`, shape (C, 8).

    The eighth becomes one over the squared length [1/m2], zero for a sphere.
    """
    for c in range(bones.size):
        ax, ay, az = to_world(bones[c], starts[c, 0], starts[c, 1], starts[c, 2], positions, matrices)
        bx, by, bz = to_world(bones[c], ends[c, 0], ends[c, 1], ends[c, 2], positions, matrices)
        placed[c, 0], placed[c, 1], placed[c, 2] = ax, ay, az
        placed[c, 3], placed[c, 4], placed[c, 5] = bx, by, bz
        squared = (bx - ax) ** 2 + (by - ay) ** 2 + (bz - az) ** 2
        placed[c, 7] = 1.0 / squared if squared > 1e-24 else 0.0


@inlined
def bounds(x, y, z, vx, vy, vz, lo, hi):
    """Smallest and largest coordinates of points lo to hi (unsigned) [m], and their largest squared speed [m2/s2]."""
    x0 = x1 = x[lo]
    y0 = y1 = y[lo]
    z0 = z1 = z[lo]
    fastest = vx[lo] * vx[lo] + vy[lo] * vy[lo] + vz[lo] * vz[lo]
    for i in range(lo, hi):
        x0, x1 = min(x0, x[i]), max(x1, x[i])
        y0, y1 = min(y0, y[i]), max(y1, y[i])
        z0, z1 = min(z0, z[i]), max(z1, z[i])
        fastest = max(fastest, vx[i] * vx[i] + vy[i] * vy[i] + vz[i] * vz[i])
    return x0, x1, y0, y1, z0, z1, fastest


@inlined
def count_within(x, y, z, lo, hi, ax, ay, az, dx, dy, dz, inverse_squared, zero, one, reach_squared):
    """Number of points lo to hi nearer than a reach to the segment from a along d; `inverse_squared` is 1/|d|^2, or 0.

    The bounds are unsigned: a signed index that does not start at 0 keeps the loop scalar.
    """
    count = 0
    for i in range(lo, hi):
        px, py, pz = x[i] - ax, y[i] - ay, z[i] - az
        t = min(max((px * dx + py * dy + pz * dz) * inverse_squared, zero), one)
        px, py, pz = px - t * dx, py - t * dy, pz - t * dz
        if px * px + py * py + pz * pz < reach_squared:
            count += 1
    return count


@inlined
def is_within(px, py, pz, placed, c, reach):
    """Tell whether a point is nearer than `reach` [m] to the segment of capsule c."""
    px, py, pz = px - placed[c, 0], py - placed[c, 1], pz - placed[c, 2]
    dx, dy, dz = placed[c, 3] - placed[c, 0], placed[c, 4] - placed[c, 1], placed[c, 5] - placed[c, 2]
    t = min(max((px * dx + py * dy + pz * dz) * placed[c, 7], 0.0), 1.0)
    px, py, pz = px - t * dx, py - t * dy, pz - t * dz
    return px * px + py * py + pz * pz < reach * reach


@inlined
def any_within(x, y, z, lo, hi, placed, c, reach):
    """Tell whether any point lo to hi is nearer than `reach` [m] to the segment of capsule c."""
    dtype = x.dtype.type
    dx, dy, dz = placed[c, 3] - placed[c, 0], placed[c, 4] - placed[c, 1], placed[c, 5] - placed[c, 2]
    return (
        count_within(
            x, y, z, np.uint64(lo), np.uint64(hi),
            dtype(placed[c, 0]), dtype(placed[c, 1]), dtype(placed[c, 2]),
            dtype(dx), dtype(dy), dtype(dz),
            dtype(placed[c, 7]), dtype(0.0), dtype(1.0), dtype(reach * reach),
        )
        > 0
    )  # fmt: skip


@driver
def find_near(
    lo, hi, x, y, z, vx, vy, vz, placed, radius, thickness, bones, positions, velocity, spin, horizon, slack, near
):
    """List, for each block of the vertices lo to hi, the capsules that it may meet within `horizon` seconds.

    `near` (blocks, C + 1) is filled: the count, then the capsules' indices. `slack` [m] allows for accelerations.
    The seventh column of `placed` is filled with how far each capsule reaches in that time.
    """
    for c in range(radius.size):
        b = bones[c]
        fastest = 0.0
        for k in range(0, 6, 3):
            lx, ly = placed[c, k] - positions[b, 0], placed[c, k + 1] - positions[b, 1]
            lz = placed[c, k + 2] - positions[b, 2]
            sx = velocity[b, 0] + spin[b, 1] * lz - spin[b, 2] * ly
            sy = velocity[b, 1] + spin[b, 2] * lx - spin[b, 0] * lz
            sz = velocity[b, 2] + spin[b, 0] * ly - spin[b, 1] * lx
            fastest = max(fastest, sx * sx + sy * sy + sz * sz)
        placed[c, 6] = radius[c] + thickness + slack + math.sqrt(fastest) * horizon
    for start in range(lo, hi, BLOCK):
        block, end = start // BLOCK, min(start + BLOCK, hi)
        x0, x1, y0, y1, z0, z1, fastest = bounds(x, y, z, vx, vy, vz, np.uint64(start), np.uint64(end))
        own = math.sqrt(fastest) * horizon
        count = 0
        for c in range(radius.size):
            margin = own + placed[c, 6]
            if (
                min(placed[c, 0], placed[c, 3]) - margin < x1
                and max(placed[c, 0], placed[c, 3]) + margin > x0
                and min(placed[c, 1], placed[c, 4]) - margin < y1
                and max(placed[c, 1], placed[c, 4]) + margin > y0
                and min(placed[c, 2], placed[c, 5]) - margin < z1
                and max(placed[c, 2], placed[c, 5]) + margin > z0
                and any_within(x, y, z, start, end, placed, c, margin)
            ):
                count += 1
                near[block, count] = c
        near[block, 0] = count


@inlined
def coefficient(friction, c):
    """Friction of collider c, None where no collider has any."""
    if friction is None:
        return None
    return friction[c]


@inlined
def respond(i, depth, nx, ny, nz, bone, friction, step, positions, velocity, spin, x, y, z, vx, vy, vz):
    """Stop vertex i, `depth` [m] too deep along the unit normal n, at the surface that moves with `bone`."""
    lx, ly, lz = x[i] - positions[bone, 0], y[i] - positions[bone, 1], z[i] - positions[bone, 2]
    sx = velocity[bone, 0] + spin[bone, 1] * lz - spin[bone, 2] * ly
    sy = velocity[bone, 1] + spin[bone, 2] * lx - spin[bone, 0] * lz
    sz = velocity[bone, 2] + spin[bone, 0] * ly - spin[bone, 1] * lx
    rx, ry, rz = vx[i] - sx, vy[i] - sy, vz[i] - sz
    inwards = -(rx * nx + ry * ny + rz * nz)
    if inwards > 0.0:
        rx, ry, rz = rx + inwards * nx, ry + inwards * ny, rz + inwards * nz
        if friction is not None:
            slide = math.sqrt(rx * rx + ry * ry + rz * rz)
            kept = max(0.0, 1.0 - friction * inwards / slide) if slide > 0.0 else 0.0
            rx, ry, rz = kept * rx, kept * ry, kept * rz
        ux, uy, uz = sx + rx, sy + ry, sz + rz
        mx, my, mz = step * (ux - vx[i]), step * (uy - vy[i]), step * (uz - vz[i])
        vx[i], vy[i], vz[i] = ux, uy, uz
        x[i] += mx
        y[i] += my
        z[i] += mz
        depth -= mx * nx + my * ny + mz * nz
    if depth > 0.0:
        x[i] += depth * nx
        y[i] += depth * ny
        z[i] += depth * nz


@inlined
def leave_capsule(
    i, c, reach, bones, placed, friction, step, positions, velocity, spin, x, y, z, vx, vy, vz
):  # fmt: skip
    """Stop vertex i at `reach` [m] from the axis of capsule c."""
    distance, nx, ny, nz = to_capsule(
        x[i], y[i], z[i],
        placed[c, 0], placed[c, 1], placed[c, 2], placed[c, 3], placed[c, 4], placed[c, 5],
        reach,
    )  # fmt: skip
    respond(
        i, -distance, nx, ny, nz, bones[c], coefficient(friction, c), step, positions, velocity, spin,
        x, y, z, vx, vy, vz,
    )  # fmt: skip


@driver
def collide_capsules(
    lo, hi, free, x, y, z, vx, vy, vz, near, touched, bones, placed, radius, friction, thickness, step,
    positions, velocity, spin,
):  # fmt: skip
    """Keep the free ones of vertices lo to hi out of all near capsules.

    Where capsules overlap, leaving one may mean entering another: each vertex that touches any is led around all near
    ones until none is violated, or `PASSES` times. `touched` (BLOCK,) is room for a mark of each.
    """
    for start in range(lo, hi, BLOCK):
        block, end = start // BLOCK, min(start + BLOCK, hi)
        touched[:] = 0
        for k in range(near[block, 0]):
            c = near[block, k + 1]
            reach = radius[c] + thickness
            if not any_within(x, y, z, start, end, placed, c, reach):
                continue
            for i in range(start, end):
                if free[i] and is_within(x[i], y[i], z[i], placed, c, reach):
                    leave_capsule(
                        i, c, reach, bones, placed, friction, step, positions, velocity, spin, x, y, z, vx, vy, vz
                    )  # fmt: skip
                    touched[i - start] = 1
        if near[block, 0] < 2:
            continue
        for i in range(start, end):
            if touched[i - start] == 0:
                continue
            for _ in range(PASSES):
                clear = True
                for k in range(near[block, 0]):
                    c = near[block, k + 1]
                    reach = radius[c] + thickness
                    if is_within(x[i], y[i], z[i], placed, c, reach - GRAZE):
                        clear = False
                        leave_capsule(
                            i, c, reach, bones, placed, friction, step, positions, velocity, spin, x, y, z, vx, vy, vz
                        )  # fmt: skip
                if clear:
                    break


@inlined
def count_behind(x, y, z, nx, ny, nz, offset):
    """Number of points whose coordinate along a direction is below an offset."""
    count = 0
    for i in range(x.size):
        if x[i] * nx + y[i] * ny + z[i] * nz < offset:
            count += 1
    return count


@driver
def collide_planes(
    lo, hi, free, x, y, z, vx, vy, vz, bones, points, normals, friction, thickness, step,
    positions, matrices, velocity, spin,
):  # fmt: skip
    """Keep the free ones of vertices lo to hi in front of planes.

    Points [m] and unit normals are in the bones' frames, shape (P, 3).
    """
    dtype = x.dtype.type
    for p in range(bones.size):
        b = bones[p]
        ox, oy, oz = to_world(b, points[p, 0], points[p, 1], points[p, 2], positions, matrices)
        m, n = matrices[b], normals[p]
        mx = m[0, 0] * n[0] + m[0, 1] * n[1] + m[0, 2] * n[2]
        my = m[1, 0] * n[0] + m[1, 1] * n[1] + m[1, 2] * n[2]
        mz = m[2, 0] * n[0] + m[2, 1] * n[1] + m[2, 2] * n[2]
        # Rounding in single precision decides at most whether to look closer.
        offset = ox * mx + oy * my + oz * mz + thickness + GRAZE
        if count_behind(x[lo:hi], y[lo:hi], z[lo:hi], dtype(mx), dtype(my), dtype(mz), dtype(offset)) == 0:
            continue
        for i in range(lo, hi):
            distance, nx, ny, nz = to_plane(x[i], y[i], z[i], ox, oy, oz, mx, my, mz)
            if distance < thickness and free[i]:
                respond(
                    i, thickness - distance, nx, ny, nz, b, coefficient(friction, p), step,
                    positions, velocity, spin, x, y, z, vx, vy, vz,
                )  # fmt: skip


@driver
def collide_boxes(
    lo, hi, free, x, y, z, vx, vy, vz, bones, centers, halves, frames, r, friction, thickness, step,
    positions, matrices, velocity, spin,
):  # fmt: skip
    """Keep the free ones of vertices lo to hi out of boxes.

    Centres [m] are in the bones' frames, `halves` [m] and `frames` (N, 3, 3) box_to_bone describe the cuboids; `r`
    (3, 3) is room for a box_to_world.
    """
    for k in range(bones.size):
        b = bones[k]
        cx, cy, cz = to_world(b, centers[k, 0], centers[k, 1], centers[k, 2], positions, matrices)
        for row in range(3):
            for column in range(3):
                r[row, column] = (
                    matrices[b, row, 0] * frames[k, 0, column]
                    + matrices[b, row, 1] * frames[k, 1, column]
                    + matrices[b, row, 2] * frames[k, 2, column]
                )
        reach = math.sqrt(halves[k, 0] ** 2 + halves[k, 1] ** 2 + halves[k, 2] ** 2) + thickness
        for i in range(lo, hi):
            wx, wy, wz = x[i] - cx, y[i] - cy, z[i] - cz
            if wx * wx + wy * wy + wz * wz > reach * reach or not free[i]:
                continue
            distance, lx, ly, lz = to_box(
                r[0, 0] * wx + r[1, 0] * wy + r[2, 0] * wz,
                r[0, 1] * wx + r[1, 1] * wy + r[2, 1] * wz,
                r[0, 2] * wx + r[1, 2] * wy + r[2, 2] * wz,
                halves[k, 0],
                halves[k, 1],
                halves[k, 2],
            )
            if distance < thickness:
                respond(
                    i, thickness - distance,
                    r[0, 0] * lx + r[0, 1] * ly + r[0, 2] * lz,
                    r[1, 0] * lx + r[1, 1] * ly + r[1, 2] * lz,
                    r[2, 0] * lx + r[2, 1] * ly + r[2, 2] * lz,
                    b, coefficient(friction, k), step, positions, velocity, spin, x, y, z, vx, vy, vz,
                )  # fmt: skip
