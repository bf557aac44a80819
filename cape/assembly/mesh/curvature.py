"""Curvature of each triangle of a mesh, from the slopes at the middles of its edges.

By the divergence theorem the mean of the second derivatives of w over a triangle of area A is

    kappa = 1/A sum over its edges of l (n x grad w at the middle),  n the outward normal, l the length,

which is exact for quadratic w, whose gradient is linear along an edge. Along the edge the slope at the middle is the
difference of its ends. Across, it is made from the mean of the slopes of the two triangles that share the edge, by the
least change that makes it exact for every quadratic, on the eight vertices of these two triangles and their neighbours;
a coefficient may change the less, the further its vertex lies from the middle (`FALL`).

Both properties matter. Exact for quadratics, a sheet bent to a cylinder has the energy of its fabric in every
direction. And since both triangles take the same slope at their edge, constant moments are in equilibrium at every
inner vertex, whatever the mesh: without that a sheet slips into shapes that its triangles don't see, and is too soft
by as much on the finest mesh. For Galerkin methods of first order Chen, Wu, Yoon and You 2001, "A stabilized conforming
nodal integration" (Int. J. Numer. Meth. Engng 50), call it the integration constraint; here by algebra. A quadratic
fitted to each triangle and its three neighbours by itself lacks it.

Angles are taken as small, and the sheet flat at rest: the curvature is linear in the positions, and the same for all
three coordinates, so that its forces are those of the same constant matrix wherever the cloth is.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import MeshCloth
from cape.cloth.triangle_mesh import Edges
from cape.kernels.cloth.slopes import USUAL, Flat, Patch, fit_slopes, gather, number_sides, weigh_sides

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Power of the distance with which the square of a coefficient's change is made dear. Of 6 to 16 it leaves
# plates on triangles of scattered points with an error within a fifth of the least.
FALL = 8
ROOM = 2 * USUAL  # vertices that there is room for around each edge, at borders, too; seldom are there more


class Slopes(NamedTuple):
    """The slope across E edges at their middles [1/m]: `coefficients` (E, M) of `vertices` (E, M)."""

    vertices: IntArray
    coefficients: FloatArray


class Unfolded(NamedTuple):
    """How the triangles beside each triangle lie in its plane.

    `neighbour` (T, 3): the triangle beyond the side from each corner to the next, -1 beyond a border; `side` (T, 3):
    the side by which that one touches; `turn` (T, 3, 2, 2) and `shift` (T, 3, 2): where its points lie in this one's
    plane, turn x + shift.
    """

    neighbour: IntArray
    side: IntArray
    turn: FloatArray
    shift: FloatArray


def curvatures(cloth: MeshCloth, unfolded: Unfolded, triangles: IntArray) -> tuple[IntArray, FloatArray]:
    """Curvature of some triangles (n,) along the weft, of twist, and along the warp [1/m2 on positions in m].

    Returns vertices (n, M) and coefficients (n, 3, M) of what is d2/du2, d2/du dv and d2/dv2 of each coordinate, filled
    up with the first vertex and zeros.
    """
    flat = flat_of(cloth, unfolded)
    every, of = np.zeros(3 * len(triangles), np.int64), np.zeros((len(triangles), 3), np.int64)
    sides = every[: number_sides(flat, triangles, np.full(unfolded.neighbour.size, -1), every, of)]
    slopes = _slopes(cloth, unfolded, sides)
    across, ends = np.zeros((2, len(triangles), 3, 3))
    weigh_sides(flat, triangles, sides, of, across, ends)
    room = room_of(slopes.vertices.shape[1])
    members, rows = np.zeros((len(triangles), room), np.int64), np.zeros((len(triangles), 3, room))
    faces, place = flat.faces[triangles], np.full(cloth.vertices, -1)
    widest = gather(*slopes, of, across, ends, faces, place, members, rows)
    return np.ascontiguousarray(members[:, :widest]), np.ascontiguousarray(rows[:, :, :widest])


def flat_of(cloth: MeshCloth, unfolded: Unfolded) -> Flat:
    """How a mesh lies, for compiled code."""
    return Flat(np.ascontiguousarray(cloth.faces), np.ascontiguousarray(cloth.corners), *unfolded)


def room_of(most: int) -> int:
    """How many vertices a triangle's curvature may have whose edges' slopes have so many at most."""
    return 3 * (most + 1)


def _doubled_areas(corners: FloatArray) -> FloatArray:
    p, q = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]


def unfold(cloth: MeshCloth, edges: Edges) -> Unfolded:
    """Lay the triangles beside each triangle in its plane."""
    faces, corners = cloth.faces, cloth.corners
    count = len(faces)
    neighbour, side = np.full((count, 3), -1), np.zeros((count, 3), dtype=np.int64)
    turn, shift = np.zeros((count, 3, 2, 2)), np.zeros((count, 3, 2))
    ahead = np.roll(corners, -1, axis=1)
    for here, there in (edges.sides.T, edges.sides.T[::-1]):
        t, c, u, d = here // 3, here % 3, there // 3, there % 3
        neighbour[t, c], side[t, c] = u, d
        same = faces[t, c] == faces[u, d]
        from_a, from_b = _swapped(corners[u, d], ahead[u, d], same)
        to_a, to_b = corners[t, c], ahead[t, c]
        # As complex numbers: the turn of the edge, mirrored where both patterns show different faces of the cloth.
        flip = np.sign(_doubled_areas(corners)[t] * _doubled_areas(corners)[u]) * np.where(same, -1.0, 1.0)
        edge, image = from_b - from_a, to_b - to_a
        edge[:, 1] *= flip
        scale = 1.0 / (np.linalg.norm(edge, axis=1) * np.linalg.norm(image, axis=1))
        cosine = (edge * image).sum(axis=1) * scale
        sine = (edge[:, 0] * image[:, 1] - edge[:, 1] * image[:, 0]) * scale
        turn[t, c] = np.stack([np.stack([cosine, -sine * flip], 1), np.stack([sine, cosine * flip], 1)], 1)
        middle = 0.5 * (from_a + from_b)
        shift[t, c] = 0.5 * (to_a + to_b) - np.einsum("nij,nj->ni", turn[t, c], middle)
    return Unfolded(neighbour, side, turn, shift)


def _swapped(a: FloatArray, b: FloatArray, same: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Ends in the order of the other triangle, which goes along a shared edge the other way unless it is `same`."""
    return np.where(same[:, None], a, b), np.where(same[:, None], b, a)


def _slopes(cloth: MeshCloth, unfolded: Unfolded, sides: IntArray) -> Slopes:
    """Slopes across edges, the first side of each given (E,), away from the triangle of that."""
    flat, room = flat_of(cloth, unfolded), ROOM
    while True:
        slopes = Slopes(np.zeros((len(sides), room), np.int64), np.zeros((len(sides), room)))
        patch = Patch.room(len(flat.faces), cloth.vertices)
        widest = int(fit_slopes(flat, patch, sides, FALL // 2, *slopes))
        if widest <= room:
            vertices, coefficients = slopes
            return Slopes(np.ascontiguousarray(vertices[:, :widest]), np.ascontiguousarray(coefficients[:, :widest]))
        room = widest
