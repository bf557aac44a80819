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

import numpy as np
from numpy.typing import NDArray

from cape.assembly.membrane import membrane_of
from cape.assembly.mesh.curvature import curvatures
from cape.assembly.springs import Springs
from cape.cloth.cloth import MeshCloth, areas
from cape.cloth.triangle_mesh import Edges, edges_of
from cape.kernels.cloth.fit import fit_weights

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# An edge keeps at least this share of what it would carry if the cloth were stretched along it and nothing else held.
LEAST_SHARE = 0.01
# A cross spring with less than this share is left out.
NEGLIGIBLE = 1e-3
SWEEPS = 200  # of the fit
RIDGE = 1e-6  # of the fit, relative: shares stiffness evenly between springs that do the same
MISSED = 0.01  # of the fabric's stiffness, from which on springs are no longer as good as a membrane
NOTHING = 1e-9  # size of a curvature's coefficients, times the area, below which they are rounding
SHARPNESS = 1e-6  # squared relative misfit at which a patch gets half of the area it gets when it is exact
ASIDE = 1e-6  # of that area, at least, for a patch whose cross spring does not cross the shared edge
ALIKE = 1e-9  # by which the product of the tensors of springs that lie alike is less than one


def mesh_springs(cloth: MeshCloth) -> Springs:
    """Derive the springs of a mesh from its flat triangles and fabric."""
    edges = edges_of(cloth.faces)
    layers = np.ones(len(cloth.faces)) if cloth.layers is None else cloth.layers
    area = areas(cloth.corners) * layers
    edge_stiffness, cross_stiffness, edge_length, cross_length, missed = _in_plane(cloth, edges, area)
    membrane, nearest = None, None
    if missed > MISSED:
        membrane, nearest = membrane_of(cloth, edges), edge_stiffness
        edge_stiffness, cross_stiffness = np.zeros_like(edge_stiffness), np.zeros_like(cross_stiffness)
    opposite = cloth.faces.ravel()[_corner(edges.sides, 2)]
    kept = cross_stiffness > 0.0
    pairs = np.concatenate([edges.vertices, np.sort(opposite[kept], axis=1)])
    stiffness = np.concatenate([edge_stiffness, cross_stiffness[kept]])
    rest = np.concatenate([edge_length, cross_length[kept]])
    measured = np.arange(len(pairs)) < len(edges.vertices)
    if cloth.threads is not None:
        measured &= np.isin(pairs @ [cloth.vertices, 1], cloth.threads @ [cloth.vertices, 1])
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    bend_vertices, bend_coefficients, bend_stiffness = _bends(cloth, edges, area)
    return Springs(
        first=pairs[order, 0],
        second=pairs[order, 1],
        stiffness=stiffness[order],
        rest=rest[order],
        measured=measured[order],
        bend_vertices=bend_vertices,
        bend_coefficients=bend_coefficients,
        bend_stiffness=bend_stiffness,
        membrane=membrane,
        nearest=None if nearest is None else nearest[order],
    )


def _corner(sides: IntArray, step: int) -> IntArray:
    """Places 3 t + c of the corners that many steps after the one a side starts from."""
    return sides - sides % 3 + (sides + step) % 3


def _tensors(vectors: FloatArray) -> FloatArray:
    """t x t x t x t of the directions of plane vectors (..., 2): five components, whose dot is that of tensors."""
    t = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    a, b = t[..., 0], t[..., 1]
    return np.stack([a**4, b**4, 6.0**0.5 * a * a * b * b, 2.0 * a**3 * b, 2.0 * a * b**3], axis=-1)


def _unfold(cloth: MeshCloth, edges: Edges) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Lay the two triangles of each interior edge flat side by side.

    Returns the vectors from the first triangle's opposite vertex to the second's [m], in the threads of either one,
    shape (I, 2, 2); where both lie, along the edge from its lower vertex and away from it [m], shape (I, 2, 2); and in
    the first triangle's threads the lower vertex and the vector from it to the higher one [m], shape (I, 2).
    """
    flat, faces = cloth.corners.reshape(-1, 2), cloth.faces.ravel()
    ahead = _corner(edges.sides, 1)
    forwards = (faces[edges.sides] < faces[ahead])[..., None]
    low = np.where(forwards, flat[edges.sides], flat[ahead])
    edge = np.where(forwards, flat[ahead], flat[edges.sides]) - low
    along = edge / np.linalg.norm(edge, axis=2, keepdims=True)
    apex = flat[_corner(edges.sides, 2)] - low
    x = np.einsum("isk,isk->is", apex, along)
    away = apex - x[..., None] * along
    height = np.linalg.norm(away, axis=2)
    away /= height[..., None]
    shift, apart = (x[:, 1] - x[:, 0])[:, None], height.sum(axis=1)[:, None]
    crossing = np.stack([shift * along[:, 0] - apart * away[:, 0], shift * along[:, 1] + apart * away[:, 1]], axis=1)
    return crossing, np.stack([x, height], axis=2), low[:, 0], edge[:, 0]


def _fit(tensors: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weights q >= 0 of S tensors (P, S, 5) whose sum is nearest to a target (5,), by projected Gauss-Seidel.

    Returns q in the target's unit, shape (P, S), and the relative misfit, shape (P,).
    """
    size, count = np.linalg.norm(target), tensors.shape[1]
    q = np.zeros(tensors.shape[:2])
    fit_weights(tensors, target / size, SWEEPS, RIDGE, np.zeros((count, count)), np.zeros(count), q)
    alike = np.einsum("psk,prk->psr", tensors, tensors) > 1.0 - ALIKE
    q = np.einsum("psr,pr->ps", alike, q) / np.maximum(alike.sum(axis=2), 1)  # one of no length is like none
    missing = np.einsum("psk,ps->pk", tensors, q) - target / size
    return size * q, np.linalg.norm(missing, axis=1)


def _in_plane(
    cloth: MeshCloth, edges: Edges, area: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float]:
    """Stiffness [N/m] of edges (E,) and cross springs (I,), their rest lengths [m], and the share that they miss.

    That is the root mean square of how far patches are from the fabric, by area. `area` [m2] counts layers.
    """
    warp, weft = cloth.fabric.stretch_warp, cloth.fabric.stretch_weft
    target = np.array([weft, warp, 6.0**0.5 * cloth.fabric.shear, 0.0, 0.0])
    stretch = min(warp, weft)
    sides = np.roll(cloth.corners, -1, axis=1) - cloth.corners
    of_side = edges.of_triangle.ravel()
    length = np.bincount(of_side, weights=np.linalg.norm(sides, axis=2).ravel()) / edges.triangles
    crossing, apex, _, edge = _unfold(cloth, edges)
    cross_length = np.linalg.norm(crossing, axis=2).mean(axis=1)

    # The springs of each patch: the shared edge, two more edges of either triangle, the cross spring.
    tensor = _tensors(sides.reshape(-1, 2))
    others = np.concatenate([_corner(edges.sides, 1), _corner(edges.sides, 2)], axis=1)
    patch = np.concatenate(
        [
            tensor[edges.sides].mean(axis=1, keepdims=True),
            tensor[others],
            _tensors(crossing).mean(axis=1, keepdims=True),
        ],
        axis=1,
    )
    weight, misfit = _fit(patch, target)
    # Where along the shared edge the cross spring passes.
    share = apex[:, 0, 1] / apex[..., 1].sum(axis=1)
    passed = (apex[:, 0, 0] + share * (apex[:, 1, 0] - apex[:, 0, 0])) / np.linalg.norm(edge, axis=1)
    trust = np.maximum(4.0 * passed * (1.0 - passed), ASIDE) / (misfit**2 + SHARPNESS)
    owner = edges.sides // 3
    shares = trust[:, None] / np.bincount(owner.ravel(), np.repeat(trust, 2), len(area))[owner]
    taken = (shares * area[owner]).sum(axis=1)
    stiffness_area = weight * taken[:, None]
    carried = np.concatenate([edges.interior[:, None], of_side[others]], axis=1)
    edge_sum = np.bincount(carried.ravel(), stiffness_area[:, :5].ravel(), len(length)).astype(float)

    alone = np.setdiff1d(np.arange(len(area)), owner)
    weight, misfit_alone = _fit(tensor.reshape(-1, 3, 5)[alone], target)
    missed = float(((taken @ misfit**2 + area[alone] @ misfit_alone**2) / area.sum()) ** 0.5)
    edge_sum += np.bincount(edges.of_triangle[alone].ravel(), (weight * area[alone, None]).ravel(), len(length))

    around = np.bincount(of_side, np.repeat(area / 3.0, 3), len(length))
    edge_stiffness = np.maximum(edge_sum, LEAST_SHARE * stretch * around) / length**2
    slight = stiffness_area[:, 5] < NEGLIGIBLE * stretch * around[edges.interior]
    return edge_stiffness, np.where(slight, 0.0, stiffness_area[:, 5]) / cross_length**2, length, cross_length, missed


def _bends(cloth: MeshCloth, edges: Edges, area: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Bend springs, three for each triangle: vertices (K, M), coefficients (K, M) and stiffness [N/m] (K,).

    Of a curvature k along the weft, t of twist and j along the warp the energy per area is
    (B_weft k^2 + 2 sqrt(B_weft B_warp) t^2 + B_warp j^2) / 2: `Fabric.bend_along` in every direction.
    """
    warp, weft = cloth.fabric.bend_warp, cloth.fabric.bend_weft
    vertices, coefficients = curvatures(cloth, edges)
    stiffness = (area[:, None] * np.array([weft, 2.0 * sqrt(weft * warp), warp])).ravel()
    coefficients = coefficients.reshape(len(stiffness), -1)
    # What is left of curvatures that no vertices tell is rounding.
    size = np.abs(coefficients).sum(axis=1) * np.repeat(area, 3)
    kept = (stiffness > 0.0) & (size > NOTHING)
    return np.repeat(vertices, 3, axis=0)[kept], coefficients[kept], stiffness[kept]
