"""Wakes: where bodies keep the wind off."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from skeleton.shapes.base import Bounded, Shape

FloatArray = NDArray[np.float64]

DRAG = 1.2  # coefficient of a cylinder across the wind, for its width
SPREAD = 0.18  # that Schlichting found for the mixing length, as a share of the wake's half width
CALM = 1e-6  # m/s


class Wakes:
    """What solids leave of a wind behind them.

    Behind a cylinder of diameter d across a wind of speed U, x downstream and y aside, the wind is slower by

        u / U = sqrt(10) / (18 b) (x / (c d))^(-1/2) (1 - (y / w)^(3/2))^2,   w = sqrt(10) b (x c d)^(1/2)

    with its drag coefficient c and b = 0.18 (H. Schlichting, Ing.-Archiv 1, 1930, 533). Nearer than where that is as
    wide as the cylinder, all wind is kept off as far as the cylinder is wide. Of several wakes the strongest counts.
    """

    def __init__(self, solids: Sequence[Shape], bones: Sequence[str]) -> None:
        """Take the solids that end somewhere, each as a capsule; `bones` are in the order of poses, the world last."""
        self._limbs: list[tuple[int, FloatArray, FloatArray, float]] = []
        for solid in solids:
            if not isinstance(solid, Bounded):
                continue
            bone = len(bones) if solid.bone is None else list(bones).index(solid.bone)
            limb = solid.as_capsule()
            if limb is None:
                middle = solid.balls()[0].mean(axis=0)
                self._limbs.append((bone, middle, middle, (0.75 * solid.volume() / math.pi) ** (1.0 / 3.0)))
            else:
                self._limbs.append((bone, limb.start, limb.end, limb.radius))

    def left(
        self, places: FloatArray, stream: FloatArray, positions: FloatArray, rotations_wxyz: FloatArray
    ) -> FloatArray:
        """The share of the wind that is left.

        Args:
            places: in the world [m], shape (V, 3).
            stream: velocity of the wind [m/s], shape (3,).
            positions: of the bones in the world [m], with the world itself last, shape (B + 1, 3).
            rotations_wxyz: unit quaternions bone_to_world, shape (B + 1, 4).

        Returns:
            0 to 1, shape (V,).
        """
        speed, off = float(np.linalg.norm(stream)), np.zeros(len(places))
        if speed < CALM:
            return 1.0 - off
        for bone, start, end, radius in self._limbs:
            turn = rotations_wxyz[bone]
            ends = [positions[bone] + quaternions.rotate(turn, point) for point in (start, end)]
            off = np.maximum(off, slowing(places, ends[0], ends[1], radius, stream / speed))
        return 1.0 - off


def slowing(places: FloatArray, start: FloatArray, end: FloatArray, radius: float, along: FloatArray) -> FloatArray:
    """The share by which the wind along a unit vector (3,) is slower behind a capsule, at places [m] (V, 3), (V,)."""
    # As seen along the wind: where on the capsule's axis each place is nearest, how far aside, how far behind.
    axis, off = end - start, places - start
    seen_axis, seen_off = axis - (axis @ along) * along, off - (off @ along)[:, None] * along
    share = np.clip(seen_off @ seen_axis / max(float(seen_axis @ seen_axis), 1e-12), 0.0, 1.0)
    aside = np.linalg.norm(seen_off - share[:, None] * seen_axis, axis=1)
    behind = (off - share[:, None] * axis) @ along
    width = DRAG * 2.0 * radius
    half = math.sqrt(10.0) * SPREAD * np.sqrt(np.maximum(behind, 0.0) * width)
    near = half < radius
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = math.sqrt(10.0) / (18.0 * SPREAD) * np.sqrt(width / behind)
        far = np.minimum(middle, 1.0) * (1.0 - np.minimum(aside / half, 1.0) ** 1.5) ** 2
    return np.where(behind <= 0.0, 0.0, np.where(near, (aside < radius).astype(float), far))
