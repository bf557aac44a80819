"""XPBD on any mesh: constraints by colour, no two of one colour sharing a vertex.

Threads share each colour and meet after it. Within a colour the loop stays scalar: gathering 64 constraints into
contiguous scratch, so that square roots and divisions vectorise, gains nothing that fetching them twice does not cost.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.absent import part, row, typed
from cape.kernels.jit import inlined, kernel, routine, unit
from cape.kernels.state import State
from cape.kernels.team import meet, share
from cape.kernels.xpbd.formulas import TINY, Constraints, bend_time, change_of, forget, pull_together, set_gains

Array = NDArray[np.floating]


class MeshConstraints(NamedTuple):
    """Constraints of a mesh sorted by colour: springs between two vertices each (E,), bend springs on four (K, 4);
    each colour goes from its place in `starts` to the next."""

    first: NDArray[np.uint32]
    second: NDArray[np.uint32]
    starts: NDArray[np.int64]
    stretch: Constraints
    vertices: NDArray[np.uint32]
    coefficients: Array
    bend_starts: NDArray[np.int64]
    bend: Constraints | None


class MeshSweeps(NamedTuple):
    """A mesh of cloth and its constraints, gone through so many times in a step; damping times [s], None for none."""

    state: State
    constraints: MeshConstraints
    inverse_mass: Array
    damping: float | None
    bend_damping: float | None
    iterations: int


@unit
def prepare_mesh(g, team, substep, substeps, step):
    """Set all gains for a step."""
    s, c = g.state, g.constraints
    prepare_list(c.stretch, typed(step, s.x), typed(g.damping, s.x), team)
    prepare_list(c.bend, typed(step, s.x), typed(g.bend_damping, s.x), team)
    meet(team)


@unit
def solve_mesh(g, team, substep, substeps, step):
    """Change the velocities to those of the step's end, in so many sweeps."""
    s, c = g.state, g.constraints
    h, tau = typed(step, s.x), typed(g.damping, s.x)
    time = bend_time(h, typed(g.bend_damping, s.x))
    forget_list(c.stretch, team)
    forget_list(c.bend, team)
    meet(team)
    for _ in range(g.iterations):
        stretch_colours(g, h, tau, team)
        bend_colours(g, c.bend, time, team)


@kernel
def stretch_listed(
    first, second, step, damping, tiny, gain, rest, slack, impulse, w, x, y, z, vx, vy, vz
):  # fmt: skip
    """Springs between listed vertices, one after the other."""
    for k in range(first.size):
        pull_together(
            k, first[k], second[k], step, damping, tiny, gain, rest, slack, impulse,
            w, w, x, y, z, x, y, z, vx, vy, vz, vx, vy, vz,
        )  # fmt: skip


@kernel
def bend_listed(vertices, coefficients, time, gain, slack, impulse_x, impulse_y, impulse_z, w, x, y, z, vx, vy, vz):
    """C(p) = sum c_a p_a on four listed vertices (K, 4), along all three coordinates; `time` is h + tau."""
    for k in range(gain.size):
        bend_one(k, vertices, coefficients, time, gain, slack, impulse_x, w, x, vx)
        bend_one(k, vertices, coefficients, time, gain, slack, impulse_y, w, y, vy)
        bend_one(k, vertices, coefficients, time, gain, slack, impulse_z, w, z, vz)


@inlined
def bend_one(k, vertices, coefficients, time, gain, slack, impulse, w, p, v):
    """One bend constraint along one coordinate."""
    a, b, c, d = vertices[k, 0], vertices[k, 1], vertices[k, 2], vertices[k, 3]
    ca, cb, cc, cd = coefficients[k, 0], coefficients[k, 1], coefficients[k, 2], coefficients[k, 3]
    va, vb, vc, vd = v[a], v[b], v[c], v[d]
    bend = ca * (p[a] + time * va) + cb * (p[b] + time * vb) + cc * (p[c] + time * vc) + cd * (p[d] + time * vd)
    change = change_of(gain[k] * bend, k, slack, impulse)
    v[a] = va - change * ca * w[a]
    v[b] = vb - change * cb * w[b]
    v[c] = vc - change * cc * w[c]
    v[d] = vd - change * cd * w[d]


@routine
def prepare_list(constraints, step, damping, team):
    """Set this thread's share of the gains of some constraints."""
    if constraints is not None:
        time = step if damping is None else step + damping
        lo, hi = share(0, constraints.gain.size, team)
        set_gains(
            step, time, constraints.stiffness[lo:hi], constraints.mobility[lo:hi], constraints.gain[lo:hi],
            part(constraints.slack, lo, hi),
        )  # fmt: skip


@routine
def forget_list(constraints, team):
    """Set this thread's share of the impulses to zero, where they are kept at all."""
    if constraints is not None:
        lo, hi = share(0, constraints.gain.size, team)
        forget(constraints.impulse, lo, hi)


@routine
def stretch_colours(g, step, damping, team):
    """Go through all springs, colour by colour."""
    s, c, w = g.state, g.constraints, g.inverse_mass
    springs = c.stretch
    for colour in range(c.starts.size - 1):
        lo, hi = share(c.starts[colour], c.starts[colour + 1], team)
        stretch_listed(
            c.first[lo:hi], c.second[lo:hi], step, damping, typed(TINY, s.x), springs.gain[lo:hi], springs.rest[lo:hi],
            part(springs.slack, lo, hi), part(springs.impulse, lo, hi), w, s.x, s.y, s.z, s.vx, s.vy, s.vz,
        )  # fmt: skip
        meet(team)


@routine
def bend_colours(g, bends, time, team):
    """Go through all bend constraints, colour by colour."""
    s, c = g.state, g.constraints
    if bends is not None:
        for colour in range(c.bend_starts.size - 1):
            lo, hi = share(c.bend_starts[colour], c.bend_starts[colour + 1], team)
            bend_listed(
                c.vertices[lo:hi], c.coefficients[lo:hi], time, bends.gain[lo:hi], part(bends.slack, lo, hi),
                part(row(bends.impulse, 0), lo, hi), part(row(bends.impulse, 1), lo, hi),
                part(row(bends.impulse, 2), lo, hi), g.inverse_mass, s.x, s.y, s.z, s.vx, s.vy, s.vz,
            )  # fmt: skip
            meet(team)
