"""How a frame is taken: once, and again in shorter steps where that did not go well."""

import math
from typing import NamedTuple

from cape.kernels.bones import Motion
from cape.run.hanging import Hanging
from cape.run.whereabouts import Diverged, Moment

RETRIES = 4  # each at half the step or less
CONVERGENCE_RETRIES = 2  # after which a step that did not converge is kept, and counted
WHIRL_RETRIES = 3  # after which one that whirls is kept
DRAWING = 6  # times as many steps as usual, that are taken where a limit of strain is not kept
MOST_HASTE = 8.0  # times as many steps as usual, that are taken for thin colliders that come by fast


class Taken(NamedTuple):
    """How a frame went: whether it exploded at first, was taken in shorter steps for another reason, or for one that
    is trouble, and whether it did not converge in those either; see `Simulation`."""

    exploded: bool
    refined: bool
    troubled: bool
    unconverged: bool


def take_frame(cloth: Hanging, motion: Motion, dt: float, substeps: int, before: Moment, *, fixed: bool) -> Taken:
    """Advance a cloth by a frame, at half the step while it explodes, a few times at most if it whirls or does not
    converge.

    Args:
        cloth: what is advanced.
        motion: of its bones.
        dt: of the frame [s].
        substeps: to begin with.
        before: the moment before it.
        fixed: whether so many were asked for.

    Raises:
        Diverged: it explodes at any step.
    """
    exploded, refined, troubled = False, False, False
    for attempt in range(RETRIES + 1):
        unconverged, sound = cloth.complete(motion, dt, substeps, before)
        if attempt == 0 and sound and not fixed:
            needed, drawing = _needed_substeps(cloth, substeps, dt)
            if max(needed, drawing) > substeps:
                refined = needed > substeps
                cloth.restore(before)
                substeps = max(needed, drawing)
                unconverged, sound = cloth.complete(motion, dt, substeps, before)
        if sound and cloth.limit.torn():
            # No limit can be kept: threads are to share out by their stiffness what limbs draw them to.
            cloth.restore(before)
            cloth.limit.acts = False
            unconverged, sound = cloth.complete(motion, dt, substeps, before)
        patience = WHIRL_RETRIES if cloth.whirls() else CONVERGENCE_RETRIES if unconverged else 0
        if sound and attempt >= patience:
            cloth.limit.rest()
            cloth.note_lift(dt)
            converged = unconverged == 0
            return Taken(exploded, refined and converged, troubled and converged, not converged)
        exploded, refined, troubled = exploded or not sound, refined or sound, troubled or sound
        if attempt < RETRIES:
            cloth.restore(before)
            # A count between what explodes and what is stable may grow slowly enough to pass for sound.
            substeps = max(2 * substeps, cloth.own_choice(dt, strained=True))
    raise diverged(substeps)


def _needed_substeps(cloth: Hanging, substeps: int, dt: float) -> tuple[int, int]:
    """Substeps that a frame of `dt` [s] would have needed, seen after taking it in fewer; and for its threads."""
    needed = math.ceil(substeps * min(cloth.haste, MOST_HASTE))
    if cloth.strained:
        needed = max(needed, cloth.choose_substeps(dt, strained=True))
    return needed, DRAWING * substeps if cloth.limit.too_long() else substeps


def diverged(substeps: int) -> Diverged:
    """The error of a cloth that explodes at so many substeps."""
    return Diverged(
        f"the cloth explodes even at {substeps} substeps per frame: "
        "use a softer or heavier fabric, a wider spacing, or another solver (xpbd, tr_bdf2)"
    )
