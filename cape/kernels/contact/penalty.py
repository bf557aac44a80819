"""Contact inside an implicit stage: springs across the thickness of colliders, with smoothed Coulomb friction.

A vertex nearer than `thickness` to a shape has the energy 1/2 k depth^2, whose force along the normal n is pressure =
k depth. Friction is that of Li et al. 2020, "Incremental potential contact", section 5.3: with u the velocity across n
relative to the surface that moves with its bone,

    f = -mu pressure f1(|u|) u / |u|,    f1(s) = 2 s / SLIP - s^2 / SLIP^2 below SLIP, otherwise 1

The pressure in it is that of the positions at hand rather than of an earlier iteration. Minus the derivative, as the
matrix has it, is symmetric and positive semidefinite: k n n^T + mu pressure f1 / (|u| b) (I - n n^T) where a vertex is
to slow down, and f1' in place of f1 / |u| along u where it is to speed up. As f1 is concave, Newton's method stays on
its side of the solution with either; with the derivative throughout it overshoots a vertex's rest, and without it
what begins to slide takes dozens of iterations.
"""

import math

from numba import literal_unroll

from cape.kernels.bones import velocity_at
from cape.kernels.contact.shapes import MOMENT, distance_to, place
from cape.kernels.contact.watch import TILE, approach, is_alarmed, look, nap, spread, tiles
from cape.kernels.jit import driver, inlined

SLIP = 1e-3  # m/s below which friction gives way: less sticks better, and costs iterations
HARD = 10.0  # contact stiffness over mass / b^2, at least: a vertex alone is stopped within a tenth of its way


@inlined
def press(i, depth, nx, ny, nz, bone, friction, stiffness, rate, m, s, work, inertia, force, blocks):
    """Add the contact of vertex i, `depth` [m] too deep along the unit normal n; `rate` is 1/b."""
    pressure = stiffness * depth
    force[0, i] += pressure * nx
    force[1, i] += pressure * ny
    force[2, i] += pressure * nz
    along = stiffness
    if friction > 0.0:
        ux, uy, uz = velocity_at(bone, s.x[i], s.y[i], s.z[i], m)
        ux, uy, uz = s.vx[i] - ux, s.vy[i] - uy, s.vz[i] - uz
        outwards = ux * nx + uy * ny + uz * nz
        ux, uy, uz = ux - outwards * nx, uy - outwards * ny, uz - outwards * nz
        speed = math.sqrt(ux * ux + uy * uy + uz * uz)
        drag = friction * pressure * ((2.0 - speed / SLIP) / SLIP if speed < SLIP else 1.0 / speed)
        force[0, i] -= drag * ux
        force[1, i] -= drag * uy
        force[2, i] -= drag * uz
        across = drag * rate
        along -= across
        blocks[0, i] += across
        blocks[1, i] += across
        blocks[2, i] += across
        if speed > 0.0 and push(i, ux, uy, uz, rate, s, work, inertia, force) > 0.0:
            less = friction * pressure * rate / (speed * (SLIP * SLIP if speed < SLIP else speed * speed))
            blocks[0, i] -= less * ux * ux
            blocks[1, i] -= less * uy * uy
            blocks[2, i] -= less * uz * uz
            blocks[3, i] -= less * ux * uy
            blocks[4, i] -= less * ux * uz
            blocks[5, i] -= less * uy * uz
    blocks[0, i] += along * nx * nx
    blocks[1, i] += along * ny * ny
    blocks[2, i] += along * nz * nz
    blocks[3, i] += along * nx * ny
    blocks[4, i] += along * nx * nz
    blocks[5, i] += along * ny * nz


@inlined
def push(i, ux, uy, uz, rate, s, work, inertia, force):
    """What is left over in the equation of motion of vertex i along u [N m/s]."""
    f, t, mass, g = work.forces, work.target, inertia.mass[i], inertia.gravity
    return (
        ux * (f[0, i] + force[0, i] + mass * (g[0] - rate * (s.vx[i] - t[3, i])))
        + uy * (f[1, i] + force[1, i] + mass * (g[1] - rate * (s.vy[i] - t[4, i])))
        + uz * (f[2, i] + force[2, i] + mass * (g[2] - rate * (s.vz[i] - t[5, i])))
    )


@driver
def press_group(lo, hi, shapes, free, substep, least, rate, m, s, work, inertia, force, blocks):
    """Add the contacts of the vertices lo to hi with the colliders of a kind that they may touch in this substep."""
    first, last = tiles(lo, hi)
    for tile in range(first, last):
        alarmed = is_alarmed(shapes, tile, substep)
        if shapes.next[tile] > substep and not alarmed:
            continue
        start, end = tile * TILE, min(tile * TILE + TILE, hi)
        for k in range(1, shapes.active[0] + 1):
            if shapes.wake[tile, k - 1] > substep and not alarmed:
                continue
            c = shapes.active[k]
            place(shapes, c, m.positions, m.matrices)
            thickness = shapes.colliders[c].thickness
            if look(shapes, c, s, start, end, thickness) >= 0.0:
                continue
            for i in range(start, end):
                if shapes.gaps[i - start] < 0.0 and free[i]:
                    distance, nx, ny, nz = distance_to(shapes, c, s.x[i], s.y[i], s.z[i])
                    press(
                        i, thickness - distance, nx, ny, nz, shapes.colliders[c].bone, shapes.colliders[c].friction,
                        least[i] + HARD * rate * rate * inertia.mass[i], rate, m, s, work, inertia, force, blocks,
                    )  # fmt: skip


@driver
def press_all(lo, hi, problem, groups, substep, b, penalty):
    """Set the contact forces of the vertices lo to hi [N] and minus their derivatives [N/m]; nothing for None."""
    if penalty is not None and groups is not None:
        penalty.force[:, lo:hi] = 0
        penalty.blocks[:, lo:hi] = 0
        for shapes in literal_unroll(groups):
            press_group(
                lo, hi, shapes, problem.contacts.free, substep, penalty.least, 1.0 / b,
                problem.bones, problem.state, problem.work, problem.inertia, penalty.force, penalty.blocks,
            )  # fmt: skip


@driver
def look_around(lo, hi, groups, m, s, step):
    """Let those colliders sleep that the vertices lo to hi can't touch in the first step of a frame, of `step` [s]."""
    if groups is not None:
        for shapes in literal_unroll(groups):
            _look_around(lo, hi, shapes, m, s, step)


@driver
def _look_around(lo, hi, shapes, m, s, step):
    shapes.clock[MOMENT] += 1
    first, last = tiles(lo, hi)
    for tile in range(first, last):
        start, end = tile * TILE, min(tile * TILE + TILE, hi)
        mid = (start + end) // 2
        far, fast = spread(s, start, end)
        for k in range(1, shapes.active[0] + 1):
            c = shapes.active[k]
            place(shapes, c, m.positions, m.matrices)
            speed = approach(s, mid, far, fast, shapes.colliders[c].bone, m)
            gap = look(shapes, c, s, start, end, shapes.colliders[c].thickness)
            shapes.wake[tile, k - 1] = nap(gap, speed, step) - 1
