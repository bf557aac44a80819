"""Cloth to tear, and what a torn one must be."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import cape
from cape.outfits.combined import combined

IDENTITY = [1.0, 0.0, 0.0, 0.0]
FABRIC = cape.Fabric(density=0.2, stretch=2000.0, shear=20.0, bend=1e-5)


def still(*bones: str) -> dict[str, tuple[list[float], list[float]]]:
    """Bones at the origin."""
    return {bone: ([0.0, 0.0, 0.0], IDENTITY) for bone in bones}


def mesh_of(cloth: cape.GridCloth, *, mirrored: bool = False, jitter: float = 0.0) -> cape.MeshCloth:
    """A flat grid as a mesh: with its diagonals, the other ones, or vertices within it moved by up to `jitter` [m]."""
    pattern, (left, right, below, down) = np.array(cloth.pattern), cloth.cells.T
    inside = np.bincount(np.concatenate([left, right, below, down])) == 4
    pattern[inside] += np.random.default_rng(1).uniform(-jitter, jitter, (inside.sum(), 2))
    triangles = [(left, down, below), (left, below, right)] if mirrored else [(left, down, right), (below, right, down)]
    return cape.Cloth.from_mesh(
        np.column_stack([np.zeros(len(pattern)), -pattern[:, 0], -pattern[:, 1]]),
        np.concatenate([np.stack(corners, axis=1) for corners in triangles]),
        pattern=pattern,
        fabric=cloth.fabric,
        regions=cloth.regions,
    )


def with_another_aside(scene: cape.Scene, fabric: cape.Fabric | None = None) -> cape.Scene:
    """A scene with another cloth, `aside` of its own, which is held likewise 3 m off; of its fabric unless told."""
    cloth, off = scene.cloth, np.array([0.0, 3.0, 0.0])
    other = replace(cloth, fabric=fabric or cloth.fabric)
    outfit = combined(["aside", "under"], [other, cloth], [cloth.positions + off, cloth.positions])
    away = [a if a.points is None else replace(a, points=a.points + off) for a in scene.attachments]
    both = [
        replace(each, vertices=each.vertices + start, cloth_vertices=outfit.vertices)
        for held, start in ((away, 0), (scene.attachments, cloth.vertices))
        for each in held
    ]
    return replace(scene, cloth=outfit, attachments=both)


def fans(triangles: NDArray[np.integer]) -> NDArray[np.int64]:
    """Of each vertex how many fans of triangles it joins, counted by hand: cells around it, linked by shared edges."""
    around: dict[int, list[set[int]]] = {}
    for triangle in triangles.tolist():
        for corner in triangle:
            around.setdefault(corner, []).append(set(triangle) - {corner})
    counts = []
    for vertex in sorted(around):
        sides, found = list(around[vertex]), 0
        while sides:
            found, rim = found + 1, sides.pop()
            while touching := [side for side in sides if side & rim]:
                for side in touching:
                    sides.remove(side)
                    rim = rim | side
        counts.append(found)
    return np.array(counts)
