"""Contact with colliders as pieces of a frame."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.bones import MotionRoom
from cape.kernels.contact.contact import Contact, collide
from cape.kernels.contact.faces import collide_faces
from cape.kernels.contact.shapes import MOMENT, Colliders
from cape.kernels.contact.watch import NEVER, begin, is_due, measure_tiles
from cape.kernels.jit import unit
from cape.kernels.state import State


class Nearby(NamedTuple):
    """A cloth, and what it may meet in a frame of `duration` (1,) [s]."""

    state: State
    colliders: Colliders
    bones: MotionRoom
    duration: NDArray[np.float64]


class FirstLook(NamedTuple):
    """Contact, and whether it is made in the first substep alone."""

    contact: Contact
    first_only: bool


@unit
def find_nearby(g, team, substep, substeps, step):
    """Note which colliders the cloth may meet within the frame."""
    begin(team.lo, team.hi, g.state, g.colliders, g.bones, g.duration[0])


@unit
def wake_faces(g, team, substep, substeps, step):
    """Let no triangle sleep that the last frame knew to be safe."""
    g.next[:] = 0
    g.due[:] = 0
    g.wake[:] = 0
    g.haste[:] = 0.0
    g.pushed[:] = NEVER


@unit
def watch_tiles(g, team, substep, substeps, step):
    """Note that the bones have moved, and how large tiles of vertices are."""
    measure_tiles(team.lo, team.hi, g.state, g.colliders.spreads, substep, step)
    g.colliders.clock[MOMENT] += 1


@unit
def note_motion(g, team, substep, substeps, step):
    """Note that the bones have moved, and with them the colliders."""
    g.clock[MOMENT] += 1


@unit
def keep_out(g, team, substep, substeps, step):
    """Keep vertices out of all colliders.

    They come after triangles: what a triangle needs leaves none of its corners inside of anything.
    """
    contact = g.contact
    if g.first_only:
        # At first nothing tells yet which triangles may sleep.
        if substep == 0:
            collide(contact, team.lo, team.hi, substep, step)
    elif contact.settled[0] != substep and is_due(contact.colliders, substep):
        collide(contact, team.lo, team.hi, substep, step)


@unit
def keep_faces_out(g, team, substep, substeps, step):
    """Keep triangles, whose corners may be any thread's, out of thin colliders; one thread does it for all."""
    collide_faces(g, substep, step)
    untouched = substep == 0 and g.faces.pushed[0] != substep
    g.contact.settled[0] = substep if untouched else NEVER
