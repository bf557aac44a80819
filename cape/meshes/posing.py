"""Which pose a cloth was modelled on: the one whose arms do not pass through it."""

import numpy as np
from numpy.typing import NDArray

from cape.garments.fitting import Fitted
from cape.measure.wearing import ray_hits

FloatArray = NDArray[np.float64]

ARMS = (90.0, 75.0, 60.0, 45.0, 30.0, 15.0, 3.0)  # degrees from the direction down the trunk: from the T pose on
LIMB = ("upper_arm", "forearm", "hand")


def modelled_arms(positions: FloatArray, triangles: NDArray[np.integer], fitted: Fitted) -> float:
    """Angle of the arms [degrees] that cross a cloth least often, and of those lie least deep in it; the widest first.

    Args:
        positions: x forward, y left, z up, in the wearer's frame [m], shape (V, 3).
        triangles: shape (T, 3).
        fitted: the body in any pose.
    """
    corners = positions[triangles]
    middles = np.concatenate([positions, corners.mean(axis=1)])
    costs = []
    for angle in ARMS:
        posed = fitted.with_arms(float(np.radians(angle)))
        arms = [piece for side in ("left", "right") for piece in posed.segments(*(f"{side}_{part}" for part in LIMB))]
        deep = -np.minimum(posed.distances(middles, within=0.0), 0.0).sum()
        costs.append((_crossings(arms, corners), round(float(deep), 6)))
    return ARMS[min(range(len(ARMS)), key=lambda k: costs[k])]


def _crossings(segments: list[tuple[FloatArray, FloatArray]], corners: FloatArray) -> int:
    """How often segments [m] pass through triangles (T, 3, 3)."""
    total = 0
    for start, end in segments:
        length = np.linalg.norm(end - start)
        if length > 0.0:
            ways = ray_hits(start[None], ((end - start) / length)[None], corners[None])
            total += int(np.count_nonzero(ways < length))
    return total
