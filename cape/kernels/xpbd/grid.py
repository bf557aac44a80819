"""XPBD on a grid cloth: long loops over vertices that share no constraint.

The vertices are dealt to nine hands, three by three: those of the rows 3 k + a and the columns 3 i + b to the hand
(a, b), at its place k, i. Three neighbours along a thread, or the four of a cell, are then in different hands, so that
the constraints of one family between the same hands share no vertex: one loop takes them all, from contiguous arrays.
No index is looked up, and all loops vectorise. What would link the end of a row to the next has stiffness 0; so has
what starts or ends beyond the grid, where columns and rows are filled up.

Threads share the rows of places k. Three phases, between which they meet, keep each vertex with one thread: within the
rows of a place; from its last row to the first of the next; from its last two rows to the first two of the next.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from cape.kernels.absent import part, row, typed
from cape.kernels.jit import inlined, kernel, routine, unit
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

HANDS = 3  # along the rows, and along the columns
LANES = 16  # numbers that whole vectors fill
LINE = 64  # bytes
X, Y, Z, THREE = np.uint64(0), np.uint64(1), np.uint64(2), np.uint64(3)


class Hands(NamedTuple):
    """Room for positions [m] and velocities [m/s] in the hands, (3, 3, 3, n), the axis third; the same flat, and the
    place `where` each vertex has its first coordinate there (N,)."""

    positions: Array
    velocities: Array
    flat_positions: Array
    flat_velocities: Array
    where: NDArray[np.uint32]


class GridConstraints(NamedTuple):
    """Constraints of a grid cloth by family, each at its first vertex: arrays (3, 3, n) by hand as `dealt` makes
    them."""

    columns: int
    hands: Hands
    inverse_mass: Array
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


class Part(NamedTuple):
    """A thread's share of every hand: places `lo` to `hi`, of which a row of the grid has `width`; and how many of the
    places from `hi` on it may use as well, 1 where they are nobody's."""

    lo: int
    hi: int
    width: int
    spare: int


def hands_for(rows: int, columns: int, dtype: DTypeLike) -> Hands:
    """Make room for a grid of cloth."""
    room = _room(rows, columns, dtype)
    positions, velocities = np.zeros((2, HANDS, HANDS, 3, room), dtype)
    hand, lane, place = _places(rows * columns, columns)
    where = (HANDS * hand + lane) * 3 * room + place
    return Hands(positions, velocities, positions.ravel(), velocities.ravel(), where.astype(np.uint32))


def dealt(values: Array, columns: int, dtype: DTypeLike) -> Array:
    """Values of a grid's vertices (N,) by hand, shape (3, 3, n), filled up with zeros."""
    result = np.zeros((HANDS, HANDS, _room(len(values) // columns, columns, dtype)), dtype)
    result[_places(len(values), columns)] = values
    return result


def _places(vertices: int, columns: int) -> tuple[NDArray[np.int64], ...]:
    """Hands of a grid's vertices by row and by column, and their places there, each (N,)."""
    row, column = np.divmod(np.arange(vertices), columns)
    return row % HANDS, column % HANDS, row // HANDS * -(-columns // HANDS) + column // HANDS


def _room(rows: int, columns: int, dtype: DTypeLike) -> int:
    """Numbers that each hand has room for: whole vectors and a row beyond the last place.

    Hands are an odd number of cache lines apart: those a power of two apart would compete for the same lines.
    """
    number, width = np.dtype(dtype).itemsize, -(-columns // HANDS)
    places = (-(-rows // HANDS) + 1) * width
    return (-(-(places + LANES + 1) * number // LINE) | 1) * LINE // number


@unit
def prepare_grid(g, team, substep, substeps, step):
    """Set all gains of this thread for a step."""
    c, s = g.constraints, g.state
    h, tau, bend_tau = typed(step, s.x), typed(g.damping, s.x), typed(g.bend_damping, s.x)
    mine = own_part(c.columns, s.x.size, team)
    prepare_family(c.across, mine, h, tau)
    prepare_family(c.down, mine, h, tau)
    prepare_family(c.diagonal, mine, h, tau)
    prepare_family(c.anti, mine, h, tau)
    prepare_family(c.bend_across, mine, h, bend_tau)
    prepare_family(c.bend_down, mine, h, bend_tau)
    prepare_family(c.twist, mine, h, bend_tau)


@unit
def solve_grid(g, team, substep, substeps, step):
    """Change the velocities to those of the step's end, in so many sweeps."""
    s, c = g.state, g.constraints
    h, tau = typed(step, s.x), typed(g.damping, s.x)
    time = bend_time(h, typed(g.bend_damping, s.x))
    mine = own_part(c.columns, s.x.size, team)
    first, last = own_vertices(c.columns, s.x.size, team)
    hands, stride = c.hands, unsigned(c.inverse_mass.shape[2])
    deal(
        first, last, stride, hands.where, s.x, s.y, s.z, s.vx, s.vy, s.vz, hands.flat_positions, hands.flat_velocities,
    )  # fmt: skip
    forget_family(c.across, mine)
    forget_family(c.down, mine)
    forget_family(c.diagonal, mine)
    forget_family(c.anti, mine)
    forget_family(c.bend_across, mine)
    forget_family(c.bend_down, mine)
    forget_family(c.twist, mine)
    for _ in range(g.iterations):
        for hand in range(HANDS):
            link(c, c.across, 0, 1, hand, mine, h, tau)
            bend(c, c.bend_across, 0, 1, hand, mine, time)
        for hand in range(HANDS - 1):
            link_down(c, hand, mine, h, tau, time)
        bend(c, c.bend_down, 1, 0, 0, mine, time)
        meet(team)
        link_down(c, 2, mine, h, tau, time)
        bend(c, c.bend_down, 1, 0, 1, mine, time)
        meet(team)
        bend(c, c.bend_down, 1, 0, 2, mine, time)
        meet(team)
    hand_back(first, last, stride, hands.where, hands.flat_velocities, s.vx, s.vy, s.vz)


@routine
def link_down(c, hand, mine, step, damping, time):
    """What links the rows of a hand to the next ones, but for bend springs."""
    link(c, c.down, 1, 0, hand, mine, step, damping)
    link(c, c.diagonal, 1, 1, hand, mine, step, damping)
    link(c, c.anti, 1, -1, hand, mine, step, damping)
    twist(c, c.twist, hand, mine, time)


@kernel
def deal(lo, hi, stride, where, x, y, z, vx, vy, vz, p, v):
    """Copy vertices lo to hi to the hands, in which the axes are `stride` apart."""
    for k in range(unsigned(lo), unsigned(hi)):
        i = unsigned(where[k])
        j = i + stride
        l = j + stride  # noqa: E741
        p[i], p[j], p[l] = x[k], y[k], z[k]
        v[i], v[j], v[l] = vx[k], vy[k], vz[k]


@kernel
def hand_back(lo, hi, stride, where, v, vx, vy, vz):
    """Copy the velocities of vertices lo to hi back."""
    for k in range(unsigned(lo), unsigned(hi)):
        i = unsigned(where[k])
        j = i + stride
        vx[k], vy[k], vz[k] = v[i], v[j], v[j + stride]


@kernel
def stretch_between(
    lo, to, count, step, damping, tiny, gain, rest, slack, impulse,
    w0, w1, x0, y0, z0, x1, y1, z1, vx0, vy0, vz0, vx1, vy1, vz1,
):  # fmt: skip
    """Springs from so many places of one hand, from `lo` on, to those of another from `to` on."""
    for k in range(count):
        pull_together(
            lo + k, lo + k, to + k, step, damping, tiny, gain, rest, slack, impulse,
            w0, w1, x0, y0, z0, x1, y1, z1, vx0, vy0, vz0, vx1, vy1, vz1,
        )  # fmt: skip


@kernel
def bend_between(
    at, count, time, gain, slack, impulse_x, impulse_y, impulse_z, w0, w1, w2,
    x0, y0, z0, x1, y1, z1, x2, y2, z2, vx0, vy0, vz0, vx1, vy1, vz1, vx2, vy2, vz2,
):  # fmt: skip
    """Bend springs over so many places of three hands, from the ones that `at` tells on."""
    for k in range(count):
        h, i, j = at[0] + k, at[1] + k, at[2] + k
        draw_to_middle(h, h, i, j, time, gain, slack, impulse_x, w0, w1, w2, x0, x1, x2, vx0, vx1, vx2)
        draw_to_middle(h, h, i, j, time, gain, slack, impulse_y, w0, w1, w2, y0, y1, y2, vy0, vy1, vy2)
        draw_to_middle(h, h, i, j, time, gain, slack, impulse_z, w0, w1, w2, z0, z1, z2, vz0, vz1, vz2)


@kernel
def twist_between(
    at, count, time, gain, slack, impulse, w00, w10, w01, w11, p00, p10, p01, p11, v00, v10, v01, v11
):  # fmt: skip
    """Cells with their corners at so many places of four hands, from the ones that `at` tells on."""
    for k in range(count):
        straighten_cell(
            at[0] + k, at[1] + k, at[2] + k, at[3] + k, time, gain, slack, impulse,
            w00, w10, w01, w11, p00, p10, p01, p11, v00, v10, v01, v11,
        )  # fmt: skip


@routine
def places_of(columns, vertices, team):
    """First row of places of this thread and the one after its last, of one for each three rows of the grid."""
    return share(0, (vertices // columns + 2) // 3, team)


@routine
def own_part(columns, vertices, team):
    """This thread's share; that of the last one is filled up to whole vectors, so that no loop has a remainder."""
    first, last = places_of(columns, vertices, team)
    width = (columns + 2) // 3
    lo, hi = first * width, last * width
    if team.rank < team.size - 1:
        return Part(lo, hi, width, 0)
    return Part(lo, lo + (hi - lo + LANES - 1) // LANES * LANES, width, 1)


@routine
def own_vertices(columns, vertices, team):
    """First vertex of this thread and the one after its last."""
    first, last = places_of(columns, vertices, team)
    return HANDS * first * columns, min(HANDS * last * columns, vertices)


@routine
def prepare_family(family, mine, step, damping):
    """Set the gains of a thread's share of one family of constraints."""
    if family is not None:
        time = step if damping is None else step + damping
        lo, hi = mine.lo, mine.hi
        for hand in range(HANDS):
            for lane in range(HANDS):
                set_gains(
                    step, time, family.stiffness[hand, lane, lo:hi], family.mobility[hand, lane, lo:hi],
                    family.gain[hand, lane, lo:hi], part(row(row(family.slack, hand), lane), lo, hi),
                )  # fmt: skip


@routine
def forget_family(family, mine):
    """Set the impulses of a thread's share of one family to zero; where they are kept at all."""
    if family is not None:
        forget(family.impulse, mine.lo, mine.hi)


@inlined
def place(start, hand, lane, mine):
    """From where on the vertices are that belong to the places from `start` on, in a hand that may be beyond the third:
    that is one of the next row or column of places."""
    return unsigned(start + hand // HANDS * mine.width + lane // HANDS)


@inlined
def starts(mine, shift):
    """First place from which a constraint may start that ends in the next column of places, or the one before, and how
    many there are.

    A row starts later, or ends earlier, where the constraint leans; what would wrap around has stiffness 0 elsewhere.
    """
    if shift == 0:
        return mine.lo, mine.hi - mine.lo
    if shift < 0:
        return mine.lo + 1, mine.hi - mine.lo - 1 + mine.spare
    return mine.lo, mine.hi - mine.lo - 1 + mine.spare


@inlined
def hand_of(index):
    """A hand, if these went on beyond the third."""
    return unsigned(index % HANDS)


@routine
def link(c, family, down, right, hand, mine, step, damping):
    """Springs of one family that start in the rows of a hand and end so many rows and columns further on."""
    if family is not None:
        q, u, w = c.hands.positions, c.hands.velocities, c.inverse_mass
        tiny, h, d = typed(TINY, u), unsigned(hand), hand_of(hand + down)
        for lane in range(HANDS):
            a, e = unsigned(lane), hand_of(lane + right)
            lo, count = starts(mine, (lane + right) // HANDS)
            stretch_between(
                unsigned(lo), place(lo, hand + down, lane + right, mine), unsigned(count), step, damping, tiny,
                family.gain[h, a], family.rest[h, a], row(row(family.slack, h), a), row(row(family.impulse, h), a),
                w[h, a], w[d, e], q[h, a, X], q[h, a, Y], q[h, a, Z], q[d, e, X], q[d, e, Y], q[d, e, Z],
                u[h, a, X], u[h, a, Y], u[h, a, Z], u[d, e, X], u[d, e, Y], u[d, e, Z],
            )  # fmt: skip


@routine
def bend(c, family, down, right, hand, mine, time):
    """Bend springs of one family that start in the rows of a hand and go on so many rows and columns twice."""
    if family is not None:
        q, u, w, impulse = c.hands.positions, c.hands.velocities, c.inverse_mass, family.impulse
        h, d, f = unsigned(hand), hand_of(hand + down), hand_of(hand + 2 * down)
        for lane in range(HANDS):
            a, e, g = unsigned(lane), hand_of(lane + right), hand_of(lane + 2 * right)
            lo, count = starts(mine, (lane + 2 * right) // HANDS)
            middle = place(lo, hand + down, lane + right, mine)
            last = place(lo, hand + 2 * down, lane + 2 * right, mine)
            bend_between(
                (unsigned(lo), middle, last), unsigned(count), time, family.gain[h, a], row(row(family.slack, h), a),
                row(row(row(impulse, X), h), a), row(row(row(impulse, Y), h), a), row(row(row(impulse, Z), h), a),
                w[h, a], w[d, e], w[f, g], q[h, a, X], q[h, a, Y], q[h, a, Z], q[d, e, X], q[d, e, Y], q[d, e, Z],
                q[f, g, X], q[f, g, Y], q[f, g, Z], u[h, a, X], u[h, a, Y], u[h, a, Z],
                u[d, e, X], u[d, e, Y], u[d, e, Z], u[f, g, X], u[f, g, Y], u[f, g, Z],
            )  # fmt: skip


@routine
def twist(c, family, hand, mine, time):
    """Cells that start in the rows of a hand."""
    if family is not None:
        q, u, w, impulse = c.hands.positions, c.hands.velocities, c.inverse_mass, family.impulse
        h, d = unsigned(hand), hand_of(hand + 1)
        for lane in range(HANDS):
            a, e = unsigned(lane), hand_of(lane + 1)
            lo, count = starts(mine, (lane + 1) // HANDS)
            right, down = place(lo, hand, lane + 1, mine), place(lo, hand + 1, lane, mine)
            both = place(lo, hand + 1, lane + 1, mine)
            for axis in range(unsigned(0), unsigned(3)):
                twist_between(
                    (unsigned(lo), right, down, both), unsigned(count), time, family.gain[h, a],
                    row(row(family.slack, h), a), row(row(row(impulse, axis), h), a),
                    w[h, a], w[h, e], w[d, a], w[d, e],
                    q[h, a, axis], q[h, e, axis], q[d, a, axis], q[d, e, axis],
                    u[h, a, axis], u[h, e, axis], u[d, a, axis], u[d, e, axis],
                )  # fmt: skip
