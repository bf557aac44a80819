"""Arms, legs and head of a body by the shape of its tree, where names don't tell.

Points are J joints followed by E end sites, `above` the index of what each hangs at, -1 for the root.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_ALIKE = 0.15  # relative difference in length up to which two sibling limbs pass for a left and a right one
_SHORT = 0.25  # share of a limb's length below which a bone is no upper or lower half of it
_NARROW = 0.5  # of the shoulders' width: that collar bones begin apart at most
_ALMOST = 0.75  # of the first two bones' length, that the second and the third have after a collar bone


@dataclass(frozen=True)
class Shape:
    """Ways down a tree, each a list of points from the first joint to the tip.

    Attributes:
        legs: of the twin limbs nearest to the root.
        arms: of the longest other twins.
        head: of what is longest between the arms, None where there is nothing.
    """

    legs: tuple[list[int], list[int]]
    arms: tuple[list[int], list[int]]
    head: list[int] | None


def find_shape(above: Sequence[int], points: FloatArray) -> Shape | None:
    """Find arms, legs and head; None where there are no two pairs of twin limbs.

    Args:
        above: index of the point above each.
        points: positions in the world over some frames, any unit, shape (F, J + E, 3).
    """
    weights = [path_length(points, (parent, point)) if parent >= 0 else 0.0 for point, parent in enumerate(above)]
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
    others = [pair for pair in twins if set(legs).isdisjoint(path_down(above, 0, pair[0]))]
    if not others:
        return None
    arms = max(others, key=lambda pair: weights[pair[0]])
    heads = [child for child in children[above[arms[0]]] if child not in arms and child not in legs]
    head = path_to_tip(above, points, max(heads, key=lambda child: weights[child])) if heads else None

    def ways(pair: tuple[int, int]) -> tuple[list[int], list[int]]:
        return path_to_tip(above, points, pair[0]), path_to_tip(above, points, pair[1])

    return Shape(ways(legs), ways(arms), head)


def segments_of(points: FloatArray, limb: Sequence[int]) -> tuple[int, int, int] | None:
    """Where the upper half of a limb begins, where the lower one does, and where that ends: its two long bones.

    They are the two bones in a row that are longest together; None where a limb has no two that are no short ones.
    """
    bones = [path_length(points, pair) for pair in pairwise(limb)]
    whole, pairs = sum(bones), [min(pair) for pair in pairwise(bones)]
    long = [k for k, shorter in enumerate(pairs) if shorter > _SHORT * whole]
    if not long:
        return None
    k = max(long, key=lambda k: bones[k] + bones[k + 1])
    return limb[k], limb[k + 1], limb[k + 2]


def roles_by_shape(above: Sequence[int], joints: int, points: FloatArray) -> dict[str, int]:
    """The joint of each role that the shape of a body tells; left is where feet that point ahead have their left.

    Without feet that point anywhere, left is where the first coordinate is greater.
    """
    shape = find_shape(above, points)
    if shape is None or shape.head is None:
        return {}
    found: dict[str, int] = {}
    for limbs, names in ((shape.arms, ("upper_arm", "forearm", "hand")), (shape.legs, ("thigh", "shin", "foot"))):
        after = _collars(points, limbs) if limbs is shape.arms else 0
        halves = [segments_of(points, limb[after:]) for limb in limbs]
        if halves[0] is None or halves[1] is None:
            return {}
        sides = ("left", "right") if _is_left(points, shape, limbs) else ("right", "left")
        for side, limb, joint_of in zip(sides, limbs, halves, strict=True):
            found |= {
                f"{side}_{name}": joint for name, joint in zip(names, joint_of or (), strict=True) if joint < joints
            }
            if names[0] == "upper_arm" and joint_of is not None:
                before = limb[: limb.index(joint_of[0])]
                found[f"{side}_shoulder"] = before[-1] if before else above[limb[0]]
    found |= {"pelvis": above[shape.legs[0][0]], "chest": above[shape.arms[0][0]]}
    bones = [point for point in shape.head if point < joints]
    if len(bones) > 1:
        found["neck"] = bones[0]
    return found | ({"head": bones[-1]} if bones else {})


def _collars(points: FloatArray, arms: tuple[list[int], list[int]]) -> int:
    """How many bones of the arms are collar bones, which may be as long as a forearm: none or one.

    They begin near each other, wherever the arms are, and what follows is hardly shorter than what they begin.
    """
    if min(map(len, arms)) < 4:
        return 0
    apart = [np.linalg.norm(points[:, arms[0][k]] - points[:, arms[1][k]], axis=-1) for k in (0, 1)]
    if (apart[0] >= _NARROW * apart[1]).any():
        return 0
    first, second = (np.mean([path_length(points, arm[k : k + 3]) for arm in arms]) for k in (0, 1))
    return int(second > _ALMOST * first)


def _is_left(points: FloatArray, shape: Shape, limbs: tuple[list[int], list[int]]) -> bool:
    """Tell whether the first of two limbs is the left one."""
    across = points[:, limbs[0][0]] - points[:, limbs[1][0]]
    if np.allclose(across, 0.0, atol=1e-9):
        across = points[:, limbs[0][-1]] - points[:, limbs[1][-1]]
    assert shape.head is not None
    hips = np.mean([points[:, leg[0]] for leg in shape.legs], axis=0)
    up, ahead = points[:, shape.head[-1]] - hips, np.zeros_like(hips)
    for leg in shape.legs:
        halves = segments_of(points, leg)
        ahead += points[:, leg[-1]] - points[:, leg[-1] if halves is None else halves[2]]
    side = np.einsum("fi,fi->f", across, np.cross(up, ahead)).mean()
    return bool(side > 0.0) if abs(side) > 1e-9 else bool(across[:, 0].mean() > 0.0)


def path_length(points: FloatArray, path: Sequence[int]) -> float:
    """Length along a way, the median over the frames."""
    steps = np.linalg.norm(np.diff(points[:, list(path)], axis=1), axis=-1)
    return float(np.median(steps, axis=0).sum())


def path_to_tip(above: Sequence[int], points: FloatArray, joint: int) -> list[int]:
    """The way from a joint, included, down to the point that is the farthest along the bones."""
    lengths = {joint: 0.0}
    for point in range(joint + 1, len(above)):
        if (parent := above[point]) in lengths:
            lengths[point] = lengths[parent] + path_length(points, (parent, point))
    return path_down(above, joint, max(lengths, key=lambda point: lengths[point]))


def path_down(above: Sequence[int], ancestor: int, point: int) -> list[int]:
    """The points from an ancestor down to a point, both included."""
    path = [point]
    while path[-1] != ancestor and above[path[-1]] >= 0:
        path.append(above[path[-1]])
    return path[::-1]


def _twins(siblings: Sequence[int], weights: Sequence[float]) -> Iterable[tuple[int, int]]:
    """Neighbours in length that are alike enough to be a left and a right limb."""
    by_length = sorted((sibling for sibling in siblings if weights[sibling] > 0), key=lambda joint: weights[joint])
    for a, b in pairwise(by_length):
        if weights[b] - weights[a] <= _ALIKE * weights[b]:
            yield a, b
