"""Meshes of revolution: rings of vertices around the z axis, one above the other."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SECTORS = 24  # around the axis
_LONGITUDES = np.linspace(0.0, 2.0 * np.pi, SECTORS, endpoint=False)

AROUND: FloatArray = np.stack([np.cos(_LONGITUDES), np.sin(_LONGITUDES), np.zeros(SECTORS)], axis=1)
"""A ring of unit vectors across +Z, shape (SECTORS, 3)."""
AROUND.setflags(write=False)


def strips(rings: int) -> NDArray[np.uint32]:
    """Triangles between so many rings, each from lower to upper: counter-clockwise from outside, shape (T, 3)."""
    ring, sector = (index.ravel() for index in np.indices((rings - 1, SECTORS)))
    corner, right = ring * SECTORS + sector, ring * SECTORS + (sector + 1) % SECTORS
    quads = np.stack([corner, right, right + SECTORS, corner, right + SECTORS, corner + SECTORS], axis=1)
    return quads.reshape(-1, 3).astype(np.uint32)
