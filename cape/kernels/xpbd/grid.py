"""XPBD on a grid cloth: long loops over neighbouring vertices that share no constraint.

Rows are dealt to three hands, row 3 k + t to hand t at its place k. The springs of one family between two hands then
link two separate arrays, vertex by vertex, over all rows at once; so do bend springs down with all three hands.
Springs along the rows link neighbours within an array, and every second of them (third, for bend springs) shares no
vertex. No index is looked up, and all loops vectorise. What would link the end of a row to the next has stiffness 0.

Threads share the places k. Three phases, between which they meet, keep each vertex with one thread:
within the rows of a place; from hand 2 to hand 0 of the next place; from hand 2 to hands 0 and 1 of the next.
"""

from cape.kernels.absent import part, row, typed
from cape.kernels.jit import driver, kernel
from cape.kernels.team import meet, share
from cape.kernels.xpbd.formulas import TINY, draw_to_middle, forget, pull_together, set_gains, unsigned


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


@driver
def grid_places(columns, vertices, team):
    """First place of this thread and the one after its last, of one place for each three rows."""
    return share(0, (vertices // columns + 2) // 3, team)


@driver
def prepare_family(family, lo, hi, step, damping):
    """Set the gains of one family of constraints on vertices lo to hi of each hand."""
    if family is not None:
        time = step if damping is None else step + damping
        for hand in range(3):
            set_gains(
                step, time, family.stiffness[hand, lo:hi], family.mobility[hand, lo:hi], family.gain[hand, lo:hi],
                part(row(family.slack, hand), lo, hi),
            )  # fmt: skip


@driver
def forget_family(family, lo, hi):
    """Set the impulses of one family on vertices lo to hi of each hand to zero; where they are kept at all."""
    if family is not None:
        forget(family.impulse, lo, hi)


@driver
def link_rows(family, shift, hand, lo, hi, other, ahead, c, step, damping):
    """Springs of one family from vertices lo to hi of a hand to those of another `ahead` + `shift` further on."""
    if family is not None:
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


@driver
def link_along(family, bends, lo, hi, c, step, damping, bend_time):
    """Springs and bend springs along the rows of all hands."""
    q, u, w = c.positions, c.velocities, c.inverse_mass
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
                    lo, bend_time, bends.gain[hand, lo:hi], part(row(bends.slack, hand), lo, hi),
                    part(row(row(bends.impulse, axis), hand), lo, hi), w[hand, lo:hi],
                    q[hand, axis, lo:hi], u[hand, axis, lo:hi],
                )  # fmt: skip


@driver
def bend_rows(bends, hand, lo, hi, middle, ahead, last, further, c, time):
    """Bend springs from vertices lo to hi of one hand over those `ahead` in the next to those `further` in the last."""
    if bends is not None:
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


@driver
def prepare_grid(c, vertices, step, damping, bend_damping, team):
    """Set all gains of this thread for a step; nothing at all where `c` is None."""
    if c is None:
        return
    first, last = grid_places(c.columns, vertices, team)
    lo, hi = first * c.columns, last * c.columns
    prepare_family(c.across, lo, hi, step, damping)
    prepare_family(c.down, lo, hi, step, damping)
    prepare_family(c.diagonal, lo, hi, step, damping)
    prepare_family(c.anti, lo, hi, step, damping)
    prepare_family(c.bend_across, lo, hi, step, bend_damping)
    prepare_family(c.bend_down, lo, hi, step, bend_damping)


@driver
def solve_grid(s, c, iterations, step, damping, bend_damping, team):
    """Change the velocities to those of the step's end, in so many sweeps; nothing at all where `c` is None."""
    if c is None:
        return
    columns = c.columns
    first, last = grid_places(columns, s.x.size, team)
    lo, hi = first * columns, last * columns
    # The last place has no next.
    end = min(hi, c.inverse_mass.shape[1] - columns)
    bend_time = step if bend_damping is None else step + bend_damping
    deal(first, last, columns, s.x, s.y, s.z, s.vx, s.vy, s.vz, c.positions, c.velocities)
    forget_family(c.across, lo, hi)
    forget_family(c.down, lo, hi)
    forget_family(c.diagonal, lo, hi)
    forget_family(c.anti, lo, hi)
    forget_family(c.bend_across, lo, hi)
    forget_family(c.bend_down, lo, hi)
    for _ in range(iterations):
        if hi > lo:
            link_along(c.across, c.bend_across, lo, hi, c, step, damping, bend_time)
            for hand in range(2):
                link_rows(c.down, 0, hand, lo, hi, hand + 1, 0, c, step, damping)
                link_rows(c.diagonal, 1, hand, lo, hi, hand + 1, 0, c, step, damping)
                link_rows(c.anti, -1, hand, lo, hi, hand + 1, 0, c, step, damping)
            bend_rows(c.bend_down, 0, lo, hi, 1, 0, 2, 0, c, bend_time)
        meet(team)
        if end > lo:
            link_rows(c.down, 0, 2, lo, end, 0, columns, c, step, damping)
            link_rows(c.diagonal, 1, 2, lo, end, 0, columns, c, step, damping)
            link_rows(c.anti, -1, 2, lo, end, 0, columns, c, step, damping)
            bend_rows(c.bend_down, 1, lo, end, 2, 0, 0, columns, c, bend_time)
        meet(team)
        if end > lo:
            bend_rows(c.bend_down, 2, lo, end, 0, columns, 1, columns, c, bend_time)
        meet(team)
    hand_back(first, last, columns, c.velocities, s.vx, s.vy, s.vz)
