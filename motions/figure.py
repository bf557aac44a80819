"""A figure posed over time by its trunk, arms and feet: inverse kinematics bends the legs, balance places the hips."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.body import SIDES, Arm, Posture, about, center_of_mass, hip_joints
from motions.legs import foot_rotation, leg, standing_ankle

FloatArray = NDArray[np.float64]

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
        knee_out: how far the knee points outwards from between the foot and the pelvis [rad], shape (F,).
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
    """The figure whose centre of mass follows `target` [m], shape (F, 3); hips are moved by what is missing, repeatedly.

    Moving the hips moves at least the trunk, half of the mass, so what is missing shrinks every time.
    """
    root = np.array(target)
    for _ in range(BALANCE_ROUNDS):
        posture = composed(root, upper, feet)
        root = root + target - center_of_mass(posture.clip("", 1.0).world_positions())
    return composed(root, upper, feet)
