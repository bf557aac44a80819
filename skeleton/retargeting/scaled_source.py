"""What a robot should do to move as a clip does: the clip's body scaled to the robot, as places and directions.

The scaled source has the robot's own lengths and the source's directions, from the joints' positions in each frame:

- The middle of the hips is the source's times s, the ratio of the robot's leg to the source's. Heights are counted from
  the source's standing ankle, and the robot's standing ankle is put there, so a foot that stands does so on z = 0.
- The hips lie on the source's hip line, as far apart as the robot's.
- The ankle is the source's as seen from its hip, times s. The knee bends to the same side, between the robot's thigh
  and shin.
- The line from the middle of the hips to the middle of the shoulders, the shoulder line, upper arms and forearms point
  where the source's do.
- Pelvis, chest, head and soles are turned as the source's are, apart from how either body holds them on average: a
  clip's typical pose and a robot's neutral one count as the same. Soles are level on average where the source's feet
  stand.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.bodies.roles import SIDES
from motions.clip import Clip
from motions.errors import ValueRangeError
from skeleton.model import Skeleton
from skeleton.rest import FRAME_ROLES, LEG_ROLES, RestPose
from skeleton.retargeting.foot_contacts import standing_frames, standing_height

FloatArray = NDArray[np.float64]

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class ScaledSource:
    """A clip's motion on a robot's scale, over F frames.

    Attributes:
        points: wanted places by role [m], shape (F, 3) each: "pelvis" is the middle of the hips; "left_upper_arm" the
            shoulder, "left_forearm" the elbow, "left_hand" the wrist; "left_thigh" the hip, "left_shin" the knee,
            "left_foot" the ankle.
        rotations: wanted axes (forward, left, up) of "pelvis", "chest", "head" and the feet by role, body_to_world
            wxyz, shape (F, 4) each; the body's own axes in the typical pose, the sole's for the feet.
        directions: unit vectors along the hands by role, shape (F, 3) each.
        stands: whether the foot of a side stands, shape (F,) each.
        scale: the robot's leg over the source's.
    """

    points: dict[str, FloatArray]
    rotations: dict[str, FloatArray]
    directions: dict[str, FloatArray]
    stands: dict[str, NDArray[np.bool_]]
    scale: float


def scaled_source(
    clip: Clip, robot: Skeleton, ankle_height: float, *, roles: Mapping[str, str] | None = None
) -> ScaledSource:
    """The motion of a clip on the scale of a robot.

    Args:
        clip: a motion of a body with legs and arms.
        robot: whose lengths it gets.
        ankle_height: of the robot above its soles, where it stands [m].
        roles: joint names for the clip's roles that aren't found or are found wrongly.

    Raises:
        UnknownNameError: a shoulder or a part of a leg has no joint in the clip or in the robot, or an override's role
            or joint doesn't exist.
        ValueRangeError: a leg of the source has no length.
    """
    source = _Source(clip, roles)
    rest = robot.rest
    thigh, shin = _length(rest, "thigh", "shin"), _length(rest, "shin", "foot")
    if source.leg <= 0.0:
        raise ValueRangeError(f"the legs of the clip {clip.name!r} have no length")
    scale = (thigh + shin) / source.leg
    points = {"pelvis": scale * (source.middle("thigh") - source.floor * _UP) + ankle_height * _UP}
    _set_apart(points, points["pelvis"], source, rest, "thigh")
    trunk = float(np.linalg.norm(rest.middle("upper_arm") - rest.middle("thigh")))
    shoulders = points["pelvis"] + trunk * _unit(source.middle("upper_arm") - source.middle("thigh"))
    _set_apart(points, shoulders, source, rest, "upper_arm")
    for side in SIDES:
        hip, foot = points[f"{side}_thigh"], f"{side}_foot"
        points[foot] = hip + scale * source.between(f"{side}_thigh", foot)
        bend = source.at(f"{side}_shin") - source.at(f"{side}_thigh")
        points[f"{side}_shin"] = bent_joint(hip, points[foot], bend, thigh, shin)
        for upper, lower in (("upper_arm", "forearm"), ("forearm", "hand")):
            if f"{side}_{upper}" in points and source.has(rest, f"{side}_{lower}"):
                along = _unit(source.between(f"{side}_{upper}", f"{side}_{lower}"))
                points[f"{side}_{lower}"] = points[f"{side}_{upper}"] + _length(rest, upper, lower) * along
    rotations = {role: source.body_axes(role) for role in ("pelvis", "chest", "head") if source.has(rest, role)}
    rotations |= {f"{side}_foot": source.sole_axes(f"{side}_foot") for side in SIDES}
    directions = {hand: source.hand_direction(hand) for hand in ("left_hand", "right_hand") if hand in points}
    return ScaledSource(points, rotations, directions, source.stands, scale)


def bent_joint(start: FloatArray, end: FloatArray, towards: FloatArray, upper: float, lower: float) -> FloatArray:
    """The knee between a hip and an ankle [m], shape (F, 3), by the law of cosines.

    An ankle farther away than the leg is long leaves the leg straight.

    Args:
        start: the hip [m], shape (F, 3).
        end: the ankle [m], shape (F, 3).
        towards: to the side of this direction from the hip the knee bends, shape (F, 3); straight where it has none.
        upper: length of the thigh [m].
        lower: length of the shin [m].
    """
    line = end - start
    distance = np.maximum(np.linalg.norm(line, axis=-1, keepdims=True), 1e-9)
    down = line / distance
    along = np.clip((upper**2 - lower**2 + distance**2) / (2.0 * distance), -upper, upper)
    across = towards - np.sum(towards * down, axis=-1, keepdims=True) * down
    return start + along * down + np.sqrt(np.maximum(upper**2 - along**2, 0.0)) * _unit(across)


def body_axes(rest: RestPose, role: str) -> FloatArray:
    """Axes (forward, left, up) of a body in its rest pose, body_to_root wxyz, shape (4,).

    Up leads from the hips to the shoulders. For the pelvis left leads from hip to hip, for all else from shoulder to
    shoulder.
    """
    limb = "thigh" if role == "pelvis" else "upper_arm"
    across = rest.joint(f"left_{limb}") - rest.joint(f"right_{limb}")
    left = _unit(across - across @ rest.up * rest.up)
    return quaternions.from_matrix(np.stack([np.cross(left, rest.up), left, rest.up], axis=-1))


def standing_axes(rest: RestPose) -> FloatArray:
    """Axes (forward, left, up) of a robot that stands level in its rest pose, up along +Z, body_to_root, shape (4,)."""
    return _level_axes(rest.forward)


def target_point(rest: RestPose, role: str) -> tuple[int, FloatArray]:
    """Bone of a robot that carries a role's place, and that place in the rest pose [m], shape (3,).

    A limb's place is where its segment starts; that of a hand and a foot is the bone's origin, where the segment before
    ends; that of the pelvis is the middle of the hips.
    """
    if role == "pelvis":
        return rest.bone(role), rest.middle("thigh")
    starts = role.endswith(("_upper_arm", "_forearm", "_thigh", "_shin"))
    bone = rest.segment_start(role) if starts else rest.bone(role)
    return bone, rest.positions[bone]


class _Source:
    """The joints of a clip by role."""

    def __init__(self, clip: Clip, roles: Mapping[str, str] | None):
        body = Skeleton.from_clip(clip, roles=roles)
        body.require_roles(("pelvis", *FRAME_ROLES, *LEG_ROLES))
        self.rest = body.rest
        self.roles = body.roles
        self.clip = clip
        self.positions, self.rotations = clip.world_poses()
        self.leg = float(
            sum(
                np.median(np.linalg.norm(self.between(f"{side}_{upper}", f"{side}_{lower}"), axis=1))
                for side in SIDES
                for upper, lower in (("thigh", "shin"), ("shin", "foot"))
            )
            / 2.0
        )
        ankles = np.stack([self.at(f"{side}_foot") for side in SIDES])
        self.floor = standing_height(ankles, self.leg, clip.fps)
        self.stands = {
            side: standing_frames(ankle, self.floor, self.leg, clip.fps)
            for side, ankle in zip(SIDES, ankles, strict=True)
        }

    def has(self, robot: RestPose, role: str) -> bool:
        """Whether both bodies have a bone for a role."""
        return role in self.roles and role in robot.roles

    def at(self, role: str) -> FloatArray:
        """Places of a role's joint [m], shape (F, 3)."""
        return self.positions[:, self.rest.bone(role)]

    def between(self, start: str, end: str) -> FloatArray:
        """From one role's joint to another's [m], shape (F, 3)."""
        return self.at(end) - self.at(start)

    def middle(self, limb: str) -> FloatArray:
        """Half way between the joints of a limb on both sides [m], shape (F, 3)."""
        return (self.at(f"left_{limb}") + self.at(f"right_{limb}")) / 2.0

    def body_axes(self, role: str) -> FloatArray:
        """Axes (forward, left, up) that turn with a role's bone, the body's in the typical pose, shape (F, 4)."""
        bone = self.rest.bone(role)
        to_bone = quaternions.conjugate(self.rest.rotations_wxyz[bone])
        into_bone = quaternions.multiply(to_bone, body_axes(self.rest, role))
        return quaternions.multiply(self.rotations[:, bone], into_bone)

    def sole_axes(self, role: str) -> FloatArray:
        """Axes (forward, left, up) that turn with a foot and are level on average where it stands, shape (F, 4)."""
        bone = self.rest.bone(role)
        ahead = self._beyond(bone)
        if not np.linalg.norm(ahead, axis=1).min() > 0.0:
            ahead = quaternions.rotate(self.body_axes("pelvis"), np.array([1.0, 0.0, 0.0]))
        stands = self.stands[role.removesuffix("_foot")]
        frames = np.flatnonzero(stands) if stands.any() else np.arange(self.clip.frames)
        to_world = self.rotations[frames, bone]
        level = quaternions.multiply(quaternions.conjugate(to_world), _level_axes(ahead[frames]))
        # Quaternions of opposite signs are the same rotation: all are brought to the side of the first.
        same_side = np.where(level @ level[0] < 0.0, -1.0, 1.0)[:, None]
        return quaternions.multiply(self.rotations[:, bone], quaternions.normalize((same_side * level).sum(axis=0)))

    def hand_direction(self, role: str) -> FloatArray:
        """Unit vectors along a hand, of the forearm where the hand has no length, shape (F, 3)."""
        ahead = self._beyond(self.rest.bone(role))
        forearm = self.between(role.replace("hand", "forearm"), role)
        has_length = np.linalg.norm(ahead, axis=1, keepdims=True) > 1e-3 * np.linalg.norm(
            forearm, axis=1, keepdims=True
        )
        return _unit(np.where(has_length, ahead, forearm))

    def _beyond(self, bone: int) -> FloatArray:
        """From a bone to the middle of the joints and end sites below it [m], shape (F, 3); zero without any."""
        inside = np.zeros(len(self.rest.bones), dtype=bool)
        inside[bone] = True
        for below in range(bone + 1, len(inside)):
            inside[below] = inside[self.rest.parents[below]]
        ends = inside[self.clip.end_parents]
        at = self.clip.end_parents[ends]
        tips = self.positions[:, at] + quaternions.rotate(self.rotations[:, at], self.clip.end_offsets[ends])
        inside[bone] = False
        points = np.concatenate([self.positions[:, inside], tips], axis=1)
        if not points.shape[1]:
            return np.zeros((self.clip.frames, 3))
        return points.mean(axis=1) - self.positions[:, bone]


def _set_apart(points: dict[str, FloatArray], middle: FloatArray, source: _Source, rest: RestPose, limb: str) -> None:
    """Put the joints of both sides on the source's line, as far apart as the robot's."""
    half = np.linalg.norm(rest.joint(f"left_{limb}") - rest.joint(f"right_{limb}")) / 2.0
    left = half * _unit(source.between(f"right_{limb}", f"left_{limb}"))
    points[f"left_{limb}"], points[f"right_{limb}"] = middle + left, middle - left


def _length(rest: RestPose, upper: str, lower: str) -> float:
    """Length of a segment, mean of both sides [m]."""
    both = [
        np.linalg.norm(target_point(rest, f"{side}_{lower}")[1] - target_point(rest, f"{side}_{upper}")[1])
        for side in SIDES
    ]
    return float(np.mean(both))


def _level_axes(ahead: FloatArray) -> FloatArray:
    """Axes (forward, left, up) with +Z up and forward over the ground towards `ahead`, (..., 3) to (..., 4)."""
    heading = np.arctan2(ahead[..., 1], ahead[..., 0])
    return quaternions.from_euler(heading[..., None], "z")


def _unit(vectors: FloatArray) -> FloatArray:
    """Vectors of unit length, zero where they have none."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(lengths > 0.0, lengths, 1.0)
