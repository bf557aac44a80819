"""How a garment sits over a take: what it covers, how close its collar is, in how many folds it falls and how low."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import Cloth
from cape.measure.wearing import across, folds, near_ray, ray_hits
from cape.results.kept import blocks, let_go
from cape.results.placed_colliders import PlacedColliders
from cape.results.take import Take
from cape.scene.scene import Scene
from motions.errors import UnknownNameError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CLOSE = 0.06  # m from the skin, within which cloth covers a shoulder
MOST_OF_ALL = 95  # per cent of the frames
LET_GO = 1000  # frames after which those on disk are let go of


@dataclass(frozen=True)
class Fit:
    """How a garment sits; None for what it has not, or what its wearer lacks the bones for.

    Attributes:
        shoulders_covered: share of the frames in which a ray from each shoulder joint up along the trunk meets cloth
            within `CLOSE` of the skin.
        collar_gap: largest distance of the collar's edge from the neck in any frame [m].
        collar_gap_p95: the same in 95 % of the frames.
        folds: prominent maxima of the hem's distance from the trunk's axis in the first frame, in which it has settled:
            in the wind of who sets out running, and over arms that are spread, into fewer than at rest.
        hem: mean height of the hem above the ankles in that frame [m].
    """

    shoulders_covered: float | None = None
    collar_gap: float | None = None
    collar_gap_p95: float | None = None
    folds: int | None = None
    hem: float | None = None


def fit_of(take: Take, cloth: Cloth, wearer: tuple[str, str, str] = Scene.wearer) -> Fit:
    """Measure how a cloth sat in a take.

    Args:
        take: of this cloth, on bones that have its wearer's.
        cloth: whose regions "collar", and "bottom" or "hem", are looked at; one that has a "waist" covers no shoulders.
        wearer: bones, or their roles, at which the left and the right arm begin, and the pelvis.
    """
    try:
        left, right, pelvis = (take.bones.positions[: len(take.positions), take.bones.index(b)] for b in wearer)
    except UnknownNameError:
        return Fit()
    trunk = (left + right) / 2.0 - pelvis
    up = trunk / np.linalg.norm(trunk, axis=1, keepdims=True)
    gaps = _collar_gaps(take, cloth)
    hem, closed = _hem(cloth)
    at_rest = take.positions[0].astype(float)
    return Fit(
        shoulders_covered=_shoulders_covered(take, cloth, (left, right), up),
        collar_gap=None if gaps is None else float(gaps.max()),
        collar_gap_p95=None if gaps is None else float(np.percentile(gaps, MOST_OF_ALL)),
        folds=None if hem is None else folds(at_rest[hem], pelvis[0], up[0], closed=closed),
        hem=None if hem is None else _above_ankles(take, at_rest[hem]),
    )


def _hem(cloth: Cloth) -> tuple[NDArray[np.int64] | None, bool]:
    """The vertices of the hem in their order, and whether they are a ring."""
    closed = "hem" in cloth.regions
    return cloth.regions.get("hem" if closed else "bottom"), closed


def _above_ankles(take: Take, hem: FloatArray) -> float | None:
    try:
        ankles = [take.bones.positions[0, take.bones.index(f"{side}_foot")] for side in ("left", "right")]
    except UnknownNameError:
        return None
    return float(hem[:, 2].mean() - np.mean(ankles, axis=0)[2])


def _shoulders_covered(take: Take, cloth: Cloth, joints: Sequence[FloatArray], up: FloatArray) -> float | None:
    body = _of_the_body(take)
    if not body or "waist" in cloth.regions:
        return None
    count, sides = len(take.positions), across(up)
    rays, frames, corners = [], [], []
    for frame, positions in enumerate(take.positions):
        if frame % LET_GO == 0:
            let_go(take.positions)
        triangles = take.triangles_at(frame)
        for ray, joint in enumerate(joints):
            near = near_ray(joint[frame], sides[frame], positions, triangles)
            corners.append(positions[triangles[near]])
            rays += [ray] * len(near)
            frames += [frame] * len(near)
    rays, frames = np.array(rays, np.int64), np.array(frames, np.int64)
    origins, along = np.stack(joints)[rays, frames], up[frames]
    ways = ray_hits(origins, along, np.concatenate(corners).astype(float)[:, None])[:, 0]
    hit = np.isfinite(ways)
    rays, frames, met = rays[hit], frames[hit], origins[hit] + ways[hit, None] * along[hit]
    close = _distances(PlacedColliders(take), body, frames, met) <= CLOSE
    covered = np.zeros((count, len(joints)), dtype=bool)
    covered[frames[close], rays[close]] = True
    return float(covered.all(axis=1).mean())


def _collar_gaps(take: Take, cloth: Cloth) -> FloatArray | None:
    """Largest distance of the collar's edge from the neck, or from the nearest limb of who has none [m], shape (F,)."""
    body = _of_the_body(take)
    if "collar" not in cloth.regions or not body:
        return None
    neck = [c for c in body if take.bones.index(str(take.colliders[c].bone)) in _neck_bones(take)]
    edge = np.intersect1d(cloth.regions["collar"], cloth.regions.get("top", cloth.regions["collar"]))
    placed, gaps = PlacedColliders(take), np.empty(len(take.positions))
    for block in blocks(take.positions):
        frames = np.repeat(np.arange(block.start, block.stop), len(edge))
        places = take.positions[block][:, edge].astype(float).reshape(-1, 3)
        gaps[block] = _distances(placed, neck or body, frames, places).reshape(-1, len(edge)).max(axis=1)
    return gaps


def _neck_bones(take: Take) -> list[int]:
    """The bones from the neck on up to the head: the longest of them carries what surrounds the neck."""
    roles, parents = take.bones.roles, take.bones.parents
    if "neck" not in roles or roles["neck"] == roles.get("head"):
        return []
    found = [take.bones.index(roles["neck"])]
    if parents is None or "head" not in roles:
        return found
    way, bone = [], int(parents[take.bones.index(roles["head"])])
    while bone >= 0 and bone != found[0]:
        way.append(bone)
        bone = int(parents[bone])
    return found + way if bone == found[0] else found


def _of_the_body(take: Take) -> list[int]:
    """The colliders that bones carry."""
    return [index for index, collider in enumerate(take.colliders) if collider.bone is not None]


def _distances(placed: PlacedColliders, colliders: Sequence[int], frames: IntArray, points: FloatArray) -> FloatArray:
    """Distances of points (n, 3), each at a frame, from the nearest of some colliders [m], negative within, (n,)."""
    deepest = np.full(len(points), -np.inf)
    for collider in colliders:
        np.maximum(deepest, placed.depth(collider, frames, points), out=deepest)
    return -deepest
