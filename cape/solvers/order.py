"""What happens in a frame, and in what order: the same for all solvers but for their own integration.

A frame begins with the bones (`begin_frame`). In each substep the solver's units move the cloth; then (`end_substep`)

1. the journal notes where that has led;
2. touching layers of cloth press on each other;
3. tethers draw in what is too far from where bones hold the cloth, and what is confined stays where it may be;
4. colliders keep triangles out, then vertices;
5. bones put the vertices that they hold hard where they belong;
6. layers of the cloth are kept apart;
7. the journal notes that, and threads are kept from stretching too far;
8. what slides along curves is put onto these;
9. the journal notes where that has led.

What a scene lacks is not in the list. A solver may have 4 to 6, and the limit of strain, act on a copy of its state in
single precision, for which they are compiled as for the others: see `kernels.solve.rounding`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import GridCloth
from cape.cloth.split_grid import SplitGrid
from cape.forces.base import Acting, Force
from cape.kernels.bones import MovingBones, begin_motion, move_on
from cape.kernels.cloth.grid import GridRoom
from cape.kernels.cloth.stream import Blowing, blow_on
from cape.kernels.contact.contact import Contact
from cape.kernels.contact.drawn import Drawing, begin_drawing, end_drawing
from cape.kernels.contact.faces import FaceContact
from cape.kernels.contact.units import (
    FirstLook,
    Nearby,
    find_nearby,
    keep_faces_out,
    keep_out,
    wake_faces,
    watch_tiles,
)
from cape.kernels.linking import Linker
from cape.kernels.program import Nothing, Use, wait_for_all
from cape.kernels.self_contact.self_contact import (
    Ahead,
    Layered,
    Pressed,
    Searched,
    keep_apart,
    look_ahead,
    press,
    search_pairs,
)
from cape.kernels.solve.attachments import Held, hold_attached
from cape.kernels.solve.confine import Confining, keep_in_front, keep_near
from cape.kernels.solve.journal import (
    Noting,
    NotingForces,
    NotingGoals,
    note_end,
    note_first_goals,
    note_goals,
    note_integrated,
    note_pressed,
    note_unlimited,
)
from cape.kernels.solve.lift import Lifted, lift_attached
from cape.kernels.solve.link_limit import LimitedLinks, limit_links
from cape.kernels.solve.rounding import Rounded, RoundedPlaces, add_changes, round_places, round_state
from cape.kernels.solve.slide import Sliding, slide
from cape.kernels.solve.soft import Aiming, aim_pull
from cape.kernels.solve.strain_limit import Limited, limit_across, limit_down
from cape.kernels.solve.tethers import Tethered, keep_tethered
from cape.kernels.tearing.limit import LimitedStrays, limit_strays
from cape.solvers.running import Thread

ROUNDS = 2  # over threads that have split off a grid and those left in it, which draw on each other, in a substep


class Order(NamedTuple):
    """Units in the order in which they are called: once at a frame's start, and in each of its substeps."""

    begin: list[Use]
    substep: list[Use]


def wait(thread: Thread) -> list[Use]:
    """Wait for the other threads, if there are any."""
    return [Use(wait_for_all, Nothing())] if thread.size > 1 else []


def forces(thread: Thread, kinds: Sequence[type[Force]], out: NDArray[np.floating], room: GridRoom | None) -> list[Use]:
    """Compute some forces into `out` (3, N) [N]."""
    running = thread.running
    acting = Acting(running.assembly, running.state, out, room)
    return [use for force in kinds for use in force.uses(acting, running.arrays.forces[force])]


def blow(thread: Thread, at: float) -> list[Use]:
    """Bring the wind to a share of the substep; nothing where it is everywhere and always alike."""
    stream = thread.running.assembly.stream
    return [] if stream is None else [Use(blow_on, Blowing(stream, at))]


def begin_frame(thread: Thread) -> list[Use]:
    """Start the motion of the bones, see what the cloth may meet, and lift what bones hold out of colliders."""
    running, contacts, bones = thread.running, thread.contacts, thread.bones
    motion, duration = running.motion, running.duration
    start = Use(begin_motion, MovingBones(motion, bones, duration))
    uses = [start]
    if contacts.colliders is not None:
        rounding = _round(thread)
        uses += [*rounding, *(wait(thread) if rounding else [])]
        uses.append(Use(find_nearby, Nearby(running.corrected, contacts.colliders, bones, duration)))
        if contacts.faces is not None and thread.is_first:
            uses.append(Use(wake_faces, contacts.faces))
        uses += wait(thread)
    attached, ties = running.assembly.attached, running.assembly.ties
    if attached is not None and ties is not None:
        if thread.is_first:
            uses += [Use(lift_attached, Lifted(attached, ties, contacts.colliders, motion, bones, duration)), start]
        uses += wait(thread)
    uses += aim_springs(thread, 0.0)
    pull, journal = running.assembly.pull, thread.journal
    if pull is not None and journal is not None:
        uses.append(Use(note_first_goals, NotingGoals(pull, journal)))
    return uses


def move_bones(thread: Thread) -> list[Use]:
    """Move the bones on by a substep, and with them what springs hold the cloth at."""
    moving = MovingBones(thread.running.motion, thread.bones, thread.running.duration)
    return [Use(move_on, moving), *aim_springs(thread, 1.0)]


def aim_springs(thread: Thread, at: float) -> list[Use]:
    """Set the goals of springs that hold the cloth to where the bones are, which is at a share of the step."""
    return [Use(aim_pull, Aiming(pull, thread.bones, at)) for pull in thread.running.assembly.pulls]


def end_substep(
    thread: Thread,
    linker: Linker,
    *,
    pressing: bool = True,
    holding: bool = False,
    earlier: NDArray[np.floating] | None = None,
    share: float = 1.0,
    force: NDArray[np.floating] | None = None,
) -> list[Use]:
    """All that follows a solver's own integration.

    Args:
        thread: who does it.
        linker: makes programs within programs.
        pressing: whether forces between layers act here, rather than within the integration.
        holding: whether attached vertices are put in place here, rather than within the integration.
        earlier: positions at the step's start [m] (at least 3, N), None where they are x - step v.
        share: of the colliders' thickness that is kept.
        force: of contact within the integration [N] (3, N), None for none.
    """
    running, contacts, assembly = thread.running, thread.contacts, thread.running.assembly
    uses = []
    if thread.journal is not None:
        uses.append(Use(note_integrated, Noting(running.state, thread.journal)))
        if assembly.pull is not None:
            uses.append(Use(note_goals, NotingGoals(assembly.pull, thread.journal)))
        if not pressing:
            uses.append(Use(note_pressed, NotingForces(thread.journal, force, contacts.pressure)))
    if contacts.pressure is not None and pressing:
        uses.append(Use(press, Pressed(running.state, contacts.pressure)))
    if assembly.tethers is not None and assembly.attached is not None:
        anchors = np.zeros((assembly.attached.vertices.size, 6))
        uses.append(
            Use(keep_tethered, Tethered(running.state, assembly.attached, assembly.tethers, thread.bones, anchors))
        )
    uses += _confine(thread)
    uses += _correct(thread, _stop(thread, linker, earlier, share, holding=holding))
    limiting = _limit_strain(thread)
    if limiting and thread.journal is not None:
        uses.append(Use(note_unlimited, Noting(running.state, thread.journal)))
    uses += _correct(thread, limiting)
    if assembly.rails is not None:
        uses.append(Use(slide, Sliding(running.state, assembly.rails, thread.bones)))
    if thread.journal is not None:
        uses.append(Use(note_end, Noting(running.state, thread.journal)))
    return uses


def _correct(thread: Thread, uses: list[Use]) -> list[Use]:
    """Have units act that correct a state, on what the solver has them correct."""
    running = thread.running
    if not uses or running.corrected is running.state:
        return uses
    return [*_round(thread), *uses, Use(add_changes, Rounded(running.state, running.corrected))]


def _round(thread: Thread) -> list[Use]:
    """Make the copy of a thread's vertices that is corrected; nothing where that is the state itself."""
    running = thread.running
    if running.corrected is running.state:
        return []
    return [Use(round_state, Rounded(running.state, running.corrected))]


def _stop(
    thread: Thread, linker: Linker, earlier: NDArray[np.floating] | None, share: float, *, holding: bool
) -> list[Use]:
    """Keep what is corrected out of colliders, held, and its layers apart; the arguments are those of `end_substep`."""
    running, contacts = thread.running, thread.contacts
    assembly, state, uses = running.assembly, running.corrected, []
    uses += _keep_out(thread, earlier, share)
    if assembly.attached is not None and holding:
        uses.append(Use(hold_attached, Held(state, assembly.attached, thread.bones)))
    if contacts.layers is not None:
        uses += wait(thread)
        if thread.is_first:
            look = Use(look_ahead, Ahead(state, contacts.layers.sight.places, contacts.layers.pressure.clock))
            search = Use(search_pairs, Searched(contacts.layers, assembly.inverse_mass))
            layered = Layered(state, contacts.layers, running.inverse_mass, linker.program([look, search]))
            uses.append(Use(keep_apart, layered))
        uses += wait(thread)
    return uses


def _limit_strain(thread: Thread) -> list[Use]:
    """Keep threads from stretching too far, and out of limbs in the end: those along a grid's columns, then those along
    its rows, or those of a mesh as one thread of the team sees to them."""
    running, cloth, colliders = thread.running, thread.running.assembly.cloth, thread.contacts.colliders
    limiting = wait(thread)
    if running.longest is not None and isinstance(cloth, GridCloth):
        whole = cloth.whole if isinstance(cloth, SplitGrid) else cloth
        limited = Limited(running.corrected, running.inverse_mass, running.longest, whole.rows, whole.columns)
        within = [Use(limit_down, limited), *wait(thread), Use(limit_across, limited)]
        strays = _limit_strays(thread)
        limiting += within if not strays else [*(use for _ in range(ROUNDS) for use in (*strays, *within)), *strays]
    elif running.links is None:
        return []
    elif thread.is_first:
        limiting.append(Use(limit_links, LimitedLinks(running.corrected, running.inverse_mass, running.links)))
    limiting += wait(thread)
    if colliders is None:
        return limiting
    drawing = Drawing(running.corrected, running.drawn, colliders)
    return [Use(begin_drawing, drawing), *limiting, Use(end_drawing, drawing)]


def _limit_strays(thread: Thread) -> list[Use]:
    """Keep threads short that lead to what has split off a grid, as one thread of the team sees to them."""
    running = thread.running
    if running.strays is None:
        return []
    limited = LimitedLinks(running.corrected, running.inverse_mass, running.strays.links)
    strays = LimitedStrays(limited, running.strays.counts)
    return [*wait(thread), *([Use(limit_strays, strays)] if thread.is_first else []), *wait(thread)]


def _confine(thread: Thread) -> list[Use]:
    """Keep vertices near where bones would carry them, then out of the spheres behind that."""
    running, confined = thread.running, thread.running.assembly.confined
    if confined is None:
        return []
    confining = Confining(running.state, running.arrays.inertia.inverse_mass, confined, thread.bones)
    uses = []
    if np.isfinite(confined.most).any():
        uses.append(Use(keep_near, confining))
    if np.isfinite(confined.behind).any():
        uses.append(Use(keep_in_front, confining))
    return uses


def _keep_out(thread: Thread, earlier: NDArray[np.floating] | None, share: float) -> list[Use]:
    """Keep triangles, then vertices, out of all colliders; one thread looks after all triangles."""
    running, contacts = thread.running, thread.contacts
    colliders, faces = contacts.colliders, contacts.faces
    if colliders is None:
        return []
    state, straight, uses = running.corrected, earlier is None, []
    if earlier is None:
        earlier = np.zeros((1, 1), state.x.dtype)
    elif running.earlier is not None:
        uses.append(Use(round_places, RoundedPlaces(earlier, running.earlier)))
        earlier = running.earlier
    contact = Contact(
        state, running.inverse_mass, contacts.free, earlier, straight, colliders, thread.bones, share,
        contacts.settled, running.drawn,
    )  # fmt: skip
    uses.append(Use(watch_tiles, Nearby(state, colliders, thread.bones, running.duration)))
    if faces is not None:
        uses += [Use(keep_out, FirstLook(contact, True)), *wait(thread)]
        if thread.is_first:
            uses.append(Use(keep_faces_out, FaceContact(contact, faces)))
        uses += wait(thread)
    return [*uses, Use(keep_out, FirstLook(contact, False))]
