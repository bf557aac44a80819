"""How frames are taken, those of putting a cloth on first: once, and again in shorter steps where that went ill."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.putting_on import touches
from cape.kernels.bones import Motion
from cape.run.hanging import Hanging
from cape.run.whereabouts import Diverged, Moment
from cape.scene.poses import Pose

RETRIES = 4  # each at half the step or less
CONVERGENCE_RETRIES = 2  # after which a step that did not converge is kept, and counted
WHIRL_RETRIES = 3  # after which one that whirls is kept
DRAWING = 6  # times as many steps as usual, that are taken where a limit of strain is not kept
MOST_HASTE = 8.0  # times as many steps as usual, that are taken for thin colliders that come by fast

SETTLING_FRAME = 1.0 / 60.0  # s
PUT_ON_TIME = 0.8  # s in which what bones hold moves from where it starts to where it is worn
DRESSED_TIME = 0.5, 1.5  # s at which bones leave the pose in which the cloth is put on, and have reached the first one
MOST_RESTED = 12  # frames of settling that explode in any steps, before it is given up
SETTLING_TIME = 3.2  # s at most, from the start
SETTLED_SPEED = 0.02  # m/s, root mean square over the vertices
SETTLING_DAMPING = 0.9  # share of the velocity that is left after each frame of settling

FloatArray = NDArray[np.float64]


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
    exploded, refined, troubled, lasting = False, False, False, 0
    end = Pose(motion.position1, motion.rotation1)
    for attempt in range(RETRIES + 1):
        unconverged, sound = cloth.complete(motion, dt, substeps, before)
        if attempt == 0 and sound and not fixed:
            excess = cloth.limit.excess()
            drawn = cloth.limit.is_too_much(excess) or cloth.slips.begin(cloth.limit.long(), end)
            needed, drawing = _needed_substeps(cloth, substeps, dt), DRAWING * substeps if drawn else substeps
            lasting = before.lasting + 1 if excess > 0.0 else 0
            if max(needed, drawing) > substeps:
                refined = needed > substeps
                cloth.restore(before)
                substeps = max(needed, drawing)
                unconverged, sound = cloth.complete(motion, dt, substeps, before)
        # Only now: in long steps limbs go through what they only push along in shorter ones.
        if attempt == 0 and sound and cloth.slips.begin(cloth.limit.long(), end):
            before = before._replace(slips=cloth.slips.of_vertices.copy())
            cloth.restore(before)
            unconverged, sound = cloth.complete(motion, dt, substeps, before)
        if sound and cloth.limit.torn():
            # No limit can be kept: threads are to share out by their stiffness what limbs draw them to.
            cloth.restore(before)
            cloth.limit.acts = False
            unconverged, sound = cloth.complete(motion, dt, substeps, before)
        patience = WHIRL_RETRIES if cloth.whirls() else CONVERGENCE_RETRIES if unconverged else 0
        if sound and attempt >= patience:
            cloth.limit.rest(lambda points: touches(cloth.assembly.scene, end, points))
            cloth.limit.lasting = lasting
            cloth.slips.go_on(cloth.limit.long, end)
            cloth.note_lift(dt)
            converged = unconverged == 0
            return Taken(exploded, refined and converged, troubled and converged, not converged)
        exploded, refined, troubled = exploded or not sound, refined or sound, troubled or sound
        if attempt < RETRIES:
            cloth.restore(before)
            # A count between what explodes and what is stable may grow slowly enough to pass for sound.
            substeps = max(2 * substeps, cloth.own_choice(dt, strained=True))
    raise diverged(substeps)


def bring_to_rest(cloth: Hanging, duration: float | None, velocity: FloatArray) -> None:
    """Bring a cloth to rest on bones that stand still, moving what they hold to where it is worn.

    For `duration` [s], None for as long as it needs where there is anything to move; the air comes as if the bones
    moved at `velocity` [m/s].
    """
    dressed = cloth.assembly.scene.dressing is not None
    if duration is None:
        moves = any(not np.array_equal(worn, spread) for _, worn, spread in cloth.ways)
        duration = SETTLING_TIME if dressed or moves else 0.0
    wind = cloth.assembly.wind  # which stays zero in a stream
    wind -= velocity if cloth.assembly.stream is None else 0.0
    leave, arrive = DRESSED_TIME if dressed else (0.0, PUT_ON_TIME)
    if dressed and duration < arrive:
        leave, arrive = leave * duration / arrive, duration
    begin, end = cloth.pose, cloth.first
    substeps = max(cloth.choose_substeps(SETTLING_FRAME), cloth.own_choice(SETTLING_FRAME))
    rested = 0
    for frame in range(1, round(duration / SETTLING_FRAME) + 1):
        now = frame * SETTLING_FRAME
        share = min(now / PUT_ON_TIME, 1.0)
        share = share * share * (3.0 - 2.0 * share)
        cloth.lead(share)
        share = min(max((now - leave) / (arrive - leave), 0.0), 1.0) if dressed else 1.0
        pose = begin.towards(end, share * share * (3.0 - 2.0 * share)) if share < 1.0 else end
        cloth.blow(pose, 0.0, against=velocity)
        rested += _settle_frame(cloth, Motion(*cloth.pose, *pose), substeps)
        if rested > MOST_RESTED:
            raise diverged(substeps)
        cloth.pose = pose
        cloth.note_lift(SETTLING_FRAME)
        for component in cloth.state[3:]:
            component *= SETTLING_DAMPING
        speed = np.sqrt(sum(float(np.mean(np.square(c, dtype=float))) for c in cloth.state[3:]))
        if now > 1.5 * arrive and speed < SETTLED_SPEED:
            break
    for attached, worn, _ in cloth.ways:
        attached.points[:] = worn
    if cloth.pose is not end and dressed:
        cloth.carry(end)  # there was no time to move
    cloth.aim()
    wind += velocity if cloth.assembly.stream is None else 0.0


def _settle_frame(cloth: Hanging, motion: Motion, substeps: int) -> bool:
    """Advance a frame of settling, in shorter steps while it explodes or whirls: limbs may pinch the cloth.

    Tells whether the cloth had to rest for it, since it explodes in any.
    """
    before = cloth.moment()
    for _ in range(RETRIES):
        if cloth.complete(motion, SETTLING_FRAME, substeps, before)[1] and not cloth.whirls():
            return False
        cloth.restore(before)
        substeps = max(2 * substeps, cloth.own_choice(SETTLING_FRAME, strained=True))
    if cloth.complete(motion, SETTLING_FRAME, substeps, before)[1]:
        return False
    cloth.restore(before)
    for component in cloth.state[3:]:
        component[:] = 0.0
    return True


def _needed_substeps(cloth: Hanging, substeps: int, dt: float) -> int:
    """Substeps that a frame of `dt` [s] would have needed, seen after taking it in fewer."""
    needed = math.ceil(substeps * min(cloth.haste, MOST_HASTE))
    return max(needed, cloth.choose_substeps(dt, strained=True)) if cloth.strained else needed


def diverged(substeps: int) -> Diverged:
    """The error of a cloth that explodes at so many substeps."""
    return Diverged(
        f"the cloth explodes even at {substeps} substeps per frame: "
        "use a softer or heavier fabric, a wider spacing, or another solver (xpbd, tr_bdf2)"
    )
