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
from cape.exports.skinned.candidates import Candidates, local_places, shares
from cape.exports.skinned.joint_motions import fit_motions
from cape.exports.skinned.joints import Joints

FloatArray = NDArray[np.float64]
INFLUENCES = 4  # joints that a vertex follows: what engines take at once
ROUNDS = 6  # of weights and motions in turn; each further one gains less
ROUGH = 0.01  # [rad] rotations are found to about its square before the weights are
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
        local = local_places(self.rest, self.centers[self.influences])
        motions = _as_rows(self.rotations, self.places)
        found = shares(self.weights, self.influences, local, len(motions)) @ motions.reshape(-1, motions.shape[2])
        return np.ascontiguousarray(found.reshape(len(self.rest), -1, 3).transpose(1, 0, 2))


def fit(positions: FloatArray, joints: Joints) -> Skin:
    """Fit a skin to a motion.

    Args:
        positions: of the vertices [m], shape (F, V, 3).
        joints: where they are on it.
    """
    frames, count = len(positions), len(joints.vertices)
    rest = positions[0]
    candidates = Candidates.among(joints, rest)
    paths = _paths(positions)
    motions = _as_rows(np.tile(np.eye(3), (frames, count, 1, 1)), positions[:, joints.vertices])
    sampled = np.unique(np.linspace(0, frames - 1, min(frames, SAMPLES)).astype(int))
    columns = (3 * sampled[:, None] + np.arange(3)).ravel()
    some, moved = np.take(paths, columns, axis=1), np.take(motions, columns, axis=2)
    weights = candidates.first_weights(INFLUENCES)
    for _ in range(ROUNDS):
        fit_motions(moved, some, candidates, weights, last=ROUGH)
        weights = _weights(some, candidates, moved, weights)
    motions = _in_all_frames(moved, positions[:, joints.vertices], sampled)
    for _ in range(2):
        fit_motions(motions, paths, candidates, weights)
    order = np.argsort(-weights, axis=1, kind="stable")[:, :INFLUENCES]
    influences = np.take_along_axis(candidates.joints, order, axis=1)
    kept = np.take_along_axis(weights, order, axis=1)
    missing = ((0, 0), (0, INFLUENCES - order.shape[1]))
    rows = motions.reshape(count, 4, frames, 3)
    return Skin(
        rest,
        candidates.centers,
        np.pad(influences, missing),
        np.pad(kept / kept.sum(axis=1, keepdims=True), missing),
        rotations=rows[:, :3].transpose(2, 0, 3, 1),
        places=rows[:, 3].transpose(1, 0, 2),
    )


def _paths(positions: FloatArray) -> FloatArray:
    """The vertices' paths, shape (V, 3F)."""
    return positions.transpose(1, 0, 2).reshape(positions.shape[1], -1)


def _as_rows(rotations: FloatArray, places: FloatArray) -> FloatArray:
    """Rotations (F, K, 3, 3) and places (F, K, 3) as the joints' motions, shape (K, 4, 3F)."""
    rows = np.concatenate([rotations.transpose(1, 3, 0, 2), places.transpose(1, 0, 2)[:, None]], axis=1)
    return rows.reshape(len(rows), 4, -1)


def _in_all_frames(motions: FloatArray, places: FloatArray, sampled: NDArray[np.intp]) -> FloatArray:
    """Motions from those in sampled frames: of others the nearest, moved as the vertex that the joint is at has moved.

    Args:
        motions: in the sampled frames alone, shape (K, 4, 3S).
        places: of the joints' vertices in all frames [m], shape (F, K, 3).
        sampled: the frames, shape (S,).
    """
    frames, count = places.shape[:2]
    nearest = np.abs(np.arange(frames)[:, None] - sampled).argmin(axis=1)
    found = motions.reshape(count, 4, -1, 3)[:, :, nearest]
    found[:, 3] += (places - places[sampled[nearest]]).swapaxes(0, 1)
    return found.reshape(count, 4, -1)


def _weights(paths: FloatArray, candidates: Candidates, motions: FloatArray, before: FloatArray) -> FloatArray:
    """Each vertex's weights, none of them negative, given the joints' motions and what they were before."""
    rows, n = motions.reshape(-1, motions.shape[2]), before.shape[1]
    products = np.empty((len(paths), n, n))
    for own, guesses in candidates.guesses:
        apart = (guesses @ rows).reshape(-1, n, rows.shape[1])
        apart -= paths[own, None]
        products[own] = apart @ apart.transpose(0, 2, 1)
    return blend(products, INFLUENCES, before)
