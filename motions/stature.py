"""How tall a moving body is and where its head and feet are, in any unit and any axes."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motions.roles import find_roles

FloatArray = NDArray[np.float64]

SAMPLES = 32
"""Number of frames, spread over a clip, from which a body is measured; more change its height by less than 1 %."""

ANKLE_HEIGHT = 0.039
"""Height of the ankle over the sole as a part of the stature; Winter, Biomechanics and Motor Control of Human Movement,
4th ed. 2009, fig. 4.1, after Drillis and Contini 1966."""

_ALIKE = 0.15  # relative difference in length up to which two sibling limbs pass for a left and a right one


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
    joints: Sequence[str], parents: ArrayLike, end_parents: ArrayLike, points: FloatArray
) -> Landmarks | None:
    """Find head and feet by the names of the joints, else by the shape of the tree.

    Args:
        joints: names of the J joints.
        parents: index of each joint's parent, -1 for the root, shape (J,).
        end_parents: joint at which each of the E end sites hangs, shape (E,).
        points: positions of the joints and the end sites in the world over some frames, any unit, shape (F, J + E, 3).

    Returns:
        None where neither names nor shape show a body with a head and feet.
    """
    above = [*(int(parent) for parent in np.asarray(parents)), *(int(parent) for parent in np.asarray(end_parents))]
    return _landmarks_by_name(joints, above, points) or _landmarks_by_shape(above, points)


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
    leg_length = np.mean([_path_length(points, leg) for leg in landmarks.legs])
    return float(leg_length + trunk_length) / (1 - ANKLE_HEIGHT)


def upright_direction(points: FloatArray, landmarks: Landmarks) -> FloatArray:
    """Mean direction from the feet to the head over all frames, at most of length 1, shape (3,)."""
    feet = np.mean([points[:, leg[-1]] for leg in landmarks.legs], axis=0)
    direction = points[:, landmarks.head] - feet
    lengths = np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.mean(direction / np.where(lengths > 0, lengths, 1.0), axis=0)


def _path_length(points: FloatArray, path: Sequence[int]) -> float:
    steps = np.linalg.norm(np.diff(points[:, list(path)], axis=1), axis=-1)
    return float(np.median(steps, axis=0).sum())


def _path_to_tip(above: Sequence[int], points: FloatArray, joint: int) -> list[int]:
    """The path from a joint, included, down to the point that is the farthest along the bones."""
    lengths = {joint: 0.0}
    for point in range(joint + 1, len(above)):
        if (parent := above[point]) in lengths:
            lengths[point] = lengths[parent] + _path_length(points, (parent, point))
    return _path_down(above, joint, max(lengths, key=lambda point: lengths[point]))


def _path_down(above: Sequence[int], ancestor: int, point: int) -> list[int]:
    """The points from an ancestor down to a point, both included."""
    path = [point]
    while path[-1] != ancestor and above[path[-1]] >= 0:
        path.append(above[path[-1]])
    return path[::-1]


def _landmarks_by_name(joints: Sequence[str], above: Sequence[int], points: FloatArray) -> Landmarks | None:
    roles = {role: joints.index(name) for role, name in find_roles(joints, above[: len(joints)]).items()}
    legs = tuple(
        tuple(_path_down(above, roles[f"{side}_thigh"], roles[f"{side}_foot"]))
        for side in ("left", "right")
        if f"{side}_thigh" in roles and f"{side}_foot" in roles
    )
    if "head" not in roles or len(legs) != 2:
        return None
    return Landmarks(_path_to_tip(above, points, roles["head"])[-1], legs)


def _landmarks_by_shape(above: Sequence[int], points: FloatArray) -> Landmarks | None:
    """Legs are the twin limbs nearest to the root, arms the longest other twins; the head is next to the arms."""
    bones = [_path_length(points, (parent, point)) if parent >= 0 else 0.0 for point, parent in enumerate(above)]
    weights = list(bones)
    children: list[list[int]] = [[] for _ in above]
    depths = [0] * len(above)
    for point, parent in enumerate(above):
        if parent >= 0:
            children[parent].append(point)
            depths[point] = depths[parent] + 1
    for point in reversed(range(len(above))):
        if above[point] >= 0:
            weights[above[point]] += weights[point]

    twins = [pair for siblings in children for pair in _twins(siblings, weights)]
    if not twins:
        return None
    legs = min(twins, key=lambda pair: (depths[pair[0]], -weights[pair[0]]))
    others = [pair for pair in twins if set(legs).isdisjoint(_path_down(above, 0, pair[0]))]
    if not others:
        return None
    arms = max(others, key=lambda pair: weights[pair[0]])
    chest = above[arms[0]]
    heads = [child for child in children[chest] if child not in arms and child not in legs]
    if not heads:
        return None
    head = max(heads, key=lambda child: weights[child])
    tip = _path_to_tip(above, points, head)[-1]
    return Landmarks(tip, tuple(tuple(_path_to_tip(above, points, leg)) for leg in legs))


def _twins(siblings: Sequence[int], weights: Sequence[float]) -> Iterable[tuple[int, int]]:
    """Neighbours in length that are alike enough to be a left and a right limb."""
    by_length = sorted((sibling for sibling in siblings if weights[sibling] > 0), key=lambda joint: weights[joint])
    for a, b in pairwise(by_length):
        if weights[b] - weights[a] <= _ALIKE * weights[b]:
            yield a, b
