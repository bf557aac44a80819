"""Meshes of revolution."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SECTORS = 24  # around the axis
RINGS = 7  # from a pole of a sphere to where the cone touches it, about


def tapered_hull(
    length: float, start_radius: float, end_radius: float
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint32]]:
    """The convex hull of a sphere at the origin and one at `length` on +Z [m], the larger one where it holds the other.

    Returns:
        Vertices [m] and unit normals, shape (N, 3), and triangles, counter-clockwise from outside, shape (T, 3).
    """
    latitudes, centers, radii = _profile(length, start_radius, end_radius)
    longitudes = np.linspace(0.0, 2.0 * np.pi, SECTORS, endpoint=False)
    around = np.stack([np.cos(longitudes), np.sin(longitudes), np.zeros(SECTORS)], axis=1)
    normals = np.cos(latitudes)[:, None, None] * around
    normals[..., 2] += np.sin(latitudes)[:, None]
    vertices = radii[:, None, None] * normals
    vertices[..., 2] += centers[:, None]
    ring, sector = (index.ravel() for index in np.indices((len(latitudes) - 1, SECTORS)))
    corner, right = ring * SECTORS + sector, ring * SECTORS + (sector + 1) % SECTORS
    quads = np.stack([corner, right, right + SECTORS, corner, right + SECTORS, corner + SECTORS], axis=1)
    return (
        vertices.reshape(-1, 3).astype(np.float32),
        normals.reshape(-1, 3).astype(np.float32),
        quads.reshape(-1, 3).astype(np.uint32),
    )


def _profile(length: float, start_radius: float, end_radius: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Latitudes of the normals [rad] up the outline, and the centre on the axis and the radius of the sphere of each.

    The cone touches both spheres where the normal has the sine (r0 - r1) / length.
    """
    if length <= abs(start_radius - end_radius):
        latitudes = np.linspace(-np.pi / 2.0, np.pi / 2.0, 2 * RINGS)
        center, radius = (0.0, start_radius) if start_radius >= end_radius else (length, end_radius)
        return latitudes, np.full(2 * RINGS, center), np.full(2 * RINGS, radius)
    touch = np.arcsin((start_radius - end_radius) / length)
    latitudes = np.concatenate([np.linspace(-np.pi / 2.0, touch, RINGS), np.linspace(touch, np.pi / 2.0, RINGS)])
    return latitudes, np.repeat([0.0, length], RINGS), np.repeat([start_radius, end_radius], RINGS)
