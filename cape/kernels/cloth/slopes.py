"""Slopes across the edges of a mesh at their middles, exact for quadratics; see `cape.assembly.mesh.curvature`.

An edge takes the eight vertices of its two triangles and their neighbours. Where these determine no quadratic clearly,
as at borders, it takes in the neighbours of its triangles, and theirs.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.cloth.fit import eigenvalues, factorise, solve
from cape.kernels.jit import inlined, routine

FloatArray = NDArray[np.float64]
Indices = NDArray[np.int64]

CLEAR = 4e-4  # smallest over largest eigenvalue of a fit's normal matrix, below which it takes in more vertices
ROUNDING = 1e-9  # largest change of a slope's coefficients, times the edge's length, that is none
QUADRATIC = 6  # numbers that make a quadratic: fewer points never determine one
GROWN = 4  # times that a fit takes in the neighbours of its triangles, at most
USUAL = 8  # vertices around an edge
NEAREST = 1e-12  # squared distance over that of the edge's length, below which a vertex is no nearer


class Flat(NamedTuple):
    """T triangles and how they lie: `faces` (T, 3), `corners` (T, 3, 2) [m], and as `Unfolded` the `neighbour` (T, 3)
    beyond each side, by which `side` it touches, its `turn` (T, 3, 2, 2) and `shift` (T, 3, 2) [m]."""

    faces: Indices
    corners: FloatArray
    neighbour: Indices
    side: Indices
    turn: FloatArray
    shift: FloatArray


class Patch(NamedTuple):
    """Room for what lies around an edge, of T triangles and N vertices.

    `triangles` (T,) that are taken in, their `frames` (T, 6), turns by rows and shifts, and for which edge each was
    last `taken` (T,); `places` (N, 2) [m] of vertices and for which edge each was last `met` (N,). `members` (N + 8,)
    are the vertices of a fit, both ends first, then the third corners of both triangles, and whether they are `there`;
    `local` (N + 8, 2) where they lie along and away from the edge, over its length. Of each the coefficients in the
    `mean` slope, the `change` of that, and how `cheap` it is; `normal` and `matrix` (6, 6), `wanted` and `basis` (6,)
    are those of the fit.
    """

    triangles: Indices
    frames: FloatArray
    taken: Indices
    places: FloatArray
    met: Indices
    members: Indices
    there: NDArray[np.bool_]
    local: FloatArray
    mean: FloatArray
    change: FloatArray
    cheap: FloatArray
    normal: FloatArray
    matrix: FloatArray
    wanted: FloatArray
    basis: FloatArray

    @classmethod
    def room(cls, triangles: int, vertices: int) -> "Patch":
        """Room for so many triangles and vertices."""
        most = vertices + USUAL
        return cls(
            triangles=np.zeros(triangles, np.int64),
            frames=np.zeros((triangles, 6)),
            taken=np.full(triangles, -1),
            places=np.zeros((vertices, 2)),
            met=np.full(vertices, -1),
            members=np.zeros(most, np.int64),
            there=np.zeros(most, np.bool_),
            local=np.zeros((most, 2)),
            mean=np.zeros(most),
            change=np.zeros(most),
            cheap=np.zeros(most),
            normal=np.zeros((QUADRATIC, QUADRATIC)),
            matrix=np.zeros((QUADRATIC, QUADRATIC)),
            wanted=np.zeros(QUADRATIC),
            basis=np.zeros(QUADRATIC),
        )


@routine
def fit_slopes(flat, patch, sides, half, vertices, coefficients):
    """Fit slopes across edges, the first side of each given (E,), away from the triangle of that.

    A coefficient may change the less, the further its vertex lies from the middle: by that power of the squared
    distance, `half`. Filled are `vertices` (E, M) and `coefficients` (E, M) [1/m] of each edge, with its first vertex
    and zeros where it has fewer. Returns how many the widest has: where these are more than M, all are to be fitted
    again with more room, and another patch.
    """
    widest = USUAL
    for e in range(sides.size):
        t, c = sides[e] // 3, sides[e] % 3
        length = surround(flat, patch, t, c)
        count = USUAL
        if not fit(patch, count, half):
            count = widen(flat, patch, e, t, c, half)
        widest = max(widest, count)
        if count <= vertices.shape[1]:
            for k in range(vertices.shape[1]):
                vertices[e, k] = patch.members[k] if k < count else patch.members[0]
                coefficients[e, k] = patch.mean[k] / length if k < count else 0.0
    return widest


@routine
def surround(flat, patch, t, c):
    """Have a patch of the eight vertices around an edge, side c of triangle t; gives the edge's length [m].

    Both ends, the third corners of this triangle and of the other, and what lies beyond the other sides of both. For
    one that lacks stands the first.
    """
    members, there, local = patch.members, patch.there, patch.local
    for k in range(3):
        corner = (c + k) % 3
        members[k], there[k] = flat.faces[t, corner], True
        local[k, 0], local[k, 1] = flat.corners[t, corner, 0], flat.corners[t, corner, 1]
    beyond, touching = flat.neighbour[t, c], flat.side[t, c]
    turn, shift = flat.turn[t, c], flat.shift[t, c]
    for way in range(5):
        k, start = way + 3, t if way < 3 else beyond
        side = (c + way) % 3 if way < 3 else (touching + way - 2) % 3
        last = flat.neighbour[start, side] if start >= 0 else start
        there[k] = last >= 0
        if last < 0:
            members[k], local[k, 0], local[k, 1] = members[0], 0.0, 0.0
            continue
        corner = (flat.side[start, side] + 2) % 3
        members[k] = flat.faces[last, corner]
        x, y = moved(flat.turn[start, side], flat.shift[start, side], flat.corners[last, corner])
        if way >= 3:
            x, y = turn[0, 0] * x + turn[0, 1] * y + shift[0], turn[1, 0] * x + turn[1, 1] * y + shift[1]
        local[k, 0], local[k, 1] = x, y
    return lay_along(patch, USUAL)


@inlined
def moved(turn, shift, point):
    """A point (2,) after a turn (2, 2) and a shift (2,)."""
    return (
        turn[0, 0] * point[0] + turn[0, 1] * point[1] + shift[0],
        turn[1, 0] * point[0] + turn[1, 1] * point[1] + shift[1],
    )


@routine
def lay_along(patch, count):
    """Have members of a patch that lie in the plane of its first triangle [m] lie along its edge and away from that
    triangle, from the edge's middle and over its length, which is given [m]."""
    local = patch.local
    ax, ay, bx, by, px, py = local[0, 0], local[0, 1], local[1, 0], local[1, 1], local[2, 0], local[2, 1]
    length = math.hypot(bx - ax, by - ay)
    mx, my, ux, uy = 0.5 * (ax + bx), 0.5 * (ay + by), (bx - ax) / length, (by - ay) / length
    turned = -1.0 if (px - ax) * uy - (py - ay) * ux > 0.0 else 1.0
    for k in range(count):
        x, y = (local[k, 0] - mx) / length, (local[k, 1] - my) / length
        local[k, 0], local[k, 1] = ux * x + uy * y, turned * (uy * x - ux * y)
    return length


@routine
def widen(flat, patch, e, t, c, half):
    """Fit the slope across edge e, side c of triangle t, on as many triangles around as it needs; on the two beside it
    where there are too few. Gives how many vertices it has."""
    frames, beyond = patch.frames, flat.neighbour[t, c]
    frames[0, 0], frames[0, 1], frames[0, 2], frames[0, 3], frames[0, 4], frames[0, 5] = 1.0, 0.0, 0.0, 1.0, 0.0, 0.0
    known = 3
    for k in range(3):
        patch.members[k] = flat.faces[t, (c + k) % 3]
    triangles, known = take_in(flat, patch, e, t, 0, known)
    if beyond >= 0:
        set_beside(flat, frames, triangles, 0, t, c)
        patch.members[3] = flat.faces[beyond, (flat.side[t, c] + 2) % 3]
    else:
        patch.members[3] = patch.members[0]
    known = 4
    if beyond >= 0:
        triangles, known = take_in(flat, patch, e, beyond, triangles, known)
    outermost = 0
    for more in range(GROWN, 0, -1):
        end = triangles
        for here in range(outermost, end):
            for side in range(3):
                there = flat.neighbour[patch.triangles[here], side]
                if there >= 0 and patch.taken[there] != e:
                    set_beside(flat, frames, triangles, here, patch.triangles[here], side)
                    triangles, known = take_in(flat, patch, e, there, triangles, known)
        outermost = end
        for k in range(known):
            vertex = patch.members[k]
            patch.there[k] = True
            patch.local[k, 0], patch.local[k, 1] = patch.places[vertex, 0], patch.places[vertex, 1]
        patch.there[3] = beyond >= 0
        lay_along(patch, known)
        if known < QUADRATIC and more > 1:
            continue
        if fit(patch, known, half):
            break
    return known


@routine
def take_in(flat, patch, e, triangle, triangles, known):
    """Take in a triangle whose frame is set, and the vertices of it that edge e has not met; gives how many triangles
    and members there are then. The first four members are there before they are met."""
    frame = patch.frames[triangles]
    patch.triangles[triangles], patch.taken[triangle] = triangle, e
    for k in range(3):
        vertex = flat.faces[triangle, k]
        if patch.met[vertex] == e:
            continue
        patch.met[vertex] = e
        u, v = flat.corners[triangle, k, 0], flat.corners[triangle, k, 1]
        patch.places[vertex, 0] = frame[0] * u + frame[1] * v + frame[4]
        patch.places[vertex, 1] = frame[2] * u + frame[3] * v + frame[5]
        if triangles > 0 and vertex != patch.members[3]:
            patch.members[known] = vertex
            known += 1
    return triangles + 1, known


@inlined
def set_beside(flat, frames, place, frame, triangle, side):
    """Set the frame at a place to that of the triangle beyond a side of one in some frame."""
    a, b, c, d = frames[frame, 0], frames[frame, 1], frames[frame, 2], frames[frame, 3]
    x, y = frames[frame, 4], frames[frame, 5]
    turn, shift = flat.turn[triangle, side], flat.shift[triangle, side]
    frames[place, 0], frames[place, 1] = a * turn[0, 0] + b * turn[1, 0], a * turn[0, 1] + b * turn[1, 1]
    frames[place, 2], frames[place, 3] = c * turn[0, 0] + d * turn[1, 0], c * turn[0, 1] + d * turn[1, 1]
    frames[place, 4], frames[place, 5] = a * shift[0] + b * shift[1] + x, c * shift[0] + d * shift[1] + y


@routine
def fit(patch, count, half):
    """Set the coefficients of a patch's slope to the mean of its two triangles', changed least so that they are exact
    for quadratics, and tell whether the points determine one clearly: else they are not changed."""
    normal, matrix, wanted, basis = patch.normal, patch.matrix, patch.wanted, patch.basis
    set_mean(patch, count)
    normal[:] = 0.0
    matrix[:] = 0.0
    for k in range(count):
        patch.change[k] = patch.cheap[k] = 0.0
        if patch.there[k]:
            x, y = patch.local[k, 0], patch.local[k, 1]
            patch.cheap[k] = 1.0 / max(x * x + y * y, NEAREST) ** half
            set_basis(basis, x, y)
            for a in range(QUADRATIC):
                for b in range(a + 1):
                    normal[a, b] += basis[a] * basis[b]
                    matrix[a, b] += patch.cheap[k] * basis[a] * basis[b]
    least, most = eigenvalues(normal)
    if not least > CLEAR * most:
        return False
    factorise(matrix)
    for _ in range(2):  # the second for the digits that the normal equations lose
        wanted[:] = 0.0
        wanted[2] = 1.0
        for k in range(count):
            if patch.there[k]:
                set_basis(basis, patch.local[k, 0], patch.local[k, 1])
                for a in range(QUADRATIC):
                    wanted[a] -= basis[a] * (patch.mean[k] + patch.change[k])
        solve(matrix, wanted)
        for k in range(count):
            if patch.there[k]:
                set_basis(basis, patch.local[k, 0], patch.local[k, 1])
                total = 0.0
                for a in range(QUADRATIC):
                    total += basis[a] * wanted[a]
                patch.change[k] += patch.cheap[k] * total
    # Where both triangles make a parallelogram there is nothing to correct but rounding.
    largest = 0.0
    for k in range(count):
        largest = max(largest, abs(patch.change[k]))
    if largest >= ROUNDING:
        for k in range(count):
            patch.mean[k] += patch.change[k]
    return True


@routine
def set_mean(patch, count):
    """Set the coefficients of the mean slope across of the triangles beside the first two members.

    The third is of the first triangle, the fourth of the second, where that is there.
    """
    mean, both = patch.mean, patch.there[3]
    for k in range(count):
        mean[k] = 0.0
    for apex in range(2, 4 if both else 3):
        x = patch.local[apex, 0]
        share = (0.5 if both else 1.0) / patch.local[apex, 1]
        mean[apex] += share
        mean[0] -= share * (0.5 - x)
        mean[1] -= share * (0.5 + x)


@inlined
def set_basis(basis, x, y):
    """Set what a quadratic is made of at a point."""
    basis[0], basis[1], basis[2], basis[3], basis[4], basis[5] = 1.0, x, y, 0.5 * x * x, x * y, 0.5 * y * y


@routine
def number_sides(flat, triangles, place, sides, of):
    """Number the edges of some triangles (n,), each once, by the first of the sides that it is.

    Filled are `sides` (3 n,), and for each side of the triangles its place in that, `of` (n, 3); `place` (3 T,) is
    room, -1. Returns how many edges there are.
    """
    count = 0
    for i in range(triangles.size):
        for k in range(3):
            t = triangles[i]
            beyond, side = flat.neighbour[t, k], 3 * t + k
            if beyond >= 0:
                side = min(side, 3 * beyond + flat.side[t, k])
            if place[side] < 0:
                place[side] = count
                sides[count] = side
                count += 1
            of[i, k] = place[side]
    for e in range(count):
        place[sides[e]] = -1
    return count


@routine
def weigh_sides(flat, triangles, sides, of, across, ends):
    """Set what the curvatures of some triangles (n,), along weft, of twist and along warp, are made of by side.

    `across` (n, 3, 3) of the slope across the edge of each side, `of` of which there are in `sides` as `number_sides`
    gives them; `ends` (n, 3, 3) of how much further up the side's end is than its start.
    """
    for i in range(triangles.size):
        corners = flat.corners[triangles[i]]
        px, py = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1]
        qx, qy = corners[2, 0] - corners[0, 0], corners[2, 1] - corners[0, 1]
        area = (px * qy - py * qx) / 2.0
        clockwise = 1.0 if area > 0.0 else -1.0
        for k in range(3):
            x, y = corners[(k + 1) % 3, 0] - corners[k, 0], corners[(k + 1) % 3, 1] - corners[k, 1]
            length = math.sqrt(x * x + y * y)
            u, v = x / length, y / length
            m, n = clockwise * v, clockwise * -u
            weight = length / abs(area)
            # A slope across is away from the first triangle of its edge.
            away = weight * (1.0 if sides[of[i, k]] // 3 == triangles[i] else -1.0)
            across[i, k, 0], across[i, k, 1], across[i, k, 2] = away * (m * m), away * (m * n), away * (n * n)
            ends[i, k, 0] = weight * (m * u) / length
            ends[i, k, 1] = weight * (0.5 * (m * v + n * u)) / length
            ends[i, k, 2] = weight * (n * v) / length


@routine
def gather(vertices, coefficients, edges, across, ends, faces, place, members, rows):
    """Sum up by vertex what curvatures of triangles are made of; returns how many vertices the widest has.

    Of triangle t they are the sum over its three `edges` (n, 3) of `across` (n, 3, 3) times the edge's slope, whose
    `vertices` (E, M) and `coefficients` (E, M) are given, and of `ends` (n, 3, 3) times how much further up the edge's
    end is than its start, corners of `faces` (n, 3). Filled are `members` (n, L), sorted, and `rows` (n, 3, L), where
    one has fewer with its first corner and zeros. L is 3 (M + 1) at least; `place` (N,) of each vertex is room, -1.
    """
    widest = 0
    for t in range(edges.shape[0]):
        own, sums, count = members[t], rows[t], 0
        for k in range(3):
            e, start, end = edges[t, k], faces[t, k], faces[t, (k + 1) % 3]
            for m in range(vertices.shape[1]):
                if coefficients[e, m] != 0.0:
                    count = add_to(vertices[e, m], coefficients[e, m], across[t, k], place, own, sums, count)
            count = add_to(start, -1.0, ends[t, k], place, own, sums, count)
            count = add_to(end, 1.0, ends[t, k], place, own, sums, count)
        for k in range(count):
            place[own[k]] = -1
        count = leave_out_nothing(own, sums, count)
        sort_members(own, sums, count)
        for k in range(count, own.size):
            own[k] = faces[t, 0]
            sums[0, k] = sums[1, k] = sums[2, k] = 0.0
        widest = max(widest, count)
    return widest


@inlined
def add_to(vertex, times, numbers, place, own, sums, count):
    """Add three numbers, some times, to those of a vertex, which may be a new one; gives how many there are then."""
    if place[vertex] < 0:
        place[vertex] = count
        own[count] = vertex
        sums[0, count] = sums[1, count] = sums[2, count] = 0.0
        count += 1
    k = place[vertex]
    sums[0, k] += times * numbers[0]
    sums[1, k] += times * numbers[1]
    sums[2, k] += times * numbers[2]
    return count


@routine
def leave_out_nothing(own, sums, count):
    """Leave out vertices of which nothing is left; gives how many there are then."""
    kept = 0
    for k in range(count):
        if (sums[0, k] != 0.0) | (sums[1, k] != 0.0) | (sums[2, k] != 0.0):
            own[kept] = own[k]
            sums[0, kept], sums[1, kept], sums[2, kept] = sums[0, k], sums[1, k], sums[2, k]
            kept += 1
    return kept


@routine
def sort_members(own, sums, count):
    """Sort vertices, some of which are in order, and what belongs to them."""
    for k in range(1, count):
        vertex, a, b, c = own[k], sums[0, k], sums[1, k], sums[2, k]
        j = k
        while j > 0 and own[j - 1] > vertex:
            own[j] = own[j - 1]
            sums[0, j], sums[1, j], sums[2, j] = sums[0, j - 1], sums[1, j - 1], sums[2, j - 1]
            j -= 1
        own[j], sums[0, j], sums[1, j], sums[2, j] = vertex, a, b, c
