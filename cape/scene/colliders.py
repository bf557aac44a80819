"""Solids that cloth can't enter, each on a bone or standing still in the world; and balls around them, which tell of
thousands at once which can't be near."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cape.scene.poses import Pose
from motions import quaternions
from skeleton.shapes import Bounded, Box, Capsule, Cylinder, Ellipsoid, Plane, Shape, Sphere, TaperedCapsule

Collider = Shape

__all__ = ["Box", "Capsule", "Collider", "Cylinder", "Ellipsoid", "Enclosing", "Plane", "Sphere", "TaperedCapsule"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_ROUNDING = 1e-9  # of a ball's radius and of its place: what a distance may be wrong by


@dataclass(frozen=True, eq=False)
class Enclosing:
    """A ball around each of C colliders, in the frame of the bone that carries it.

    Attributes:
        centers: [m], shape (C, 3).
        radii: [m], infinite for what has no end, shape (C,).
        bones: indices of the bones that carry them, shape (C,).
    """

    centers: FloatArray
    radii: FloatArray
    bones: IntArray

    @classmethod
    def of(cls, colliders: Sequence[Collider], bones: Sequence[str]) -> "Enclosing":
        """Enclose colliders that some of these bones carry, or the world, which comes after them."""
        numbers = {bone: number for number, bone in enumerate((*bones, None))}
        centers, radii = np.zeros((len(colliders), 3)), np.full(len(colliders), np.inf)
        for c, collider in enumerate(colliders):
            if isinstance(collider, Bounded):
                centers[c], radii[c] = collider.ball()
        radii += _ROUNDING * (radii + np.abs(centers).max(axis=1, initial=0.0))
        return cls(centers, radii, np.array([numbers[c.bone] for c in colliders], dtype=np.int64))

    def near(self, pose: Pose, points: FloatArray, within: float) -> IntArray:
        """Those that may be within a distance [m] of one of some points in the world [m], shape (n, 3), if any.

        The pose is of the bones, and of the world as the last.
        """
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        reach = np.sqrt(np.square(points - middle).sum(axis=1).max()) + within
        in_bones = quaternions.rotate(quaternions.conjugate(pose.rotations_wxyz), middle - pose.positions)
        away = np.sqrt(np.square(in_bones[self.bones] - self.centers).sum(axis=1))
        return np.flatnonzero(~(away > reach * (1.0 + _ROUNDING) + self.radii))
