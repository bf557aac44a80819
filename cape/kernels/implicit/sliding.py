"""Vertices that slide along curves, within the stages of implicit solvers.

A spring of no length pulls a vertex x across to the nearest point c of its curve: f = k (I - t t^T) (c - x), t being
the unit tangent there. As c moves along with x, that is also k (c - x) but beyond an end, from which it would throw the
vertex back; minus its derivative is k (I - t t^T). Stages end so close to the curve that `solve.slide` has next to
nothing to do: k is `HARD` times the mass over b^2, as for contact, and never less than what holds the whole cloth near
the curve.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.bones import MotionRoom
from cape.kernels.contact.penalty import HARD
from cape.kernels.implicit.stiffness import Matrix
from cape.kernels.jit import inlined, unit
from cape.kernels.solve.slide import Rails, nearest_on, point_on, tangent_on
from cape.kernels.state import Inertia, State

Array = NDArray[np.floating]


class Railing(NamedTuple):
    """Curves that hold vertices by springs of at least `least` [N/m]; `forces` (3, N) [N] and the matrix that these are
    added to."""

    state: State
    inertia: Inertia
    rails: Rails
    bones: MotionRoom
    least: float
    forces: Array
    matrix: Matrix


@inlined
def stiffness_of(g, i, b):
    """Stiffness of the spring of vertex i [N/m] in a stage of b."""
    return g.least + HARD * g.inertia.mass[i] / (b * b)


@unit
def pull_to_rails(g, team, substep, substeps, b):
    """Add the forces of curves on a thread's vertices."""
    s, rails, f = g.state, g.rails, g.forces
    attached = rails.attached
    for k in range(attached.vertices.size):
        i = attached.vertices[k]
        if i < team.lo or i >= team.hi:
            continue
        j, u = nearest_on(rails, k, s.x[i], s.y[i], s.z[i], g.bones)
        x, y, z = point_on(rails, attached.bones[k], j, u, g.bones)
        tx, ty, tz = tangent_on(rails, attached.bones[k], j, u, g.bones)
        x, y, z = x - s.x[i], y - s.y[i], z - s.z[i]
        stiffness, along = stiffness_of(g, i, b), x * tx + y * ty + z * tz
        f[0, i] += stiffness * (x - along * tx)
        f[1, i] += stiffness * (y - along * ty)
        f[2, i] += stiffness * (z - along * tz)


@unit
def add_rail_blocks(g, team, substep, substeps, b):
    """Add curves to the own blocks of a thread's vertices."""
    s, rails, own, front = g.state, g.rails, g.matrix.own, g.matrix.front
    attached, number = rails.attached, own.dtype.type
    for k in range(attached.vertices.size):
        i = attached.vertices[k]
        if i < team.lo or i >= team.hi:
            continue
        j, u = nearest_on(rails, k, s.x[i], s.y[i], s.z[i], g.bones)
        stiffness = stiffness_of(g, i, b)
        x, y, z = tangent_on(rails, attached.bones[k], j, u, g.bones)
        own[0, front + i] += number(stiffness * (1.0 - x * x))
        own[1, front + i] += number(stiffness * (1.0 - y * y))
        own[2, front + i] += number(stiffness * (1.0 - z * z))
        own[3, front + i] -= number(stiffness * x * y)
        own[4, front + i] -= number(stiffness * x * z)
        own[5, front + i] -= number(stiffness * y * z)
