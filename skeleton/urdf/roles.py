"""Which bone of a robot plays which role, by the names of its joints, of what is fixed to them, and of its links."""

from collections import Counter
from collections.abc import Mapping

import numpy as np

from motions.bodies.roles import ROLES, SIDES, find_roles
from motions.errors import UnknownNameError
from skeleton.track import nearest_parents
from skeleton.urdf.carriers import RobotBones


def roles_of_robot(bones: RobotBones, given: Mapping[str, str]) -> dict[str, str]:
    """The bone of each role. Joints that move come first; where these lack arms, all bones' names, and links', serve.

    Args:
        bones: of the robot.
        given: bones or links for roles, which win over what is found.

    Raises:
        UnknownNameError: a role, or a bone or link, doesn't exist; lists what there is.
    """
    chosen = {role: _bone_of(name, bones) for role, name in given.items()}
    if unknown := [role for role in chosen if role not in ROLES]:
        raise UnknownNameError("role", unknown[0], ROLES)
    moving = np.flatnonzero(~bones.carriers.fixed).tolist()
    names = [bones.names[bone] for bone in moving]
    known = {role: bone for role, bone in chosen.items() if bone in names}
    found = find_roles(names, nearest_parents(bones.parents, moving).tolist(), known) | chosen
    if not all(f"{side}_upper_arm" in found for side in SIDES):
        parents = bones.parents.tolist()
        found = find_roles(bones.names, parents, chosen) | found
        found = _by_links(bones, parents, chosen) | found
    return {role: found[role] for role in ROLES if role in found}


def _bone_of(name: str, bones: RobotBones) -> str:
    bone = name if name in bones.names else bones.links.get(name)
    if bone is None:
        raise UnknownNameError("bone", name, bones.names)
    return bone


def _by_links(bones: RobotBones, parents: list[int], chosen: Mapping[str, str]) -> dict[str, str]:
    """Roles by the names of links, which may tell where those of joints don't."""
    moved: dict[str, str] = {}
    for link, bone in bones.links.items():
        moved.setdefault(bone, link)
    links = [moved.get(bone, "") for bone in bones.names]
    count = Counter(links)
    unique = [link if count[link] == 1 else f"{link} {bone}" for link, bone in zip(links, bones.names, strict=True)]
    given = {role: unique[bones.names.index(bone)] for role, bone in chosen.items()}
    return {role: bones.names[unique.index(name)] for role, name in find_roles(unique, parents, given).items()}
