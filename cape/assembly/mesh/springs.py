"""Springs of any triangle mesh, with stiffness from its fabric.

A spring of direction t, length l and stiffness k gives the cloth around it the stiffness k l^2 t x t x t x t: under the
uniform strain e its energy is 1/2 k l^2 (t.e t)^2. Sums of such terms obey the relation of Cauchy, C1122 = C1212, so
that five numbers are asked of them, which are those of the grid: C1111 = stretch along the weft, C2222 = stretch along
the warp, C1122 = C1212 = shear, and no coupling of strain and shear. A single triangle has three springs and can't give
all five. The two triangles of an interior edge have six, with the cross spring between the two vertices opposite of
that edge: a patch. The stiffness of each patch is the k >= 0 nearest to the fabric's, in the norm of the fourth-order
tensor, shared evenly between springs that lie alike; each triangle gives most of its area to those of its patches that
come nearest, and the less to one, the further its cross spring passes from the middle of the shared edge: one that
passes an end of it runs beside two edges, and where a sheet is bent it is shorter than both by more than they can give.
On a grid whose cells are split along either diagonal, the patches of the diagonals are exact, and the springs are those
of the grid.

Elsewhere springs meet the fabric in the mean at best, and oblique ones resist shear as they resist stretch: of a fabric
whose shear is a hundredth of its stretch, cells split at random with vertices moved by up to 0.3 of a cell have six
times the shear. Where springs miss the fabric by more than `MISSED` a membrane takes their place, and those along edges
only precondition its equations.

Bend springs are the curvatures of the triangles, `cape.assembly.mesh.curvature`.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.fabrics import of_triangles
from cape.assembly.membrane import membrane_of
from cape.assembly.mesh.curvature import Unfolded, curvatures, unfold
from cape.assembly.mesh.in_plane import corner, fit_in_plane
from cape.assembly.springs import Springs
from cape.cloth.cloth import MeshCloth, areas
from cape.cloth.fabric import Fabric
from cape.cloth.triangle_mesh import edges_of
from cape.kernels.tearing.mesh_bends import NOTHING

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MISSED = 0.01  # of the fabric's stiffness, from which on springs are no longer as good as a membrane


class Bends(NamedTuple):
    """Bend springs, three for each triangle: `vertices` (K, M), `coefficients` (K, M), and `stiffness` [N/m] (K,), 0
    for none."""

    vertices: IntArray
    coefficients: FloatArray
    stiffness: FloatArray


def mesh_springs(cloth: MeshCloth) -> Springs:
    """Derive the springs of a mesh from its flat triangles and fabric."""
    edges, area = edges_of(cloth.faces), layered_area(cloth)
    fitted = fit_in_plane(cloth, edges, area)
    first = np.unique(edges.of_triangle, return_index=True)[1]
    edge_stiffness, cross_stiffness = fitted.edge_stiffness(first), fitted.cross_stiffness(edges.sides[:, 0])
    membrane, nearest = None, None
    if fitted.missed() > MISSED:
        membrane, nearest = membrane_of(cloth, edges), edge_stiffness
        edge_stiffness, cross_stiffness = np.zeros_like(edge_stiffness), np.zeros_like(cross_stiffness)
    opposite = cloth.faces.ravel()[corner(edges.sides, 2)]
    kept = cross_stiffness > 0.0
    pairs = np.concatenate([edges.vertices, np.sort(opposite[kept], axis=1)])
    stiffness = np.concatenate([edge_stiffness, cross_stiffness[kept]])
    rest = np.concatenate([fitted.edge_lengths(first), fitted.cross_length[edges.sides[kept, 0]]])
    measured = np.arange(len(pairs)) < len(edges.vertices)
    if cloth.threads is not None:
        measured &= np.isin(pairs @ [cloth.vertices, 1], cloth.threads @ [cloth.vertices, 1])
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    bends = bends_of(cloth, unfold(cloth, edges), area, np.arange(len(area)))
    acting = bends.stiffness > 0.0
    return Springs(
        first=pairs[order, 0],
        second=pairs[order, 1],
        stiffness=stiffness[order],
        rest=rest[order],
        measured=measured[order],
        bend_vertices=bends.vertices[acting],
        bend_coefficients=bends.coefficients[acting],
        bend_stiffness=bends.stiffness[acting],
        membrane=membrane,
        nearest=None if nearest is None else nearest[order],
    )


def layered_area(cloth: MeshCloth) -> FloatArray:
    """Area of the triangles of a mesh, times the layers [m2], shape (T,)."""
    return areas(cloth.corners) * (1.0 if cloth.layers is None else cloth.layers)


def bends_of(cloth: MeshCloth, unfolded: Unfolded, area: FloatArray, triangles: IntArray) -> Bends:
    """Bend springs of some triangles (n,) of a mesh, whose areas [m2] (T,) count layers.

    Of a curvature k along the weft, t of twist and j along the warp the energy per area is
    (B_weft k^2 + 2 sqrt(B_weft B_warp) t^2 + B_warp j^2) / 2: `Fabric.bend_along` in every direction.
    """
    vertices, coefficients = curvatures(cloth, unfolded, triangles)
    area = area[triangles]
    stiffness = (area[:, None] * of_triangles(cloth, plate_of, triangles)).ravel()
    coefficients = coefficients.reshape(len(stiffness), -1)
    # What is left of curvatures that no vertices tell is rounding.
    size = np.abs(coefficients).sum(axis=1) * np.repeat(area, 3)
    return Bends(np.repeat(vertices, 3, axis=0), coefficients, np.where(size > NOTHING, stiffness, 0.0))


def plate_of(fabric: Fabric) -> list[float]:
    """Bending stiffness [N m] of curvatures along the weft, of twist, and along the warp."""
    warp, weft = fabric.bend_warp, fabric.bend_weft
    return [weft, 2.0 * sqrt(weft * warp), warp]
