"""Vertices that contact has stopped, and that threads which are too long then draw on.

A limit of strain has the last word in a step: threads stay short, and what is taut around a limb is drawn into the
thickness that contact keeps free around that. Not beyond: of what it is drawn in by along the normal at which contact
has stopped it, a vertex gets back all but a share of the thickness, and in the next step contact gives it all of the
rest. A quarter is what a thread needs less than a cell of cloth's middle does, to be held off a round limb by its ends
(`garments.collared`): so no step draws a limb through. What two limbs pinch stays in the middle between them.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.contact.order import from_order, to_order
from cape.kernels.contact.shapes import MOMENT, Colliders
from cape.kernels.contact.watch import GAIN, TILE, alarm, tiles
from cape.kernels.jit import inlined, kernel, routine, unit
from cape.kernels.state import State

Array = NDArray[np.float64]

DRAWN = 0.25  # of the thickness, that threads may take at most


class Drawn(NamedTuple):
    """Whether threads are held short at all (`acts`), and by how far that has moved vertices in the last step, `by`
    (3, N) [m]; where contact has stopped them, the normal (3, N), at which `moment` (N,), and how much `room` [m] (N,)
    there is for being drawn in."""

    acts: bool
    by: Array
    normal: Array
    moment: NDArray[np.int64]
    room: Array

    @classmethod
    def blank(cls, count: int, *, acts: bool = True) -> "Drawn":
        """Of so many vertices, none of which has been stopped or moved."""
        return cls(acts, np.zeros((3, count)), np.zeros((3, count)), np.full(count, -1), np.zeros(count))


class Drawing(NamedTuple):
    """A cloth whose threads are about to be held short, or have been, and what it can't enter."""

    state: State
    drawn: Drawn
    colliders: Colliders


@inlined
def note_stopped(drawn, colliders, i, nx, ny, nz, thickness):
    """Note that vertex i is stopped at a `thickness` [m] along the normal n."""
    if drawn.acts:
        drawn.normal[0, i], drawn.normal[1, i], drawn.normal[2, i] = nx, ny, nz
        drawn.moment[i] = colliders.clock[MOMENT]
        drawn.room[i] = DRAWN * thickness


@inlined
def drawn_in(drawn, i, nx, ny, nz):
    """How far vertex i was drawn against the normal n [m]."""
    if not drawn.acts:
        return 0.0
    return max(-drawn.by[0, i] * nx - drawn.by[1, i] * ny - drawn.by[2, i] * nz, 0.0)


@unit
def begin_drawing(g, team, substep, substeps, step):
    """Note where a thread's vertices are before threads are held short."""
    s, by, lo, hi = g.state, g.drawn.by, team.lo, team.hi
    copy(s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], by[0, lo:hi], by[1, lo:hi], by[2, lo:hi])


@unit
def end_drawing(g, team, substep, substeps, step):
    """Give a thread's vertices back what they were drawn too far into limbs, and note by what they have been drawn."""
    s, by = g.state, g.drawn.by
    first, last = tiles(team.lo, team.hi)
    for tile in range(first, last):
        lo, hi = tile * TILE, min(tile * TILE + TILE, team.hi)
        farthest = find_ways(s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], by[0, lo:hi], by[1, lo:hi], by[2, lo:hi])
        if farthest == 0.0:
            continue
        give_back(s, g.drawn, g.colliders, lo, hi)
        # A tile that sleeps may have come closer to something than its speed says.
        if farthest > GAIN * step:
            alarm(g.colliders, tile, substep)


@kernel
def copy(x, y, z, px, py, pz):
    """Copy points."""
    for i in range(x.size):
        px[i], py[i], pz[i] = x[i], y[i], z[i]


@kernel
def find_ways(x, y, z, px, py, pz):
    """Replace places p by the ways from there to points [m]; returns the longest."""
    farthest = np.int64(0)
    for i in range(x.size):
        dx, dy, dz = x[i] - px[i], y[i] - py[i], z[i] - pz[i]
        px[i], py[i], pz[i] = dx, dy, dz
        farthest = max(farthest, to_order(dx * dx + dy * dy + dz * dz))
    return math.sqrt(from_order(farthest))


@routine
def give_back(s, drawn, colliders, start, end):
    """Give those of vertices start to end that contact has stopped back what they were drawn too far along the normal.

    What two limbs pinch stays where it was along that.
    """
    by, normal = drawn.by, drawn.normal
    for i in range(start, end):
        if drawn.moment[i] != colliders.clock[MOMENT]:
            continue
        nx, ny, nz = normal[0, i], normal[1, i], normal[2, i]
        along = by[0, i] * nx + by[1, i] * ny + by[2, i] * nz
        back = along if colliders.pinched[i] else min(along + drawn.room[i], 0.0)
        if back != 0.0:
            s.x[i] -= back * nx
            s.y[i] -= back * ny
            s.z[i] -= back * nz
            by[0, i] -= back * nx
            by[1, i] -= back * ny
            by[2, i] -= back * nz
