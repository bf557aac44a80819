"""The body of the shipped clips: a joint tree 1.75 m tall, its masses, and how a posture becomes a clip.

Segment lengths are fractions of the body height from R. Drillis and R. Contini, "Body segment parameters" (1966), as in
D. A. Winter, "Biomechanics and Motor Control of Human Movement", 4th ed. (2009), figure 4.1; masses and centres of mass
are from Winter's table 4.1. How the trunk is divided into its joints, the distance of the hip joints and the shape of
the foot (beyond its height and length) are choices of this module.

In the rest pose the body stands in a T-pose facing +x, z up, and the frames of all joints are parallel to the world's.
"""

from dataclasses import dataclass, fields, replace
from functools import reduce
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motions import quaternions
from motions.clip import Clip

FloatArray = NDArray[np.float64]

HEIGHT = 1.75
THIGH, SHIN = 0.245 * HEIGHT, 0.246 * HEIGHT
ANKLE_HEIGHT = 0.039 * HEIGHT
FOOT_LENGTH = 0.152 * HEIGHT
HIP_HEIGHT = 0.530 * HEIGHT
SHOULDER_HEIGHT = 0.818 * HEIGHT
UPPER_ARM, FOREARM, HAND = 0.186 * HEIGHT, 0.146 * HEIGHT, 0.108 * HEIGHT

HIP_HALF_WIDTH = 0.050 * HEIGHT
SHOULDER_HALF_WIDTH = 0.129 * HEIGHT
ROOT_HEIGHT = HIP_HEIGHT + 0.04

# Points of the foot in its own frame, whose origin is the ankle.
HEEL = np.array([-0.055, 0.0, -ANKLE_HEIGHT])
BALL = np.array([0.125, 0.0, 0.015 - ANKLE_HEIGHT])
TOE_TIP = np.array([FOOT_LENGTH - 0.055, 0.0, 0.012 - ANKLE_HEIGHT])

SIDES = {"Left": 1.0, "Right": -1.0}


def _tree() -> tuple[list[tuple[str, str, tuple[float, float, float]]], list[tuple[str, tuple[float, float, float]]]]:
    joints = [
        ("Hips", "", (0.0, 0.0, 0.0)),
        ("Spine", "Hips", (0.0, 0.0, 0.10)),
        ("Spine1", "Spine", (0.0, 0.0, 0.13)),
        ("Spine2", "Spine1", (0.0, 0.0, 0.13)),
        ("Neck", "Spine2", (-0.01, 0.0, 0.165)),
        ("Head", "Neck", (0.02, 0.0, 0.09)),
    ]
    ends = [("Head", (0.0, 0.0, HEIGHT - ROOT_HEIGHT - 0.615))]
    clavicle = 0.03
    for side, sign in SIDES.items():
        joints += [
            (f"{side}Shoulder", "Spine2", (0.0, sign * clavicle, SHOULDER_HEIGHT - ROOT_HEIGHT - 0.36)),
            (f"{side}Arm", f"{side}Shoulder", (0.0, sign * (SHOULDER_HALF_WIDTH - clavicle), 0.0)),
            (f"{side}ForeArm", f"{side}Arm", (0.0, sign * UPPER_ARM, 0.0)),
            (f"{side}Hand", f"{side}ForeArm", (0.0, sign * FOREARM, 0.0)),
        ]
        ends.append((f"{side}Hand", (0.0, sign * HAND, 0.0)))
    for side, sign in SIDES.items():
        joints += [
            (f"{side}UpLeg", "Hips", (0.0, sign * HIP_HALF_WIDTH, HIP_HEIGHT - ROOT_HEIGHT)),
            (f"{side}Leg", f"{side}UpLeg", (0.0, 0.0, -THIGH)),
            (f"{side}Foot", f"{side}Leg", (0.0, 0.0, -SHIN)),
            (f"{side}ToeBase", f"{side}Foot", tuple(BALL)),
        ]
        ends.append((f"{side}ToeBase", tuple(TOE_TIP - BALL)))
    return joints, ends


_JOINTS, _ENDS = _tree()
JOINTS = tuple(name for name, _, _ in _JOINTS)
INDEX = {name: index for index, name in enumerate(JOINTS)}
PARENTS = np.array([INDEX.get(parent, -1) for _, parent, _ in _JOINTS], dtype=np.int64)
OFFSETS = np.array([offset for _, _, offset in _JOINTS])
END_PARENTS = np.array([INDEX[name] for name, _ in _ENDS], dtype=np.int64)
END_OFFSETS = np.array([offset for _, offset in _ENDS])

# Winter (2009), table 4.1: segments from their proximal to their distal joints (the middle, where they are two), mass
# over body mass, and centre of mass from the proximal end over the length. The joint "Head" stands for the ear.
_SEGMENTS: list[tuple[tuple[str, ...], tuple[str, ...], float, float]] = [
    (("LeftUpLeg", "RightUpLeg"), ("LeftArm", "RightArm"), 0.497, 0.50),
    (("Head",), ("Head",), 0.081, 0.0),
]
for _side in SIDES:
    _SEGMENTS += [
        ((f"{_side}Arm",), (f"{_side}ForeArm",), 0.028, 0.436),
        ((f"{_side}ForeArm",), (f"{_side}Hand",), 0.016, 0.430),
        ((f"{_side}Hand",), (f"{_side}Hand",), 0.006, 0.0),
        ((f"{_side}UpLeg",), (f"{_side}Leg",), 0.100, 0.433),
        ((f"{_side}Leg",), (f"{_side}Foot",), 0.0465, 0.433),
        ((f"{_side}Foot",), (f"{_side}ToeBase",), 0.0145, 0.5),
    ]


@dataclass(frozen=True, eq=False, kw_only=True)
class Arm:
    """Angles of one arm over F frames [rad], shapes (F,), all zero where it hangs straight down.

    Attributes:
        flexion: of the shoulder, forwards.
        abduction: of the shoulder, away from the body.
        twist: of the upper arm about itself, inwards.
        elbow: flexion of the elbow.
    """

    flexion: FloatArray
    abduction: FloatArray
    twist: FloatArray
    elbow: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Leg:
    """Segments of one leg over F frames.

    Attributes:
        thigh, shin, foot: unit quaternions (w, x, y, z) segment_to_world, shape (F, 4).
        toes: bend of the toes upwards [rad], shape (F,).
    """

    thigh: FloatArray
    shin: FloatArray
    foot: FloatArray
    toes: FloatArray


_Part = TypeVar("_Part", Arm, Leg)


@dataclass(frozen=True, eq=False, kw_only=True)
class Posture:
    """A motion of the whole body over F frames.

    Attributes:
        root: position of the hips in the world [m], shape (F, 3).
        pelvis, chest, head: unit quaternions (w, x, y, z) joint_to_world, shape (F, 4); the joints of the spine and of
            the neck share evenly what lies between.
        arms: by "Left" and "Right".
        legs: by "Left" and "Right".
    """

    root: FloatArray
    pelvis: FloatArray
    chest: FloatArray
    head: FloatArray
    arms: dict[str, Arm]
    legs: dict[str, Leg]

    def taken(self, frames: NDArray[np.int64]) -> "Posture":
        """The frames of these indices, shape (N,)."""

        def part(of: _Part) -> _Part:
            return replace(of, **{field.name: getattr(of, field.name)[frames] for field in fields(of)})

        return Posture(
            root=self.root[frames],
            pelvis=self.pelvis[frames],
            chest=self.chest[frames],
            head=self.head[frames],
            arms={side: part(arm) for side, arm in self.arms.items()},
            legs={side: part(leg) for side, leg in self.legs.items()},
        )

    def local_rotations(self) -> FloatArray:
        """Unit quaternions (w, x, y, z) joint_to_parent, shape (F, J, 4), signs continuous over the frames."""
        still = np.array([1.0, 0.0, 0.0, 0.0])
        local = np.tile(still, (len(self.root), len(JOINTS), 1))

        def place(joint: str, rotation: FloatArray) -> None:
            local[:, INDEX[joint]] = rotation

        place("Hips", self.pelvis)
        for joint in ("Spine", "Spine1", "Spine2"):
            place(joint, quaternions.slerp(still, between(self.pelvis, self.chest), 1 / 3))
        for joint in ("Neck", "Head"):
            place(joint, quaternions.slerp(still, between(self.chest, self.head), 1 / 2))
        for side, sign in SIDES.items():
            arm, leg = self.arms[side], self.legs[side]
            swing = chain(about("y", -arm.flexion), about("x", sign * arm.abduction))
            twist = about("z", -sign * arm.twist)
            place(f"{side}Arm", chain(swing, twist, about("x", -sign * np.pi / 2)))
            place(f"{side}ForeArm", about("z", -sign * arm.elbow))
            place(f"{side}UpLeg", between(self.pelvis, leg.thigh))
            place(f"{side}Leg", between(leg.thigh, leg.shin))
            place(f"{side}Foot", between(leg.shin, leg.foot))
            place(f"{side}ToeBase", about("y", -leg.toes))
        return quaternions.make_continuous(local)

    def clip(self, name: str, fps: float) -> Clip:
        """The motion as a clip."""
        return Clip(
            name=name,
            joints=JOINTS,
            parents=PARENTS,
            offsets=OFFSETS,
            end_parents=END_PARENTS,
            end_offsets=END_OFFSETS,
            fps=fps,
            root_positions=self.root,
            rotations_wxyz=self.local_rotations(),
        )


def about(axis: str, angle: ArrayLike) -> FloatArray:
    """Unit quaternions of rotations by `angle` [rad] about "x", "y" or "z", shape angle.shape + (4,)."""
    return quaternions.from_euler(np.asarray(angle, dtype=float)[..., None], axis)


def oriented(yaw: ArrayLike = 0.0, roll: ArrayLike = 0.0, pitch: ArrayLike = 0.0) -> FloatArray:
    """Joint_to_world of a trunk turned left by `yaw`, then raised on its left by `roll`, then bent forwards [rad]."""
    return chain(about("z", yaw), about("x", roll), about("y", pitch))


def chain(*rotations: FloatArray) -> FloatArray:
    """The product of unit quaternions, the last one applied first."""
    return reduce(quaternions.multiply, rotations)


def between(parent: FloatArray, child: FloatArray) -> FloatArray:
    """child_to_parent from parent_to_world and child_to_world."""
    return quaternions.multiply(quaternions.conjugate(parent), child)


def hip_joints(root: FloatArray, pelvis: FloatArray) -> dict[str, FloatArray]:
    """World positions of the "Left" and "Right" hip joint [m], shape (F, 3) each."""
    return {side: root + quaternions.rotate(pelvis, OFFSETS[INDEX[f"{side}UpLeg"]]) for side in SIDES}


def center_of_mass(positions: FloatArray) -> FloatArray:
    """Centre of mass of the body [m], shape (F, 3), from the joints' world positions, shape (F, J, 3)."""
    total = np.zeros((len(positions), 3))
    for proximal, distal, mass, along in _SEGMENTS:
        start, end = (positions[:, [INDEX[joint] for joint in ends]].mean(axis=1) for ends in (proximal, distal))
        total += mass * (start + along * (end - start))
    return total / sum(mass for _, _, mass, _ in _SEGMENTS)
