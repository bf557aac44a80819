"""Which joint of a body plays which role, from the joints' names and the shape of the tree."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from motions.border import checked
from motions.errors import MissingRolesError, UnknownNameError, ValueRangeError

SIDES = ("left", "right")
LIMBS = ("shoulder", "upper_arm", "forearm", "hand", "thigh", "shin", "foot")

ROLES: tuple[str, ...] = ("pelvis", "chest", "neck", "head", *(f"{side}_{limb}" for side in SIDES for limb in LIMBS))
"""Every role. A role's joint is the one whose frame moves the segment: `left_upper_arm` sits at the shoulder,
`left_forearm` at the elbow, `left_hand` at the wrist, `left_thigh` at the hip, `left_shin` at the knee, `left_foot` at
the ankle; `left_shoulder` is the clavicle, `chest` the last joint of the spine, which carries the arms and the neck."""

# What the words of a name say about the joint, side, numbers and filler removed. Three words have two meanings, which
# only the other joints of the limb settle: "shoulder" (clavicle or upper arm), "leg" (shin or thigh) and "hip" (thigh,
# or a joint of no length before it).
_MEANINGS = {
    "neck": "neck lowerneck upperneck",
    "head": "head skull",
    "clavicle": "clavicle clavicula clav collar collarbone scapula",
    "shoulder": "shoulder",
    "upper_arm": "upperarm uparm uarm arm humerus shldr bicep",
    "forearm": "forearm lowerarm lowarm farm elbow radius ulna",
    "hand": "hand wrist",
    "hip": "hip hipjoint buttock",
    "thigh": "thigh upleg upperleg uleg femur",
    "leg": "leg",
    "shin": "shin lowerleg lowleg lleg knee calf tibia",
    "foot": "foot ankle",
}
_MEANING_OF = {word: meaning for meaning, words in _MEANINGS.items() for word in words.split()}
_SIDE_OF = {"left": "left", "l": "left", "lft": "left", "right": "right", "r": "right", "rt": "right", "rgt": "right"}
_FILLER = {"joint", "jnt", "link", "bone", "def", "bend", "stretch", "pitch", "roll", "yaw"}
_TURNS = {"pitch", "roll", "yaw"}
_HELPERS = ("twist", "roll", "helper", "pole", "corrective", "nub", "end")  # what is part of a limb, but no joint of it


@dataclass(frozen=True)
class _Name:
    """What a joint's name says.

    Attributes:
        side: "left" or "right", None for what is in the middle.
        meaning: one of `_MEANINGS`, None where it is no word of these.
        single_axis: whether it is one of a robot's serial single-axis joints.
        strange: whether nothing in it is a word of these, as in another language.
    """

    side: str | None
    meaning: str | None
    single_axis: bool
    strange: bool

    def may_be_of(self, side: str) -> bool:
        """Tell whether it may be any joint of a side's limbs."""
        return self.strange and self.side in (None, side)


@checked
def find_roles(
    joints: Sequence[str], parents: Sequence[int], overrides: Mapping[str, str] | None = None
) -> dict[str, str]:
    """Find the joint that plays each role.

    Names decide first, over the usual conventions (CMU, Mixamo, DAZ, Blender, Unreal, SMPL, Xsens, robots' URDF); the
    tree settles words of two meanings and fills gaps: `chest` and `pelvis` are where the arms and the legs meet, a
    missing `left_shoulder` is the joint between chest and upper arm, or the chest itself where nothing lies between. Of
    a body without legs the root is the pelvis.

    Args:
        joints: names of the J joints, parents first.
        parents: index of each joint's parent, -1 for a root, J of them.
        overrides: joint names given by hand, such as {"left_shoulder": "clav_L"}; they win over what would be found.

    Returns:
        Joint name of each role that was found, in the order of `ROLES`.

    Raises:
        UnknownNameError: an override's role or joint doesn't exist.
        ValueRangeError: a joint has no parent, or comes before it.
    """
    if len(parents) != len(joints) or any(not -1 <= parent < joint for joint, parent in enumerate(parents)):
        raise ValueRangeError(f"{len(joints)} joints need as many parents, each of them before its joint, -1 for none")
    tree = _Tree(joints, parents)
    given = {}
    for role, joint in (overrides or {}).items():
        if role not in ROLES:
            raise UnknownNameError("role", role, ROLES)
        if joint not in joints:
            raise UnknownNameError("bone", joint, joints)
        given[role] = joints.index(joint)
    names = _read_names(joints)
    found = dict(given)
    for side in SIDES:
        limbs = _find_arm(tree, names, side, given) | _find_leg(tree, names, side, given)
        found |= {role: joint for role, joint in limbs.items() if role not in given}
    found = _find_trunk(tree, names, found) | found
    if "chest" in found and not any(f"{side}_thigh" in found for side in SIDES):
        found.setdefault("pelvis", 0)  # what has no legs moves with its root
    for side in SIDES:
        if f"{side}_upper_arm" in found and "chest" in found:
            chest = found["chest"]
            between = tree.between(chest, found[f"{side}_upper_arm"])
            clavicles = [joint for joint in between if not names[joint].single_axis]
            found.setdefault(f"{side}_shoulder", clavicles[-1] if clavicles else chest)
    return {role: joints[found[role]] for role in ROLES if role in found}


@checked
def require_role(role: str, roles: Mapping[str, str], joints: Sequence[str]) -> str:
    """Name of the joint that plays `role`.

    Raises:
        UnknownNameError: there is no such role, or no joint was found for it; lists the joints and how to name one.
    """
    require_roles([role], roles, joints)
    return roles[role]


def require_roles(wanted: Iterable[str], roles: Mapping[str, str], joints: Sequence[str]) -> None:
    """Check that joints were found for all roles that are wanted.

    Raises:
        UnknownNameError: there is no such role, or no joint was found for some; names all of them, lists the joints
            and how to name one.
    """
    wanted = tuple(dict.fromkeys(wanted))
    if unknown := [role for role in wanted if role not in ROLES]:
        raise UnknownNameError("role", unknown[0], ROLES)
    if missing := [role for role in wanted if role not in roles]:
        raise MissingRolesError(missing, joints)


class _Tree:
    """The questions about a tree that finding roles asks."""

    def __init__(self, joints: Sequence[str], parents: Sequence[int]):
        self.parents = [int(parent) for parent in parents]
        self.children: list[list[int]] = [[] for _ in joints]
        self.heights = [1] * len(joints)
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                self.children[parent].append(joint)
        for joint in reversed(range(len(joints))):
            if (parent := self.parents[joint]) >= 0:
                self.heights[parent] = max(self.heights[parent], self.heights[joint] + 1)

    def ancestors(self, joint: int) -> list[int]:
        """The joint's parent, its parent, and so on up to a root."""
        chain = []
        while (joint := self.parents[joint]) >= 0:
            chain.append(joint)
        return chain

    def meeting(self, a: int, b: int) -> int | None:
        """The deepest joint that is above both."""
        above_b = set(self.ancestors(b))
        return next((joint for joint in self.ancestors(a) if joint in above_b), None)

    def between(self, ancestor: int, joint: int) -> list[int]:
        """The joints strictly between, from the top down."""
        above = self.ancestors(joint)
        return above[: above.index(ancestor)][::-1] if ancestor in above else []

    def next_below(self, joint: int) -> int | None:
        """The child that starts the longest way down."""
        return max(self.children[joint], key=lambda child: self.heights[child], default=None)

    def first(self, candidates: Sequence[int], names: Sequence["_Name"], below: int | None = None) -> int | None:
        """The candidate nearest to the root, or below a given joint; of a robot's serial axes the last."""
        if below is not None:
            candidates = [joint for joint in candidates if below in self.ancestors(joint)]
        if not candidates:
            return None
        top = min(candidates, key=lambda joint: len(self.ancestors(joint)))
        if names[top].single_axis:
            # Only after the last axis has turned does a joint's frame move with the whole segment.
            serial = [joint for joint in candidates if names[joint].single_axis and top in self.ancestors(joint)]
            return max(serial, key=lambda joint: len(self.ancestors(joint)), default=top)
        return top


def _words(joint: str) -> list[str]:
    """Lower-case words of a joint's name, without namespace and numbers: "mixamorig:LeftUpLeg1" is left, up, leg."""
    plain = re.split(r"[:|]", joint)[-1]
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", plain)]


def _read_names(joints: Sequence[str]) -> list[_Name]:
    """Side and meaning of every name, after taking off words that more than half of the names begin with."""
    words = [_words(joint) for joint in joints]
    while True:
        firsts = Counter(name[0] for name in words if len(name) > 1 and name[0] not in _SIDE_OF)
        common, count = max(firsts.items(), key=lambda item: item[1], default=("", 0))
        if count * 2 <= len(joints):
            break
        words = [name[1:] if len(name) > 1 and name[0] == common else name for name in words]
    return [_read_name(name) for name in words]


def _read_name(words: Sequence[str]) -> _Name:
    side = next((_SIDE_OF[word] for word in words if word in _SIDE_OF), None)
    word = "".join(word for word in words if word not in _SIDE_OF and word not in _FILLER)
    if side is None and word not in _MEANING_OF:
        # Side and word written as one: "lhumerus", "leftarm", "calfr".
        for mark, marked_side in _SIDE_OF.items():
            for bare in (word.removeprefix(mark), word.removesuffix(mark)):
                if bare != word and bare in _MEANING_OF:
                    side, word = marked_side, bare
    turns = not _TURNS.isdisjoint(words)
    strange = not turns and not any(known in word for known in (*_MEANING_OF, *_HELPERS))
    return _Name(side, _MEANING_OF.get(word), turns, strange)


def _find_arm(tree: _Tree, names: Sequence[_Name], side: str, given: Mapping[str, int]) -> dict[str, int]:
    """The joints of one arm by role, as far as they can be found."""

    def named(*meanings: str) -> list[int]:
        return [joint for joint, name in enumerate(names) if name.side == side and name.meaning in meanings]

    limb: dict[str, int | None] = {}
    upper = given.get(f"{side}_upper_arm", tree.first(named("upper_arm"), names))
    clavicle = tree.first(named("clavicle"), names)
    if upper is None:
        upper = tree.first(named("shoulder"), names)
        below = tree.first(named("forearm"), names)
        strangers = 1 if below is not None else 2
        between = _between(tree, upper, tree.first(named("hand"), names, below=upper) if below is None else below)
        if clavicle is None and len(between) == strangers and all(names[joint].may_be_of(side) for joint in between):
            clavicle, upper = upper, between[-1]  # the next one; its own name tells nothing, as in another language
    elif clavicle is None:
        above = tree.ancestors(upper)
        clavicle = tree.first([joint for joint in named("shoulder") if joint in above], names)
    if upper is None and (forearm := tree.first(named("forearm"), names)) is not None and tree.parents[forearm] >= 0:
        upper = tree.parents[forearm]
    if upper is None:
        return {}
    forearm = given.get(f"{side}_forearm", tree.first(named("forearm"), names, below=upper))
    if forearm is None:
        forearm = tree.next_below(upper)
    limb["hand"] = tree.first(named("hand"), names, below=forearm)
    limb |= {"shoulder": clavicle, "upper_arm": upper, "forearm": forearm}
    return {f"{side}_{role}": joint for role, joint in limb.items() if joint is not None}


def _between(tree: _Tree, above: int | None, below: int | None) -> list[int]:
    """The joints strictly between two of a limb, none where they are not of one limb."""
    if above is None or below is None or above not in (way := tree.ancestors(below)):
        return []
    return [joint for joint in way if above in tree.ancestors(joint)]


def _find_leg(tree: _Tree, names: Sequence[_Name], side: str, given: Mapping[str, int]) -> dict[str, int]:
    """The joints of one leg by role, as far as they can be found."""

    def named(*meanings: str) -> list[int]:
        return [joint for joint, name in enumerate(names) if name.side == side and name.meaning in meanings]

    thigh = given.get(f"{side}_thigh", tree.first(named("thigh"), names))
    shin = given.get(f"{side}_shin")
    if thigh is None:
        # "Leg" is the shin below a thigh of its own name or a hip, and the thigh above a shin of its own name.
        # Of nested hips (CMU's LHipJoint above LeftHip, a robot's three axes) the last carries the thigh.
        hip = max(named("hip"), key=lambda joint: len(tree.ancestors(joint)), default=None)
        leg = tree.first(named("leg"), names)
        has_shin = bool(named("shin"))
        thigh = leg if leg is not None and (hip is None or has_shin) else hip
        if (
            thigh == leg
            and not has_shin
            and (strange := _thigh_above(tree, names, side, leg, named("foot"))) is not None
        ):
            thigh, shin = strange, leg
    if thigh is None:
        return {}
    if shin is None:
        shin = tree.first(named("shin"), names, below=thigh)
    if shin is None:
        shin = tree.first(named("leg"), names, below=thigh)
    if shin is None:
        shin = tree.next_below(thigh)
    foot = given.get(f"{side}_foot")
    if foot is None and shin is not None:
        foot = tree.first(named("foot"), names, below=shin)
        foot = tree.next_below(shin) if foot is None else foot
    limb = {"thigh": thigh, "shin": shin, "foot": foot}
    return {f"{side}_{role}": joint for role, joint in limb.items() if joint is not None}


def _thigh_above(tree: _Tree, names: Sequence[_Name], side: str, leg: int | None, feet: Sequence[int]) -> int | None:
    """The joint above a "leg" that bears the foot and is thus the shin; None where that isn't so, or it bears both."""
    if leg is None or not any(tree.parents[foot] == leg for foot in feet):
        return None
    above = tree.parents[leg]
    if above < 0 or not names[above].may_be_of(side):
        return None
    others = [joint for joint, name in enumerate(names) if name.side not in (None, side)]
    return None if any(above in tree.ancestors(joint) for joint in others) else above


def _find_trunk(tree: _Tree, names: Sequence[_Name], limbs: Mapping[str, int]) -> dict[str, int]:
    """Pelvis and chest where the limbs meet, neck and head above the chest."""
    trunk: dict[str, int | None] = {}
    for role, limb in (("pelvis", "thigh"), ("chest", "upper_arm")):
        pair = [limbs[f"{side}_{limb}"] for side in SIDES if f"{side}_{limb}" in limbs]
        trunk[role] = tree.meeting(*pair) if len(pair) == 2 else None
    chest = limbs.get("chest", trunk["chest"])
    middle = [joint for joint, name in enumerate(names) if name.side is None]
    trunk["neck"] = tree.first([joint for joint in middle if names[joint].meaning == "neck"], names, below=chest)
    head = tree.first([joint for joint in middle if names[joint].meaning == "head"], names, below=chest)
    if chest is not None and head is None:
        arms = {limbs[f"{side}_upper_arm"] for side in SIDES if f"{side}_upper_arm" in limbs}
        carrying_arms = {joint for arm in arms for joint in (arm, *tree.ancestors(arm))}
        free = [child for child in tree.children[chest] if child not in carrying_arms]
        head = max(free, key=lambda child: tree.heights[child], default=None)
        while head is not None and (below := tree.next_below(head)) is not None:
            head = below
    trunk["head"] = head
    if chest is not None and head is not None and trunk["neck"] is None:
        trunk["neck"] = next(iter(tree.between(chest, head)), None)
    return {role: joint for role, joint in trunk.items() if joint is not None}
