"""What a user should look at after a run, a sentence each."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cape.colliders import Collider

FloatArray = NDArray[np.float64]

NOTABLE_PENETRATION = 0.005  # m
NOTABLE_STRETCH = 0.1


def penetration_warnings(depths: FloatArray, which: NDArray[np.int64], colliders: Sequence[Collider]) -> list[str]:
    """Name the colliders that vertices went notably deep into; depth [m] and index of the deepest each frame, (F,)."""
    notable = depths > NOTABLE_PENETRATION
    warnings = []
    for index in np.unique(which[notable]):
        frames = np.flatnonzero(notable & (which == index))
        worst = int(frames[depths[frames].argmax()])
        warnings.append(
            f"the cloth enters {colliders[index].name} by up to {1000 * depths[worst]:.1f} mm at frame {worst}, "
            f"for {len(frames)} frames: limbs that pass through each other leave it no place"
        )
    return warnings


def stretch_warnings(strains: FloatArray) -> list[str]:
    """Tell of notable stretch; the largest strain of each frame, shape (F,)."""
    worst, frames = int(strains.argmax()), int((strains > NOTABLE_STRETCH).sum())
    if frames == 0:
        return []
    return [
        f"the cloth stretches by up to {strains[worst]:.0%} at frame {worst}, for {frames} frames: "
        "use a stiffer fabric, more substeps (xpbd), or look whether limbs hold it fast"
    ]
