"""What every solver does in a frame besides its own integration: the bones' motion, contact, attachments."""

from numba import literal_unroll

from cape.kernels.bones import start_motion
from cape.kernels.contact.contact import collide
from cape.kernels.contact.faces import collide_faces
from cape.kernels.contact.shapes import MOMENT
from cape.kernels.contact.watch import NEVER, begin, is_due, measure_tiles
from cape.kernels.jit import driver, inlined
from cape.kernels.solve.attachments import lift_held
from cape.kernels.team import is_first, meet


@driver
def begin_frame(lo, hi, s, attached, groups, faces, motion, m, duration, substeps, team):
    """Start the motion of the bones, see which colliders the cloth may meet, and lift what bones hold out of them."""
    start_motion(motion, m, duration, substeps)
    if groups is not None:
        for shapes in literal_unroll(groups):
            begin(lo, hi, s, shapes, m, duration)
    if faces is not None:
        for group in literal_unroll(faces):
            group.next[:] = 0
            group.due[:] = 0
            group.wake[:] = 0
            group.haste[:] = 0.0
            group.pushed[:] = NEVER
    if groups is not None:
        meet(team)
    if attached is not None:
        lift_held(lo, hi, attached, groups, motion, m, duration)
        start_motion(motion, m, duration, substeps)


@inlined
def keep_out(lo, hi, s, inverse_mass, earlier, free, groups, faces, m, share, turn, step, team):
    """Keep triangles, then the `free` ones of vertices lo to hi, out of all colliders, which `m` has moved.

    `groups` and `faces` are those of `Contacts`; the other arguments are those of `contact.collide`. One thread looks
    after all triangles, whose corners may be any thread's. Vertices come last: what a triangle needs leaves none of its
    corners inside of anything.
    """
    if groups is not None:
        measure_tiles(lo, hi, s, groups[0].spreads, turn, step)
        for shapes in literal_unroll(groups):
            shapes.clock[MOMENT] += 1
            # At first nothing tells yet which triangles may sleep.
            if faces is not None and turn == 0:
                collide(lo, hi, free, s, earlier, shapes, m, share, turn, step)
    done = faces is not None and turn == 0
    if faces is not None:
        meet(team)
        if is_first(team):
            for group in literal_unroll(faces):
                collide_faces(s, inverse_mass, earlier, group, m, share, turn, step)
        meet(team)
        for group in literal_unroll(faces):
            done = done and group.pushed[0] != turn
    if groups is not None and not done:
        for shapes in literal_unroll(groups):
            if is_due(shapes, turn):
                collide(lo, hi, free, s, earlier, shapes, m, share, turn, step)
