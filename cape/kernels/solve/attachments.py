"""Vertices that bones hold: where, and how each kind of solver puts them there."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.bones import MotionRoom, to_world, turned, velocity_at
from cape.kernels.jit import inlined, routine, unit
from cape.kernels.state import State

Array = NDArray[np.floating]
Indices = NDArray[np.int64]


class Blend(NamedTuple):
    """How several bones hold each of n vertices: those from `starts` (n + 1,) on, by `weights` (m,) of 1 in sum, the
    heaviest first."""

    starts: Indices
    weights: Array


class Attached(NamedTuple):
    """Vertices (n,) held at points [m] (n, 3) of their bones (n,), or each at the mean of points (m, 3) of bones (m,).

    `lift` [m] is how far they are held off there at a frame's start, out of colliders or where a jump of the bones has
    left them, and `drift` [m/s] how that changes in it, both (n, 3) and in the frames of the bones, of a vertex's
    heaviest of several. `blend` is None where each vertex has one bone.
    """

    vertices: Indices
    bones: Indices
    points: Array
    lift: Array
    drift: Array
    blend: Blend | None = None


class Held(NamedTuple):
    """A cloth, and which of its vertices bones hold."""

    state: State
    attached: Attached
    bones: MotionRoom


@unit
def hold_attached(g, team, substep, substeps, step):
    """Put attached vertices where they are held; their velocity is what brings them there."""
    hold(team.lo, team.hi, g.state, g.attached, g.bones, (substep + 1) * step, step)


@unit
def aim_attached(g, team, substep, substeps, step):
    """Give attached vertices the velocity that brings them to where they are held in one step."""
    aim(team.lo, team.hi, g.state, g.attached, g.bones, (substep + 1) * step, step)


@inlined
def goal(attached, k, m, time):
    """Where attachment k holds its vertex in the world [m], `time` [s] after the frame's start."""
    lift, drift = attached.lift, attached.drift
    x, y, z = lift[k, 0] + time * drift[k, 0], lift[k, 1] + time * drift[k, 1], lift[k, 2] + time * drift[k, 2]
    return carried(attached, attached.blend, k, x, y, z, m)


@inlined
def carried(attached, blend, k, ox, oy, oz, m):
    """Where bones carry the vertex of attachment k in the world, held off by `o` in its heaviest bone's frame [m]."""
    bones, points = attached.bones, attached.points
    if blend is None:
        return to_world(
            bones[k], points[k, 0] + ox, points[k, 1] + oy, points[k, 2] + oz, m.positions, m.matrices
        )  # fmt: skip
    first = blend.starts[k]
    x, y, z = turned(bones[first], ox, oy, oz, m.matrices)
    for j in range(first, blend.starts[k + 1]):
        weight = blend.weights[j]
        px, py, pz = to_world(bones[j], points[j, 0], points[j, 1], points[j, 2], m.positions, m.matrices)
        x, y, z = x + weight * px, y + weight * py, z + weight * pz
    return x, y, z


@inlined
def carrying_velocity(attached, blend, k, x, y, z, m):
    """Velocity [m/s] of where attachment k holds its vertex, which is at x, y, z in the world [m]."""
    bones, points, drift = attached.bones, attached.points, attached.drift
    first = heaviest(attached, blend, k)
    dx, dy, dz = turned(first, drift[k, 0], drift[k, 1], drift[k, 2], m.matrices)
    if blend is None:
        vx, vy, vz = velocity_at(first, x, y, z, m)
        return vx + dx, vy + dy, vz + dz
    # What is held off turns with the heaviest bone about where all of them carry the vertex.
    px, py, pz = carried(attached, blend, k, 0.0, 0.0, 0.0, m)
    spin = m.spin[first]
    dx += spin[1] * (z - pz) - spin[2] * (y - py)
    dy += spin[2] * (x - px) - spin[0] * (z - pz)
    dz += spin[0] * (y - py) - spin[1] * (x - px)
    for j in range(blend.starts[k], blend.starts[k + 1]):
        weight = blend.weights[j]
        px, py, pz = to_world(bones[j], points[j, 0], points[j, 1], points[j, 2], m.positions, m.matrices)
        vx, vy, vz = velocity_at(bones[j], px, py, pz, m)
        dx, dy, dz = dx + weight * vx, dy + weight * vy, dz + weight * vz
    return dx, dy, dz


@inlined
def heaviest(attached, blend, k):
    """The bone that has the most weight in attachment k."""
    if blend is None:
        return attached.bones[k]
    return attached.bones[blend.starts[k]]


@routine
def hold(lo, hi, s, attached, m, time, step):
    """Put the attached ones of vertices lo to hi where they are held; their velocity is what brings them there."""
    inverse_step = 1.0 / step
    for k in range(attached.vertices.size):
        i = attached.vertices[k]
        if i < lo or i >= hi:
            continue
        x, y, z = goal(attached, k, m, time)
        # The step has moved the vertex with the last one's velocity; undo it to know where the vertex was.
        s.vx[i] = (x - (s.x[i] - step * s.vx[i])) * inverse_step
        s.vy[i] = (y - (s.y[i] - step * s.vy[i])) * inverse_step
        s.vz[i] = (z - (s.z[i] - step * s.vz[i])) * inverse_step
        s.x[i], s.y[i], s.z[i] = x, y, z


@routine
def aim(lo, hi, s, attached, m, time, step):
    """Give the attached ones of vertices lo to hi the velocity that brings them to where they are held in one step."""
    for k in range(attached.vertices.size):
        i = attached.vertices[k]
        if i < lo or i >= hi:
            continue
        x, y, z = goal(attached, k, m, time)
        s.vx[i] = (x - s.x[i]) / step
        s.vy[i] = (y - s.y[i]) / step
        s.vz[i] = (z - s.z[i]) / step


@routine
def hold_rigidly(lo, hi, s, attached, m, time, b, target):
    """Put the attached ones of vertices lo to hi where they are held, with the velocity of that place.

    Rows 0 to 2 of `target` are set to xt, so that v = (x - xt) / b.
    """
    for k in range(attached.vertices.size):
        i = attached.vertices[k]
        if i < lo or i >= hi:
            continue
        x, y, z = goal(attached, k, m, time)
        vx, vy, vz = carrying_velocity(attached, attached.blend, k, x, y, z, m)
        s.x[i], s.y[i], s.z[i] = x, y, z
        s.vx[i], s.vy[i], s.vz[i] = vx, vy, vz
        target[0, i], target[1, i], target[2, i] = x - b * vx, y - b * vy, z - b * vz
