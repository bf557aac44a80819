"""The membrane of a mesh: an orthotropic sheet of triangles whose strains are averaged over edges.

Each triangle has Green's strain E = (F'F - 1) / 2 along weft and warp, with the shear angle 2 E12 third, and the cloth
the energy per area E'CE / 2 of Saint Venant and Kirchhoff. Triangles of constant strain lock: a mesh whose edges do not
run along the threads can't shear without stretching them. So the strain of each edge, the mean of its two triangles'
by area, is what resists, with a third of the area of both: the edge-based smoothing of Liu, Nguyen-Thoi and Lam 2009,
"An edge-based smoothed finite element method" (Journal of Sound and Vibration 320).
With a_t the areas, and P the mean of strains over a triangle's three edges, the energy is

    1/2 sum over t of a_t E_t' C (P E)_t,    (P E)_t = own E_t + sum over the three neighbours of share E_n,

so that the tension in a triangle is C times its smoothed strain. C is that of a grid's springs (`cape.Fabric`): stretch
along both threads, and shear both against shear and as what couples the threads.
"""

from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.fabrics import of_triangles
from cape.cloth.cloth import MeshCloth, areas
from cape.cloth.fabric import Fabric
from cape.cloth.triangle_mesh import Edges

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Stretches that the largest stable step is for: of cloth as it usually is, and of cloth that is strained far.
USUAL_STRETCH, FAR_STRETCH = 1.2, 1.5


class EdgeStrains(NamedTuple):
    """What the strain of each of E edges is made of.

    `vertices` (E, 4): both ends, the third corner of one triangle and of the other, that of the first again at a
    border. `slopes` [1/m] (E, 2, 4): of either triangle from the first end: along weft and warp for the second end,
    then for its third corner. `shares` (E, 2): of the triangles in the strain. `area` [m2] (E,).
    """

    vertices: IntArray
    slopes: FloatArray
    shares: FloatArray
    area: FloatArray

    @property
    def numbers(self) -> FloatArray:
        """Slopes, shares and area, side by side, shape (E, 11)."""
        return np.concatenate([self.slopes.reshape(-1, 8), self.shares, self.area[:, None]], axis=1)


@dataclass(frozen=True, eq=False)
class Membrane:
    """T triangles of a membrane.

    Attributes:
        faces: vertices (T, 3).
        slopes: of each triangle from its first corner: vectors p and q to the others stand for F = (p, q) slopes
            [1/m], the columns of F along weft and warp; shape (T, 2, 2).
        area: at rest, times the layers [m2], shape (T,).
        neighbours: triangles beyond the side from each corner to the next, itself beyond a border, shape (T, 3).
        own: share of a triangle's own strain in its smoothed strain, shape (T,).
        share: of the neighbours' strains, 0 beyond a border, shape (T, 3).
        stiffness: C, of strains along weft and warp and of the shear angle [N/m], shape (3, 3), or (T, 3, 3) where
            pieces are of different fabrics.
    """

    faces: IntArray
    slopes: FloatArray
    area: FloatArray
    neighbours: IntArray
    own: FloatArray
    share: FloatArray
    stiffness: FloatArray

    def gradients(self, positions: FloatArray) -> FloatArray:
        """F at positions [m], shape (N, 3); its columns are rows here, shape (T, 2, 3)."""
        p, q = (positions[self.faces[:, k]] - positions[self.faces[:, 0]] for k in (1, 2))
        return np.einsum("tji,tjk->tik", self.slopes, np.stack([p, q], axis=1))

    def strains(self, positions: FloatArray) -> FloatArray:
        """Green's strain along weft and warp, and the shear angle, at positions [m], shape (N, 3); shape (T, 3)."""
        return strains_of(self.gradients(positions))

    def smoothed(self, strains: FloatArray) -> FloatArray:
        """Strains (T, 3) averaged over edges."""
        return self.own[:, None] * strains + np.einsum("tk,tkc->tc", self.share, strains[self.neighbours])

    def edges(self) -> EdgeStrains:
        """The same, edge by edge."""
        count = len(self.faces)
        triangle, side = np.repeat(np.arange(count), 3), np.tile(np.arange(3), count)
        beyond = self.neighbours[triangle, side]
        # An edge within is seen from both sides, once from each triangle: the lower one has it.
        kept = beyond >= triangle
        triangle, side, beyond = triangle[kept], side[kept], beyond[kept]
        first, second = self.faces[triangle, side], self.faces[triangle, (side + 1) % 3]
        corners, third = zip(*(self._from_edge(t, first, second) for t in (triangle, beyond)), strict=True)
        total = self.area[triangle] + np.where(beyond == triangle, 0.0, self.area[beyond])
        share = self.area[triangle] / total
        return EdgeStrains(
            vertices=np.stack([first, second, *third], axis=1),
            slopes=np.stack(corners, axis=1),
            shares=np.stack([share, 1.0 - share], axis=1),
            area=total / 3.0,
        )

    def _from_edge(self, triangle: IntArray, first: IntArray, second: IntArray) -> tuple[FloatArray, IntArray]:
        """Slopes (E, 4) of the second end and of the third corner of triangles with an edge, and that corner (E,)."""
        slopes, faces = self.slopes[triangle], self.faces[triangle]
        by_corner = np.concatenate([-slopes.sum(axis=1, keepdims=True), slopes], axis=1)
        every = np.arange(len(triangle))
        at = np.argmax(faces == second[:, None], axis=1)
        rest = 3 - at - np.argmax(faces == first[:, None], axis=1)
        return np.concatenate([by_corner[every, at], by_corner[every, rest]], axis=1), faces[every, rest]

    def energy(self, positions: FloatArray) -> float:
        """Energy [J] at positions [m], shape (N, 3)."""
        strains = self.strains(positions)
        sums = "tc,cd,td->t" if self.stiffness.ndim == 2 else "tc,tcd,td->t"
        return 0.5 * float(self.area @ np.einsum(sums, strains, self.stiffness, self.smoothed(strains)))

    def among(self, triangles: IntArray) -> tuple["Membrane", IntArray]:
        """Some triangles (n,) with their neighbours as a membrane, and where in it they are (n,).

        Strains of the neighbours are averaged with those of triangles within alone.
        """
        members = np.unique(np.concatenate([triangles, self.neighbours[triangles].ravel()]))
        number = np.full(len(self.faces), -1)
        number[members] = np.arange(len(members))
        beyond = number[self.neighbours[members]]
        within = beyond >= 0
        share = np.where(within, self.share[members], 0.0)
        part = Membrane(
            faces=self.faces[members],
            slopes=self.slopes[members],
            area=self.area[members],
            neighbours=np.where(within, beyond, np.arange(len(members))[:, None]),
            own=1.0 - share.sum(axis=1),
            share=share,
            stiffness=self.stiffness if self.stiffness.ndim == 2 else self.stiffness[members],
        )
        return part, number[triangles]

    def forces_between(self, moved: FloatArray, gradients: FloatArray) -> FloatArray:
        """Forces [N] of one fabric against small displacements [m], shape (N, 3), at F without tension; (N, 3)."""
        change = self.gradients(moved)
        strains = np.stack(
            [
                (gradients[:, 0] * change[:, 0]).sum(axis=1),
                (gradients[:, 1] * change[:, 1]).sum(axis=1),
                (gradients[:, 0] * change[:, 1] + gradients[:, 1] * change[:, 0]).sum(axis=1),
            ],
            axis=1,
        )
        tension = self.area[:, None] * (self.smoothed(strains) @ self.stiffness)
        along = tension[:, 0, None] * gradients[:, 0] + tension[:, 2, None] * gradients[:, 1]
        across = tension[:, 2, None] * gradients[:, 0] + tension[:, 1, None] * gradients[:, 1]
        return self._scattered(np.stack([along, across], axis=1), len(moved))

    def bounding_forces(self, moved: FloatArray) -> FloatArray:
        """Forces [N] of a matrix that bounds that of the membrane from above, along any axis; `moved` (N, D) [m]. It
        is of one fabric.

        For a displacement along any direction, which makes angles with both threads, E'CE is at most
        max(C11, C33) a^2 + max(C22, C33) b^2 + (C12 + C33) (a^2 + b^2) / 2 of its slopes a and b, and smoothing makes
        it less; tension across comes on top. At a stretch L both together are (3 L^2 - 1) / 2 times as much.
        """
        return self._scattered(self.area[:, None, None] * self.bounds[:, None] * self.gradients(moved), len(moved))

    @property
    def bounds(self) -> FloatArray:
        """Of slopes along weft and warp, in the matrix that bounds that of the membrane [N/m], shape (2,)."""
        c = self.stiffness
        mixed = 0.5 * (c[0, 1] + c[2, 2])
        return np.array([max(c[0, 0], c[2, 2]) + mixed, max(c[1, 1], c[2, 2]) + mixed])

    def _scattered(self, pulls: FloatArray, vertices: int) -> FloatArray:
        """Sums at the vertices, shape (N, D), of what triangles pull on their slopes, shape (T, 2, D)."""
        corners = np.einsum("tji,tik->tjk", self.slopes, pulls)
        result = np.zeros((vertices, pulls.shape[2]))
        for axis in range(pulls.shape[2]):
            for k, values in enumerate((-corners.sum(axis=1), corners[:, 0], corners[:, 1])):
                result[:, axis] += np.bincount(self.faces[:, k], values[:, axis], vertices)
        return result


def stiffened(stretch: float) -> float:
    """How many times as stiff a thread is at a stretch as at rest: the second derivative of (L^2 - 1)^2 / 8."""
    return (3.0 * stretch**2 - 1.0) / 2.0


def strains_of(gradients: FloatArray) -> FloatArray:
    """Green's strain along weft and warp, and the shear angle, of F by rows (T, 2, 3); shape (T, 3)."""
    weft, warp = gradients[:, 0], gradients[:, 1]
    squares = [(a * b).sum(axis=1) for a, b in ((weft, weft), (warp, warp), (weft, warp))]
    return np.stack([0.5 * (squares[0] - 1.0), 0.5 * (squares[1] - 1.0), squares[2]], axis=1)


def membrane_of(cloth: MeshCloth, edges: Edges) -> Membrane:
    """The membrane of a mesh, from its flat triangles and its fabric."""
    layers = np.ones(len(cloth.faces)) if cloth.layers is None else cloth.layers
    area = areas(cloth.corners) * layers
    sides = cloth.corners[:, 1:] - cloth.corners[:, :1]
    neighbours = np.repeat(np.arange(len(area))[:, None], 3, axis=1)
    for here, there in (edges.sides.T, edges.sides.T[::-1]):
        neighbours[here // 3, here % 3] = there // 3
    beyond = np.where(neighbours == np.arange(len(area))[:, None], 0.0, area[neighbours])
    share = beyond / (area[:, None] + beyond) / 3.0
    return Membrane(
        faces=cloth.faces,
        slopes=np.asarray(np.linalg.inv(np.swapaxes(sides, 1, 2)), dtype=float),
        area=area,
        neighbours=neighbours,
        own=1.0 - share.sum(axis=1),
        share=share,
        stiffness=of_triangles(cloth, plane_stiffness),
    )


def plane_stiffness(fabric: Fabric) -> FloatArray:
    """C of a fabric [N/m], shape (3, 3); threads are coupled by no more than leaves the energy positive."""
    weft, warp = fabric.stretch_weft, fabric.stretch_warp
    coupling = min(fabric.shear, sqrt(weft * warp))
    return np.array([[weft, coupling, 0.0], [coupling, warp, 0.0], [0.0, 0.0, fabric.shear]])
