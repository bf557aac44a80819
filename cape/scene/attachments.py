"""What holds a cloth: vertices that move with a bone."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.cloth.cloth import Cloth
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Attachment:
    """Vertices that a bone carries along.

    Attributes:
        bone: name of the bone, or the role it plays, such as "left_shoulder".
        vertices: indices of the n vertices, shape (n,).
        points: where the bone holds them, in its frame [m], shape (n, 3); None for where they are when the cloth is
            put on: on the neckline for the top row of a cape, otherwise where they start.
        within: keep only those of the vertices that are within this distance of the bone's origin when the cloth is
            put on [m]; None for all.
    """

    bone: str
    vertices: NDArray[np.int64]
    points: FloatArray | None = None
    within: float | None = None


def attach(
    cloth: Cloth,
    bone: str,
    vertices: str | Sequence[int] | NDArray[np.integer] | None = None,
    *,
    points: ArrayLike | None = None,
    within: float | None = None,
) -> Attachment:
    """Attach vertices of a cloth to a bone.

    Args:
        cloth: whose vertices.
        bone: a bone's name, or a role such as "left_shoulder"; which bones there are is known once a track is given.
        vertices: a named region of the cloth, indices, or None for all vertices `within` a distance.
        points: where in the bone's frame to hold them [m], shape (n, 3), or None for where they are when put on.
        within: distance from the bone's origin [m] beyond which vertices are left out.

    Raises:
        UnknownNameError: the cloth has no such region.
        ValueRangeError: an index is outside of the cloth, points and vertices differ in number, nothing is selected.
    """
    if vertices is None and within is None:
        raise ValueRangeError(f"attach to {bone!r}: name the vertices, or give a distance with within=")
    if within is not None and not within > 0.0:
        raise ValueRangeError(f"attach to {bone!r}: the distance must be positive, not {within}")
    chosen = np.arange(cloth.vertices) if vertices is None else cloth.region(vertices)
    held = None if points is None else np.array(points, dtype=float).reshape(-1, 3)
    if held is not None and (within is not None or len(held) != len(chosen) or not np.isfinite(held).all()):
        raise ValueRangeError(
            f"attach to {bone!r}: points must be finite, one for each of the {len(chosen)} vertices, without within="
        )
    return Attachment(bone, chosen, held, within)
