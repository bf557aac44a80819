"""A grid of cloth as a mesh."""

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import GridCloth, MeshCloth

FloatArray = NDArray[np.float64]


def as_mesh(grid: GridCloth) -> MeshCloth:
    """A grid as a mesh of the same vertices and triangles, with its threads along rows and columns.

    Gathers count as layers: the mesh has their mass, and is as stiff across them as along.
    """
    cells, columns = grid.cells, grid.columns
    layers = np.ones(len(cells))
    for thicker in (grid.layers, grid.gathers):
        layers = layers if thicker is None else layers * thicker.ravel()
    numbers = np.arange(grid.vertices).reshape(grid.rows, columns)
    across = np.stack([numbers[:, :-1].ravel(), numbers[:, 1:].ravel()], axis=1)
    down = np.stack([numbers[:-1].ravel(), numbers[1:].ravel()], axis=1)
    return MeshCloth(
        pattern=grid.pattern,
        positions=grid.positions,
        frame=grid.frame,
        neckline=grid.neckline,
        fabric=grid.fabric,
        layers=None if grid.layers is None and grid.gathers is None else np.tile(layers, 2),
        regions=grid.regions,
        faces=grid.triangles.astype(np.int64),
        corners=_laid_along(grid),
        threads=np.concatenate([across, down]),
    )


def _laid_along(grid: GridCloth) -> FloatArray:
    """Corners of the triangles at rest, along the rows and the columns of their cells [m], shape (T, 3, 2)."""
    places = grid.places_at_rest
    if places.shape[1] == 2:
        places = np.column_stack([places, np.zeros(len(places))])
    first, second, third, fourth = (places[grid.cells[:, k]] for k in range(4))
    right, down = (np.tile((a + b - c - d) / 2.0, (2, 1)) for a, b, c, d in (
        (second, third, first, fourth), (third, fourth, first, second)))  # fmt: skip
    corners = places[grid.triangles]
    corners = corners - corners[:, :1]
    normal = _unit(np.cross(corners[:, 1], corners[:, 2]))
    warp = _unit(down - np.einsum("tk,tk->t", down, normal)[:, None] * normal)
    weft = np.cross(warp, normal)
    weft *= np.sign(np.einsum("tk,tk->t", weft, right))[:, None]
    return np.stack([np.einsum("tck,tk->tc", corners, weft), np.einsum("tck,tk->tc", corners, warp)], axis=2)


def _unit(vectors: FloatArray) -> FloatArray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
