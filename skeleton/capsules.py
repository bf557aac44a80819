"""Capsules around head, trunk and limbs, sized by the proportions of the human body."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from motions.errors import UnknownNameError, ValueRangeError
from skeleton import proportions
from skeleton.rest import FRAME_ROLES, NEXT_ROLE, RestPose, missing_roles
from skeleton.shapes import Capsule

FloatArray = NDArray[np.float64]

SIDES = ("left", "right")

CAPSULES: tuple[str, ...] = (
    "head",
    "neck",
    "left_chest",
    "right_chest",
    "chest",
    "pelvis",
    *(f"{side}_{limb}" for side in SIDES for limb in ("shoulder", "upper_arm", "forearm", "hand")),
    *(f"{side}_{limb}" for side in SIDES for limb in ("thigh", "shin", "foot")),
)
"""Names of all capsules of a whole body."""


def body_capsules(
    rest: RestPose,
    *,
    radii: Mapping[str, float] | None = None,
    only: Sequence[str] | None = None,
    scale: float = 1.0,
    height: float | None = None,
    friction: float | None = None,
) -> tuple[tuple[Capsule, ...], dict[str, str]]:
    """Capsules of a body: one for each segment of a limb, head and neck, and a trunk of six.

    The trunk is wider than deep: `pelvis` lies across the hips; `left_chest` and `right_chest` rise from the waist and
    part towards the shoulders, and `chest` fills the groove between them; `left_shoulder` and `right_shoulder` slope
    from the neck to the arms.

    Args:
        rest: the body.
        radii: radius [m] of capsules by name (`CAPSULES`), instead of the proportion's.
        only: names of the capsules wanted, all by default.
        scale: factor on the radii that come from proportions.
        height: stature [m] to which the proportions apply, by default the body's own.
        friction: Coulomb coefficient of all of them.

    Returns:
        The capsules, and for each that had to be left out the reason by name.

    Raises:
        UnknownNameError: `radii` or `only` names a capsule that doesn't exist; lists the capsules.
        ValueRangeError: a radius, the scale or the height isn't positive.
    """
    radii = dict(radii or {})
    for name in (*radii, *(() if only is None else only)):
        if name not in CAPSULES:
            raise UnknownNameError("capsule", name, CAPSULES)
    for label, value in (("scale", scale), ("height", height)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise ValueRangeError(f"the {label} of the capsules must be positive, got {value}")
    wanted = [name for name in CAPSULES if only is None or name in only]
    if missing := missing_roles(rest, FRAME_ROLES):
        return (), {name: _reason(missing) for name in wanted}
    figure = _Figure(rest, height or rest.height)
    capsules, left_out = [], {}
    for name in wanted:
        kind = name.removeprefix("left_").removeprefix("right_")
        if missing := missing_roles(rest, _needed_roles(name)):
            left_out[name] = _reason(missing)
            continue
        radius = radii.get(name, scale * figure.stature * proportions.RADII[kind])
        segment = figure.segment(name, radius)
        if segment is None:
            left_out[name] = "its segment has no length"
            continue
        bone, start, end = segment
        capsules.append(
            Capsule(name, rest.bones[bone], rest.into_bone(bone, start), rest.into_bone(bone, end), radius, friction)
        )
    return tuple(capsules), left_out


def _needed_roles(name: str) -> tuple[str, ...]:
    """Roles of the bones that a capsule lies along."""
    if name.endswith("chest"):
        return ("chest", "pelvis")
    if name == "neck":
        return ("neck", "head")
    return (name, NEXT_ROLE[name]) if name in NEXT_ROLE else (name,)


def _reason(missing: Sequence[str]) -> str:
    return "no bone for the role " + ", ".join(repr(role) for role in missing)


_Segment = tuple[int, FloatArray, FloatArray]
"""The bone that carries a capsule, and the ends in the root's frame of the typical pose [m]."""


class _Figure:
    """Where the capsules of a body lie in its typical pose."""

    def __init__(self, rest: RestPose, stature: float):
        self.rest = rest
        self.stature = stature
        self.up, self.left, self.forward = rest.up, rest.left, rest.forward
        self.hips, self.shoulders = rest.middle("thigh"), rest.middle("upper_arm")

    def segment(self, name: str, radius: float) -> _Segment | None:
        """Segment of a capsule, None where the bones leave it no length."""
        side, _, limb = name.rpartition("_")
        across = {"left": self.left, "right": -self.left}.get(side, np.zeros(3))
        if limb == "head":
            return self._head(radius)
        if limb == "neck":
            return self._link(self.rest.bone("neck"), self.rest.bone("head"))
        if limb == "chest":
            return self._chest(across, radius)
        if limb == "pelvis":
            return self._pelvis(radius)
        if limb == "shoulder":
            return self._shoulder(side, across, radius)
        if limb == "hand":
            return self._extremity(name, self._forearm_direction(side), proportions.HAND_LENGTH, radius)
        if limb == "foot":
            return self._extremity(name, self.forward, proportions.FOOT_REACH, radius)
        return self._link(self.rest.segment_start(name), self.rest.bone(NEXT_ROLE[name]))

    def _link(self, start: int, next_bone: int) -> _Segment | None:
        """From one joint to another, carried by the bone with the longest link on the way."""
        way = self.rest.chain(start, next_bone)
        lengths = np.linalg.norm(np.diff(self.rest.positions[way], axis=0), axis=1)
        if len(way) < 2 or lengths.sum() < _NO_LENGTH * self.stature:
            return None
        return way[int(np.argmax(lengths))], self.rest.positions[start], self.rest.positions[next_bone]

    def _head(self, radius: float) -> _Segment:
        """The caps end at the vertex and at the chin."""
        bone = self.rest.bone("head")
        vertex = self.rest.vertex
        direction = _direction(vertex - self.rest.positions[bone])
        chin = vertex - proportions.HEAD_HEIGHT * self.stature * direction
        neck_side, crown_side = chin + radius * direction, vertex - radius * direction
        return bone, neck_side, crown_side

    def _chest(self, across: FloatArray, radius: float) -> _Segment:
        """From the waist up to below the shoulder joints, where the armpit's muscles end, and outwards on a side."""
        trunk = self.shoulders - self.hips
        half_chest = max(self.rest.shoulder_width, proportions.CHEST_BREADTH * self.stature) / 2
        top_reach = np.clip(half_chest - radius, 0, _CHEST_SPREAD * radius)
        waist_reach = np.clip(proportions.WAIST_BREADTH * self.stature / 2 - radius, 0, top_reach)
        waist = self.hips + _WAIST * trunk + waist_reach * across
        armpit = self.shoulders - _ARMPIT_DROP * self.stature * self.up + top_reach * across
        if not across.any():
            waist = waist + _CHEST_PARTS * (armpit - waist)
        return self._chest_bone(), waist, armpit

    def _chest_bone(self) -> int:
        """The chest's bone, or the one below it where the chest's starts as high as the arms."""
        chain = self.rest.chain(self.rest.bone("pelvis"), self.rest.bone("chest"))
        trunk = self.shoulders - self.hips
        heights = (self.rest.positions[chain] - self.hips) @ trunk / (trunk @ trunk)
        low_enough = [bone for bone, height in zip(chain, heights, strict=True) if height < _CHEST_BONE_BELOW]
        return low_enough[-1] if low_enough else chain[-1]

    def _pelvis(self, radius: float) -> _Segment:
        """Across the hips; the caps end where the hips are broadest."""
        bone = self.rest.bone("pelvis")
        centre = self.hips + _PELVIS_RISE * self.stature * self.up
        reach = max(proportions.HIP_BREADTH * self.stature / 2 - radius, 0.1 * radius) * self.left
        return bone, centre + reach, centre - reach

    def _shoulder(self, side: str, across: FloatArray, radius: float) -> _Segment:
        """Down the trapezius, from beside the neck to the upper arm's joint."""
        neck = self.shoulders + proportions.RADII["neck"] * self.stature * across
        rise = max(_TRAPEZIUS_TOP * self.stature - radius, 0) * self.up
        return self.rest.bone(f"{side}_shoulder"), neck + rise, self.rest.joint(f"{side}_upper_arm")

    def _extremity(self, role: str, direction: FloatArray, reach: float, radius: float) -> _Segment:
        """A hand or a foot: to its farthest tip, or as far as proportions say where the file has no tip."""
        bone = self.rest.bone(role)
        origin = self.rest.positions[bone]
        tip = origin + reach * self.stature * direction
        tips = self.rest.tips(bone)
        distances = np.linalg.norm(tips - origin, axis=1)
        if len(tips) and distances.max() > reach * self.stature / 2:
            tip = tips[int(np.argmax(distances))]
        # The cap ends at the tip; whatever the radius, a segment remains.
        length = float(np.linalg.norm(tip - origin))
        return bone, origin, origin + max(length - radius, length / 10) / length * (tip - origin)

    def _forearm_direction(self, side: str) -> FloatArray:
        """A stretched hand goes on where the forearm ends; without a forearm it hangs down."""
        if f"{side}_forearm" not in self.rest.roles:
            return -self.up
        forearm = self.rest.origin(f"{side}_hand") - self.rest.origin(f"{side}_forearm")
        return _direction(forearm) if np.linalg.norm(forearm) > _NO_LENGTH * self.stature else -self.up


_NO_LENGTH = 1e-3
"""Segments shorter than this part of the stature (2 mm) are joints in one place, with nothing between them."""
_WAIST = 0.40
"""Where the chest's capsules start on the way from hips to shoulders; the pelvis' caps reach beyond half of it."""
_CHEST_BONE_BELOW = 0.75
"""A joint nearer to the shoulders than this part of the trunk moves the shoulders, not the ribs below them."""
_CHEST_SPREAD = 0.7
"""Farthest a chest capsule's axis lies from the middle's, in radii: the groove between is then 0.06 radii deep."""
_CHEST_PARTS = 0.25
"""Where on the way from waist to armpit the middle's starts: below, its cap reaches and the groove is no deeper."""
_ARMPIT_DROP = 0.045
"""Centre of the chest's upper cap below the shoulder joints: its top is then level with the collar bones."""
_PELVIS_RISE = 0.015
"""Centre of the pelvis' capsule above the hip joints."""
_TRAPEZIUS_TOP = 0.05
"""Top of the trapezius beside the neck above the shoulder joints: C7 (0.86, ANSUR II) against 0.82, a little above."""


def _direction(vector: FloatArray) -> FloatArray:
    return vector / np.linalg.norm(vector)
