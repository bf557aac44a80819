"""Boxes."""

# Coal lies in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.border import checked
from skeleton.shapes.base import TINY, UNIT_TOLERANCE, Layout, lengths, upright
from skeleton.shapes.hulls import HullOfBalls
from skeleton.shapes.outlines import BoxOutline

FloatArray = NDArray[np.float64]


def nearest(x, y, z, half_x, half_y, half_z, _h):
    """Box of the given half sizes around the origin.

    Inside, the nearest face gives the normal; of faces at equal depth the first in the order x, y, z. After Ericson,
    "Real-Time Collision Detection" (2005), 5.1.4.
    """
    qx, qy, qz = abs(x) - half_x, abs(y) - half_y, abs(z) - half_z
    sx, sy, sz = math.copysign(1.0, x), math.copysign(1.0, y), math.copysign(1.0, z)
    depth = max(qx, max(qy, qz))
    ox, oy, oz = max(qx, 0.0), max(qy, 0.0), max(qz, 0.0)
    off = math.sqrt(ox * ox + oy * oy + oz * oz)
    scale = 1.0 / max(off, TINY)
    outside = off > TINY
    first = qx >= depth
    second = (qy >= depth) & (not first)
    third = not (first | second)
    return (
        off + min(depth, 0.0),
        sx * (ox * scale if outside else (1.0 if first else 0.0)),
        sy * (oy * scale if outside else (1.0 if second else 0.0)),
        sz * (oz * scale if outside else (1.0 if third else 0.0)),
    )


@checked
@dataclass(frozen=True, eq=False, kw_only=True)
class Box(HullOfBalls):
    """A solid cuboid.

    Attributes:
        name: unique name.
        bone: name of the bone that carries it, None for one that stands still in the world.
        center: in the bone's frame [m], shape (3,).
        half_sizes: half the edge lengths [m], shape (3,).
        rotation_wxyz: unit quaternion (w, x, y, z) box_to_bone, shape (4,).
        friction: Coulomb coefficient against cloth, None for the scene's default.
        thickness: distance from the surface at which cloth is stopped [m], None for the scene's default.

    Raises:
        ValueRangeError: a value is out of range.
    """

    name: str = "box"
    center: FloatArray = field(default_factory=lambda: np.zeros(3))
    half_sizes: FloatArray = field(default_factory=lambda: np.full(3, 0.5))
    rotation_wxyz: FloatArray = field(default_factory=upright)

    numbers: ClassVar[Mapping[str, int]] = {"center": 3, "half_sizes": 3, "rotation_wxyz": 4}
    optional: ClassVar[tuple[str, ...]] = ("rotation_wxyz",)
    nearest = staticmethod(nearest)

    def _check(self) -> None:
        self._require((self.half_sizes > 0.0).all(), "half_sizes must be positive", self.half_sizes)
        unit = abs(np.linalg.norm(self.rotation_wxyz) - 1.0) < UNIT_TOLERANCE
        self._require(unit, "rotation_wxyz must be of unit length", self.rotation_wxyz)

    def describe(self) -> str:
        """Kind and edge lengths."""
        return f"{self.kind()} of " + " x ".join(f"{2000 * half:.0f}" for half in self.half_sizes) + " mm"

    def layout(self) -> Layout:
        """From the centre, along the edges; sizes are the half edge lengths [m]."""
        halves = tuple(float(h) for h in self.half_sizes)
        return Layout(self.center, quaternions.to_matrix(self.rotation_wxyz), halves, min(halves), 0.0)

    def distances(self, points: FloatArray) -> FloatArray:
        """Distances of points (N, 3) in the bone's frame from the surface [m], negative inside, shape (N,).

        Outside the way to the nearest point, inside that to the nearest face.
        """
        own = (points - self.center) @ quaternions.to_matrix(self.rotation_wxyz)
        beyond = np.abs(own) - self.half_sizes
        return lengths(np.maximum(beyond, 0.0)) + np.minimum(beyond.max(axis=1), 0.0)

    def volume(self) -> float:
        """Volume [m^3]."""
        return float(8.0 * np.prod(self.half_sizes))

    def grown(self, thickness: float) -> Self:
        """The same with its faces so much further out [m]; it keeps its sharp edges."""
        return replace(self, half_sizes=self.half_sizes + thickness)

    def core(self, share: float) -> Self:
        """What is deeper than all but a share of the smallest half size."""
        return replace(self, half_sizes=self.half_sizes - (1.0 - share) * self.half_sizes.min())

    def outline(self) -> BoxOutline:
        """The box itself."""
        return BoxOutline(self.center, self.half_sizes, self.rotation_wxyz)

    def collision_geometry(self) -> tuple[Any, FloatArray, FloatArray]:
        """`coal.Box`; turn and place in the bone's frame."""
        import coal

        return coal.Box(*(2.0 * self.half_sizes).tolist()), self.rotation_wxyz, self.center

    def balls(self) -> tuple[FloatArray, FloatArray]:
        """The corners: in the bone's frame [m], shape (8, 3), and no radii [m], shape (8,)."""
        corners = np.array(list(product((-1.0, 1.0), repeat=3))) * self.half_sizes
        return self.center + quaternions.rotate(self.rotation_wxyz, corners), np.zeros(8)
