"""The joints that each vertex may follow: those that are nearest to it along the cloth."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.exports.skinned.joints import Joints

FloatArray = NDArray[np.float64]
MOST = 8  # joints, out of which those that a vertex follows are chosen
AT_ONCE = 64  # vertices whose guesses stay near the processor
NARROWEST = 0.01  # [m] distances to which a vertex's first weights are told apart


def shares(weights: FloatArray, joints: NDArray[np.intp], local: FloatArray, count: int) -> Any:
    """A sparse matrix that takes the motions of `count` joints as rows, (4 count, 3F), to the paths that they blend to.

    Args:
        weights: of V points, shape (V, n).
        joints: that they are of, shape (V, n).
        local: places of the points as these joints at rest have them, and a one, shape (V, n, 4).
        count: of all joints.
    """
    from scipy.sparse import csr_array

    point, slot = np.nonzero(weights)
    values = weights[point, slot, None] * local[point, slot]
    columns = 4 * joints[point, slot, None] + np.arange(4)
    starts = 4 * np.searchsorted(point, np.arange(len(weights) + 1))
    return csr_array((values.ravel(), columns.ravel(), starts), shape=(len(weights), 4 * count))


def local_places(rest: FloatArray, centers: FloatArray) -> FloatArray:
    """Places as joints have them whose axes are the world's, with a one for the joint's own place, shape (V, n, 4).

    Args:
        rest: places [m], shape (V, 3).
        centers: of n joints for each [m], shape (V, n, 3).
    """
    local = np.ones((*centers.shape[:2], 4))
    local[..., :3] = rest[:, None] - centers
    return local


@dataclass(frozen=True, eq=False)
class Candidates:
    """n of K joints for each of V vertices.

    Attributes:
        joints: the nearest first, shape (V, n).
        distances: to them [m], shape (V, n).
        centers: places of all joints at rest [m]; their axes are the world's, shape (K, 3).
        local: places of the vertices as these joints at rest have them, with a one for a joint's own place,
            shape (V, n, 4).
    """

    joints: NDArray[np.intp]
    distances: FloatArray
    centers: FloatArray
    local: FloatArray

    @classmethod
    def among(cls, joints: Joints, rest: FloatArray) -> "Candidates":
        """The nearest of joints, where the vertices rest [m], shape (V, 3)."""
        nearest = np.argsort(joints.distances, axis=0, kind="stable")[:MOST].T
        centers = rest[joints.vertices]
        distances = np.take_along_axis(joints.distances.T, nearest, axis=1)
        return cls(nearest, distances, centers, local_places(rest, centers[nearest]))

    @cached_property
    def guesses(self) -> list[tuple[slice, Any]]:
        """What takes the joints' motions as rows, (4K, 3F), to the candidates' guesses of some vertices' paths, a guess
        a row; with those vertices."""
        found = []
        for begin in range(0, len(self.joints), AT_ONCE):
            part = slice(begin, begin + AT_ONCE)
            joints, local = self.joints[part].reshape(-1, 1), self.local[part].reshape(-1, 1, 4)
            found.append((part, shares(np.ones(joints.shape), joints, local, len(self.centers))))
        return found

    def first_weights(self, most: int) -> FloatArray:
        """Weights by distance alone, none for more than the `most` nearest, shape (V, n)."""
        weights = 1.0 / (np.square(self.distances) + NARROWEST**2)
        weights[:, most:] = 0.0
        return weights / weights.sum(axis=1, keepdims=True)
