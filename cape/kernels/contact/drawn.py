"""Vertices that contact has stopped, and that threads which are too long then draw on.

A limit of strain has the last word in a step: threads stay short, and what is taut around a limb is drawn into the
thickness that contact keeps free around that. Not beyond: of what it is drawn in by along the normal at which contact
has stopped it, a vertex gets back all but a share of the thickness, and in the next step contact gives it all of the
rest. So a limb is never pulled through the cloth, however the two disagree. What two limbs pinch is not drawn out of
the middle between them at all.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.contact.shapes import MOMENT, Colliders
from cape.kernels.contact.watch import GAIN, TILE, alarm, tiles
from cape.kernels.jit import inlined, routine, unit
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
    s, by = g.state, g.drawn.by
    for i in range(team.lo, team.hi):
        by[0, i], by[1, i], by[2, i] = s.x[i], s.y[i], s.z[i]


@unit
def end_drawing(g, team, substep, substeps, step):
    """Give a thread's vertices back what they were drawn too far into limbs, and note by what they have been drawn."""
    first, last = tiles(team.lo, team.hi)
    for tile in range(first, last):
        start, end = tile * TILE, min(tile * TILE + TILE, team.hi)
        # A tile that sleeps may have come closer to something than its speed says.
        if give_back(g.state, g.drawn, g.colliders, start, end) > GAIN * step:
            alarm(g.colliders, tile, substep)


@routine
def give_back(s, drawn, colliders, start, end):
    """The same for vertices start to end; tells how far they have been drawn at most [m]."""
    by, normal, farthest = drawn.by, drawn.normal, 0.0
    for i in range(start, end):
        x, y, z = s.x[i] - by[0, i], s.y[i] - by[1, i], s.z[i] - by[2, i]
        if x == 0.0 and y == 0.0 and z == 0.0:
            by[0, i], by[1, i], by[2, i] = 0.0, 0.0, 0.0
            continue
        if drawn.moment[i] == colliders.clock[MOMENT]:
            nx, ny, nz = normal[0, i], normal[1, i], normal[2, i]
            along = x * nx + y * ny + z * nz
            back = along if colliders.pinched[i] else min(along + drawn.room[i], 0.0)
            if back != 0.0:
                x, y, z = x - back * nx, y - back * ny, z - back * nz
                s.x[i], s.y[i], s.z[i] = by[0, i] + x, by[1, i] + y, by[2, i] + z
        by[0, i], by[1, i], by[2, i] = x, y, z
        farthest = max(farthest, x * x + y * y + z * z)
    return math.sqrt(farthest)
