"""A figure posed over time by its trunk, arms and feet: inverse kinematics bends the legs, balance places the hips."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motions import quaternions
from motions.making.body import SHIN, SIDES, THIGH, Arm, Posture, about, center_of_mass, hip_joints, oriented
from motions.making.legs import foot_rotation, leg, standing_ankle

FloatArray = NDArray[np.float64]

STANDING = 1.005  # height of the centre of mass of the figure at ease, knees all but straight
TOE_OUT = np.radians(8.0)
FOOT_SPREAD = 0.10
BALANCE_ROUNDS = 12


@dataclass(frozen=True, eq=False, kw_only=True)
class Foot:
    """Where one foot is over F frames.

    Attributes:
        ankle: position in the world [m], shape (F, 3).
        pitch: toes up positive [rad], shape (F,).
        yaw: direction of the foot in the world [rad], shape (F,).
        toes: bend of the toes upwards [rad], shape (F,).
        knee_out: how far the knee points outwards of the direction between foot and pelvis [rad], shape (F,).
    """

    ankle: FloatArray
    pitch: FloatArray
    yaw: FloatArray
    toes: FloatArray
    knee_out: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Upper:
    """Pelvis, chest and head (unit quaternions wxyz to world, shape (F, 4)) and arms (by "Left" and "Right")."""

    pelvis: FloatArray
    chest: FloatArray
    head: FloatArray
    arms: dict[str, Arm]


Feet = Callable[[dict[str, FloatArray]], dict[str, Foot]]
"""Feet by side, given the world positions of the hip joints by side [m], shape (F, 3) each."""


def spot(side: str, x: float = 0.0) -> FloatArray:
    """Where a foot stands at ease [m], shape (3,)."""
    return np.array([x, SIDES[side] * FOOT_SPREAD, 0.0])


def on_ground(side: str, spots: FloatArray, *, pitch: FloatArray | None = None, turn: FloatArray | None = None) -> Foot:
    """A foot on the floor over F frames, rolling on heel or ball as `pitch` says.

    Args:
        side: "Left" or "Right".
        spots: point of the floor under the ankle while the foot is flat [m], shape (F, 3).
        pitch: toes up positive [rad], shape (F,), None for flat.
        turn: direction beyond the usual small turn outwards [rad], shape (F,), None for none.
    """
    none = np.zeros(len(spots))
    pitch = none if pitch is None else pitch
    yaw = SIDES[side] * TOE_OUT + (none if turn is None else turn)
    ankle = standing_ankle(spots, pitch, yaw)
    return Foot(ankle=ankle, pitch=pitch, yaw=yaw, toes=np.maximum(-pitch, 0.0), knee_out=none)


def composed(root: FloatArray, upper: Upper, feet: Feet) -> Posture:
    """The whole figure for hips at `root` [m], shape (F, 3)."""
    hips = hip_joints(root, upper.pelvis)
    left = quaternions.rotate(upper.pelvis, np.array([0.0, 1.0, 0.0]))
    left[:, 2] = 0.0
    left /= np.linalg.norm(left, axis=1)[:, None]
    legs = {}
    for side, foot in feet(hips).items():
        across = left + quaternions.rotate(about("z", foot.yaw), np.array([0.0, 1.0, 0.0]))
        hinge = quaternions.rotate(about("z", SIDES[side] * foot.knee_out), across)
        legs[side] = leg(hips[side], foot.ankle, foot_rotation(foot.pitch, foot.yaw), foot.toes, hinge)
    return Posture(root=root, pelvis=upper.pelvis, chest=upper.chest, head=upper.head, arms=upper.arms, legs=legs)


def balanced(target: FloatArray, upper: Upper, feet: Feet) -> Posture:
    """The figure whose centre of mass follows `target` [m], shape (F, 3), by moving the hips by what is missing.

    Moving the hips moves at least the trunk, half of the mass, so what is missing shrinks every time.
    """
    root = np.array(target)
    for _ in range(BALANCE_ROUNDS):
        posture = composed(root, upper, feet)
        root = root + target - center_of_mass(posture.clip("", 1.0).world_positions())
    return composed(root, upper, feet)


def turned(*, yaw: ArrayLike = 0.0, roll: ArrayLike = 0.0, pitch: ArrayLike = 0.0) -> FloatArray:
    """`body.oriented` in degrees; one or more of the angles have shape (F,)."""
    return oriented(*np.broadcast_arrays(*(np.radians(angle) for angle in (yaw, roll, pitch))))


def arm(*, flexion: ArrayLike, abduction: ArrayLike, twist: ArrayLike, elbow: ArrayLike) -> Arm:
    """A `body.Arm` in degrees; one or more of the angles have shape (F,)."""
    angles = np.broadcast_arrays(*(np.radians(angle) for angle in (flexion, abduction, twist, elbow)))
    flexion, abduction, twist, elbow = angles
    return Arm(flexion=flexion, abduction=abduction, twist=twist, elbow=elbow)


def hanging(hip: FloatArray, thigh: FloatArray, knee: FloatArray) -> FloatArray:
    """World positions of the ankle [m], shape (F, 3), of a leg that hangs in the air from the hip of a body facing +x.

    Args:
        hip: world positions of the hip joint [m], shape (F, 3).
        thigh: how far the thigh is raised forwards [rad], shape (F,).
        knee: flexion of the knee [rad], shape (F,).
    """
    shin = thigh - knee
    forwards = THIGH * np.sin(thigh) + SHIN * np.sin(shin)
    downwards = THIGH * np.cos(thigh) + SHIN * np.cos(shin)
    return hip + np.column_stack([forwards, np.zeros_like(forwards), -downwards])
