"""Vertices that springs hold at where bones carry them: soft attachments, in each kind of solver.

A spring of stiffness k [N/m] and no length pulls vertex x to its goal g, a damper c [N s/m] to the goal's velocity u:

    f = k (g - x) + c (u - v)

Explicit solvers take f as it is. An implicit one adds k + c / b to the vertex's own block of its matrix, as v follows x
by v = (x - xt) / b. XPBD takes it as a constraint x - g of compliance 1 / k: Macklin, Mueller, Chentanez 2016, eq. 26,
for one vertex of mass m and the velocity that takes it to the end of a step h, is

    v' = (m v + h k (g - x) + h c u) / (m + h^2 k + h c)

with g and u at the step's end.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.bones import MotionRoom
from cape.kernels.jit import unit
from cape.kernels.solve.attachments import Attached, carrying_velocity, goal
from cape.kernels.state import Inertia, State

Array = NDArray[np.floating]


class Pull(NamedTuple):
    """Springs between n vertices and where bones carry them: `stiffness` [N/m] and `damping` [N s/m] (n,).

    `goals` [m] and their velocities `speeds` [m/s], (3, n), are set as the bones move.
    """

    attached: Attached
    stiffness: Array
    damping: Array
    goals: Array
    speeds: Array


class Aiming(NamedTuple):
    """Springs whose goals are to be set for bones that are where they are at a share `at` of a step."""

    pull: Pull
    bones: MotionRoom
    at: float


class Pulled(NamedTuple):
    """A cloth that springs pull at, and `forces` (3, N) [N] that they add to."""

    state: State
    pull: Pull
    forces: Array


class Drawn(NamedTuple):
    """A cloth whose velocities springs are to change."""

    state: State
    pull: Pull
    inertia: Inertia


@unit
def aim_pull(g, team, substep, substeps, step):
    """Set the goals of a thread's vertices."""
    attached, goals, speeds = g.pull.attached, g.pull.goals, g.pull.speeds
    time = (substep + g.at) * step
    for k in range(attached.vertices.size):
        i = attached.vertices[k]
        if i < team.lo or i >= team.hi:
            continue
        x, y, z = goal(attached, k, g.bones, time)
        goals[0, k], goals[1, k], goals[2, k] = x, y, z
        u, v, w = carrying_velocity(attached, attached.blend, k, x, y, z, g.bones)
        speeds[0, k], speeds[1, k], speeds[2, k] = u, v, w


@unit
def pull_vertices(g, team, substep, substeps, step):
    """Add the forces of springs on a thread's vertices."""
    s, pull, f = g.state, g.pull, g.forces
    vertices = pull.attached.vertices
    for k in range(vertices.size):
        i = vertices[k]
        if i < team.lo or i >= team.hi:
            continue
        stiffness, damping = pull.stiffness[k], pull.damping[k]
        f[0, i] += stiffness * (pull.goals[0, k] - s.x[i]) + damping * (pull.speeds[0, k] - s.vx[i])
        f[1, i] += stiffness * (pull.goals[1, k] - s.y[i]) + damping * (pull.speeds[1, k] - s.vy[i])
        f[2, i] += stiffness * (pull.goals[2, k] - s.z[i]) + damping * (pull.speeds[2, k] - s.vz[i])


@unit
def draw_vertices(g, team, substep, substeps, step):
    """Let springs change the velocities of a thread's vertices, as constraints of XPBD."""
    s, pull, inverse_mass = g.state, g.pull, g.inertia.inverse_mass
    vertices = pull.attached.vertices
    for k in range(vertices.size):
        i = vertices[k]
        if i < team.lo or i >= team.hi:
            continue
        w = step * inverse_mass[i]
        pulled, damped = w * pull.stiffness[k], w * pull.damping[k]
        share = 1.0 / (1.0 + step * pulled + damped)
        s.vx[i] = share * (s.vx[i] + pulled * (pull.goals[0, k] - s.x[i]) + damped * pull.speeds[0, k])
        s.vy[i] = share * (s.vy[i] + pulled * (pull.goals[1, k] - s.y[i]) + damped * pull.speeds[1, k])
        s.vz[i] = share * (s.vz[i] + pulled * (pull.goals[2, k] - s.z[i]) + damped * pull.speeds[2, k])
