"""Irregular meshes, whose material is a membrane, since no springs along their edges can be the fabric."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.bench.sheets import assemble_standing, sheet
from cape.cloth.cloth import Cloth, GridCloth, MeshCloth
from cape.cloth.triangle_mesh import locality_order, reordered
from cape.scene.attachments import attach
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

MOVED = 0.2  # of a cell: at 0.3 some triangles have hardly any height


def irregular(cloth: GridCloth, rng: np.random.Generator, moved: float = MOVED) -> MeshCloth:
    """A flat grid with cells split along random diagonals, and inner vertices moved by up to a share of a cell."""
    rows, columns = cloth.rows, cloth.columns
    y, x = np.divmod(np.arange(cloth.vertices), columns)
    inner = np.flatnonzero((x > 0) & (x < columns - 1) & (y > 0) & (y < rows - 1))
    by = moved * rng.uniform(-1.0, 1.0, (len(inner), 2))

    def places(start: FloatArray) -> FloatArray:
        across, down = start[inner + 1] - start[inner], start[inner + columns] - start[inner]
        found = start.copy()
        found[inner] += by[:, :1] * across + by[:, 1:] * down
        return found

    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    b, c, d = a + 1, a + columns, a + columns + 1
    flip = rng.random(len(a))[:, None] < 0.5
    one = np.where(flip, np.stack([a, c, d], axis=1), np.stack([a, c, b], axis=1))
    two = np.where(flip, np.stack([a, d, b], axis=1), np.stack([d, b, c], axis=1))
    faces, fabric = np.concatenate([one, two]), cloth.fabric
    return Cloth.from_mesh(places(cloth.positions), faces, pattern=places(cloth.pattern), fabric=fabric)


def irregular_swing(vertices: int) -> tuple[Assembly, BoneTrack]:
    """The sheet of `cape bench` of about so many vertices as an irregular mesh, and the motion of its bones."""
    swinging = sheet(vertices)
    grid = swinging.scene.cloth
    assert isinstance(grid, GridCloth)
    cloth = irregular(grid, np.random.default_rng(0))
    cloth = reordered(cloth, locality_order(cloth.faces, cloth.positions))
    top = np.flatnonzero(cloth.pattern[:, 1] == 0.0)
    held = [attach(cloth, a.bone, top) for a in swinging.scene.attachments]
    assembly = assemble_standing(replace(swinging.scene, cloth=cloth, attachments=held))
    assert assembly.springs.membrane is not None
    return assembly, swinging.track
