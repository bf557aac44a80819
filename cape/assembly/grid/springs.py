"""Springs of a grid cloth, with stiffness from its fabric so that the resolution does not change what it does.

Columns run down along the warp, rows across along the weft. With cells of width a and height b, tension per width
Y_warp and Y_weft and shear stiffness G, a lattice of springs along the threads and both diagonals has the plane
stiffness C11 = Y_weft, C22 = Y_warp and C66 = G when

    k_diagonal = G (a^2 + b^2) / (2 a b)
    k_right = (b / a) (Y_weft - G a^2 / b^2)
    k_down = (a / b) (Y_warp - G b^2 / a^2)

for each cell, the two edges that share a cell side taking half each (from equating the energy of a cell under uniform
strain; the diagonals carry the G terms). Bend springs draw a vertex to the midpoint of its neighbours, with energy
1/2 k |p0 - 2 p1 + p2|^2; equal to B/2 times curvature squared for k = B_weft b / a^3 across and B_warp a / b^3 down. A
distance spring over two cells, the usual choice, has an energy of fourth order in the curvature: no bending rigidity.

Twist is resisted cell by cell, with energy 1/2 k |p00 - p10 - p01 + p11|^2 and k = 2 H / (a b), where H is the root of
B_weft B_warp, as in `Fabric.bend_along`. The energy per area of curvatures k11, k22 and k12 is then
1/2 (B_weft k11^2 + B_warp k22^2 + 2 H k12^2), that of a plate without Poisson's effect. A curvature k at the angle t to
the weft, of which these are k cos^2 t, k sin^2 t and k cos t sin t, meets the rigidity B_weft cos^4 t +
2 H cos^2 t sin^2 t + B_warp sin^4 t (by algebra), the same in all directions where both threads bend alike; of second
differences alone it is half of that at 45 degrees.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.springs import Families, Springs
from cape.cloth.cloth import GridCloth

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# A thread keeps at least this share of its stiffness where long cells would give all of it to the diagonals.
LEAST_SHARE = 0.1


class CellStiffness(NamedTuple):
    """What R - 1 times C - 1 cells add to springs, and lengths at rest.

    `across` (R, C - 1) and `along` (R - 1, C) [m] of edges. Of each cell, shape (R - 1, C - 1): `right` and `down` of
    each of its two edges across and along, `diagonal` of either of them, and `twist` [N/m]; of the strip that each
    thread on its border carries in it, in all layers, the `height` and the `width` [m].
    """

    across: FloatArray
    along: FloatArray
    right: FloatArray
    down: FloatArray
    diagonal: FloatArray
    twist: FloatArray
    height: FloatArray
    width: FloatArray


def grid_springs(cloth: GridCloth) -> Springs:
    """Derive the springs of a grid from its shape at rest and its fabric."""
    rows, columns, fabric = cloth.rows, cloth.columns, cloth.fabric
    cells = cell_stiffness(cloth)
    right, down = np.zeros((rows, columns)), np.zeros((rows, columns))
    right[:-1, :-1] += cells.right
    right[1:, :-1] += cells.right
    down[:-1, :-1] += cells.down
    down[:-1, 1:] += cells.down
    diagonal, anti = np.zeros((rows, columns)), np.zeros((rows, columns))
    diagonal[:-1, :-1] = anti[:-1, 1:] = cells.diagonal

    height, width = np.zeros((rows, columns - 1)), np.zeros((rows - 1, columns))
    height[:-1] += cells.height
    height[1:] += cells.height
    width[:, :-1] += cells.width
    width[:, 1:] += cells.width
    bend_right, bend_down, twist = np.zeros((3, rows, columns))
    bend_right[:, :-2] = fabric.bend_weft * _middle(height, 1) / _middle(cells.across, 1) ** 3
    bend_down[:-2] = fabric.bend_warp * _middle(width, 0) / _middle(cells.along, 0) ** 3
    twist[:-1, :-1] = cells.twist

    offsets = np.array([1, columns, columns + 1, columns - 1])
    rest = np.ones((4, rows * columns))
    for family, offset in enumerate(offsets):
        ends = cloth.places_at_rest[offset:] - cloth.places_at_rest[:-offset]
        rest[family, : len(ends)] = np.linalg.norm(ends, axis=1)
    families = Families(
        offsets=offsets,
        stiffness=np.stack([right, down, diagonal, anti]).reshape(4, -1),
        rest=rest,
        bend_offsets=np.array([1, columns]),
        bend_stiffness=np.stack([bend_right, bend_down]).reshape(2, -1),
        twist_stiffness=twist.ravel(),
    )
    family, first = np.nonzero(families.stiffness)
    bends = _bends(families, columns)
    return Springs(
        first=first,
        second=first + offsets[family],
        stiffness=families.stiffness[family, first],
        rest=rest[family, first],
        measured=family < 2,
        bend_vertices=bends[0],
        bend_coefficients=bends[1],
        bend_stiffness=bends[2],
        families=families,
    )


def cell_stiffness(cloth: GridCloth) -> CellStiffness:
    """What each cell of a grid adds to its springs."""
    rows, columns, fabric = cloth.rows, cloth.columns, cloth.fabric
    grid = cloth.places_at_rest.reshape(rows, columns, -1)
    across = np.linalg.norm(np.diff(grid, axis=1), axis=2)
    along = np.linalg.norm(np.diff(grid, axis=0), axis=2)
    layers = np.ones_like(across[1:]) if cloth.layers is None else cloth.layers
    along_warp = layers if cloth.gathers is None else layers * cloth.gathers
    a = (across[:-1] + across[1:]) / 2.0
    b = (along[:, :-1] + along[:, 1:]) / 2.0
    warp, weft = fabric.stretch_warp, fabric.stretch_weft
    return CellStiffness(
        across=across,
        along=along,
        right=0.5 * layers * (b / a) * np.maximum(weft - fabric.shear * (a / b) ** 2, LEAST_SHARE * weft),
        down=0.5 * along_warp * (a / b) * np.maximum(warp - fabric.shear * (b / a) ** 2, LEAST_SHARE * warp),
        diagonal=layers * fabric.shear * (a**2 + b**2) / (2.0 * a * b),
        twist=2.0 * layers * math.sqrt(fabric.bend_weft * fabric.bend_warp) / (a * b),
        height=layers * b / 2.0,
        width=along_warp * a / 2.0,
    )


def _bends(families: Families, columns: int) -> tuple[IntArray, FloatArray, FloatArray]:
    """Vertices (K, 4), coefficients (K, 4) and stiffness (K,) of bend springs across and down, and of twist.

    A bend spring has three vertices; its last one comes twice, with the coefficient 0.
    """
    families_of_bends, starts = np.nonzero(families.bend_stiffness)
    cells = np.flatnonzero(families.twist_stiffness)
    return (
        np.concatenate(
            [
                starts[:, None] + families.bend_offsets[families_of_bends, None] * np.array([0, 1, 2, 2]),
                cells[:, None] + np.array([0, 1, columns, columns + 1]),
            ]
        ),
        np.repeat([[1.0, -2.0, 1.0, 0.0], [1.0, -1.0, -1.0, 1.0]], [len(starts), len(cells)], axis=0),
        np.concatenate([families.bend_stiffness[families_of_bends, starts], families.twist_stiffness[cells]]),
    )


def _middle(sizes: FloatArray, axis: int) -> FloatArray:
    """Mean of each two consecutive entries."""
    ahead, behind = np.delete(sizes, 0, axis=axis), np.delete(sizes, -1, axis=axis)
    return (ahead + behind) / 2.0
