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

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import MeshCloth
from cape.cloth.triangle_mesh import Edges

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Power of the distance with which the square of a coefficient's change is made dear. Of 6 to 16 it leaves
# plates on triangles of scattered points with an error within a fifth of the least.
FALL = 8
CLEAR = 4e-4  # smallest over largest eigenvalue of a fit's normal matrix, below which it takes in more vertices
ROUNDING = 1e-9  # largest change of a slope's coefficients, times the edge's length, that is none
QUADRATIC = 6  # numbers that make a quadratic: fewer points never determine one
GROWN = 4  # times that a fit takes in the neighbours of its triangles, at most


Frame = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
"""A turn, by rows, and a shift: where the points of a triangle lie in the plane of another one."""
STILL: Frame = ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0))


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
    from scipy.sparse import csr_matrix

    faces, corners = cloth.faces[triangles], cloth.corners[triangles]
    edges, of = np.unique(_first_sides(unfolded, triangles), return_inverse=True)
    of = of.reshape(-1, 3)
    slopes = _slopes(cloth, unfolded, edges)
    sides = np.roll(corners, -1, axis=1) - corners
    length = np.linalg.norm(sides, axis=2)
    area = _doubled_areas(corners) / 2.0
    clockwise = np.sign(area)[:, None, None]
    along = sides / length[..., None]
    outward = clockwise * np.stack([along[..., 1], -along[..., 0]], axis=2)
    # A slope across is away from the first triangle of its edge.
    away = np.where(edges[of] // 3 == triangles[:, None], 1.0, -1.0)
    weight = (length / np.abs(area)[:, None])[..., None]

    across = weight * away[..., None] * _outer(outward, outward)
    ends = weight * _outer(outward, along) / length[..., None]
    reach = slopes.vertices.shape[1]
    by_slope = (across[:, :, None, :] * slopes.coefficients[of][..., None]).reshape(len(area), -1, 3)
    values = np.concatenate([by_slope, -ends, ends], axis=1)
    members = np.concatenate([slopes.vertices[of].reshape(-1, 3 * reach), faces, np.roll(faces, -1, axis=1)], axis=1)
    columns = np.repeat(members, 3, axis=1).reshape(len(area), -1, 3)
    rows = np.broadcast_to(3 * np.arange(len(area))[:, None, None] + np.arange(3), values.shape)
    shape = (3 * len(area), cloth.vertices)
    table: Any = csr_matrix((values.ravel(), (rows.ravel(), columns.ravel())), shape)
    table.sum_duplicates()
    return _padded(table.indptr, table.indices, table.data, faces[:, 0])


def _padded(starts: IntArray, indices: IntArray, data: FloatArray, blank: IntArray) -> tuple[IntArray, FloatArray]:
    """Rows of equally many vertices, three at a time on the same ones."""
    count = np.diff(starts)[::3]
    place = np.arange(count.max())
    inside = place < count[:, None]
    at = np.where(inside, place, 0)
    vertices = np.where(inside, indices[starts[:-1:3, None] + at], blank[:, None])
    rows = np.stack([np.where(inside, data[starts[axis:-1:3, None] + at], 0.0) for axis in range(3)], axis=1)
    # Those that matter first, as many as any triangle has.
    none = (rows == 0.0).all(axis=1)
    order = np.argsort(none, axis=1, kind="stable")[:, : int((~none).sum(axis=1).max())]
    rows = np.take_along_axis(rows, order[:, None], axis=2)
    vertices, none = np.take_along_axis(vertices, order, axis=1), np.take_along_axis(none, order, axis=1)
    return np.where(none, blank[:, None], vertices).astype(np.int64), rows


def _outer(a: FloatArray, b: FloatArray) -> FloatArray:
    """Components 11, 12 and 22 of the symmetric part of a x b."""
    mixed = 0.5 * (a[..., 0] * b[..., 1] + a[..., 1] * b[..., 0])
    return np.stack([a[..., 0] * b[..., 0], mixed, a[..., 1] * b[..., 1]], axis=-1)


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
    t, c = sides // 3, sides % 3
    members, points, inside = _around(cloth, unfolded, t, c)
    origin, end = points[:, 0], points[:, 1]
    along = end - origin
    length = np.linalg.norm(along, axis=1)
    along /= length[:, None]
    away = np.stack([along[:, 1], -along[:, 0]], axis=1)
    away *= -np.sign(((points[:, 2] - origin) * away).sum(axis=1))[:, None]
    offset = (points - 0.5 * (origin + end)[:, None]) / length[:, None, None]
    local = np.stack([np.einsum("nmk,nk->nm", offset, along), np.einsum("nmk,nk->nm", offset, away)], axis=2)
    local = np.where(inside[..., None], local, 0.0)

    coefficients, clear = _corrected(local, inside, _mean_slope(local, inside[:, 3]))
    unclear = np.flatnonzero(~clear)
    grown = _grown([Patch(cloth, unfolded, int(t[e]), int(c[e])) for e in unclear])
    more = max([0, *(len(wider) - members.shape[1] for wider, _ in grown)])
    members = np.concatenate([members, np.repeat(members[:, -1:], more, axis=1)], axis=1)
    coefficients = np.concatenate([coefficients, np.zeros((len(t), more))], axis=1)
    for e, (wider, values) in zip(unclear, grown, strict=True):
        members[e], coefficients[e] = members[e, 0], 0.0
        members[e, : len(wider)], coefficients[e, : len(wider)] = wider, values
    return Slopes(members, coefficients / length[:, None])


def _first_sides(unfolded: Unfolded, triangles: IntArray) -> IntArray:
    """The first side 3 t + c that the edge of each side of some triangles (n,) is, shape (n, 3)."""
    own, beyond = 3 * triangles[:, None] + np.arange(3), unfolded.neighbour[triangles]
    return np.where(beyond < 0, own, np.minimum(own, 3 * beyond + unfolded.side[triangles]))


def _around(
    cloth: MeshCloth, unfolded: Unfolded, t: IntArray, c: IntArray
) -> tuple[IntArray, FloatArray, NDArray[np.bool_]]:
    """The eight vertices around edges, sides c of triangles t, of which a border lacks some.

    Both ends, the third corner of this triangle and of the other, and what lies beyond the other sides of both. Returns
    the vertices (E, 8), the first one for one that lacks; where they lie in the plane of t [m], shape (E, 8, 2); and
    which there are (E, 8).
    """
    faces, corners = cloth.faces, cloth.corners
    vertices = [faces[t, (c + step) % 3] for step in range(3)]
    places = [corners[t, (c + step) % 3] for step in range(3)]
    known = [np.ones(len(t), dtype=bool)] * 3
    beyond, touching = unfolded.neighbour[t, c], unfolded.side[t, c]
    turn, shift = unfolded.turn[t, c], unfolded.shift[t, c]
    unturned, still = np.broadcast_to(np.eye(2), turn.shape), np.zeros_like(shift)
    ways = [(t, (c + step) % 3, unturned, still, known[0]) for step in range(3)]
    ways += [(beyond, (touching + step) % 3, turn, shift, beyond >= 0) for step in (1, 2)]
    for start, side, start_turn, start_shift, there in ways:
        last = unfolded.neighbour[start, side]
        corner = (unfolded.side[start, side] + 2) % 3
        point = np.einsum("nij,nj->ni", unfolded.turn[start, side], corners[last, corner]) + unfolded.shift[start, side]
        vertices.append(faces[last, corner])
        places.append(np.einsum("nij,nj->ni", start_turn, point) + start_shift)
        known.append(there & (last >= 0))
    members, inside = np.stack(vertices, axis=1), np.stack(known, axis=1)
    return np.where(inside, members, members[:, :1]), np.stack(places, axis=1), inside


def _mean_slope(local: FloatArray, both: NDArray[np.bool_]) -> FloatArray:
    """Mean of the slopes across of the triangles beside the first two of points (E, M, 2), at (-1/2, 0) and (1/2, 0).

    The third point is of the first triangle, the fourth of the second, where there are `both`.
    """
    result = np.zeros(local.shape[:2])
    for apex, used in ((2, np.where(both, 0.5, 1.0)), (3, np.where(both, 0.5, 0.0))):
        x = local[:, apex, 0]
        share = used / np.where(used > 0.0, local[:, apex, 1], 1.0)
        result[:, apex] += share
        result[:, 0] -= share * (0.5 - x)
        result[:, 1] -= share * (0.5 + x)
    return result


def _corrected(local: FloatArray, inside: NDArray[np.bool_], mean: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The slopes changed least so that they are exact for quadratics, and whether the points determine one clearly."""
    x, y = local[..., 0], local[..., 1]
    basis = np.stack([np.ones_like(x), x, y, x * x / 2.0, x * y, y * y / 2.0], axis=2) * inside[..., None]
    values = np.linalg.eigvalsh(np.einsum("nma,nmb->nab", basis, basis))
    clear = values[:, 0] > CLEAR * values[:, -1]
    cheap = np.where(inside, 1.0 / np.maximum((local**2).sum(axis=2), 1e-12) ** (FALL // 2), 0.0)
    matrix = np.einsum("nma,nm,nmb->nab", basis, cheap, basis)
    matrix[~clear] = np.eye(6)
    change = np.zeros_like(mean)
    for _ in range(2):  # the second for the digits that the normal equations lose
        missing = -np.einsum("nma,nm->na", basis, mean + change)
        missing[:, 2] += 1.0
        change += cheap * np.einsum("nma,na->nm", basis, np.linalg.solve(matrix, missing[..., None])[..., 0])
    # Where both triangles make a parallelogram there is nothing to correct but rounding.
    change[~clear | (np.abs(change) < ROUNDING).all(axis=1)] = 0.0
    return mean + change, clear


class Patch:
    """The vertices of some triangles around an edge, laid out in the plane of one of the two beside it.

    Attributes:
        both: whether there is a triangle on either side.
        members: the vertices, first both ends, then the third corners of one triangle and of the other, M in all.
        local: where they lie, along the edge and away from the first triangle, from its middle and over its length,
            M pairs.
    """

    def __init__(self, cloth: MeshCloth, unfolded: Unfolded, triangle: int, side: int) -> None:
        """The two triangles beside a side of one."""
        self._cloth, self._unfolded = cloth, unfolded
        faces, corners = cloth.faces[triangle].tolist(), cloth.corners[triangle].tolist()
        (ax, ay), (bx, by), (px, py) = (corners[(side + step) % 3] for step in range(3))
        self._middle, length = (0.5 * (ax + bx), 0.5 * (ay + by)), math.hypot(bx - ax, by - ay)
        x, y = (bx - ax) / length, (by - ay) / length
        turned = -1.0 if (px - ax) * y - (py - ay) * x > 0.0 else 1.0
        self._axes = (x / length, y / length), (turned * y / length, -turned * x / length)
        beyond = int(unfolded.neighbour[triangle, side])
        self.both = beyond >= 0
        second = int(cloth.faces[beyond, (unfolded.side[triangle, side] + 2) % 3]) if self.both else faces[side]
        self._places: dict[int, tuple[float, float]] = {}
        self._frames: dict[int, Frame] = {}
        self._add(triangle, STILL)
        if self.both:
            self._add(beyond, self._beside(triangle, side, STILL))
        first = [*(faces[(side + step) % 3] for step in range(3)), second]
        self._order, self._outermost = first, list(self._frames)

    def grow(self) -> None:
        """Take in the neighbours of all triangles."""
        added = len(self._frames)
        for here in self._outermost:
            frame = self._frames[here]
            for c, there in enumerate(self._unfolded.neighbour[here].tolist()):
                if there >= 0 and there not in self._frames:
                    self._add(there, self._beside(here, c, frame))
        self._outermost = list(self._frames)[added:]
        self.members = [*self._order, *(v for v in self._places if v not in self._order)]
        x, y = self._middle
        (p, q), (r, s) = self._axes
        offsets = ((u - x, v - y) for u, v in map(self._places.__getitem__, self.members))
        self.local = [(p * u + q * v, r * u + s * v) for u, v in offsets]

    def _beside(self, triangle: int, side: int, frame: Frame) -> Frame:
        """The frame of the triangle beyond a side of one in a frame."""
        (a, b), (c, d), (x, y) = frame
        (e, f), (g, h) = self._unfolded.turn[triangle, side].tolist()
        u, v = self._unfolded.shift[triangle, side].tolist()
        turn = (a * e + b * g, a * f + b * h), (c * e + d * g, c * f + d * h)
        return *turn, (a * u + b * v + x, c * u + d * v + y)

    def _add(self, triangle: int, frame: Frame) -> None:
        self._frames[triangle] = frame
        (a, b), (c, d), (x, y) = frame
        faces, corners = self._cloth.faces[triangle].tolist(), self._cloth.corners[triangle].tolist()
        for vertex, (u, v) in zip(faces, corners, strict=True):
            if vertex not in self._places:
                self._places[vertex] = a * u + b * v + x, c * u + d * v + y


def _grown(patches: list[Patch]) -> list[tuple[IntArray, FloatArray]]:
    """The same for some edges, each on as many triangles around as it needs; as they are where there are too few.

    Returns of each the vertices (M,) and the coefficients (M,) of the slope times the edge's length.
    """
    found: dict[Patch, tuple[IntArray, FloatArray]] = {}
    left = patches
    for taken_in in range(1, GROWN + 1):
        if not left:
            break
        for patch in left:
            patch.grow()
        if taken_in < GROWN and all(len(patch.members) < QUADRATIC for patch in left):
            continue
        most = max(len(patch.members) for patch in left)
        local, inside = np.zeros((len(left), most, 2)), np.zeros((len(left), most), dtype=bool)
        for place, patch in enumerate(left):
            local[place, : len(patch.members)], inside[place, : len(patch.members)] = patch.local, True
            inside[place, 3] = patch.both
        coefficients, clear = _corrected(local, inside, _mean_slope(local, inside[:, 3]))
        for place, patch in enumerate(left):
            if clear[place] or taken_in == GROWN:
                found[patch] = np.array(patch.members), coefficients[place, : len(patch.members)]
        left = [patch for patch in left if patch not in found]
    return [found[patch] for patch in patches]
