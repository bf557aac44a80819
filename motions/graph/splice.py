"""Stretches of clips and the blends between them, one after the other, into one motion through the world."""

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.graph.blend import Blends
from motions.graph.blend_source import Source

FloatArray = NDArray[np.float64]


class Splice:
    """Frames so far, and how the clip that is played now stands in the world.

    Attributes:
        frames: number of frames so far.
    """

    def __init__(self) -> None:
        """Begin with no frame; the first clip stands in the world as it is."""
        self.frames = 0
        self._rotations: list[FloatArray] = []
        self._local_positions: list[FloatArray] = []
        self._morphs: list[FloatArray] = []
        self._turn = np.array([1.0, 0.0, 0.0, 0.0])  # clip_to_world, about +Z
        self._shift = np.zeros(3)  # [m], after the turn

    def play(self, source: Source, first: int, last: int) -> None:
        """Add the frames of a clip from the first to the last, both included."""
        frames = np.arange(first, last + 1).astype(float)
        rotations, local, _ = source.at(frames[None])
        self._add(rotations[0], local[0], source.morphs_at(frames))

    def pass_over(self, blends: Blends) -> None:
        """Add what lies between the ends of a single blend, and go on with the clip that it leads to."""
        self._add(blends.rotations_wxyz[0, 1:-1], blends.local_positions[0, 1:-1], blends.morphs[0, 1:-1])
        self._shift = self._shift + quaternions.rotate(self._turn, blends.shifts[0])
        self._turn = quaternions.normalize(quaternions.multiply(self._turn, blends.turns[0]))

    def poses(self) -> tuple[FloatArray, FloatArray]:
        """All frames.

        Returns:
            Unit quaternions joint_to_parent (w, x, y, z), signs continuous, shape (F, J, 4), and positions in the
            parent's frame, the root's in the world [m], shape (F, J, 3).
        """
        rotations = quaternions.make_continuous(np.concatenate(self._rotations))
        return rotations, np.concatenate(self._local_positions)

    def morphs(self) -> FloatArray:
        """Weights of the mesh's M morphs in all frames, shape (F, M)."""
        return np.concatenate(self._morphs)

    def _add(self, rotations: FloatArray, local_positions: FloatArray, morphs: FloatArray) -> None:
        rotations, local_positions = rotations.copy(), local_positions.copy()
        rotations[:, 0] = quaternions.multiply(self._turn, rotations[:, 0])
        local_positions[:, 0] = quaternions.rotate(self._turn, local_positions[:, 0]) + self._shift
        self._rotations.append(rotations)
        self._local_positions.append(local_positions)
        self._morphs.append(morphs)
        self.frames += len(rotations)
