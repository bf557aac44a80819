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
from cape.kernels.xpbd.membrane import MembraneConstraints, forget_membrane, stretch_membrane

Array = NDArray[np.floating]


class SpringConstraints(NamedTuple):
    """Springs between two vertices each (E,), sorted by colour; each colour goes from its place in `starts` to the
    next."""

    first: NDArray[np.uint32]
    second: NDArray[np.uint32]
    starts: NDArray[np.int64]
    stretch: Constraints


class MeshConstraints(NamedTuple):
    """Constraints of a mesh: springs or a membrane, None for the other, and three bend springs on each of K patches of
    M vertices (K, M), with coefficients (K, 3, M) and `mixed` (K, 3) as in `bend_listed`, sorted by colour like the
    springs; their `bend` is flat, 3 K long."""

    springs: SpringConstraints | None
    membrane: MembraneConstraints | None
    vertices: NDArray[np.uint32]
    coefficients: Array
    mixed: Array
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
    prepare_springs(c.springs, typed(step, s.x), typed(g.damping, s.x), team)
    prepare_list(c.bend, typed(step, s.x), typed(g.bend_damping, s.x), team)
    meet(team)


@unit
def solve_mesh(g, team, substep, substeps, step):
    """Change the velocities to those of the step's end, in so many sweeps."""
    s, c = g.state, g.constraints
    h, tau = typed(step, s.x), typed(g.damping, s.x)
    time = bend_time(h, typed(g.bend_damping, s.x))
    forget_springs(c.springs, team)
    forget_membrane(c.membrane, team)
    forget_list(c.bend, team)
    meet(team)
    for _ in range(g.iterations):
        stretch_colours(g, c.springs, h, tau, team)
        stretch_membrane(c.membrane, h, tau, g.inverse_mass, s, team)
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
def bend_listed(
    vertices, coefficients, mixed, time, gain, slack, impulse_x, impulse_y, impulse_z, w, x, y, z, vx, vy, vz
):  # fmt: skip
    """C(p) = sum c_a p_a for three rows of coefficients (K, 3, M) on the listed vertices (K, M), along all three
    coordinates; `time` is h + tau.

    The rows are solved one after the other as if each were by itself; but all are told before any vertex is changed,
    and what one changes of the next ones' C is known beforehand: `mixed` (K, 3), the sums w c c' of the rows 0 and 1,
    0 and 2, 1 and 2 [1/kg].
    """
    for k in range(vertices.shape[0]):
        members, rows, none = vertices[k], coefficients[k], type(time)(0.0)
        ax = ay = az = bx = by = bz = cx = cy = cz = none
        for m in range(members.size):
            j = members[m]
            px, py, pz = x[j] + time * vx[j], y[j] + time * vy[j], z[j] + time * vz[j]
            a, b, c = rows[0, m], rows[1, m], rows[2, m]
            ax, ay, az = ax + a * px, ay + a * py, az + a * pz
            bx, by, bz = bx + b * px, by + b * py, bz + b * pz
            cx, cy, cz = cx + c * px, cy + c * py, cz + c * pz
        ax, bx, cx = three_changes(k, ax, bx, cx, mixed[k], time, gain, slack, impulse_x)
        ay, by, cy = three_changes(k, ay, by, cy, mixed[k], time, gain, slack, impulse_y)
        az, bz, cz = three_changes(k, az, bz, cz, mixed[k], time, gain, slack, impulse_z)
        for m in range(members.size):
            j = members[m]
            a, b, c = w[j] * rows[0, m], w[j] * rows[1, m], w[j] * rows[2, m]
            vx[j] = vx[j] - (a * ax + b * bx + c * cx)
            vy[j] = vy[j] - (a * ay + b * by + c * cy)
            vz[j] = vz[j] - (a * az + b * bz + c * cz)


@inlined
def three_changes(k, a, b, c, mixed, time, gain, slack, impulse):
    """What is added to the impulses of patch k along one coordinate, of whose bend springs C is given."""
    a = change_of(gain[3 * k] * a, 3 * k, slack, impulse)
    b = change_of(gain[3 * k + 1] * (b - time * mixed[0] * a), 3 * k + 1, slack, impulse)
    c = change_of(gain[3 * k + 2] * (c - time * (mixed[1] * a + mixed[2] * b)), 3 * k + 2, slack, impulse)
    return a, b, c


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
def prepare_springs(springs, step, damping, team):
    """Set this thread's share of the springs' gains."""
    if springs is not None:
        prepare_list(springs.stretch, step, damping, team)


@routine
def forget_springs(springs, team):
    """Set this thread's share of the springs' impulses to zero, where they are kept at all."""
    if springs is not None:
        forget_list(springs.stretch, team)


@routine
def stretch_colours(g, c, step, damping, team):
    """Go through all springs, if there are any, colour by colour."""
    if c is not None:
        s, w, springs = g.state, g.inverse_mass, c.stretch
        for colour in range(c.starts.size - 1):
            lo, hi = share(c.starts[colour], c.starts[colour + 1], team)
            stretch_listed(
                c.first[lo:hi], c.second[lo:hi], step, damping, typed(TINY, s.x), springs.gain[lo:hi],
                springs.rest[lo:hi], part(springs.slack, lo, hi), part(springs.impulse, lo, hi), w,
                s.x, s.y, s.z, s.vx, s.vy, s.vz,
            )  # fmt: skip
            meet(team)


@routine
def bend_colours(g, bends, time, team):
    """Go through all bend constraints, colour by colour."""
    s, c = g.state, g.constraints
    if bends is not None:
        for colour in range(c.bend_starts.size - 1):
            lo, hi = share(c.bend_starts[colour], c.bend_starts[colour + 1], team)
            a, e = 3 * lo, 3 * hi
            bend_listed(
                c.vertices[lo:hi], c.coefficients[lo:hi], c.mixed[lo:hi], time, bends.gain[a:e],
                part(bends.slack, a, e), part(row(bends.impulse, 0), a, e), part(row(bends.impulse, 1), a, e),
                part(row(bends.impulse, 2), a, e), g.inverse_mass, s.x, s.y, s.z, s.vx, s.vy, s.vz,
            )  # fmt: skip
            meet(team)
