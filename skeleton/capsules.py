"""Capsules around limbs."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Capsule:
    """All points within `radius` of a segment that moves with a bone.

    Attributes:
        name: unique name, the role where the bone plays one, otherwise the bone's own.
        bone: name of the bone that carries it, None for one that stands still in the world.
        start: one end of the segment in the bone's frame [m], shape (3,).
        end: the other end in the bone's frame [m], shape (3,).
        radius: [m].
        friction: Coulomb coefficient against cloth, None for the scene's default.
    """

    name: str
    bone: str | None
    start: NDArray[np.float64]
    end: NDArray[np.float64]
    radius: float
    friction: float | None = None
