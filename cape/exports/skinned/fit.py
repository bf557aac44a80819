"""Rigid motions of joints, and weights of vertices, that follow a cloth's motion as well as can be.

After Le and Deng, "Smooth skinning decomposition with rigid bones" (ACM Transactions on Graphics 31, 6, 2012): in turn
the weights are fitted to the joints' motions, vertex by vertex, and each joint's motion to what the others leave of
it, frame by frame, a weighted absolute orientation. Joints stay where they were spread out.

Here a *path* is where a vertex is in all frames, one row of 3F numbers, and a joint's motion four such rows: what
becomes of its axes, and its place. A vertex that follows it takes the path of (x, y, z, 1) times these.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cape.exports.skinned.blending import blend
from cape.exports.skinned.joints import Joints

FloatArray = NDArray[np.float64]
INFLUENCES = 4  # joints that a vertex follows: what engines take at once
CANDIDATES = 8  # the nearest joints, out of which those are chosen
ROUNDS = 6  # of weights and motions in turn; further ones gain less than 2 % each
SAMPLES = 120  # frames to which the weights are fitted


@dataclass(frozen=True, eq=False)
class Skin:
    """How V vertices follow K joints over F frames, from the first frame on.

    Attributes:
        rest: places of the vertices that all transforms start from [m], shape (V, 3).
        centers: places of the joints there [m]; their axes are the world's, shape (K, 3).
        influences: joints that each vertex follows, shape (V, 4).
        weights: by how much; each vertex's sum is one, shape (V, 4).
        rotations: of the joints from their rest, shape (F, K, 3, 3).
        places: of the joints [m], shape (F, K, 3).
    """

    rest: FloatArray
    centers: FloatArray
    influences: NDArray[np.intp]
    weights: FloatArray
    rotations: FloatArray
    places: FloatArray

    def positions(self) -> FloatArray:
        """Where the skin puts the vertices [m], shape (F, V, 3)."""
        found = np.zeros((len(self.rest), 3 * len(self.places)))
        for k, motion in enumerate(_as_rows(self.rotations, self.places)):
            own, slot = np.nonzero((self.influences == k) & (self.weights > 0.0))
            found[own] += self.weights[own, slot, None] * (_local(self.rest[own], self.centers[k]) @ motion)
        return np.ascontiguousarray(found.reshape(len(self.rest), -1, 3).transpose(1, 0, 2))


def fit(positions: FloatArray, joints: Joints) -> Skin:
    """Fit a skin to a motion.

    Args:
        positions: of the vertices [m], shape (F, V, 3).
        joints: where they are on it.
    """
    frames, vertices = positions.shape[:2]
    rest, count = positions[0], len(joints.vertices)
    centers = rest[joints.vertices]
    nearest = np.argsort(joints.distances, axis=0, kind="stable")[: min(CANDIDATES, count)].T
    near = np.take_along_axis(joints.distances.T, nearest, axis=1)
    weights = np.zeros((vertices, count))
    closeness = 1.0 / (np.square(near[:, :INFLUENCES]) + 1e-4)
    np.put_along_axis(weights, nearest[:, :INFLUENCES], closeness / closeness.sum(axis=1, keepdims=True), axis=1)
    paths = _paths(positions)
    motions = _as_rows(np.tile(np.eye(3), (frames, count, 1, 1)), positions[:, joints.vertices])
    sampled = np.unique(np.linspace(0, frames - 1, min(frames, SAMPLES)).astype(int))
    columns = (3 * sampled[:, None] + np.arange(3)).ravel()
    some, moved = paths[:, columns], motions[:, :, columns]
    for _ in range(ROUNDS):
        _fit_motions(moved, some, rest, centers, weights)
        weights = _weights(some, rest, centers, nearest, moved)
    motions[:, :, columns] = moved
    for _ in range(2):
        _fit_motions(motions, paths, rest, centers, weights)
    influences = np.argsort(-weights, axis=1, kind="stable")[:, :INFLUENCES]
    if count < INFLUENCES:
        influences = np.pad(influences, ((0, 0), (0, INFLUENCES - count)))
    kept = np.take_along_axis(weights, influences, axis=1)
    kept[:, count:] = 0.0
    rows = motions.reshape(count, 4, frames, 3)
    rotations, places = rows[:, :3].transpose(2, 0, 3, 1), rows[:, 3].transpose(1, 0, 2)
    return Skin(rest, centers, influences, kept / kept.sum(axis=1, keepdims=True), rotations, places)


def _paths(positions: FloatArray) -> FloatArray:
    """The vertices' paths, shape (V, 3F)."""
    return positions.transpose(1, 0, 2).reshape(positions.shape[1], -1)


def _as_rows(rotations: FloatArray, places: FloatArray) -> FloatArray:
    """Rotations (F, K, 3, 3) and places (F, K, 3) as the joints' motions, shape (K, 4, 3F)."""
    rows = np.concatenate([rotations.transpose(1, 3, 0, 2), places.transpose(1, 0, 2)[:, None]], axis=1)
    return rows.reshape(len(rows), 4, -1)


def _local(places: FloatArray, center: FloatArray) -> FloatArray:
    """Places (V, 3) as a joint at rest has them, with a one for its own place, shape (V, 4)."""
    return np.pad(places - center, ((0, 0), (0, 1)), constant_values=1.0)


def _fit_motions(
    motions: FloatArray, paths: FloatArray, rest: FloatArray, centers: FloatArray, weights: FloatArray
) -> None:
    """Fit each joint's motion in turn, in place, given the others'."""
    moved = [np.flatnonzero(each) for each in weights.T]
    shares = [weights[own, k, None] * _local(rest[own], centers[k]) for k, own in enumerate(moved)]
    residual, parts = paths.copy(), []
    for own, share, motion in zip(moved, shares, motions, strict=True):
        parts.append(share @ motion)
        residual[own] -= parts[-1]
    for k, own in enumerate(moved):
        if not len(own):
            continue
        w, share = weights[own, k], shares[k]
        left = residual[own] + parts[k]  # what this joint alone should make: w (R x + t)
        square = np.square(w).sum()
        middle = w @ share[:, :3] / square
        # The sums of w^2 q and of w^2 q (x - middle)^T over the vertices, with q = left / w.
        sums = np.vstack([share[:, :3].T - middle[:, None] * w, w]) @ left
        turned = _nearest_rotation(sums[:3].reshape(3, -1, 3).transpose(1, 2, 0)).transpose(2, 0, 1).reshape(3, -1)
        motions[k, :3], motions[k, 3] = turned, sums[3] / square - middle @ turned
        residual[own] = left - share @ motions[k]


def _nearest_rotation(matrices: FloatArray) -> FloatArray:
    """The rotations nearest to matrices, shape (F, 3, 3)."""
    u, _, vt = np.linalg.svd(matrices)
    flip = np.linalg.det(u @ vt)
    u[:, :, 2] *= flip[:, None]
    return u @ vt


def _weights(
    paths: FloatArray, rest: FloatArray, centers: FloatArray, nearest: NDArray[np.intp], motions: FloatArray
) -> FloatArray:
    """Each vertex's weights, none of them negative, given the joints' motions."""
    apart = np.empty((*nearest.shape, paths.shape[1]))
    for k, motion in enumerate(motions):
        own, slot = np.nonzero(nearest == k)
        apart[own, slot] = _local(rest[own], centers[k]) @ motion - paths[own]
    weights = np.zeros((len(rest), len(centers)))
    np.put_along_axis(weights, nearest, blend(apart @ apart.transpose(0, 2, 1), INFLUENCES), axis=1)
    return weights
