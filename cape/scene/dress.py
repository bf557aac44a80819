"""A character's own garment: cut to its measures, held by its bones, kept out by its limbs and its floor."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cape.air.wind import Wind
from cape.cloth.fabric import Fabric
from cape.garments import registry
from cape.garments.base import Measures, Worn
from cape.garments.fitting import Fitted
from cape.scene.colliders import Collider, Plane
from cape.scene.floor import floor_under
from cape.scene.holding.attachments import Attachment, attach
from cape.scene.holding.confinement import confine
from cape.scene.scene import WEARER_ROLES, Scene
from cape.scene.self_contact import SelfContact
from cape.scene.stance import room_on_all_fours
from cape.scene.tearing import Tearing
from motions.border import checked_first
from motions.errors import ValueRangeError
from skeleton import proportions
from skeleton.checks.arms import passing_arms
from skeleton.rest import FRAME_ROLES
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    from skeleton.model import Skeleton


@checked_first
def dress(
    body: "Skeleton",
    track: BoneTrack,
    *,
    garment: str = registry.DEFAULT,
    garments: Sequence[str] | None = None,
    length: float | None = None,
    flare: float | None = None,
    spacing: float | None = None,
    fabric: Fabric | Mapping[str, Fabric] | None = None,
    colliders: Sequence[Collider] | None = None,
    wind: Wind | None = None,
    self_contact: bool | SelfContact | None = None,
    strain_limit: bool | None = None,
    hold: Mapping[str, str] | None = None,
    tearing: Tearing | None = None,
    under_arms: bool | None = None,
) -> Scene:
    """Cut a cape for a body and build the scene in which it wears it.

    Args:
        body: the character.
        track: its motion, of all bones.
        garment: which of `GARMENTS`.
        garments: several of them in its place, worn together, the outermost first: they meet each other as layers of
            one cloth (`cape.outfits`). Length, flare and hold are then those of the outermost.
        length: of the garment [m], down from where it is held; None for its own, as 0.62 of the body's height, or
            as much as there is room above the floor for a body that goes on all fours throughout. A sash has none but
            that which it takes around the body.
        flare: length of the hem divided by that of the neckline, or of the waist, or of the ring around the shoulders
            where the garment lies on them; None for the garment's own.
        spacing: mean distance of neighbouring vertices [m]; None for the garment's own, as 0.0137 of the body's height.
        fabric: of what is worn, or of each garment by its name, as {"cloak": ..., "skirt": ...}; None, and for garments
            that are not named, that of `Fabric()`.
        colliders: what surrounds its limbs; None for capsules by the proportions of the human body.
        wind: the air; None for still air.
        self_contact: whether, or how, layers of the cape are kept from passing through each other; None where the
            garment falls in folds whose layers meet.
        hold: bones, by name or role, that hold parts of the garment where it is put on, by the names of its regions, as
            {"collar": "neck"}: in place of the bone that does by itself, if any. What another part already holds stays.
        strain_limit: whether threads stop stretching at the limits of their fabric; None for unless they may part.
        tearing: when the cloth parts; None for never.
        under_arms: whether arms that pass through trunk or legs, as a robot's may, are left out of the colliders from
            where they do on, as there is no place for cloth in between; None where arms hang over all that is worn.

    Raises:
        ValueRangeError: a size is out of range, garments can't be worn over each other, or a fabric is given for
            what is not worn.
        UnknownNameError: there is no such garment, it has no such region, or the body no such bone; or it has no
            shoulders, upper arms, chest, pelvis or head, as far as the garment needs them, that are known by name.
    """
    if garments is not None:
        from cape.outfits.dressing import dress_in

        return dress_in(
            body, track, garments, length=length, flare=flare, spacing=spacing, fabric=fabric, colliders=colliders,
            wind=wind, self_contact=self_contact, strain_limit=strain_limit, hold=hold, tearing=tearing,
            under_arms=under_arms,
        )  # fmt: skip
    kind = registry.garment(garment)
    body.require_roles((*WEARER_ROLES, *FRAME_ROLES))
    colliders = body.capsules() if colliders is None else tuple(colliders)
    fitted = Fitted(body, colliders)
    floor = floor_of(body, colliders, track)
    room = _room(body, track, colliders, floor) if length is None else None
    own = fabric_of_each(fabric, [garment])[garment]
    worn = kind.fit(fitted, Measures(length=length, flare=flare, spacing=spacing, fabric=own, room=room))
    hold = hold or {}
    worn = worn._replace(holds=tuple(own for own in worn.holds if own.region not in hold))
    for bone in hold.values():
        body.bone(bone)
    body.require_roles((*(own.bone for own in worn.holds), *(kept.bone for kept in worn.kept)))
    thickness = Scene.thickness if worn.thickness is None else worn.thickness
    under_arms = kind.under_arms if under_arms is None else under_arms
    left_out = passing_arms(body, track, colliders if under_arms else (), deeper=thickness)
    scene = Scene(
        worn.cloth,
        _attachments(worn, hold),
        (*(collider for collider in colliders if collider.name not in left_out), floor),
        wind=wind or Wind(),
        self_contact=self_contact_of(worn.layered if self_contact is None else self_contact),
        thickness=thickness,
        confinements=[confine(worn.cloth, k.bone, k.vertices, max_distance=k.most) for k in worn.kept],
        strain_limit=(tearing is None if strain_limit is None else strain_limit) and worn.cloth.has_threads,
        tearing=tearing,
        wearer=(beginning_of(body, WEARER_ROLES[0]), beginning_of(body, WEARER_ROLES[1]), WEARER_ROLES[2]),
        left_out=left_out,
    )
    for bone in scene.bones:
        track.index(bone)
    if worn.put_on is None:
        return scene
    pose = zip(*worn.put_on.pose(scene.bones), strict=True)
    return replace(scene, dressing=dict(zip(scene.bones, pose, strict=True)))


def fabric_of_each(
    fabric: Fabric | Mapping[str, Fabric] | None, garments: Sequence[str]
) -> Mapping[str, Fabric | None]:
    """The fabric of each of some garments, None for the usual one.

    Raises:
        ValueRangeError: one is given for what is not among them.
    """
    if not isinstance(fabric, Mapping):
        return dict.fromkeys(garments, fabric)
    for name in fabric:
        if name not in garments:
            raise ValueRangeError(f"a fabric is given for the {name}, but worn is: {', '.join(garments)}")
    return {name: fabric.get(name) for name in garments}


def _room(body: "Skeleton", track: BoneTrack, colliders: Sequence[Collider], floor: Plane) -> float | None:
    """How long a cape may be above the floor [m], of a body that goes on all fours throughout the whole motion."""
    room = room_on_all_fours(track, float(floor.point[2]))
    if room is None or body.whole is None:
        return room
    whole = body.track(body.whole)
    return room_on_all_fours(whole, float(floor_of(body, colliders, whole).point[2]))


def _attachments(worn: Worn, hold: Mapping[str, str]) -> list[Attachment]:
    """What holds a garment: its own holds, then those asked for, of vertices that nothing before holds.

    Raises:
        UnknownNameError: the garment has no such region.
    """
    found = [
        attach(
            worn.cloth,
            h.bone if h.half is None else (h.bone, h.half),
            h.region,
            points=h.points,
            stiffness=h.stiffness,
        )
        for h in worn.holds
    ]
    for region, bone in hold.items():
        free = np.setdiff1d(worn.cloth.region(region), [i for before in found for i in before.vertices])
        if len(free):
            found.append(attach(worn.cloth, bone, free))
    return found


def floor_of(body: "Skeleton", colliders: Sequence[Collider], track: BoneTrack) -> Plane:
    """The floor under a motion: of a body without legs no higher than they would reach."""
    floor = floor_under(colliders, track)
    if body.rest.has_legs:
        return floor
    shoulders = track.positions[:, [track.index(role) for role in FRAME_ROLES], 2]
    below = float(np.median(shoulders)) - proportions.SHOULDER_HEIGHT * body.rest.height
    return replace(floor, point=np.array([0.0, 0.0, min(below, float(floor.point[2]))]))


def self_contact_of(asked: bool | SelfContact) -> SelfContact | None:
    """How layers are kept apart: as asked, or by default where only that is asked for."""
    return asked if isinstance(asked, SelfContact) else SelfContact() if asked else None


def beginning_of(body: "Skeleton", role: str) -> str:
    """The bone at which a limb begins: its role, or of a robot that turns it by several joints the first of them."""
    bone = body.bones[body.rest.segment_start(role)]
    return role if bone == body.role(role) else bone
