"""XPBD on a grid cloth: long loops over neighbouring vertices that share no constraint.

Rows are dealt to three hands, row 3 k + t to hand t at its place k. The springs of one family between two hands then
link two separate arrays, vertex by vertex, over all rows at once; so do bend springs down with all three hands.
Springs along the rows link neighbours within an array, and every second of them (third, for bend springs) shares no
vertex; nor does every second cell between two hands, each of which resists twist. No index is looked up, and all loops
vectorise. What would link the end of a row to the next has stiffness 0.

Threads share the places k. Three phases, between which they meet, keep each vertex with one thread:
within the rows of a place; from hand 2 to hand 0 of the next place; from hand 2 to hands 0 and 1 of the next.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.absent import part, row, typed
from cape.kernels.jit import kernel, routine, unit
from cape.kernels.state import State
from cape.kernels.team import meet, share
from cape.kernels.xpbd.formulas import (
    TINY,
    Constraints,
    bend_time,
    draw_to_middle,
    forget,
    pull_together,
    set_gains,
    straighten_cell,
    unsigned,
)

Array = NDArray[np.floating]


class GridConstraints(NamedTuple):
    """Constraints of a grid cloth by family, each at its first vertex: arrays (3, n) by hand, see `xpbd.grid`; room for
    positions and velocities there (3, 3, n)."""

    columns: int
    inverse_mass: Array
    positions: Array
    velocities: Array
    across: Constraints
    down: Constraints
    diagonal: Constraints | None
    anti: Constraints | None
    bend_across: Constraints | None
    bend_down: Constraints | None
    twist: Constraints | None


class GridSweeps(NamedTuple):
    """A grid of cloth and its constraints, gone through so many times in a step; damping times [s], None for none."""

    state: State
    constraints: GridConstraints
    damping: float | None
    bend_damping: float | None
    iterations: int


@unit
def prepare_grid(g, team, substep, substeps, step):
    """Set all gains of this thread for a step."""
    c, s = g.constraints, g.state
    h, tau, bend_tau = typed(step, s.x), typed(g.damping, s.x), typed(g.bend_damping, s.x)
    first, last = grid_places(c.columns, s.x.size, team)
    lo, hi = first * c.columns, last * c.columns
    prepare_family(c.across, lo, hi, h, tau)
    prepare_family(c.down, lo, hi, h, tau)
    prepare_family(c.diagonal, lo, hi, h, tau)
    prepare_family(c.anti, lo, hi, h, tau)
    prepare_family(c.bend_across, lo, hi, h, bend_tau)
    prepare_family(c.bend_down, lo, hi, h, bend_tau)
    prepare_family(c.twist, lo, hi, h, bend_tau)


@unit
def solve_grid(g, team, substep, substeps, step):
    """Change the velocities to those of the step's end, in so many sweeps."""
    s, c = g.state, g.constraints
    h, tau, columns = typed(step, s.x), typed(g.damping, s.x), c.columns
    time = bend_time(h, typed(g.bend_damping, s.x))
    first, last = grid_places(columns, s.x.size, team)
    lo, hi = first * columns, last * columns
    # The last place has no next.
    end = min(hi, c.inverse_mass.shape[1] - columns)
    deal(first, last, columns, s.x, s.y, s.z, s.vx, s.vy, s.vz, c.positions, c.velocities)
    forget_family(c.across, lo, hi)
    forget_family(c.down, lo, hi)
    forget_family(c.diagonal, lo, hi)
    forget_family(c.anti, lo, hi)
    forget_family(c.bend_across, lo, hi)
    forget_family(c.bend_down, lo, hi)
    forget_family(c.twist, lo, hi)
    for _ in range(g.iterations):
        if hi > lo:
            link_along(c, c.bend_across, lo, hi, h, tau, time)
            for hand in range(2):
                link_rows(c, c.down, 0, hand, lo, hi, 0, h, tau)
                link_rows(c, c.diagonal, 1, hand, lo, hi, 0, h, tau)
                link_rows(c, c.anti, -1, hand, lo, hi, 0, h, tau)
                twist_rows(c, c.twist, hand, lo, hi, 0, time)
            bend_rows(c, c.bend_down, 0, lo, hi, 0, 0, time)
        meet(team)
        if end > lo:
            link_rows(c, c.down, 0, 2, lo, end, columns, h, tau)
            link_rows(c, c.diagonal, 1, 2, lo, end, columns, h, tau)
            link_rows(c, c.anti, -1, 2, lo, end, columns, h, tau)
            twist_rows(c, c.twist, 2, lo, end, columns, time)
            bend_rows(c, c.bend_down, 1, lo, end, 0, columns, time)
        meet(team)
        if end > lo:
            bend_rows(c, c.bend_down, 2, lo, end, columns, columns, time)
        meet(team)
    hand_back(first, last, columns, c.velocities, s.vx, s.vy, s.vz)


@kernel
def deal(first, last, columns, x, y, z, vx, vy, vz, positions, velocities):
    """Copy the rows of places first to last to the three hands, each of shape (3, 3, n)."""
    width = unsigned(columns)
    rows = x.size // columns
    for place in range(first, last):
        for hand in range(3):
            if 3 * place + hand >= rows:
                continue
            there, here = unsigned(place) * width, unsigned(3 * place + hand) * width
            for c in range(unsigned(0), width):
                positions[hand, 0, there + c] = x[here + c]
                positions[hand, 1, there + c] = y[here + c]
                positions[hand, 2, there + c] = z[here + c]
                velocities[hand, 0, there + c] = vx[here + c]
                velocities[hand, 1, there + c] = vy[here + c]
                velocities[hand, 2, there + c] = vz[here + c]


@kernel
def hand_back(first, last, columns, velocities, vx, vy, vz):
    """Copy the velocities of places first to last back from the three hands."""
    width = unsigned(columns)
    rows = vx.size // columns
    for place in range(first, last):
        for hand in range(3):
            if 3 * place + hand >= rows:
                continue
            there, here = unsigned(place) * width, unsigned(3 * place + hand) * width
            for c in range(unsigned(0), width):
                vx[here + c] = velocities[hand, 0, there + c]
                vy[here + c] = velocities[hand, 1, there + c]
                vz[here + c] = velocities[hand, 2, there + c]


@kernel
def stretch_along(lo, step, damping, tiny, gain, rest, slack, impulse, w, x, y, z, vx, vy, vz):
    """Springs between neighbours of arrays that start at the vertex `lo` of a hand: first even ones of it, then odd."""
    one, two = unsigned(1), unsigned(2)
    for parity in range(2):
        start = unsigned((lo + parity) % 2)
        for pair in range(unsigned(0), (unsigned(x.size) - start) // two):
            i = start + two * pair
            pull_together(
                i, i, i + one, step, damping, tiny, gain, rest, slack, impulse,
                w, w, x, y, z, x, y, z, vx, vy, vz, vx, vy, vz,
            )  # fmt: skip


@kernel
def stretch_between(
    step, damping, tiny, gain, rest, slack, impulse,
    w0, w1, x0, y0, z0, x1, y1, z1, vx0, vy0, vz0, vx1, vy1, vz1,
):  # fmt: skip
    """Springs from each vertex of one group of arrays to the same place of the other."""
    for i in range(x0.size):
        pull_together(
            i, i, i, step, damping, tiny, gain, rest, slack, impulse,
            w0, w1, x0, y0, z0, x1, y1, z1, vx0, vy0, vz0, vx1, vy1, vz1,
        )  # fmt: skip


@kernel
def bend_along(lo, time, gain, slack, impulse, w, p, v):
    """Bend springs over three neighbours in arrays that start at the vertex `lo` of a hand, every third at once."""
    one, two, three = unsigned(1), unsigned(2), unsigned(3)
    for phase in range(3):
        start = unsigned((phase - lo) % 3)
        for triple in range(unsigned(0), (unsigned(p.size) - start) // three):
            i = start + three * triple
            draw_to_middle(i, i, i + one, i + two, time, gain, slack, impulse, w, w, w, p, p, p, v, v, v)


@kernel
def bend_between(time, gain, slack, impulse, w0, w1, w2, p0, p1, p2, v0, v1, v2):
    """Bend springs over the same place of three groups of arrays."""
    for i in range(p0.size):
        draw_to_middle(i, i, i, i, time, gain, slack, impulse, w0, w1, w2, p0, p1, p2, v0, v1, v2)


@kernel
def twist_between(lo, time, gain, slack, impulse, w0, w1, p0, p1, v0, v1):
    """Cells between two groups of arrays that start at the vertex `lo` of a hand: first even ones of it, then odd."""
    two = unsigned(2)
    for parity in range(2):
        start = unsigned((lo + parity) % 2)
        for pair in range(unsigned(0), (unsigned(p0.size) - start) // two):
            i = start + two * pair
            straighten_cell(i, i, i, time, gain, slack, impulse, w0, w1, p0, p1, v0, v1)


@routine
def grid_places(columns, vertices, team):
    """First place of this thread and the one after its last, of one place for each three rows."""
    return share(0, (vertices // columns + 2) // 3, team)


@routine
def prepare_family(family, lo, hi, step, damping):
    """Set the gains of one family of constraints on vertices lo to hi of each hand."""
    if family is not None:
        time = step if damping is None else step + damping
        for hand in range(3):
            set_gains(
                step, time, family.stiffness[hand, lo:hi], family.mobility[hand, lo:hi], family.gain[hand, lo:hi],
                part(row(family.slack, hand), lo, hi),
            )  # fmt: skip


@routine
def forget_family(family, lo, hi):
    """Set the impulses of one family on vertices lo to hi of each hand to zero; where they are kept at all."""
    if family is not None:
        forget(family.impulse, lo, hi)


@routine
def link_rows(c, family, shift, hand, lo, hi, ahead, step, damping):
    """Springs of one family from vertices lo to hi of a hand to those of the next one `ahead` + `shift` further on."""
    if family is not None:
        other = (hand + 1) % 3
        # A row starts later, or ends earlier, where the link leans; what would wrap around has stiffness 0 elsewhere.
        lo, hi = lo - min(shift, 0), hi - max(shift, 0)
        to, end = lo + ahead + shift, hi + ahead + shift
        q, u, w = c.positions, c.velocities, c.inverse_mass
        stretch_between(
            step, damping, typed(TINY, u), family.gain[hand, lo:hi], family.rest[hand, lo:hi],
            part(row(family.slack, hand), lo, hi), part(row(family.impulse, hand), lo, hi),
            w[hand, lo:hi], w[other, to:end],
            q[hand, 0, lo:hi], q[hand, 1, lo:hi], q[hand, 2, lo:hi],
            q[other, 0, to:end], q[other, 1, to:end], q[other, 2, to:end],
            u[hand, 0, lo:hi], u[hand, 1, lo:hi], u[hand, 2, lo:hi],
            u[other, 0, to:end], u[other, 1, to:end], u[other, 2, to:end],
        )  # fmt: skip


@routine
def link_along(c, bends, lo, hi, step, damping, time):
    """Springs and bend springs along the rows of all hands."""
    q, u, w, family = c.positions, c.velocities, c.inverse_mass, c.across
    for hand in range(3):
        stretch_along(
            lo, step, damping, typed(TINY, u), family.gain[hand, lo:hi], family.rest[hand, lo:hi],
            part(row(family.slack, hand), lo, hi), part(row(family.impulse, hand), lo, hi), w[hand, lo:hi],
            q[hand, 0, lo:hi], q[hand, 1, lo:hi], q[hand, 2, lo:hi],
            u[hand, 0, lo:hi], u[hand, 1, lo:hi], u[hand, 2, lo:hi],
        )  # fmt: skip
        if bends is not None:
            for axis in range(3):
                bend_along(
                    lo, time, bends.gain[hand, lo:hi], part(row(bends.slack, hand), lo, hi),
                    part(row(row(bends.impulse, axis), hand), lo, hi), w[hand, lo:hi],
                    q[hand, axis, lo:hi], u[hand, axis, lo:hi],
                )  # fmt: skip


@routine
def bend_rows(c, bends, hand, lo, hi, ahead, further, time):
    """Bend springs from vertices lo to hi of one hand over those `ahead` in the next to those `further` in the last."""
    if bends is not None:
        middle, last = (hand + 1) % 3, (hand + 2) % 3
        q, u, w = c.positions, c.velocities, c.inverse_mass
        near, far = lo + ahead, lo + further
        count = hi - lo
        for axis in range(3):
            bend_between(
                time, bends.gain[hand, lo:hi], part(row(bends.slack, hand), lo, hi),
                part(row(row(bends.impulse, axis), hand), lo, hi),
                w[hand, lo:hi], w[middle, near : near + count], w[last, far : far + count],
                q[hand, axis, lo:hi], q[middle, axis, near : near + count], q[last, axis, far : far + count],
                u[hand, axis, lo:hi], u[middle, axis, near : near + count], u[last, axis, far : far + count],
            )  # fmt: skip


@routine
def twist_rows(c, cells, hand, lo, hi, ahead, time):
    """Cells that start from vertices lo to hi of one hand and end `ahead` of them in the next."""
    if cells is not None:
        other = (hand + 1) % 3
        q, u, w = c.positions, c.velocities, c.inverse_mass
        to, end = lo + ahead, hi + ahead
        for axis in range(3):
            twist_between(
                lo, time, cells.gain[hand, lo:hi], part(row(cells.slack, hand), lo, hi),
                part(row(row(cells.impulse, axis), hand), lo, hi), w[hand, lo:hi], w[other, to:end],
                q[hand, axis, lo:hi], q[other, axis, to:end], u[hand, axis, lo:hi], u[other, axis, to:end],
            )  # fmt: skip
