"""From a cloth to the sheet that splits, and back to triangles."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import Cloth, GridCloth, MeshCloth, areas
from cape.run.tearing.sheet import Sheet, cells_around

IntArray = NDArray[np.int64]

AROUND = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))  # along the sides of a grid's cells


def sheet_of(cloth: Cloth, fixed: NDArray[np.bool_]) -> Sheet:
    """A whole cloth as a sheet; `fixed` are the vertices that never split, shape (V,)."""
    if isinstance(cloth, GridCloth):
        cells = cloth.cells
        area = areas(cloth.corners_at_rest).reshape(2, -1).sum(axis=0)
        ways = [AROUND] * len(cells)
    else:
        cells, corners = cloth.triangles.astype(np.int64), cloth.corners_at_rest
        sides = np.roll(corners, -1, axis=1) - corners
        ways = (sides / np.linalg.norm(sides, axis=2, keepdims=True)).tolist()
        area = areas(corners)
    return Sheet.whole(cells, ways, area, fixed)


def triangles_of(cloth: Cloth, sheet: Sheet) -> NDArray[np.int32]:
    """The triangles of a cloth (T, 3), in its own order, as a sheet of it has split."""
    cells = sheet.cells.astype(np.int32)
    if not isinstance(cloth, GridCloth):
        return cells
    return np.concatenate([cells[:, [0, 3, 1]], cells[:, [2, 1, 3]]])


def in_triangles(cloth: Cloth, sheet: Sheet, triangles: Sheet) -> Sheet:
    """The sheet of a cloth by its triangles, as it has split; `triangles` is that of the cloth before."""
    cells = triangles_of(cloth, sheet).astype(np.int64)
    around = cells_around(cells, sheet.vertices)
    own = {name: getattr(sheet, name) for name in ("parents", "fixed", "tears", "torn")}
    return replace(triangles, cells=cells, around=around, **own)


def split_mesh(mesh: MeshCloth, sheet: Sheet, copies: IntArray) -> MeshCloth:
    """A mesh as a sheet of it has split, with copies of some of its vertices behind the others."""
    known = {name: getattr(mesh, name) for name in ("pattern", "positions", "rest")}
    grown = {name: np.concatenate([of, of[copies]]) for name, of in known.items() if of is not None}
    threads = mesh.threads
    if threads is not None:
        ends = np.sort(np.stack([sheet.cells, np.roll(sheet.cells, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        usual = np.sort(np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        along = np.isin(usual @ [mesh.vertices, 1], threads @ [mesh.vertices, 1])
        threads = np.unique(ends[along], axis=0)
    return replace(mesh, faces=sheet.cells, threads=threads, **grown)
