"""How tall a moving body is and where its head and feet are, in any unit and any axes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motions.bodies.roles import find_roles
from motions.bodies.shape import find_shape, path_down, path_length, path_to_tip, segments_of

FloatArray = NDArray[np.float64]

SAMPLES = 32
"""Number of frames, spread over a clip, from which a body is measured; more change its height by less than 1 %."""

ANKLE_HEIGHT = 0.039
"""Height of the ankle over the sole as a part of the stature; Winter, Biomechanics and Motor Control of Human Movement,
4th ed. 2009, fig. 4.1, after Drillis and Contini 1966."""


@dataclass(frozen=True)
class Landmarks:
    """Indices of what tells a body's length, among its J joints followed by its E end sites.

    Attributes:
        head: the top of the head, or what comes nearest to it.
        legs: points from the hip down to the ankle (or the tip of the foot, where names don't tell), one list a leg.
    """

    head: int
    legs: tuple[tuple[int, ...], ...]


def find_landmarks(
    joints: Sequence[str],
    parents: ArrayLike,
    end_parents: ArrayLike,
    points: FloatArray,
    roles: Mapping[str, str] | None = None,
) -> Landmarks | None:
    """Find head and feet by the names of the joints, else by the shape of the tree.

    Args:
        joints: names of the J joints.
        parents: index of each joint's parent, -1 for the root, shape (J,).
        end_parents: joint at which each of the E end sites hangs, shape (E,).
        points: positions of the joints and the end sites in the world over some frames, any unit, shape (F, J + E, 3).
        roles: joints of roles that are known besides.

    Returns:
        None where neither names nor shape show a body with a head and feet.
    """
    above = [*(int(parent) for parent in np.asarray(parents)), *(int(parent) for parent in np.asarray(end_parents))]
    return _landmarks_by_name(joints, above, points, roles) or _landmarks_by_shape(above, points)


def standing_height(points: FloatArray, landmarks: Landmarks | None) -> float:
    """Height of the body if it stood upright, in the unit of the points.

    With landmarks it is the length of the legs' bones, the distance of the head's top from the middle of the hips where
    the trunk is straight (90th percentile over the frames), and the ankle's height by proportion, so a body that sits
    or crouches is measured as well. Without, it is the largest distance of two points along a coordinate axis.

    Args:
        points: as in `find_landmarks`.
        landmarks: what `find_landmarks` returned.
    """
    if landmarks is None:
        return float(np.ptp(points, axis=1).max())
    hips = np.mean([points[:, leg[0]] for leg in landmarks.legs], axis=0)
    trunk_length = np.quantile(np.linalg.norm(points[:, landmarks.head] - hips, axis=-1), 0.9)
    leg_length = np.mean([path_length(points, leg) for leg in landmarks.legs])
    return float(leg_length + trunk_length) / (1 - ANKLE_HEIGHT)


def upright_direction(points: FloatArray, landmarks: Landmarks) -> FloatArray:
    """Mean direction from the feet to the head over all frames, at most of length 1, shape (3,)."""
    feet = np.mean([points[:, leg[-1]] for leg in landmarks.legs], axis=0)
    direction = points[:, landmarks.head] - feet
    lengths = np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.mean(direction / np.where(lengths > 0, lengths, 1.0), axis=0)


def _landmarks_by_name(
    joints: Sequence[str], above: Sequence[int], points: FloatArray, known: Mapping[str, str] | None
) -> Landmarks | None:
    roles = {role: joints.index(name) for role, name in find_roles(joints, above[: len(joints)], known).items()}
    legs = tuple(
        tuple(path_down(above, roles[f"{side}_thigh"], roles[f"{side}_foot"]))
        for side in ("left", "right")
        if f"{side}_thigh" in roles and f"{side}_foot" in roles
    )
    if "head" not in roles or len(legs) != 2:
        return None
    return Landmarks(path_to_tip(above, points, roles["head"])[-1], legs)


def _landmarks_by_shape(above: Sequence[int], points: FloatArray) -> Landmarks | None:
    """The head is the tip of the longest way from between the arms; a leg goes to the ankle, or to its tip."""
    shape = find_shape(above, points)
    if shape is None or shape.head is None:
        return None
    ankles = [segments_of(points, leg) for leg in shape.legs]
    legs = (
        leg if ankle is None else leg[: leg.index(ankle[2]) + 1] for leg, ankle in zip(shape.legs, ankles, strict=True)
    )
    return Landmarks(shape.head[-1], tuple(map(tuple, legs)))
