"""The shape of a body apart from any motion: its bones in one typical pose, and the directions and lengths it gives."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.bodies.roles import SIDES, require_role
from motions.errors import ValueRangeError
from skeleton import proportions

FloatArray = NDArray[np.float64]

STUB = 0.25  # of the way from a head's joint to its top by proportions: a bone that is no longer only marks the joint
HAIR_LINE = 0.75  # of that way: heads' bones of many files end in the middle of the head, and would leave it no neck


@dataclass(frozen=True, eq=False)
class RestPose:
    """Bones in a typical pose, the root at the origin. All positions and directions are in the root's frame.

    The offsets of a motion file need not form a standing body, so the pose is the mean over the clip; a robot's is its
    neutral one. Which way is up, left and forward follows from the places of the limbs.

    Attributes:
        bones: names of the B bones, parents first.
        parents: index of each bone's parent, -1 for none, shape (B,).
        roles: name of the bone of each role.
        positions: origins of the bones [m], shape (B, 3).
        rotations_wxyz: unit quaternions bone_to_root, shape (B, 4).
        end_parents: bone at which each of the E end sites hangs, shape (E,).
        end_offsets: end sites in their bone's frame [m], shape (E, 3).
        single_axis: whether the bone is one of several joints in a row that together turn a limb, shape (B,).
        fixed: whether the bone is fixed to the one above it, shape (B,).
    """

    bones: tuple[str, ...]
    parents: NDArray[np.int64]
    roles: Mapping[str, str]
    positions: FloatArray
    rotations_wxyz: FloatArray
    end_parents: NDArray[np.int64]
    end_offsets: FloatArray
    single_axis: NDArray[np.bool_]
    fixed: NDArray[np.bool_]

    def bone(self, role: str) -> int:
        """Index of the bone that plays a role.

        Raises:
            UnknownNameError: there is none; lists the bones.
        """
        return self.bones.index(require_role(role, self.roles, self.bones))

    def origin(self, role: str) -> FloatArray:
        """Origin of a role's bone [m], shape (3,)."""
        return self.positions[self.bone(role)]

    def joint(self, role: str) -> FloatArray:
        """Where the segment of a limb's role starts [m], shape (3,)."""
        return self.positions[self.segment_start(role)]

    def middle(self, limb: str) -> FloatArray:
        """Half way between the joints of a limb on both sides [m], shape (3,); hips without legs by proportions."""
        if limb == "thigh" and not self.has_legs:
            drop = (proportions.SHOULDER_HEIGHT - proportions.HIP_HEIGHT) * self.height
            return self.middle("upper_arm") - drop * self.up
        return (self.joint(f"left_{limb}") + self.joint(f"right_{limb}")) / 2

    def into_bone(self, bone: int, point: FloatArray) -> FloatArray:
        """A point [m], shape (3,), seen from a bone's frame."""
        return quaternions.rotate(quaternions.conjugate(self.rotations_wxyz[bone]), point - self.positions[bone])

    def chain(self, ancestor: int, bone: int) -> list[int]:
        """Bones from an ancestor down to a bone, both included; just the bone where it isn't below the ancestor.

        What is fixed between them is left out: it moves with the one above.
        """
        way = [bone]
        while way[-1] != ancestor:
            parent = int(self.parents[way[-1]])
            if parent < 0:
                return [bone]
            way.append(parent)
        inner = [between for between in way[-2:0:-1] if not self.fixed[between]]
        return [bone] if bone == ancestor else [ancestor, *inner, bone]

    def tips(self, bone: int) -> FloatArray:
        """End sites of a bone and of the bones below, and those bones' origins [m], shape (T, 3)."""
        moving = np.flatnonzero(~self.fixed).tolist()  # what is fixed is often a sensor's place, and no tip
        below = [other for other in moving if other > bone and len(self.chain(bone, other)) > 1]
        ends = [
            self.positions[parent] + quaternions.rotate(self.rotations_wxyz[parent], offset)
            for parent, offset in zip(self.end_parents, self.end_offsets, strict=True)
            if parent == bone or parent in below
        ]
        return np.array([*self.positions[below], *ends]).reshape(-1, 3)

    @property
    def has_legs(self) -> bool:
        """Whether both legs are known; otherwise a body has hips and stature by the proportions of its arms."""
        return not missing_roles(self, LEG_ROLES)

    @property
    def up(self) -> FloatArray:
        """Unit vector from the hips to the shoulders, +Z without legs, shape (3,)."""
        if not self.has_legs:
            return np.array([0.0, 0.0, 1.0])
        return _unit(
            self.middle("upper_arm") - self.middle("thigh"), "the hips and the shoulders are at the same place"
        )

    @property
    def left(self) -> FloatArray:
        """Unit vector to the body's left, square to `up`, shape (3,)."""
        across = self.joint("left_upper_arm") - self.joint("right_upper_arm")
        return _unit(across - across @ self.up * self.up, "the left and the right shoulder are at the same place")

    @property
    def forward(self) -> FloatArray:
        """Unit vector to where the body faces, shape (3,)."""
        return np.cross(self.left, self.up)

    @property
    def shoulder_width(self) -> float:
        """Distance between the upper-arm joints [m]."""
        return float(np.linalg.norm(self.joint("left_upper_arm") - self.joint("right_upper_arm")))

    @property
    def height(self) -> float:
        """Standing height [m]: straight legs, trunk, neck and head, what bones don't tell taken from proportions."""
        if not self.has_legs:
            return self._height_by_arms
        if "head" in self.roles:
            above_hips = float(np.linalg.norm(self.vertex - self.middle("thigh")))
            return (self._leg_length + above_hips) / (1 - proportions.ANKLE_HEIGHT)
        above_hips = float(np.linalg.norm(self.middle("upper_arm") - self.middle("thigh")))
        return (self._leg_length + above_hips) / (proportions.SHOULDER_HEIGHT - proportions.ANKLE_HEIGHT)

    @property
    def vertex(self) -> FloatArray:
        """Top of the head [m], shape (3,): the end site of its bone, from proportions where there is none."""
        bone = self.bone("head")
        joint = self.positions[bone]
        below = self._leg_length + np.linalg.norm(joint - self.middle("thigh"))
        reach = proportions.HEAD_JOINT_TO_VERTEX
        reach *= below / (1 - proportions.ANKLE_HEIGHT - reach)
        ends = self.end_offsets[self.end_parents == bone]
        lengths = np.linalg.norm(ends, axis=1)
        # A stub that only marks the joint tells nothing, a bone that ends below the hair line only where it points.
        if not len(ends) or lengths.max() <= STUB * reach:
            return joint + reach * self.up
        longest = quaternions.rotate(self.rotations_wxyz[bone], ends[np.argmax(lengths)])
        return joint + longest * (reach / lengths.max() if lengths.max() < HAIR_LINE * reach else 1.0)

    @property
    def _height_by_arms(self) -> float:
        """Standing height [m] of a body whose arms are known, or at least their joints' distance."""
        arms = [(f"{side}_upper_arm", f"{side}_forearm", f"{side}_hand") for side in SIDES]
        known = [arm for arm in arms if not missing_roles(self, arm)]
        if not known:
            return self.shoulder_width / proportions.SHOULDER_JOINTS_APART
        lengths = [self.segment_length(upper) + self.segment_length(forearm) for upper, forearm, _ in known]
        return sum(lengths) / len(lengths) / proportions.ARM_LENGTH

    @property
    def _leg_length(self) -> float:
        """Hip to ankle along a straight leg, mean of both sides [m]; by proportions of a body without legs."""
        if not self.has_legs:
            return (proportions.HIP_HEIGHT - proportions.ANKLE_HEIGHT) * self.height
        legs = [self.segment_length(f"{side}_{bone}") for side in ("left", "right") for bone in ("thigh", "shin")]
        return sum(legs) / 2

    def segment_length(self, role: str) -> float:
        """Length of a limb's segment from its own joint to the next role's [m]."""
        return float(np.linalg.norm(self.origin(NEXT_ROLE[role]) - self.joint(role)))

    def segment_start(self, role: str) -> int:
        """Bone at whose origin a limb's segment starts.

        It is the role's own, except where a robot turns the limb by several joints in a row: the role is the last of
        them, and the segment starts before the longest link between them.
        """
        bone = self.bone(role)
        row = [bone]
        while self.single_axis[row[0]] and (parent := self._moving_above(row[0])) >= 0 and self._turns_limb(parent):
            row.insert(0, parent)
        links = np.linalg.norm(np.diff(self.positions[row], axis=0), axis=1)
        return row[int(np.argmax(links))] if links.size and links.max() > 0 else bone

    def _moving_above(self, bone: int) -> int:
        """The nearest bone above that isn't fixed to another, or has a role; -1 for none."""
        above = int(self.parents[bone])
        while above >= 0 and self.fixed[above] and self.bones[above] not in self.roles.values():
            above = int(self.parents[above])
        return above

    def _turns_limb(self, bone: int) -> bool:
        """Whether a bone is one of a limb's joints in a row and no part of the trunk or of the segment before."""
        if not self.single_axis[bone] or self.bones[bone] in self.roles.values():
            return False
        trunk = [self.bones.index(self.roles[role]) for role in ("chest", "pelvis") if role in self.roles]
        return not any(len(self.chain(bone, end)) > 1 for end in trunk)


FRAME_ROLES: tuple[str, ...] = tuple(f"{side}_upper_arm" for side in SIDES)
"""Roles without which a body's directions are not known."""

LEG_ROLES: tuple[str, ...] = tuple(f"{side}_{limb}" for side in SIDES for limb in ("thigh", "shin", "foot"))
"""Roles without which a body has no legs."""

NEXT_ROLE: dict[str, str] = {
    f"{side}_{role}": f"{side}_{following}"
    for side in ("left", "right")
    for role, following in (
        ("shoulder", "upper_arm"),
        ("upper_arm", "forearm"),
        ("forearm", "hand"),
        ("thigh", "shin"),
        ("shin", "foot"),
    )
}
"""The role at whose joint the segment of a limb's role ends."""


def mean_rotations(rotations_wxyz: FloatArray) -> FloatArray:
    """Mean over frames of unit quaternions, (F, J, 4) to (J, 4).

    The eigenvector of the largest eigenvalue of sum q q^T, which doesn't depend on signs (Markley et al. 2007,
    "Averaging Quaternions", eq. 12).
    """
    outer = np.einsum("fja,fjb->jab", rotations_wxyz, rotations_wxyz)
    return np.linalg.eigh(outer)[1][..., -1]


def _unit(vector: FloatArray, problem: str) -> FloatArray:
    length = np.linalg.norm(vector)
    if length < 1e-9:
        raise ValueRangeError(f"the body's directions can't be told: {problem}")
    return vector / length


def missing_roles(rest: RestPose, roles: Sequence[str]) -> list[str]:
    """Those of the roles for which the body has no bone."""
    return [role for role in roles if role not in rest.roles]
