"""Rigid motions of joints, and weights of vertices, that follow a cloth's motion as well as can be.

After Le and Deng, "Smooth skinning decomposition with rigid bones" (ACM Transactions on Graphics 31, 6, 2012): in turn
the weights are fitted to the joints' motions, vertex by vertex, and each joint's motion to what the others leave of
it, frame by frame, a weighted absolute orientation. Joints stay where they were spread out.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cape.exports.skinned.joints import Joints

FloatArray = NDArray[np.float64]
INFLUENCES = 4  # joints that a vertex follows: what engines take at once
CANDIDATES = 8  # the nearest joints, out of which those are chosen
ROUNDS = 6  # of weights and motions in turn; further ones gain less than 2 % each
SAMPLES = 120  # frames to which the weights are fitted
ONE = 1e3  # weight of the sum of a vertex's weights being one, beside its place


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
        found = np.zeros((len(self.places), *self.rest.shape))
        for slot in range(INFLUENCES):
            joint = self.influences[:, slot]
            local = self.rest - self.centers[joint]
            turned = np.einsum("fvij,vj->fvi", self.rotations[:, joint], local) + self.places[:, joint]
            found += self.weights[:, slot, None] * turned
        return found


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
    rotations = np.tile(np.eye(3), (frames, count, 1, 1))
    places = positions[:, joints.vertices].copy()
    sampled = np.unique(np.linspace(0, frames - 1, min(frames, SAMPLES)).astype(int))
    for _ in range(ROUNDS):
        rotations[sampled], places[sampled] = _motions(
            positions[sampled], rest, centers, weights, rotations[sampled], places[sampled]
        )
        weights = _weights(positions[sampled], rest, centers, nearest, rotations[sampled], places[sampled])
    for _ in range(2):
        rotations, places = _motions(positions, rest, centers, weights, rotations, places)
    influences = np.argsort(-weights, axis=1, kind="stable")[:, :INFLUENCES]
    if count < INFLUENCES:
        influences = np.pad(influences, ((0, 0), (0, INFLUENCES - count)))
    kept = np.take_along_axis(weights, influences, axis=1)
    kept[:, count:] = 0.0
    return Skin(rest, centers, influences, kept / kept.sum(axis=1, keepdims=True), rotations, places)


def _motions(
    positions: FloatArray,
    rest: FloatArray,
    centers: FloatArray,
    weights: FloatArray,
    rotations: FloatArray,
    places: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Each joint's motion in turn, given the others'."""
    rotations, places = rotations.copy(), places.copy()
    moved = [np.flatnonzero(weights[:, k]) for k in range(weights.shape[1])]
    residual = positions.copy()
    parts = []
    for k, own in enumerate(moved):
        part = weights[own, k, None] * _turned(rest[own] - centers[k], rotations[:, k], places[:, k])
        residual[:, own] -= part
        parts.append(part)
    for k, own in enumerate(moved):
        if not len(own):
            continue
        w, local = weights[own, k], rest[own] - centers[k]
        left = residual[:, own] + parts[k]  # what this joint alone should make: w (R x + t)
        square = np.square(w)
        middle = square @ local / square.sum()
        target = w @ left / square.sum()
        # The sum of w^2 (q - target) (x - middle)^T over the vertices, with q = left / w.
        spread = left.transpose(0, 2, 1) @ (w[:, None] * (local - middle))
        rotations[:, k] = _nearest_rotation(spread)
        places[:, k] = target - rotations[:, k] @ middle
        part = w[:, None] * _turned(local, rotations[:, k], places[:, k])
        residual[:, own] = left - part
    return rotations, places


def _turned(local: FloatArray, rotations: FloatArray, places: FloatArray) -> FloatArray:
    """Vectors from a joint in its rest (V, 3), as it has turned and moved them in each frame, shape (F, V, 3)."""
    return local @ rotations.transpose(0, 2, 1) + places[:, None]


def _nearest_rotation(matrices: FloatArray) -> FloatArray:
    """The rotations nearest to matrices, shape (F, 3, 3)."""
    u, _, vt = np.linalg.svd(matrices)
    flip = np.linalg.det(u @ vt)
    u[:, :, 2] *= flip[:, None]
    return u @ vt


def _weights(
    positions: FloatArray,
    rest: FloatArray,
    centers: FloatArray,
    nearest: NDArray[np.intp],
    rotations: FloatArray,
    places: FloatArray,
) -> FloatArray:
    """Each vertex's weights, none of them negative, given the joints' motions."""
    from scipy.optimize import nnls

    vertices, candidates = nearest.shape
    weights = np.zeros((vertices, len(centers)))
    for v in range(vertices):
        joint = nearest[v]
        columns = np.einsum("fkij,kj->fki", rotations[:, joint], rest[v] - centers[joint]) + places[:, joint]
        system = columns.transpose(0, 2, 1).reshape(-1, candidates)
        # From the vertex's own place, so that numbers are small beside those that hold the sum.
        target = positions[:, v].reshape(-1)
        matrix = np.vstack([system - target[:, None], np.full(candidates, ONE)])
        wanted = np.append(np.zeros(len(target)), ONE)
        found = nnls(matrix, wanted)[0]
        if np.count_nonzero(found) > INFLUENCES:
            best = np.sort(np.argsort(-found)[:INFLUENCES])
            found = np.zeros(candidates)
            found[best] = nnls(matrix[:, best], wanted)[0]
        weights[v, joint] = found / found.sum()
    return weights
