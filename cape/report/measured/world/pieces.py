"""Level strips of a fabric, cut along its threads or between them."""

import math

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import Cloth
from cape.cloth.fabric import Fabric
from cape.report.measured.world import triangulations

GRID = "grid"

# Rows: where a strip's length and width point to in the pattern, along weft and warp.
PATTERN_OF: dict[str, NDArray[np.float64]] = {
    "warp": np.array([[0.0, 1.0], [-1.0, 0.0]]),
    "weft": np.array([[1.0, 0.0], [0.0, 1.0]]),
    "bias": np.array([[1.0, 1.0], [-1.0, 1.0]]) / math.sqrt(2.0),
}


def strip_of(fabric: Fabric, direction: str, variant: str, length: float, spacing: float, width: int) -> Cloth:
    """A level strip from the origin along the world's X, `direction` of the fabric lying along it.

    Args:
        fabric: what it is made of.
        direction: "warp", "weft", or "bias", at 45 degrees to both, which a grid can't have.
        variant: "grid", or a kind of triangulation.
        length: along X [m].
        spacing: of the vertices [m].
        width: in cells, along Y.
    """
    wide, x, y = width * spacing, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    if variant != GRID:
        piece = triangulations.strip(variant, length, wide, spacing)
        places = np.column_stack([piece.points, np.zeros(len(piece.points))])
        pattern = piece.points @ PATTERN_OF[direction]
        return Cloth.from_mesh(places, piece.triangles, pattern=pattern, fabric=fabric)
    if direction == "warp":
        return Cloth.rectangle(width=wide, height=length, spacing=spacing, fabric=fabric, right=y, down=x)
    return Cloth.rectangle(width=length, height=wide, spacing=spacing, fabric=fabric, right=x, down=y)
