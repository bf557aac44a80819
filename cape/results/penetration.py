"""How deep the cloth of a take is in its colliders, vertices and faces, and what passed through them.

Measured from the take's positions alone, with distances of its own (`skeleton.solid_measures`): nothing that a solver
believes enters into it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.results.placed_colliders import PlacedColliders
from cape.results.solid_cores import core
from cape.results.take import Take
from cape.scene.colliders import Collider
from motions.errors import ValueRangeError
from skeleton.solid_measures import signed_distance

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SPACING = 0.002  # m between the samples of a face
MOST_SAMPLES = 100_000  # at once: some 20 MB
DIVISION_CLASS = 4  # faces are divided into a multiple of so many parts, so that few sizes of grid occur
TERNARY_STEPS = 60  # (2/3)^60 of a segment is 3e-11


@dataclass(frozen=True, eq=False)
class Deepest:
    """The deepest places of F frames.

    Attributes:
        depth: [m], 0 where nothing is inside, shape (F,).
        collider: index of the collider, -1 where nothing is inside, shape (F,).
        index: of the vertex or triangle, -1 where nothing is inside, shape (F,).
    """

    depth: FloatArray
    collider: IntArray
    index: IntArray


@dataclass(frozen=True, eq=False)
class Penetration:
    """How deep a cloth is in its colliders.

    Attributes:
        frames: of the take that were measured, shape (F,).
        vertices: the deepest vertex of each.
        faces: the deepest point of any triangle of each, at most `spacing` / sqrt(3) deeper than it says.
    """

    frames: IntArray
    vertices: Deepest
    faces: Deepest


def penetration(
    take: Take,
    *,
    frames: ArrayLike | None = None,
    spacing: float = SPACING,
    counted: ArrayLike | None = None,
    margin: float = 0.0,
) -> Penetration:
    """Measure the deepest penetration of each frame.

    A face is sampled on a grid that contains its corners and edges. Any of its points is within spacing / sqrt(3) of a
    sample and so no deeper by more than that; on a solid of radius r, where the distance is curved, by
    spacing^2 / (6 r), 0.013 mm on one of 5 cm at 2 mm.

    Args:
        take: what to measure.
        frames: which of its frames, None for all.
        spacing: largest distance of neighbouring samples of a face [m].
        counted: which vertices count, shape (V,), such as those that no bone holds; None for all. A face counts where
            all of its corners do.
        margin: by how much the colliders are grown [m]: with the scene's thickness, how deep the cloth is in the skin
            that they should keep clear.

    Raises:
        ValueRangeError: the spacing is not positive, the margin is negative, a frame is outside of the take, or
            `counted` has a wrong shape.
        UnknownNameError: a collider is of no shape in `skeleton.shapes.SHAPES`.
    """
    if not 0.0 < spacing < float("inf"):
        raise ValueRangeError(f"the spacing of samples must be positive and finite, not {spacing}")
    if not 0.0 <= margin < float("inf"):
        raise ValueRangeError(f"the margin must be zero or more and finite, not {margin}")
    chosen, counting = _frames(take, frames), _counted(take, counted)
    vertices, faces = _blank(len(chosen)), _blank(len(chosen))
    solids = PlacedColliders(take, margin)
    triangles = np.flatnonzero(counting[take.triangles].all(axis=1))
    vertex_indices = np.flatnonzero(counting)
    for row, frame in enumerate(chosen):
        points = take.positions[frame].astype(float)
        near = solids.within_reach(frame, points)
        if not near:
            continue
        corners = points[take.triangles_at(int(frame))[triangles]]
        sample = _FaceSampler(corners, spacing)
        for c in near:
            _deepen(vertices, row, c, vertex_indices, solids.depth(c, frame, points[counting]))
            depth, face = sample.deepest(partial(solids.depth, c, frame), faces.depth[row])
            _deepen(faces, row, c, triangles[face : face + 1], np.array([depth] if face >= 0 else []))
    return Penetration(chosen, vertices, faces)


def crossings(take: Take, *, frames: ArrayLike | None = None, counted: ArrayLike | None = None) -> IntArray:
    """Count the vertices that get into or through the core of a collider between a frame and the one before.

    The way of a vertex is the straight line between its places in the collider's own moving frame. A core is what lies
    deepest in a solid, a tenth of its inner radius around its middle: who got there is about to leave on the other
    side, or did. A half-space has no other side, and is left out.

    Args:
        take: what to measure.
        frames: which of its frames, None for all; nothing gets anywhere in frame 0.
        counted: which vertices count, shape (V,); None for all.

    Returns:
        Number of vertices for each frame and collider, shape (F, C).

    Raises:
        ValueRangeError: a frame is outside of the take, or `counted` has a wrong shape.
        UnknownNameError: a collider is of no shape in `skeleton.shapes.SHAPES`.
    """
    chosen, counting = _frames(take, frames), _counted(take, counted)
    solids, inner = PlacedColliders(take), [core(solid) for solid in take.colliders]
    counts = np.zeros((len(chosen), len(inner)), dtype=np.int64)
    for row, frame in enumerate(chosen):
        if frame == 0:
            continue
        before, now = (take.positions[k][counting].astype(float) for k in (frame - 1, frame))
        for c, solid in enumerate(inner):
            if solid is not None:
                counts[row, c] = _entered(solid, solids.in_bone(c, frame - 1, before), solids.in_bone(c, frame, now))
    return counts


def _entered(solid: Collider, before: FloatArray, now: FloatArray) -> int:
    """Number of points (N, 3), in the frame of the solid's bone, that were outside and touched it on their way."""
    way = now - before
    near = signed_distance(solid, before + 0.5 * way) < 0.5 * np.sqrt(np.einsum("ij,ij->i", way, way))
    start, way = before[near], way[near]
    outside = signed_distance(solid, start) > 0.0
    start, way = start[outside], way[outside]
    if not len(start):
        return 0
    low, high = np.zeros(len(start)), np.ones(len(start))

    def distance(share: FloatArray) -> FloatArray:
        return signed_distance(solid, start + share[:, None] * way)

    # The distance from a convex solid along a line is convex: a third of the line falls away in each step.
    for _ in range(TERNARY_STEPS):
        first, second = (2.0 * low + high) / 3.0, (low + 2.0 * high) / 3.0
        falls = distance(first) > distance(second)
        low, high = np.where(falls, first, low), np.where(falls, high, second)
    return int((np.minimum(distance(low), distance(high)) < 0.0).sum())


class _FaceSampler:
    """Triangles with corners (T, 3, 3) [m], and grids of points in them."""

    def __init__(self, corners: FloatArray, spacing: float) -> None:
        self._corners = corners
        self._middles = corners.mean(axis=1)
        self._reach = np.sqrt(np.square(corners - self._middles[:, None]).sum(axis=2).max(axis=1))
        longest = np.sqrt(np.square(corners - np.roll(corners, 1, axis=1)).sum(axis=2).max(axis=1))
        self._divisions = DIVISION_CLASS * np.maximum(1, np.ceil(longest / spacing / DIVISION_CLASS).astype(np.int64))

    def deepest(self, depth_at: Callable[[FloatArray], FloatArray], least: float) -> tuple[float, int]:
        """Give the deepest sample and its triangle, -1 where none is deeper than `least` [m].

        `depth_at` gives depths of points (N, 3) [m]. As a depth changes no faster than the point moves, no triangle
        need be sampled whose middle is too shallow by more than its corners are far.
        """
        depth, face = least, -1
        bound = depth_at(self._middles) + self._reach
        candidates = np.flatnonzero(bound > least)
        for divisions in np.unique(self._divisions[candidates]):
            weights = _barycentric_grid(int(divisions))
            of_size = candidates[self._divisions[candidates] == divisions]
            at_once = max(1, MOST_SAMPLES // len(weights))
            for first in range(0, len(of_size), at_once):
                some = of_size[first : first + at_once]
                depths = depth_at((weights @ self._corners[some]).reshape(-1, 3)).reshape(len(some), -1).max(axis=1)
                best = int(depths.argmax())
                if depths[best] > depth:
                    depth, face = float(depths[best]), int(some[best])
        return depth, face


def _barycentric_grid(divisions: int) -> FloatArray:
    """Weights of the corners at all points of a grid that parts each edge, shape (N, 3)."""
    first, second = np.indices((divisions + 1, divisions + 1)).reshape(2, -1)
    inside = first + second <= divisions
    first, second = first[inside], second[inside]
    return np.stack([first, second, divisions - first - second], axis=1) / divisions


def _blank(frames: int) -> Deepest:
    return Deepest(np.zeros(frames), np.full(frames, -1), np.full(frames, -1))


def _deepen(found: Deepest, row: int, collider: int, indices: IntArray, depths: FloatArray) -> None:
    """Take over the deepest of some places, with their indices, where it is deeper than what was found before."""
    if depths.size and (best := int(depths.argmax())) >= 0 and depths[best] > found.depth[row]:
        found.depth[row], found.collider[row], found.index[row] = depths[best], collider, indices[best]


def _frames(take: Take, frames: ArrayLike | None) -> IntArray:
    count = len(take.positions)
    if frames is None:
        return np.arange(count)
    chosen = np.atleast_1d(np.asarray(frames))
    if chosen.dtype.kind not in "iu" or ((chosen < 0) | (chosen >= count)).any():
        raise ValueRangeError(f"frames must be whole numbers from 0 to {count - 1}, not {frames}")
    return chosen.astype(np.int64)


def _counted(take: Take, counted: ArrayLike | None) -> NDArray[np.bool_]:
    vertices = take.positions.shape[1]
    if counted is None:
        return np.ones(vertices, dtype=bool)
    mask = np.asarray(counted)
    if mask.shape != (vertices,) or mask.dtype != bool:
        raise ValueRangeError(f"counted must be {vertices} truth values, one for each vertex")
    return mask
