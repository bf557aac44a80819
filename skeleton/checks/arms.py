"""Arms that pass through trunk or legs, as those of a robot may that follows a narrower actor: how deep, and when."""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.bodies.roles import SIDES
from skeleton.model import Skeleton
from skeleton.shapes import Bounded, Shape
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

ALONG = 9  # places along a limb at which it is looked at
ACROSS = 5  # places along each edge of the box around a solid that is no limb


class Passage(NamedTuple):
    """A solid of an arm that is in another: how deep [m], in which one, and in which frame that is."""

    depth: float
    through: str
    frame: int


def forearm_sides(body: Skeleton) -> list[str | None]:
    """The side whose forearm each bone is or hangs from, None for all other bones."""
    return _sides_below(body, {body.bones.index(body.roles[role]): side for role, side in _known(body, "forearm")})


def passages(body: Skeleton, track: BoneTrack, solids: Sequence[Shape]) -> dict[str, Passage]:
    """Find the solids of arms, from the elbow on, that are in those of the trunk, the head or the legs in a motion.

    The depth is how far a ball within the arm's solid reaches below the other's surface, the deepest of some of those.

    Args:
        body: whose.
        track: its motion.
        solids: around its bones; others are let be.

    Returns:
        Of each such solid of an arm, by its name, where it is deepest.

    Raises:
        UnknownNameError: a bone of the body isn't in the track.
    """
    below = forearm_sides(body)
    starts = {body.rest.segment_start(role): side for role, side in _known(body, "upper_arm")}
    arms = _sides_below(body, starts)
    carried = _carried(body, solids)
    if not carried:
        return {}
    places = [track.index(bone) for bone in body.bones]
    others = [(solid, places[bone]) for solid, bone in carried if arms[bone] is None]
    found = {}
    for solid, bone in carried:
        if below[bone] is None:
            continue
        passed = [_deepest(solid, places[bone], other, at, track) for other, at in others]
        deepest = max(passed, key=lambda passage: passage.depth, default=None)
        if deepest is not None and deepest.depth > 0.0:
            found[solid.name] = deepest
    return found


def passing_arms(body: Skeleton, track: BoneTrack, solids: Sequence[Shape], *, deeper: float) -> dict[str, str]:
    """Find what cloth under the arms would be caught by: what is deeper in the body than that, and what hangs from it.

    Args:
        body: whose.
        track: its motion.
        solids: around its bones; others are let be.
        deeper: how deep arms may be in the body [m].

    Returns:
        Why, of each such solid by its name.
    """
    found = {name: passage for name, passage in passages(body, track, solids).items() if passage.depth > deeper}
    if not found:
        return {}
    reasons = {}
    bones = {solid.name: bone for solid, bone in _carried(body, solids)}
    passing = {bones[name] for name in found}
    for name, bone in bones.items():
        if name in found:
            depth, through, frame = found[name]
            reasons[name] = f"{1000.0 * depth:.0f} mm deep in {through} at frame {frame}"
        elif (above := _nearest_above(body, bone, passing)) is not None:
            reasons[name] = f"hangs from {body.bones[above]}, which passes through the body"
    return reasons


def _nearest_above(body: Skeleton, bone: int, among: Collection[int]) -> int | None:
    """The first of some bones on the way from one, itself included, to the root; None if there is none."""
    while bone >= 0 and bone not in among:
        bone = int(body.parents[bone])
    return bone if bone >= 0 else None


def _carried(body: Skeleton, solids: Sequence[Shape]) -> list[tuple[Bounded, int]]:
    """The solids that a body's bones carry, and by index which."""
    known = {*body.bones, *body.roles, *body.links}
    return [(s, body.bone(s.bone)) for s in solids if isinstance(s, Bounded) and s.bone is not None and s.bone in known]


def _known(body: Skeleton, part: str) -> list[tuple[str, str]]:
    """Roles of both sides that a body has, and their sides."""
    return [(f"{side}_{part}", side) for side in SIDES if f"{side}_{part}" in body.roles]


def _sides_below(body: Skeleton, beginnings: dict[int, str]) -> list[str | None]:
    """The side of each bone that is, or hangs from, one of those where something begins, None for all others."""
    sides: list[str | None] = []
    for bone, parent in enumerate(body.parents.tolist()):
        sides.append(beginnings.get(bone) or (sides[parent] if parent >= 0 else None))
    return sides


def _deepest(arm: Bounded, bone: int, other: Bounded, at: int, track: BoneTrack) -> Passage:
    """Where a solid on a bone is deepest in one on another; as deep as 0 where it never is."""
    (middle, reach), (center, radius) = arm.ball(), other.ball()
    there, turned = track.positions[:, at], quaternions.conjugate(track.rotations_wxyz[:, at])

    def seen(points: FloatArray, frames: NDArray[np.int64]) -> FloatArray:
        """Points (n, 3) in the arm's frame, in the other's, (frames, n, 3)."""
        world = quaternions.rotate(track.rotations_wxyz[frames, bone][:, None], points)
        world += (track.positions[frames, bone] - there[frames])[:, None]
        return quaternions.rotate(turned[frames][:, None], world)

    apart = np.linalg.norm(seen(middle[None], np.arange(track.frames))[:, 0] - center, axis=1)
    near = np.flatnonzero(apart < reach + radius)
    places = _places_in(arm)
    if not len(near) or not len(places):
        return Passage(0.0, other.name, 0)
    inside = -other.distances(seen(places, near).reshape(-1, 3)).reshape(len(near), len(places))
    depths = (inside - arm.distances(places)).max(axis=1)
    frame = int(depths.argmax())
    return Passage(max(float(depths[frame]), 0.0), other.name, int(near[frame]))


def _places_in(solid: Bounded) -> FloatArray:
    """Places within a solid, in its bone's frame [m], shape (n, 3): along the middle of a limb, else all over it."""
    capsule = solid.as_capsule()
    if capsule is not None:
        places = capsule.start + np.linspace(0.0, 1.0, ALONG)[:, None] * (capsule.end - capsule.start)
    else:
        edges = np.linspace(*solid.bounds(), ACROSS).T
        places = np.stack(np.meshgrid(*edges, indexing="ij"), axis=-1).reshape(-1, 3)
    return places[solid.distances(places) < 0.0]
