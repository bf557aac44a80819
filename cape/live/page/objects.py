"""Colliders as meshes in the frame of what carries them, for a page that draws nothing else."""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from cape.record.figure.body import hull_of_balls
from cape.scene.colliders import Collider
from motions import quaternions
from skeleton.shapes.outlines import BoxOutline, CapsuleOutline, EllipsoidOutline, MeshOutline

CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
SIDES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
HANDLE = 0.03  # [m], radius of a ball that stands for a bone without any shape

Mesh = tuple[NDArray[np.float32], NDArray[np.uint32]]
"""Vertices [m], shape (V, 3), and triangles, counter-clockwise from outside, shape (T, 3)."""


def mesh_of(collider: Collider) -> Mesh | None:
    """A collider in the frame of its bone, or of the world; None for what has no end."""
    outline = collider.outline()
    if isinstance(outline, CapsuleOutline):
        return _ball((outline.start, outline.radius), (outline.end, outline.radius))
    if isinstance(outline, BoxOutline):
        corners = outline.center + quaternions.rotate(outline.rotation_wxyz, CORNERS * outline.half_sizes)
        return corners.astype(np.float32), np.concatenate([SIDES[:, [0, 1, 2]], SIDES[:, [0, 2, 3]]]).astype(np.uint32)
    if isinstance(outline, EllipsoidOutline):
        vertices, triangles = _ball((np.zeros(3), 1.0))
        placed = outline.center + quaternions.rotate(outline.rotation_wxyz, vertices * outline.half_sizes)
        return placed.astype(np.float32), triangles
    if isinstance(outline, MeshOutline):
        placed = outline.origin + quaternions.rotate(outline.rotation_wxyz, outline.vertices.astype(float))
        return placed.astype(np.float32), outline.triangles
    return None


def handle() -> Mesh:
    """A small ball to take a bone by."""
    return _ball((np.zeros(3), HANDLE))


def _ball(*balls: tuple[NDArray[np.float64], float]) -> Mesh:
    vertices, _, triangles = hull_of_balls(list(balls))
    return vertices, triangles
