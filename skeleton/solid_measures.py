"""How far points are from a solid, and how much room it takes; in double precision, nothing shared with the solvers."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skeleton.shapes import Bounded, Shape, require_known

FloatArray = NDArray[np.float64]


def signed_distance(solid: Shape, points: FloatArray) -> FloatArray:
    """Distances of points (N, 3), in the frame of the solid's bone, from its surface [m], negative inside, shape (N,).

    All solids are convex, so the distance is a convex function of the point that changes no faster than the point
    moves.

    Raises:
        UnknownNameError: the solid is of no shape in `skeleton.shapes.SHAPES`.
    """
    require_known((solid,))
    return solid.distances(points)


def volume(solid: Shape) -> float:
    """Volume of a solid [m^3], infinite for a half-space.

    Raises:
        UnknownNameError: the solid is of no shape in `skeleton.shapes.SHAPES`.
    """
    require_known((solid,))
    return solid.volume()


def union_volume(solids: Sequence[Bounded], *, across: int = 24) -> float:
    """Volume of the union of solids in one frame [m^3], from a grid of so many points across the box around them.

    A single solid's is exact. Of each cell that the surface cuts, half is wrong at most: with 24 points across, the
    error stays below 5 % for solids that fill a third of their box.

    Raises:
        UnknownNameError: a solid is of no shape in `skeleton.shapes.SHAPES`.
    """
    if len(solids) == 1:
        return volume(solids[0])
    corners = [solid.bounds() for solid in solids]
    low, high = np.min([low for low, _ in corners], axis=0), np.max([high for _, high in corners], axis=0)
    shares = (np.arange(across) + 0.5) / across
    grid = low + np.stack(np.meshgrid(shares, shares, shares), axis=-1).reshape(-1, 3) * (high - low)
    inside = np.min([signed_distance(solid, grid) for solid in solids], axis=0) <= 0.0
    return float(inside.mean() * np.prod(high - low))
