"""How stiff the edges and cross springs of a mesh are in its plane: fits of patches, shared out between them.

See `cape.assembly.mesh.springs` for what is fitted. All is kept by side: side 3 t + c of triangle t leads from its
corner c to the next, and the first of an edge's two sides stands for the edge. Where an edge parts its patch is gone,
and what its triangles gave to that goes to their other patches: the fits of those stay as they are.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.assembly.fabrics import fabrics_of, of_triangles
from cape.cloth.cloth import MeshCloth
from cape.cloth.fabric import Fabric
from cape.cloth.triangle_mesh import Edges
from cape.kernels.cloth.fit import fit_weights
from cape.kernels.tearing.in_plane import Fits, areas_taken, crosses_stiffness, edges_stiffness

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SWEEPS = 200  # of the fit
RIDGE = 1e-6  # of the fit, relative: shares stiffness evenly between springs that do the same
SHARPNESS = 1e-6  # squared relative misfit at which a patch gets half of the area it gets when it is exact
ASIDE = 1e-6  # of that area, at least, for a patch whose cross spring does not cross the shared edge
ALIKE = 1e-9  # by which the product of the tensors of springs that lie alike is less than one


@dataclass(frozen=True, eq=False)
class InPlane:
    """The fits of a mesh of T triangles, which may split: they change in place (`kernels.tearing.mesh_springs`).

    Attributes:
        cloth: the mesh, of which only corners and fabric are used.
        area: of its triangles, times the layers [m2], shape (T,).
        mate: the other side of the edge that each side is, itself at a border, shape (3 T,).
        weight: what the patch of each side's edge asks of that edge, and of the next two sides of the side's triangle,
            times an area [N/m], shape (3 T, 3); 0 at a border.
        cross: what it asks of its cross spring, shape (3 T,).
        trust: how much of a triangle's area goes to it, against the triangle's other patches, shape (3 T,).
        misfit: how far it is from the fabric, relative, shape (3 T,).
        length: of each side [m], shape (3 T,).
        cross_length: of the cross spring over it [m], shape (3 T,).
        pull: the lesser stiffness of the threads of each triangle [N/m], shape (T,).
        alone: what sides of triangles without neighbours carry [N m], where that is known, shape (T, 3).
    """

    cloth: MeshCloth
    area: FloatArray
    pull: FloatArray
    mate: IntArray
    weight: FloatArray
    cross: FloatArray
    trust: FloatArray
    misfit: FloatArray
    length: FloatArray
    cross_length: FloatArray
    alone: FloatArray

    def edge_lengths(self, sides: IntArray) -> FloatArray:
        """Rest lengths of the edges that some sides (n,) are [m], shape (n,)."""
        return 0.5 * (self.length[sides] + self.length[self.mate[sides]])

    @property
    def fits(self) -> Fits:
        """The same for compiled code, which sees what becomes of it."""
        return Fits(**{name: getattr(self, name) for name in Fits._fields})

    def edge_stiffness(self, sides: IntArray) -> FloatArray:
        """Stiffness of the edges that some sides (n,) are [N/m], shape (n,)."""
        self.fit_alone(np.unique(np.concatenate([sides, self.mate[sides]]) // 3))
        return self._of_sides(edges_stiffness, sides)

    def cross_stiffness(self, sides: IntArray) -> FloatArray:
        """Stiffness of the cross springs over the edges that some sides (n,) are [N/m], shape (n,); 0 for none."""
        return self._of_sides(crosses_stiffness, sides)

    def fit_alone(self, triangles: IntArray) -> None:
        """Know what sides of triangles without neighbours carry, which have no patches, if some (n,) are such."""
        own = 3 * triangles[:, None] + np.arange(3)
        alone = triangles[(self.mate[own] == own).all(axis=1)]
        if len(alone):
            self.alone[alone] = self._fit_alone(alone)[0] * self.area[alone, None]

    def missed(self) -> float:
        """Root mean square of how far patches are from the fabric, by area; of several fabrics that which is worst."""
        sides = np.arange(len(self.mate))
        first = sides[self.mate > sides]
        alone = np.flatnonzero((self.mate == sides).reshape(-1, 3).all(axis=1))
        _, misfit = self._fit_alone(alone)
        patches, worst = self.cloth.patchwork, 0.0
        of = np.zeros(len(self.area), np.int64) if patches is None else patches.number
        for number in range(len(fabrics_of(self.cloth))):
            own, by_itself = first[of[first // 3] == number], of[alone] == number
            total = (
                self._of_sides(areas_taken, own) @ self.misfit[own] ** 2
                + self.area[alone[by_itself]] @ misfit[by_itself] ** 2
            )
            worst = max(worst, float((total / self.area[of == number].sum()) ** 0.5))
        return worst

    def _of_sides(self, kind: Any, sides: IntArray) -> FloatArray:
        found = np.zeros(len(sides))
        kind(self.fits, sides, found)
        return found

    def _fit_alone(self, triangles: IntArray) -> tuple[FloatArray, FloatArray]:
        corners = self.cloth.corners[triangles]
        return _fit_to_fabrics(self.cloth, _tensors(np.roll(corners, -1, axis=1) - corners), triangles)


def fit_in_plane(cloth: MeshCloth, edges: Edges, area: FloatArray) -> InPlane:
    """Fit the patches of a mesh; `area` [m2] (T,) counts layers."""
    first, second = edges.sides.T
    count = 3 * len(area)
    mate = np.arange(count)
    mate[first], mate[second] = second, first
    sides = (np.roll(cloth.corners, -1, axis=1) - cloth.corners).reshape(-1, 2)
    crossing, apex, edge = _unfold(cloth, edges)

    # The springs of each patch: the shared edge, two more edges of either triangle, the cross spring.
    tensor = _tensors(sides)
    others = np.concatenate([corner(edges.sides, 1), corner(edges.sides, 2)], axis=1)
    patch = np.concatenate(
        [
            tensor[edges.sides].mean(axis=1, keepdims=True),
            tensor[others],
            _tensors(crossing).mean(axis=1, keepdims=True),
        ],
        axis=1,
    )
    fitted, missing = _fit_to_fabrics(cloth, patch, first // 3)
    # Where along the shared edge the cross spring passes.
    share = apex[:, 0, 1] / apex[..., 1].sum(axis=1)
    passed = (apex[:, 0, 0] + share * (apex[:, 1, 0] - apex[:, 0, 0])) / np.linalg.norm(edge, axis=1)
    relied = np.maximum(4.0 * passed * (1.0 - passed), ASIDE) / (missing**2 + SHARPNESS)

    weight, (cross, trust, misfit, cross_length) = np.zeros((count, 3)), np.zeros((4, count))
    weight[first], weight[second] = fitted[:, [0, 1, 3]], fitted[:, [0, 2, 4]]
    for own in (first, second):
        cross[own], trust[own], misfit[own] = fitted[:, 5], relied, missing
        cross_length[own] = np.linalg.norm(crossing, axis=2).mean(axis=1)
    length = np.linalg.norm(sides, axis=1)
    pull = np.broadcast_to(of_triangles(cloth, lambda f: min(f.stretch_warp, f.stretch_weft)), area.shape).copy()
    alone = np.full((len(area), 3), np.nan)
    return InPlane(cloth, area, pull, mate, weight, cross, trust, misfit, length, cross_length, alone)


def _fit_to_fabrics(cloth: MeshCloth, tensors: FloatArray, triangles: IntArray) -> tuple[FloatArray, FloatArray]:
    """What `_fit` gives of patches (P, S, 5), each for the fabric of one of its triangles (P,)."""
    if cloth.patchwork is None:
        return _fit(tensors, target_of(cloth.fabric))
    weight, missing = np.zeros(tensors.shape[:2]), np.zeros(len(tensors))
    for number, fabric in enumerate(cloth.patchwork.fabrics):
        own = cloth.patchwork.number[triangles] == number
        weight[own], missing[own] = _fit(tensors[own], target_of(fabric))
    return weight, missing


def target_of(fabric: Fabric) -> FloatArray:
    """What springs should add up to [N/m], shape (5,): the components that `_tensors` gives."""
    return np.array([fabric.stretch_weft, fabric.stretch_warp, 6.0**0.5 * fabric.shear, 0.0, 0.0])


def corner(sides: IntArray, step: int) -> IntArray:
    """Places 3 t + c of the corners that many steps after the one a side starts from."""
    return sides - sides % 3 + (sides + step) % 3


def _tensors(vectors: FloatArray) -> FloatArray:
    """t x t x t x t of the directions of plane vectors (..., 2): five components, whose dot is that of tensors."""
    t = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    a, b = t[..., 0], t[..., 1]
    return np.stack([a**4, b**4, 6.0**0.5 * a * a * b * b, 2.0 * a**3 * b, 2.0 * a * b**3], axis=-1)


def _unfold(cloth: MeshCloth, edges: Edges) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lay the two triangles of each interior edge flat side by side.

    Returns the vectors from the first triangle's opposite vertex to the second's [m], in the threads of either one,
    shape (I, 2, 2); where both lie, along the edge from its lower vertex and away from it [m], shape (I, 2, 2); and in
    the first triangle's threads the vector from the lower vertex to the higher one [m], shape (I, 2).
    """
    flat, faces = cloth.corners.reshape(-1, 2), cloth.faces.ravel()
    ahead = corner(edges.sides, 1)
    forwards = (faces[edges.sides] < faces[ahead])[..., None]
    low = np.where(forwards, flat[edges.sides], flat[ahead])
    edge = np.where(forwards, flat[ahead], flat[edges.sides]) - low
    along = edge / np.linalg.norm(edge, axis=2, keepdims=True)
    apex = flat[corner(edges.sides, 2)] - low
    x = np.einsum("isk,isk->is", apex, along)
    away = apex - x[..., None] * along
    height = np.linalg.norm(away, axis=2)
    away /= height[..., None]
    shift, apart = (x[:, 1] - x[:, 0])[:, None], height.sum(axis=1)[:, None]
    crossing = np.stack([shift * along[:, 0] - apart * away[:, 0], shift * along[:, 1] + apart * away[:, 1]], axis=1)
    return crossing, np.stack([x, height], axis=2), edge[:, 0]


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
