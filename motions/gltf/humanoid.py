"""Who is who among the nodes of a VRM file, as it says itself: version 0 and version 1 (vrm-c/vrm-specification)."""

from typing import Any

from motions.bodies.roles import ROLES
from motions.gltf.document import Document

_LIMBS = {"Shoulder": "shoulder", "UpperArm": "upper_arm", "LowerArm": "forearm", "Hand": "hand"} | {
    "UpperLeg": "thigh", "LowerLeg": "shin", "Foot": "foot",
}  # fmt: skip
_ROLE_OF = {"hips": "pelvis", "neck": "neck", "head": "head"} | {
    f"{side}{limb}": f"{side}_{role}" for side in ("left", "right") for limb, role in _LIMBS.items()
}
_CHESTS = ("upperChest", "chest", "spine")  # the highest that there is carries arms and neck


def roles_of_file(document: Document) -> dict[str, int]:
    """The node of each role that the file names, empty for a file that is no VRM."""
    bones = human_bones(document)
    found = {role: bones[bone] for bone, role in _ROLE_OF.items() if bone in bones}
    chest = next((bones[bone] for bone in _CHESTS if bone in bones), None)
    if chest is not None:
        found["chest"] = chest
    return {role: found[role] for role in ROLES if role in found}


def human_bones(document: Document) -> dict[str, int]:
    """The node of each bone by VRM's name for it, empty for a file that is no VRM and no VRM animation."""
    nodes, found = len(document.list_of("nodes")), _bones(document.top.get("extensions", {}))
    return {bone: node for bone, node in found.items() if isinstance(node, int) and 0 <= node < nodes}


def _bones(extensions: dict[str, Any]) -> dict[str, Any]:
    for kind in ("VRMC_vrm", "VRMC_vrm_animation"):
        if (one := extensions.get(kind)) is not None:
            return {bone: each.get("node") for bone, each in one["humanoid"]["humanBones"].items()}
    if (zero := extensions.get("VRM")) is not None:
        return {each["bone"]: each.get("node") for each in zero["humanoid"]["humanBones"]}
    return {}
