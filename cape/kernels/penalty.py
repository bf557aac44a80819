"""Contact inside an implicit stage: springs across the thickness of colliders, with smoothed Coulomb friction.

A vertex nearer than `thickness` to a shape has the energy 1/2 k depth^2, whose force along the normal n is pressure =
k depth. Friction is that of Li et al. 2020, "Incremental potential contact", section 5.3: with u the velocity across n
relative to the surface that moves with its bone,

    f = -mu pressure f1(|u|) u / |u|,    f1(s) = 2 s / SLIP - s^2 / SLIP^2 below SLIP, otherwise 1

The pressure in it is that of the positions at hand rather than of an earlier iteration; minus the derivative, as the
matrix has it, is k n n^T + mu pressure f1 / (|u| b) (I - n n^T), symmetric and positive semidefinite.
"""

import math

from cape.kernels.bones import to_world
from cape.kernels.contact import (
    BLOCK,
    GRAZE,
    any_within,
    coefficient,
    count_behind,
    find_near,
    is_within,
    place_capsules,
)
from cape.kernels.distance import to_box, to_capsule, to_plane
from cape.kernels.jit import driver, inlined

SLIP = 1e-3  # m/s below which friction gives way: less sticks better, and costs iterations
HARD = 10.0  # contact stiffness over mass / b^2, at least: a vertex alone is stopped within a tenth of its way
SLACK = 0.01  # m that a vertex may move in a step beyond what its speed tells


@inlined
def press(i, depth, nx, ny, nz, bone, friction, stiffness, rate, m, s, force, blocks):
    """Add the contact of vertex i, `depth` [m] too deep along the unit normal n; `rate` is 1/b."""
    pressure = stiffness * depth
    fx, fy, fz = pressure * nx, pressure * ny, pressure * nz
    along, across = stiffness, 0.0
    if friction is not None:
        spin, velocity = m.spin[bone], m.velocity[bone]
        lx, ly, lz = s.x[i] - m.positions[bone, 0], s.y[i] - m.positions[bone, 1], s.z[i] - m.positions[bone, 2]
        ux = s.vx[i] - (velocity[0] + spin[1] * lz - spin[2] * ly)
        uy = s.vy[i] - (velocity[1] + spin[2] * lx - spin[0] * lz)
        uz = s.vz[i] - (velocity[2] + spin[0] * ly - spin[1] * lx)
        outwards = ux * nx + uy * ny + uz * nz
        ux, uy, uz = ux - outwards * nx, uy - outwards * ny, uz - outwards * nz
        speed = math.sqrt(ux * ux + uy * uy + uz * uz)
        drag = friction * pressure * ((2.0 - speed / SLIP) / SLIP if speed < SLIP else 1.0 / speed)
        fx, fy, fz = fx - drag * ux, fy - drag * uy, fz - drag * uz
        across = drag * rate
    force[0, i] += fx
    force[1, i] += fy
    force[2, i] += fz
    along -= across
    blocks[0, i] += along * nx * nx + across
    blocks[1, i] += along * ny * ny + across
    blocks[2, i] += along * nz * nz + across
    blocks[3, i] += along * nx * ny
    blocks[4, i] += along * nx * nz
    blocks[5, i] += along * ny * nz


@driver
def press_capsules(lo, hi, capsules, free, thickness, least, mass, rate, m, s, force, blocks):
    """Add the contacts of the vertices lo to hi with the capsules near them."""
    if capsules is not None:
        placed = capsules.placed
        for start in range(lo, hi, BLOCK):
            block, end = start // BLOCK, min(start + BLOCK, hi)
            for k in range(capsules.near[block, 0]):
                c = capsules.near[block, k + 1]
                reach = capsules.radius[c] + thickness
                if not any_within(s.x, s.y, s.z, start, end, placed, c, reach):
                    continue
                for i in range(start, end):
                    if free[i] and is_within(s.x[i], s.y[i], s.z[i], placed, c, reach):
                        distance, nx, ny, nz = to_capsule(
                            s.x[i], s.y[i], s.z[i], placed[c, 0], placed[c, 1], placed[c, 2],
                            placed[c, 3], placed[c, 4], placed[c, 5], reach,
                        )  # fmt: skip
                        press(
                            i, -distance, nx, ny, nz, capsules.bones[c], coefficient(capsules.friction, c),
                            least[i] + HARD * rate * rate * mass[i], rate, m, s, force, blocks,
                        )  # fmt: skip


@driver
def press_planes(lo, hi, planes, free, thickness, least, mass, rate, m, s, force, blocks):
    """Add the contacts of the vertices lo to hi with all planes."""
    if planes is not None:
        dtype = s.x.dtype.type
        for p in range(planes.bones.size):
            b, point, n = planes.bones[p], planes.points[p], planes.normals[p]
            ox, oy, oz = to_world(b, point[0], point[1], point[2], m.positions, m.matrices)
            turn = m.matrices[b]
            nx = turn[0, 0] * n[0] + turn[0, 1] * n[1] + turn[0, 2] * n[2]
            ny = turn[1, 0] * n[0] + turn[1, 1] * n[1] + turn[1, 2] * n[2]
            nz = turn[2, 0] * n[0] + turn[2, 1] * n[1] + turn[2, 2] * n[2]
            # Rounding in single precision decides at most whether to look closer.
            offset = ox * nx + oy * ny + oz * nz + thickness + GRAZE
            if count_behind(s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], dtype(nx), dtype(ny), dtype(nz), dtype(offset)) == 0:
                continue
            for i in range(lo, hi):
                distance, _, _, _ = to_plane(s.x[i], s.y[i], s.z[i], ox, oy, oz, nx, ny, nz)
                if distance < thickness and free[i]:
                    press(
                        i, thickness - distance, nx, ny, nz, b, coefficient(planes.friction, p),
                        least[i] + HARD * rate * rate * mass[i], rate, m, s, force, blocks,
                    )  # fmt: skip


@driver
def press_boxes(lo, hi, boxes, free, thickness, least, mass, rate, m, s, force, blocks):
    """Add the contacts of the vertices lo to hi with all boxes."""
    if boxes is not None:
        r = boxes.room
        for k in range(boxes.bones.size):
            b, center, half = boxes.bones[k], boxes.centers[k], boxes.halves[k]
            cx, cy, cz = to_world(b, center[0], center[1], center[2], m.positions, m.matrices)
            for row in range(3):
                for column in range(3):
                    r[row, column] = (
                        m.matrices[b, row, 0] * boxes.frames[k, 0, column]
                        + m.matrices[b, row, 1] * boxes.frames[k, 1, column]
                        + m.matrices[b, row, 2] * boxes.frames[k, 2, column]
                    )
            reach = math.sqrt(half[0] * half[0] + half[1] * half[1] + half[2] * half[2]) + thickness
            for i in range(lo, hi):
                x, y, z = s.x[i] - cx, s.y[i] - cy, s.z[i] - cz
                if x * x + y * y + z * z > reach * reach or not free[i]:
                    continue
                distance, nx, ny, nz = to_box(
                    r[0, 0] * x + r[1, 0] * y + r[2, 0] * z,
                    r[0, 1] * x + r[1, 1] * y + r[2, 1] * z,
                    r[0, 2] * x + r[1, 2] * y + r[2, 2] * z,
                    half[0],
                    half[1],
                    half[2],
                )
                if distance < thickness:
                    press(
                        i, thickness - distance,
                        r[0, 0] * nx + r[0, 1] * ny + r[0, 2] * nz,
                        r[1, 0] * nx + r[1, 1] * ny + r[1, 2] * nz,
                        r[2, 0] * nx + r[2, 1] * ny + r[2, 2] * nz,
                        b, coefficient(boxes.friction, k), least[i] + HARD * rate * rate * mass[i],
                        rate, m, s, force, blocks,
                    )  # fmt: skip


@driver
def press_all(lo, hi, contacts, m, mass, s, b, penalty):
    """Set the contact forces of the vertices lo to hi [N] and minus their derivatives [N/m]; nothing for None."""
    if penalty is not None:
        penalty.force[:, lo:hi] = 0
        penalty.blocks[:, lo:hi] = 0
        free, thickness, rate = contacts.free, contacts.thickness, 1.0 / b
        k, f, a = penalty.least, penalty.force, penalty.blocks
        press_capsules(lo, hi, contacts.capsules, free, thickness, k, mass, rate, m, s, f, a)
        press_planes(lo, hi, contacts.planes, free, thickness, k, mass, rate, m, s, f, a)
        press_boxes(lo, hi, contacts.boxes, free, thickness, k, mass, rate, m, s, f, a)


@driver
def place_colliders(capsules, m):
    """Bring the capsules to where `m` has the bones; planes and boxes follow it by themselves."""
    if capsules is not None:
        place_capsules(capsules.bones, capsules.starts, capsules.ends, m.positions, m.matrices, capsules.placed)


@driver
def look_around(lo, hi, capsules, thickness, m, s, horizon):
    """List the capsules that the vertices lo to hi may meet within `horizon` seconds."""
    if capsules is not None:
        place_colliders(capsules, m)
        find_near(
            lo, hi, s.x, s.y, s.z, s.vx, s.vy, s.vz, capsules.placed, capsules.radius, thickness,
            capsules.bones, m.positions, m.velocity, m.spin, horizon, SLACK, capsules.near,
        )  # fmt: skip
