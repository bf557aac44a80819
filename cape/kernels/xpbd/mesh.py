"""XPBD on any mesh: constraints by colour, no two of one colour sharing a vertex, on vertices packed for a step.

Threads share each colour and meet after it. Springs, and the edges of a membrane, are solved `LANES` at once, a
membrane's at a third of what they cost one by one; patches of bend springs vertex by vertex.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.absent import part, typed
from cape.kernels.fused import fused
from cape.kernels.jit import inlined, kernel, routine, unit
from cape.kernels.state import State
from cape.kernels.team import meet, share
from cape.kernels.xpbd.bending import BendConstraints, bend_patches
from cape.kernels.xpbd.formulas import TINY, Constraints, bend_time, forget, pulled, set_gains
from cape.kernels.xpbd.membrane import MembraneConstraints, forget_membrane, stretch_membrane
from cape.kernels.xpbd.packed import HALF, LANES, NEXT, VX, VY, VZ, W, X, Y, Z, fetch, pack, put_back, unpack

Array = NDArray[np.floating]


class SpringConstraints(NamedTuple):
    """Springs between two vertices each, sorted by colour and filled up to whole blocks of `LANES`; each colour goes
    from its block in `starts` to the next. `ends` (B, 2 LANES): first ends, then second ends; `stretch` is flat,
    B LANES long."""

    ends: NDArray[np.uint32]
    starts: NDArray[np.int64]
    stretch: Constraints


@routine
def lay_springs(pairs, stiffness, rest, weights, places, ends, laid):
    """Lay out springs in blocks, as `SpringConstraints` has them, from their vertices (E, 2), stiffness [N/m], lengths
    at rest [m], and the inverse masses of all vertices [1/kg]; -1 in `places` (B, LANES) is for none.

    `laid` (3, B LANES) is stiffness, length at rest, and mobility [1/kg], all zero.
    """
    lanes = places.shape[1]
    for block in range(places.shape[0]):
        for lane in range(lanes):
            k, place = places[block, lane], block * lanes + lane
            if k < 0:
                ends[block, lane] = ends[block, lanes + lane] = weights.size
                continue
            a, b = pairs[k, 0], pairs[k, 1]
            ends[block, lane], ends[block, lanes + lane] = a, b
            laid[0, place], laid[1, place], laid[2, place] = stiffness[k], rest[k], weights[a] + weights[b]


class MeshConstraints(NamedTuple):
    """Constraints of a mesh: springs or a membrane, None for the other, and patches of bend springs or None. Room:
    `packed` for its vertices, `rows` (threads, n) for those of a block."""

    springs: SpringConstraints | None
    membrane: MembraneConstraints | None
    bends: BendConstraints | None
    packed: Array
    rows: Array


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
    prepare_bends(c.bends, typed(step, s.x), typed(g.bend_damping, s.x), team)
    meet(team)


@unit
def solve_mesh(g, team, substep, substeps, step):
    """Change the velocities to those of the step's end, in so many sweeps."""
    s, c, lo, hi = g.state, g.constraints, team.lo, team.hi
    h, tau = typed(step, s.x), typed(g.damping, s.x)
    time = bend_time(h, typed(g.bend_damping, s.x))
    pack(lo, hi, g.inverse_mass, s.x, s.y, s.z, s.vx, s.vy, s.vz, c.packed)
    forget_springs(c.springs, team)
    forget_membrane(c.membrane, team)
    forget_bends(c.bends, team)
    meet(team)
    for _ in range(g.iterations):
        stretch_colours(c.springs, h, tau, c.packed, c.rows[team.rank], team)
        stretch_membrane(c.membrane, h, tau, c.packed, c.rows[team.rank], team)
        bend_patches(c.bends, time, c.packed, team)
    unpack(lo, hi, c.packed, s.vx, s.vy, s.vz)


@kernel
def stretch_blocks(lo, hi, ends, step, damping, tiny, gain, rest, slack, impulse, packed, rows):
    """Solve the springs of blocks lo to hi."""
    for block in range(lo, hi):
        for k in range(2):
            for lane in range(0, LANES, HALF):
                fetch(packed, ends[block], LANES * k + lane, rows, NEXT * k + lane)
        solve_springs(np.uint64(LANES * block), step, damping, tiny, gain, rest, slack, impulse, rows)
        for k in range(2):
            for lane in range(0, LANES, HALF):
                put_back(packed, ends[block], LANES * k + lane, rows, NEXT * k + lane)


@inlined
def solve_springs(first, step, damping, tiny, gain, rest, slack, impulse, rows):
    """Solve the springs of a block, whose ends have been fetched."""
    for lane in range(LANES):
        i, j = lane, NEXT + lane
        ax, ay, az, bx, by, bz = rows[VX + i], rows[VY + i], rows[VZ + i], rows[VX + j], rows[VY + j], rows[VZ + j]
        ux, uy, uz = bx - ax, by - ay, bz - az
        dx, dy, dz = (
            fused(step, ux, rows[X + j] - rows[X + i]),
            fused(step, uy, rows[Y + j] - rows[Y + i]),
            fused(step, uz, rows[Z + j] - rows[Z + i]),
        )
        scale = pulled(first + np.uint64(lane), dx, dy, dz, ux, uy, uz, damping, tiny, gain, rest, slack, impulse)
        a, b = scale * rows[W + i], scale * rows[W + j]
        rows[VX + i], rows[VY + i], rows[VZ + i] = fused(a, dx, ax), fused(a, dy, ay), fused(a, dz, az)
        rows[VX + j], rows[VY + j], rows[VZ + j] = fused(-b, dx, bx), fused(-b, dy, by), fused(-b, dz, bz)


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
def prepare_bends(bends, step, damping, team):
    """Set this thread's share of the bend springs' gains."""
    if bends is not None:
        prepare_list(bends.bend, step, damping, team)


@routine
def forget_bends(bends, team):
    """Set this thread's share of the bend springs' impulses to zero, where they are kept at all."""
    if bends is not None:
        forget_list(bends.bend, team)


@routine
def stretch_colours(c, step, damping, packed, rows, team):
    """Go through all springs, if there are any, colour by colour; `rows` is this thread's own room."""
    if c is not None:
        springs = c.stretch
        for colour in range(c.starts.size - 1):
            lo, hi = share(c.starts[colour], c.starts[colour + 1], team)
            stretch_blocks(
                lo, hi, c.ends, step, damping, typed(TINY, packed), springs.gain, springs.rest, springs.slack,
                springs.impulse, packed, rows,
            )  # fmt: skip
            meet(team)
