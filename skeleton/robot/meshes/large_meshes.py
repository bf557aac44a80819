"""Meshes of a million triangles, which no hitbox and no picture needs: thinned before anything else reads them."""

import atexit
import secrets
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motions.errors import FileError
from motions.files import printable, scratch_folder

LARGE = 2**24
"""Bytes of a mesh from which on it is thinned: 330,000 triangles as STL."""
THINNED = (".stl", ".obj", ".ply")
"""Files that are; those of the others tell of axes, units and parts what a thinned mesh would no more."""
CELL = 0.005
"""Of a mesh's size: vertices of one cell of a grid become one, their mean."""


class Thinned(NamedTuple):
    """A file that holds a mesh with fewer triangles.

    Attributes:
        path: the file, for as long as this process lives.
        before: triangles of the mesh as it was.
        after: triangles that are left.
    """

    path: Path
    before: int
    after: int


def thinned(path: Path) -> Thinned:
    """Write a mesh with fewer vertices, once for each file as it stands.

    Raises:
        FileError: the mesh can't be read, or the thinned one not be written.
    """
    status = path.stat()
    return _thinned(path.resolve(), status.st_mtime_ns, status.st_size)


@cache
def _thinned(path: Path, _changed: int, _size: int) -> Thinned:
    import trimesh

    try:
        mesh = trimesh.load_mesh(path, process=False)
    except Exception as error:  # whatever a reader of a foreign file may raise
        raise FileError(f"{path} can't be read as a mesh: {printable(' '.join(str(error).split()))[:200]}") from None
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces) or not np.isfinite(mesh.vertices).all():
        raise FileError(f"{path} is no mesh of triangles with finite corners")
    vertices, triangles = clustered(np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces))
    place = _folder() / f"{secrets.token_hex(8)}.stl"
    try:
        trimesh.Trimesh(vertices, triangles, process=False).export(place)
    except OSError as error:
        raise FileError(f"can't write temporary files: {error.strerror}") from None
    return Thinned(place, len(mesh.faces), len(triangles))


@cache
def _folder() -> Path:
    """A folder that goes with this process."""
    until_the_end = ExitStack()
    atexit.register(until_the_end.close)
    return until_the_end.enter_context(scratch_folder())


def clustered(
    vertices: NDArray[np.float64], triangles: NDArray[np.integer]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices [m], shape (V, 3), and triangles, shape (T, 3), of a mesh in which each cell of a grid holds one vertex.

    A corner moves by less than a cell's diagonal, `CELL` of the size of the mesh's box times the root of 3; triangles
    that become edges or points go. The grid lies about the middle of the box, so that a mirrored mesh is thinned to the
    mirror image.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    size = float(np.linalg.norm(high - low)) or 1.0
    steps = np.round((vertices - 0.5 * (low + high)) / (CELL * size)).astype(np.int64)
    steps -= steps.min(axis=0, initial=0)
    across = steps.max(axis=0, initial=0) + 1
    cells = (steps[:, 0] * across[1] + steps[:, 1]) * across[2] + steps[:, 2]
    _, own, counts = np.unique(cells, return_inverse=True, return_counts=True)
    means = np.stack([np.bincount(own, vertices[:, axis]) / counts for axis in range(3)], axis=1)
    corners = own[triangles]
    distinct = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    return means, corners[distinct]
