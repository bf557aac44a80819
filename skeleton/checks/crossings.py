"""Limbs that pass through each other: how deep capsules are in capsules, and when."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from skeleton.checks.findings import Finding, in_frames, run_of
from skeleton.placed_solids import ends_in_world
from skeleton.shapes import Capsule
from skeleton.track import BoneTrack, nearest_parents

FloatArray = NDArray[np.float64]

YIELD = 0.5  # of the thinner capsule's radius: flesh gives way, and limbs are flatter in places than capsules
NEAR = 3  # bones from one to another along the skeleton, from upper arm over clavicle and chest to the pelvis


def crossings(track: BoneTrack, capsules: Sequence[Capsule]) -> list[Finding]:
    """Find pairs of capsules that are deeper in each other than half of the thinner one's radius, the deepest first.

    Left out are pairs on one bone and on neighbours along the skeleton, which meet at their joint, and pairs at most
    `NEAR` bones apart that overlap in most frames, as the parts of a trunk do by construction.

    Args:
        track: the motion.
        capsules: of its bones; those that stand still in the world are left out.

    Raises:
        UnknownNameError: a capsule's bone isn't in the track.
    """
    moving = [capsule for capsule in capsules if capsule.bone is not None]
    steps = bones_between(track.parents, [track.index(capsule.bone or "") for capsule in moving])
    ends = ends_in_world(moving, track)
    found = []
    for i, j in combinations(range(len(moving)), 2):
        if steps[i, j] <= 1:
            continue
        gap = segment_distance(ends[:, i, 0], ends[:, i, 1], ends[:, j, 0], ends[:, j, 1])
        depth = moving[i].radius + moving[j].radius - gap
        if steps[i, j] <= NEAR and np.median(depth) > 0.0:
            continue
        crossed = depth > YIELD * min(moving[i].radius, moving[j].radius)
        if crossed.any():
            thin, thick = sorted((moving[i], moving[j]), key=lambda capsule: capsule.radius)
            found.append(_finding(thin, thick, depth, crossed))
    return sorted(found, key=lambda finding: -finding.figure)


def segment_distance(a_start: FloatArray, a_end: FloatArray, b_start: FloatArray, b_end: FloatArray) -> FloatArray:
    """Distance of two segments, ends of shape (..., 3) [m], shape (...) [m].

    Follows Ericson, "Real-Time Collision Detection" (2005), 5.1.9. Parallel segments have a pair of nearest points at
    an end of one of them; a segment may be a point.
    """
    a, b, apart = a_end - a_start, b_end - b_start, a_start - b_start
    aa, bb, ab = _dot(a, a), _dot(b, b), _dot(a, b)
    a_apart, b_apart = _dot(a, apart), _dot(b, apart)
    cross = aa * bb - ab * ab  # |a|^2 |b|^2 sin^2 of the angle between them
    skew = cross > 1e-12 * aa * bb
    s = np.where(skew, np.clip((ab * b_apart - a_apart * bb) / np.where(skew, cross, 1.0), 0.0, 1.0), 0.0)
    t = np.clip(_ratio(ab * s + b_apart, bb), 0.0, 1.0)
    # The point of a nearest to that of b, which may have been moved to an end.
    s = np.clip(_ratio(ab * t - a_apart, aa), 0.0, 1.0)
    between = apart + s[..., None] * a - t[..., None] * b
    return np.sqrt(_dot(between, between))


def _finding(thin: Capsule, thick: Capsule, depth: FloatArray, crossed: NDArray[np.bool_]) -> Finding:
    deepest = int(depth.argmax())
    run, others = run_of(crossed, deepest)
    text = f"{thin.name} in {thick.name} by {1000 * depth[deepest]:.0f} mm {in_frames(run, others)}"
    return Finding("crossing", text, float(depth[deepest]), "m", run, (thin.name, thick.name))


def bones_between(all_parents: NDArray[np.int64] | None, bones: Sequence[int]) -> NDArray[np.int64]:
    """Number of steps from each of n bones to each other along the skeleton, by these bones only, shape (n, n).

    Bones may come several times. Many steps where nothing connects them, or where parents aren't known.

    Args:
        all_parents: of each bone of the skeleton its parent's index, -1 for none.
        bones: their indices.
    """
    carriers = list(dict.fromkeys(bones))
    parents = np.full(len(carriers), -1) if all_parents is None else nearest_parents(all_parents, carriers)
    steps = np.full((len(carriers), len(carriers)), len(carriers))
    for i in range(len(carriers)):
        steps[i, i] = 0
        if parents[i] >= 0:
            steps[i, parents[i]] = steps[parents[i], i] = 1
    for k in range(len(carriers)):  # Floyd (1962)
        steps = np.minimum(steps, steps[:, k, None] + steps[None, k])
    places = [carriers.index(bone) for bone in bones]
    return steps[np.ix_(places, places)]


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.einsum("...i,...i->...", a, b)


def _ratio(above: FloatArray, below: FloatArray) -> FloatArray:
    """The quotient, 0 where it has no meaning as a segment is a point."""
    return np.where(below > 0.0, above / np.where(below > 0.0, below, 1.0), 0.0)
