"""The motions of joints that put vertices of given weights as near to their paths as can be.

Each joint's is fitted to what the others leave of the paths, in turn. A joint's least squares need no more of the
vertices than sums over them, which are taken once: N = S^T S and T = S^T P, where vertex after vertex S has its
shares, the weights times (x, y, z, 1), and P the paths. Joints that share no vertex don't meet in N: those among them
that no other one comes between are fitted at once.
"""

import numpy as np
from numpy.typing import NDArray

from cape.exports.skinned.candidates import Candidates, shares
from cape.exports.skinned.rotations import EXACT, nearest_rotations

FloatArray = NDArray[np.float64]


def fit_motions(
    motions: FloatArray, paths: FloatArray, candidates: Candidates, weights: FloatArray, *, last: float = EXACT
) -> None:
    """Fit each joint's motion in turn, in place, given the others'.

    Args:
        motions: of K joints, rotations as rows and places [m], shape (K, 4, 3F).
        paths: of the vertices [m], shape (V, 3F).
        candidates: the joints that each vertex may follow.
        weights: by how much it does, shape (V, n).
        last: rotations that a step turns by less are taken to be found [rad].
    """
    count = len(motions)
    products, wanted = _sums(paths, candidates, weights)
    ties = products.reshape(count, 4, count, 4)
    shared = ties[:, 3, :, 3]  # sums of products of two joints' weights
    rows = motions.reshape(4 * count, -1)
    for group in _in_turn(shared > 0.0):
        left = wanted.reshape(count, 4, -1)[group]  # what these alone should make: T, less what the others do
        middles = ties[group, 3, group, :3] / shared[group, group, None]
        for k, own in zip(group, left, strict=True):
            others = (4 * _others(shared[k], k)[:, None] + np.arange(4)).ravel()
            own -= products[4 * k : 4 * k + 4, others] @ rows[others]
        left[:, :3] -= middles[:, :, None] * left[:, 3:]
        as_rows = (3, -1, 3)
        wished, now = (each[:, :3].swapaxes(0, 1).reshape(as_rows) for each in (left, motions[group]))
        turned = nearest_rotations(wished, now, last=last)
        motions[group, :3] = turned.reshape(3, len(group), -1).swapaxes(0, 1)
        motions[group, 3] = left[:, 3] / shared[group, group, None]
        motions[group, 3] -= np.einsum("ka,kaf->kf", middles, motions[group, :3])


def _sums(paths: FloatArray, candidates: Candidates, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """S^T S, shape (4K, 4K), and S^T P, shape (4K, 3F)."""
    shared = shares(weights, candidates.joints, candidates.local, len(candidates.centers))
    transposed = shared.T.tocsr()
    return (transposed @ shared).toarray(), transposed @ paths


def _others(shared: FloatArray, own: int) -> NDArray[np.intp]:
    found = np.flatnonzero(shared)
    return found[found != own]


def _in_turn(tied: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """All joints that have vertices in groups, the fewest that do the same as one joint after another."""
    level = np.zeros(len(tied), np.intp)
    for k in range(1, len(tied)):
        level[k] = level[:k][tied[k, :k]].max(initial=-1) + 1
    own = np.flatnonzero(tied.diagonal())
    return [own[level[own] == each] for each in np.unique(level[own])]
