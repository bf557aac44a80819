"""A cloth that was modelled on a body, worn by it: placed on the body as it stood for it, and held by its bones."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cape.air.wind import Wind
from cape.assembly.putting_on import wearer_to_world
from cape.cloth.cloth import MeshCloth
from cape.cloth.triangle_mesh import check_mesh, edges_of
from cape.garments.fitting import CLEARANCE, COARSEST, Fitted, room_between
from cape.meshes.holding import attachments, by_the_shoulders
from cape.meshes.letting_out import let_out
from cape.meshes.posing import modelled_arms
from cape.scene.colliders import Collider
from cape.scene.dress import beginning_of, floor_of, self_contact_of
from cape.scene.scene import WEARER_ROLES, Scene
from cape.scene.self_contact import SelfContact
from motions import quaternions
from motions.border import checked_first
from motions.errors import ValueRangeError
from skeleton import proportions
from skeleton.solid_measures import signed_distance
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    from skeleton.model import Skeleton

FloatArray = NDArray[np.float64]

SMALLEST, LARGEST = 0.02, 3.0  # of the body's height: extent of what it may wear


@checked_first
def wear(
    cloth: MeshCloth,
    body: "Skeleton",
    track: BoneTrack,
    *,
    hold: Mapping[str, str] | None = None,
    place: str | None = None,
    arms: float | None = None,
    colliders: Sequence[Collider] | None = None,
    wind: Wind | None = None,
    self_contact: bool | SelfContact | None = None,
) -> Scene:
    """Build the scene in which a body wears a cloth of any shape.

    The cloth is modelled on the body as it stands with straight legs and stretched arms: x forward, y left, z up, the
    origin on the ground below its hips. Where the body as it is known here is thicker, the cloth is let out, and has no
    tension so. It is put on there; then the body goes to where its motion begins and takes
    the cloth along, which settles before the first frame. Skinning it there by its nearest bones was tried: it tears
    at a cape over the shoulders as arms go down, which then was stretched by 320 % where this stretches it by 7 %.

    Args:
        cloth: the cloth, such as `Cloth.load` reads it.
        body: the character.
        track: its motion, of all bones.
        hold: bones, by name or role, by what they hold: a region's name, the path of an image over the texture
            coordinates, which holds where it is bright, or a distance from the bone's limb [m] as text. None to have
            the top edge held by the shoulders.
        place: the bone, by name or role, in whose frame the cloth is modelled; None for on the ground.
        arms: angle between the arms and the direction down the trunk in the pose it is modelled on [degrees], 90 in a T
            pose; None for the widest at which they do not pass through the cloth.
        colliders: what surrounds the body's limbs; None for capsules by the proportions of the human body.
        wind: the air; None for still air.
        self_contact: whether, or how, its layers are kept from passing through each other; None for not.

    Raises:
        UnknownNameError: there is no such region or bone, or the body lacks legs, shoulders, upper arms or a pelvis
            that are known by name.
        ValueRangeError: the cloth is out of proportion to the body, closed without a hold, or has a part without one.
        FileError: an image can't be read.
    """
    if arms is not None and not 0.0 <= arms <= 180.0:
        raise ValueRangeError(f"the arms of the pose a cloth is modelled on are at 0 to 180 degrees, not {arms}")
    colliders = body.capsules() if colliders is None else tuple(colliders)
    height = body.height()
    extent = float(np.ptp(cloth.positions, axis=0).max())
    if not SMALLEST * height <= extent <= LARGEST * height:
        raise ValueRangeError(
            f"the cloth is {extent:.3g} m across and the body {height:.2f} m tall: positions are in metres; "
            "scale it to the body"
        )
    hold = hold or {}
    for bone in (*hold.values(), *(() if place is None else (place,))):
        body.bone(bone)
    body.require_roles(WEARER_ROLES)
    fitted = Fitted(body, colliders, standing=True)
    if arms is None:
        arms = modelled_arms(_in_wearers_frame(cloth.positions, fitted, place), cloth.faces, fitted)
    fitted = fitted.with_arms(float(np.radians(arms)))
    modelled = _in_wearers_frame(cloth.positions, fitted, place)
    if (spacing := _spacing(cloth)) > COARSEST * height:
        raise ValueRangeError(
            f"the cloth's edges of {spacing:.3g} m are too long to go around a body {height:.2f} m tall: "
            "remesh it to a spacing, such as 0.03 m"
        )
    thickness = room_between(spacing, height)
    fitting = let_out(modelled, cloth.faces, fitted, thickness + CLEARANCE)
    corners = check_mesh(fitting, cloth.faces).corners
    worn = replace(cloth, positions=fitting, rest=None, corners=corners, frame="wearer")
    if hold:
        distances = {bone: _from_limb(modelled, bone, fitted, colliders) for bone in hold.values()}
        holds = attachments(worn, hold, distances)
    else:
        holds = by_the_shoulders(worn, modelled, fitted.carrier("left"), fitted.carrier("right"), fitted.shoulder_width)
    scene = Scene(
        worn,
        holds,
        (*colliders, floor_of(body, colliders, track)),
        wind=wind or Wind(),
        self_contact=self_contact_of(bool(self_contact) if self_contact is None else self_contact),
        thickness=thickness,
        wearer=(beginning_of(body, WEARER_ROLES[0]), beginning_of(body, WEARER_ROLES[1]), WEARER_ROLES[2]),
    )
    for bone in scene.bones:
        track.index(bone)
    pose = zip(*fitted.pose(scene.bones), strict=True)
    return replace(scene, cloth=_seen_by_bones(worn, fitted, scene), dressing=dict(zip(scene.bones, pose, strict=True)))


def _in_wearers_frame(points: FloatArray, fitted: Fitted, place: str | None) -> FloatArray:
    """Points as they were modelled, between the shoulders as origin [m], shape (V, 3)."""
    if place is not None:
        origins, turns = fitted.pose([place])
        return origins[0] + quaternions.rotate(turns[0], points)
    if fitted.has_feet:
        ankles = fitted.pose(["left_foot", "right_foot"])[0][:, 2]
        ground = float(ankles.mean()) - proportions.ANKLE_HEIGHT * fitted.height
    else:
        ground = -proportions.SHOULDER_HEIGHT * fitted.height
    return points + np.array([fitted.hips[0], fitted.hips[1], ground])


def _seen_by_bones(cloth: MeshCloth, fitted: Fitted, scene: Scene) -> MeshCloth:
    """The same in the wearer's frame as a scene's bones give it, by the pelvis rather than by both hips."""
    rotation, origin = wearer_to_world(*fitted.pose(scene.wearer)[0])
    return replace(cloth, positions=(cloth.positions - origin) @ rotation)


def _from_limb(points: FloatArray, bone: str, fitted: Fitted, colliders: Sequence[Collider]) -> FloatArray:
    """How far points of the wearer's frame are from a bone's limb, or from its origin where it has none [m], (V,)."""
    in_bone = fitted.into_bone(bone, points)
    index = fitted.bone(bone)
    own = [solid for solid in colliders if solid.bone is not None and fitted.bone(solid.bone) == index]
    if not own:
        return np.linalg.norm(in_bone, axis=1)
    return np.min([signed_distance(solid, in_bone) for solid in own], axis=0)


def _spacing(cloth: MeshCloth) -> float:
    """Median length of a cloth's edges as it is modelled [m]."""
    ends = cloth.positions[edges_of(cloth.faces).vertices]
    return float(np.median(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)))
