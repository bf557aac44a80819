"""Where a cloth touches colliders."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class ContactPoints:
    """The contacts of vertices with colliders at the ends of F frames, n in all.

    A vertex is in contact with each collider within whose thickness, or a little beyond it, it is.

    Attributes:
        starts: those of frame f go from `starts[f]` to `starts[f + 1]`, shape (F + 1,).
        points: on the collider's surface, in the world [m], shape (n, 3).
        normals: out of the collider there, of unit length, shape (n, 3).
        depths: of the vertex in the collider's thickness [m]; beyond the thickness itself it is in the collider.
            Shape (n,).
        colliders: index of the collider, shape (n,).
        vertices: index of the vertex, shape (n,).
    """

    starts: NDArray[np.int64]
    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    depths: NDArray[np.float32]
    colliders: NDArray[np.int32]
    vertices: NDArray[np.int32]

    @classmethod
    def none(cls, frames: int) -> "ContactPoints":
        """No contact in so many frames."""
        vectors, index = np.zeros((0, 3), np.float32), np.zeros(0, np.int32)
        return cls(np.zeros(frames + 1, np.int64), vectors, vectors, vectors[:, 0], index, index)

    @classmethod
    def joined(cls, parts: Sequence["ContactPoints"]) -> "ContactPoints":
        """The contacts of one run of frames after the other; at least one."""
        offsets = np.cumsum([0, *(part.starts[-1] for part in parts)])
        starts = [np.zeros(1, np.int64)] + [o + p.starts[1:] for o, p in zip(offsets[:-1], parts, strict=True)]
        names = ("points", "normals", "depths", "colliders", "vertices")
        return cls(np.concatenate(starts), *(np.concatenate([getattr(p, name) for p in parts]) for name in names))

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of contacts of each frame, shape (F,)."""
        return np.diff(self.starts)

    @property
    def frames(self) -> NDArray[np.int64]:
        """Frame of each contact, shape (n,)."""
        return np.repeat(np.arange(len(self.starts) - 1), self.counts)

    def select(self, frames: NDArray[np.int64]) -> "ContactPoints":
        """The contacts of the given frames, in their order."""
        counts = self.counts[frames]
        starts = np.concatenate([[0], np.cumsum(counts)])
        rows = np.arange(starts[-1]) + np.repeat(self.starts[frames] - starts[:-1], counts)
        return ContactPoints(
            starts, self.points[rows], self.normals[rows], self.depths[rows], self.colliders[rows], self.vertices[rows]
        )
