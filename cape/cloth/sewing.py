"""Panels of cloth, each cut for itself, and sewn together along their edges.

A seam joins the vertices of two edges, or of two ends of one panel, that lie at the same places. What was cut flat need
not lie flat any more when it is sewn: each triangle has the threads of its own panel.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import Cloth, MeshCloth
from cape.cloth.fabric import Fabric

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SAME = 1e-5  # m between vertices that a seam joins


@dataclass(frozen=True, eq=False, kw_only=True)
class Panel:
    """A grid of vertices without tension, some cells of which may be cut out.

    Attributes:
        places: of the vertices [m], shape (rows, columns, 3).
        threads: where each vertex is along the weft and the warp, shape (rows, columns, 2): only the directions count
            in which these grow, lengths are those of the places.
        layers: how many layers of fabric each cell has, shape (rows - 1, columns - 1).
        kept: False for a cell that is cut out, shape (rows - 1, columns - 1); None where there is none.
        regions: names for sets of vertices, numbered row after row.
    """

    places: FloatArray
    threads: FloatArray
    layers: FloatArray
    kept: NDArray[np.bool_] | None = None
    regions: Mapping[str, IntArray] = field(default_factory=dict)


def sewn(panels: Sequence[Panel], *, fabric: Fabric) -> MeshCloth:
    """Sew panels together where their vertices lie at the same places; a cloth in the wearer's frame.

    Regions of the same name become one, in the order of the panels; vertices that are left in no cell are in none.

    Raises:
        ValueRangeError: what comes out is no cloth, as where three panels meet along one edge.
    """
    places, threads = (
        np.concatenate([getattr(panel, name).reshape(-1, width) for panel in panels])
        for name, width in (("places", 3), ("threads", 2))
    )
    starts = np.cumsum([0, *(panel.places.size // 3 for panel in panels)])
    cells = [_cells(panel) for panel in panels]
    faces = np.concatenate([start + triangles for start, (triangles, _) in zip(starts, cells, strict=False)])
    corners = along_threads(places[faces], threads[faces])
    number = _numbers(places, np.unique(faces))
    first = np.unique(number[number >= 0], return_index=True)[1]
    own = np.flatnonzero(number >= 0)[first]
    cloth = Cloth.from_mesh(places[own], number[faces], fabric=fabric)
    regions: dict[str, list[IntArray]] = {}
    for start, panel in zip(starts, panels, strict=False):
        for name, vertices in panel.regions.items():
            regions.setdefault(name, []).append(number[start + vertices])
    return replace(
        cloth,
        frame="wearer",
        pattern=threads[own],
        corners=corners,
        threads=np.unique(np.sort(number[_lines(panels, starts)], axis=1), axis=0),
        layers=np.concatenate([layers for _, layers in cells]),
        regions={name: _once(np.concatenate(parts)) for name, parts in regions.items()},
    )


def _cells(panel: Panel) -> tuple[IntArray, FloatArray]:
    """Triangles of a panel, two for each cell that is kept, shape (T, 3), and their layers (T,).

    Diagonals lean alternately, so that no direction across the threads is stiffer than the other.
    """
    (a, b, c, d), kept = _corners(panel)
    row, column = np.indices(a.shape)
    leans = ((row + column) % 2 == 0)[..., None, None]
    one, other = (np.stack([np.stack(t, axis=-1) for t in pair], axis=-2) for pair in (
        ((a, c, b), (d, b, c)), ((a, c, d), (a, d, b)),
    ))  # fmt: skip
    return np.where(leans, one, other)[kept].reshape(-1, 3), np.repeat(panel.layers[kept], 2)


def _lines(panels: Sequence[Panel], starts: IntArray) -> IntArray:
    """Sides of the cells that are kept, along rows and columns, shape (n, 2)."""
    sides = []
    for start, panel in zip(starts, panels, strict=False):
        corners, kept = _corners(panel)
        for first, second in ((0, 1), (2, 3), (0, 2), (1, 3)):
            sides.append(start + np.stack([corners[first][kept], corners[second][kept]], axis=1))
    return np.concatenate(sides)


def _corners(panel: Panel) -> tuple[tuple[IntArray, ...], NDArray[np.bool_]]:
    """Numbers of the corners of a panel's cells, upper left and right, lower left and right, and which are kept."""
    rows, columns = panel.places.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    kept = np.ones((rows - 1, columns - 1), dtype=bool) if panel.kept is None else panel.kept
    return (index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]), kept


def along_threads(points: FloatArray, threads: FloatArray) -> FloatArray:
    """Triangles (T, 3, 3) laid flat [m], with the weft where the first of their thread coordinates (T, 3, 2) grows.

    Where weft and warp are not square to each other in the plane of a triangle, both are off by as much.
    """
    sides, grown = points[:, 1:] - points[:, :1], threads[:, 1:] - threads[:, :1]
    weft, warp = np.moveaxis(np.linalg.solve(grown, sides), 1, 0)
    weft /= np.linalg.norm(weft, axis=1, keepdims=True)
    warp /= np.linalg.norm(warp, axis=1, keepdims=True)
    # The bisectors of both are square to each other, and so are what lies at 45 degrees to them.
    even, odd = weft + warp, weft - warp
    even /= np.linalg.norm(even, axis=1, keepdims=True)
    odd /= np.linalg.norm(odd, axis=1, keepdims=True)
    axes = np.stack([even + odd, even - odd], axis=1) / np.sqrt(2.0)
    corners = np.einsum("tck,tak->tca", points - points[:, :1], axes)
    # All triangles seen from the same side, so that neighbours agree which way is shear.
    corners[np.linalg.det(corners[:, 1:]) < 0.0, :, 0] *= -1.0
    return corners


def _numbers(places: FloatArray, used: IntArray) -> IntArray:
    """New numbers of vertices, the same for those at one place, -1 for those not used, shape (n,)."""
    from scipy.spatial import KDTree

    lowest = np.full(len(places), -1)
    lowest[used] = used
    for first, second in sorted(KDTree(places[used]).query_pairs(SAME)):
        lowest[used[second]] = min(lowest[used[first]], lowest[used[second]])
    number = np.full(len(places), -1)
    number[used] = np.unique(lowest[used], return_inverse=True)[1]
    return number


def _once(vertices: IntArray) -> IntArray:
    """Each of the vertices where it comes first, without those of no cell."""
    first = np.unique(vertices, return_index=True)[1]
    kept = vertices[np.sort(first)]
    return kept[kept >= 0]
