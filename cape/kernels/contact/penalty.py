"""Contact inside an implicit stage: springs across the thickness of colliders, with smoothed Coulomb friction.

A vertex nearer than `thickness` to a shape has the energy 1/2 k depth^2, whose force along the normal n is pressure =
k depth. Friction is that of Li et al. 2020, "Incremental potential contact", section 5.3: with u the velocity across n
relative to the surface that moves with its bone,

    f = -mu pressure f1(|u|) u / |u|,    f1(s) = 2 s / SLIP - s^2 / SLIP^2 below SLIP, otherwise 1

The pressure in it is that of the positions at hand rather than of an earlier iteration. Minus the derivative, as the
matrix has it, is symmetric and positive semidefinite: k n n^T + mu pressure f1 / (|u| b) (I - n n^T), with another
slope in place of f1 / |u| along u: f1' where a vertex is to speed up, where it is to slow down that of the chord of f1
to the speed at which, by itself, it would be in equilibrium, which may be rest. As f1 is concave, Newton's method stays
on its side of the solution; with the derivative throughout it overshoots a vertex's rest. With the chord to rest
throughout, which is f1 / |u|, what slides or has just been caught takes dozens of iterations: each leaves all but
1 / (1 + mu pressure b / (m |u|)) of what is amiss, and the pressure of an impact grows as 1 / b^2.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.bones import MotionRoom, velocity_at
from cape.kernels.contact.shapes import MOMENT, Colliders, distance_to, place
from cape.kernels.contact.slip import is_let_go
from cape.kernels.contact.watch import TILE, approach, is_alarmed, look, nap, spread, tiles
from cape.kernels.jit import inlined, kernel, routine, unit
from cape.kernels.state import Inertia, State

Array = NDArray[np.floating]

SLIP = 1e-3  # m/s below which friction gives way: less sticks better, and costs iterations
ALIKE = 0.99  # share of a speed from which on another one is told from it by the derivative of friction
HARD = 10.0  # contact stiffness over mass / b^2, at least: a vertex alone is stopped within a tenth of its way


class Penalty(NamedTuple):
    """Contact: `least` stiffness [N/m] (N,), room for forces [N] (3, N) and minus their derivatives [N/m] (6, N)."""

    least: Array
    force: Array
    blocks: Array


class PenaltyContact(NamedTuple):
    """A cloth within an implicit stage, and what presses on it.

    `free` (N,) is False for attached vertices; `target` (6, N) is what the stage aims at, `forces` (3, N) [N] are the
    others; both as in `implicit.stages`.
    """

    state: State
    inertia: Inertia
    free: NDArray[np.bool_]
    colliders: Colliders
    bones: MotionRoom
    penalty: Penalty
    target: Array
    forces: Array


@routine
def press(g, c, i, depth, nx, ny, nz, rate):
    """Add the contact of vertex i with collider c, `depth` [m] too deep along the unit normal n; `rate` is 1/b."""
    s, force, blocks, record = g.state, g.penalty.force, g.penalty.blocks, g.colliders.records[c]
    friction, stiffness = record.friction, g.penalty.least[i] + HARD * rate * rate * g.inertia.mass[i]
    pressure = stiffness * depth
    force[0, i] += pressure * nx
    force[1, i] += pressure * ny
    force[2, i] += pressure * nz
    along = stiffness
    if friction > 0.0:
        ux, uy, uz = velocity_at(record.bone, s.x[i], s.y[i], s.z[i], g.bones)
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
        if speed > 0.0:
            over = push(g, i, ux, uy, uz, rate) / speed
            slope = friction_slope(friction * pressure, speed, rate * g.inertia.mass[i], over)
            less = (drag - slope) * rate / (speed * speed)
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
def friction_slope(most, speed, inertia, over):
    """Slope of friction along a vertex's velocity [N s/m], to find its speed by: see above.

    `most` is mu times the pressure [N], `inertia` m / b [kg/s], and `over` what is left over in the equation of motion
    along the velocity [N].
    """
    drive = over + inertia * speed + most * grip(speed)
    if drive <= 0.0:
        settled = 0.0
    elif drive >= most + inertia * SLIP:
        settled = (drive - most) / inertia
    else:
        half = 0.5 * inertia + most / SLIP
        settled = drive / (half + math.sqrt(half * half - most * drive / (SLIP * SLIP)))
    if settled < ALIKE * speed:
        return most * (grip(speed) - grip(settled)) / (speed - settled)
    return 2.0 * most * (1.0 - speed / SLIP) / SLIP if speed < SLIP else 0.0


@inlined
def grip(speed):
    """Friction at a speed, as a share of what it is at most: f1."""
    return (2.0 - speed / SLIP) * speed / SLIP if speed < SLIP else 1.0


@inlined
def push(g, i, ux, uy, uz, rate):
    """What is left over in the equation of motion of vertex i along u [N m/s]."""
    s, f, t, force, mass, gravity = g.state, g.forces, g.target, g.penalty.force, g.inertia.mass[i], g.inertia.gravity
    return (
        ux * (f[0, i] + force[0, i] + mass * (gravity[0] - rate * (s.vx[i] - t[3, i])))
        + uy * (f[1, i] + force[1, i] + mass * (gravity[1] - rate * (s.vy[i] - t[4, i])))
        + uz * (f[2, i] + force[2, i] + mass * (gravity[2] - rate * (s.vz[i] - t[5, i])))
    )


@routine
def press_all(g, lo, hi, substep, b):
    """Set the contact forces of the vertices lo to hi [N] and minus their derivatives [N/m]."""
    s, colliders, rate = g.state, g.colliders, 1.0 / b
    g.penalty.force[:, lo:hi] = 0
    g.penalty.blocks[:, lo:hi] = 0
    first, last = tiles(lo, hi)
    for tile in range(first, last):
        alarmed = is_alarmed(colliders, tile, substep)
        if colliders.next[tile] > substep and not alarmed:
            continue
        start, end = tile * TILE, min(tile * TILE + TILE, hi)
        for k in range(1, colliders.active[0] + 1):
            if colliders.wake[tile, k - 1] > substep and not alarmed:
                continue
            c = colliders.active[k]
            place(colliders, c, g.bones)
            thickness = colliders.records[c].thickness
            if look(colliders, c, s, start, end, thickness) >= 0.0:
                continue
            for i in range(start, end):
                if colliders.points.gaps[i - start] < 0.0 and g.free[i] and not is_let_go(colliders, c, i):
                    distance, nx, ny, nz = distance_to(colliders, c, s.x[i], s.y[i], s.z[i])
                    press(g, c, i, thickness - distance, nx, ny, nz, rate)


@unit
def press_colliders(g, team, substep, substeps, b):
    """Find the contact forces of a stage, and add them to the others."""
    press_all(g, team.lo, team.hi, substep, b)
    for axis in range(3):
        add(g.penalty.force[axis, team.lo : team.hi], g.forces[axis, team.lo : team.hi])


@kernel
def add(values, out):
    """Add the values to `out`."""
    for i in range(out.size):
        out[i] += values[i]


@unit
def find_touchable(g, team, substep, substeps, step):
    """Let those colliders sleep that the cloth can't touch in the first step of a frame."""
    s, colliders, m = g.state, g.colliders, g.bones
    colliders.clock[MOMENT] += 1
    first, last = tiles(team.lo, team.hi)
    for tile in range(first, last):
        start, end = tile * TILE, min(tile * TILE + TILE, team.hi)
        mid = (start + end) // 2
        far, fast = spread(s, start, end)
        for k in range(1, colliders.active[0] + 1):
            c = colliders.active[k]
            place(colliders, c, m)
            speed = approach(s, mid, far, fast, colliders.records[c].bone, m)
            gap = look(colliders, c, s, start, end, colliders.records[c].thickness)
            colliders.wake[tile, k - 1] = nap(gap, speed, step) - 1
