"""Legs that reach for the ground: inverse kinematics of thigh and shin, and the roll of a foot that stands."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motions import quaternions
from motions.making.body import ANKLE_HEIGHT, BALL, HEEL, SHIN, THIGH, Leg, about, chain

FloatArray = NDArray[np.float64]

# A knee stretched to the limit would turn infinitely fast: d(knee)/d(distance) grows like 1/sin(knee).
LONGEST_REACH = 0.9995 * (THIGH + SHIN)


def reach(hip: FloatArray, ankle: FloatArray, hinge: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Segment_to_world of thigh and shin, shapes (F, 4), that put the ankle at its place: two-bone inverse kinematics.

    The triangle of thigh, shin and the line from hip to ankle is solved by the law of cosines; it lies in the plane
    across `hinge`, with the knee in front. An ankle out of reach is approached along that line.

    Args:
        hip: positions of the hip joint in the world [m], shape (F, 3).
        ankle: wanted positions of the ankle in the world [m], shape (F, 3), not at the hip.
        hinge: directions near the knee's axis, towards the body's left, not along the leg, shape (F, 3).
    """
    line = ankle - hip
    distance = np.linalg.norm(line, axis=1)
    down = line / distance[:, None]
    distance = np.minimum(distance, LONGEST_REACH)
    axis = hinge - np.einsum("fi,fi->f", hinge, down)[:, None] * down
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    at_hip = np.arccos((THIGH**2 + distance**2 - SHIN**2) / (2 * THIGH * distance))
    at_knee = np.arccos((THIGH**2 + SHIN**2 - distance**2) / (2 * THIGH * SHIN))
    straight = quaternions.from_matrix(np.stack([np.cross(axis, -down), axis, -down], axis=2))
    thigh = chain(quaternions.from_rotation_vector(-at_hip[:, None] * axis), straight)
    shin = chain(quaternions.from_rotation_vector((np.pi - at_knee)[:, None] * axis), thigh)
    return thigh, shin


def leg(hip: FloatArray, ankle: FloatArray, foot: FloatArray, toes: FloatArray, hinge: FloatArray) -> Leg:
    """A leg between the hip and a foot of given place and rotation: `reach` with the foot and toes added."""
    thigh, shin = reach(hip, ankle, hinge)
    return Leg(thigh=thigh, shin=shin, foot=foot, toes=toes)


def foot_rotation(pitch: ArrayLike, yaw: ArrayLike) -> FloatArray:
    """Foot_to_world of a foot pitched toes up by `pitch` and turned to the left by `yaw` [rad], shape (F, 4)."""
    return chain(about("z", yaw), about("y", np.negative(pitch)))


def standing_ankle(spot: FloatArray, pitch: FloatArray, yaw: ArrayLike) -> FloatArray:
    """World positions of the ankle [m], shape (F, 3), of a foot that rolls in place without sliding.

    Toes up, it turns about the lower edge of the heel; heel up, about the joint of the toes, which stay flat.

    Args:
        spot: point of the floor under the ankle where the foot stands flat [m], shape (3,) or (F, 3).
        pitch: toes up positive [rad], shape (F,).
        yaw: direction of the foot [rad], scalar or shape (F,).
    """
    pivot = np.where(pitch[:, None] > 0, HEEL, BALL)
    flat = quaternions.rotate(about("z", yaw), pivot + np.array([0.0, 0.0, ANKLE_HEIGHT]))
    return spot + flat - quaternions.rotate(foot_rotation(pitch, yaw), pivot)
