"""A character's own cape: cut to its measures, held by its shoulders, kept out by its limbs and its floor."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cape.cloth.cloth import Cloth
from cape.cloth.fabric import Fabric
from cape.scene.attachments import attach
from cape.scene.colliders import Collider
from cape.scene.floor import floor_under
from cape.scene.scene import WEARER_ROLES, Scene
from cape.scene.wind import Wind
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    from skeleton.model import Skeleton

LENGTH = 0.62  # of the body's height: from the shoulders to the middle of the shins
SPACING = 0.0137  # of the body's height
# Skeletons place shoulder joints anywhere from the neck's side to the deltoid; a cape is cut to a plausible width.
NARROWEST, WIDEST = 0.19, 0.26  # of the body's height


def dress(
    body: "Skeleton",
    track: BoneTrack,
    *,
    length: float | None = None,
    flare: float = 2.0,
    spacing: float | None = None,
    fabric: Fabric | None = None,
    colliders: Sequence[Collider] | None = None,
    wind: Wind | None = None,
) -> Scene:
    """Cut a cape for a body and build the scene in which it wears it.

    Args:
        body: the character.
        track: its motion, of all bones.
        length: of the cape [m]; None for 0.62 of the body's height.
        flare: length of the hem divided by that of the neckline.
        spacing: mean distance of neighbouring vertices [m]; None for 0.0137 of the body's height, about 1,500 vertices.
        fabric: None for that of `Fabric()`.
        colliders: what surrounds its limbs; None for capsules by the proportions of the human body.
        wind: the air; None for still air.

    Raises:
        ValueRangeError: a size is out of range.
        UnknownNameError: the body has no shoulders, upper arms or pelvis that are known by name.
    """
    height = body.height()
    cloth = Cloth.cape(
        length=LENGTH * height if length is None else length,
        flare=flare,
        spacing=SPACING * height if spacing is None else spacing,
        shoulder_width=float(np.clip(body.shoulder_width(), NARROWEST * height, WIDEST * height)),
        fabric=fabric,
    )
    shoulders = [attach(cloth, f"{side}_shoulder", f"top_{side}") for side in ("left", "right")]
    for role in (*(a.bone for a in shoulders), *WEARER_ROLES):
        body.role(role)  # says how to name a bone by hand where none is found
    colliders = body.capsules() if colliders is None else tuple(colliders)
    scene = Scene(
        cloth,
        shoulders,
        (*colliders, floor_under(colliders, track)),
        wind=wind or Wind(),
        wearer=(_beginning(body, WEARER_ROLES[0]), _beginning(body, WEARER_ROLES[1]), WEARER_ROLES[2]),
    )
    for bone in scene.bones:
        track.index(bone)
    return scene


def _beginning(body: "Skeleton", role: str) -> str:
    """The bone at which a limb begins: its role, or of a robot that turns it by several joints the first of them."""
    bone = body.bones[body.rest.segment_start(role)]
    return role if bone == body.role(role) else bone
