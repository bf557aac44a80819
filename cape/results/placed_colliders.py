"""The colliders of a take where its bones have them, and how deep points are in them."""

import numpy as np
from numpy.typing import NDArray

from cape.results.take import Take
from cape.scene.enclosing import Enclosing
from cape.scene.poses import Pose, read_pose
from motions import quaternions
from skeleton.shapes import require_known
from skeleton.solid_measures import signed_distance

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class PlacedColliders:
    """The colliders of a take, where its bones have them."""

    def __init__(self, take: Take, margin: float = 0.0) -> None:
        """Of all of a take's colliders, each grown by a margin [m].

        Raises:
            UnknownNameError: a collider is of no shape in `skeleton.shapes.SHAPES`.
        """
        require_known(take.colliders)
        self._margin = margin
        track = take.bones
        self._solids = take.colliders
        self._track, self._bones = track, tuple(dict.fromkeys(c.bone for c in take.colliders if c.bone is not None))
        self._numbers = [track.index(bone) for bone in self._bones]
        placed = {
            bone: (track.positions[:, b], quaternions.to_matrix(track.rotations_wxyz[:, b]))
            for bone, b in zip(self._bones, self._numbers, strict=True)
        }
        self._places = [None if c.bone is None else placed[c.bone] for c in take.colliders]
        self._enclosing = Enclosing.of(take.colliders, self._bones)

    def in_bone(self, collider: int, frame: int | IntArray, points: FloatArray) -> FloatArray:
        """Bring points in the world (N, 3) [m], at a frame or one each, into the frame of the collider's bone."""
        place = self._places[collider]
        if place is None:
            return points
        positions, bone_to_world = place
        if isinstance(frame, np.ndarray):
            return np.einsum("ni,nij->nj", points - positions[frame], bone_to_world[frame])
        return (points - positions[frame]) @ bone_to_world[frame]

    def depth(self, collider: int, frame: int | IntArray, points: FloatArray) -> FloatArray:
        """Depths of points in the world (N, 3) [m], at a frame or one each, in a collider grown by the margin, (N,)."""
        return self._margin - signed_distance(self._solids[collider], self.in_bone(collider, frame, points))

    def within_reach(self, frame: int, points: FloatArray) -> list[int]:
        """Colliders that touch the sphere around all points."""
        middle = points.mean(axis=0)
        reach = float(np.linalg.norm(points - middle, axis=1).max())
        chosen = self._track.positions[frame, self._numbers], self._track.rotations_wxyz[frame, self._numbers]
        near = self._enclosing.near(read_pose(Pose(*chosen), self._bones), points, self._margin)
        return [int(c) for c in near if self.depth(c, frame, middle[None])[0] > -reach]
