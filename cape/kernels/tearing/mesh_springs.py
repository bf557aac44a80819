"""The springs of a mesh as some of its edges part: what changes is found, and written in place.

See `cape.assembly.mesh.split_springs`. Bending follows in `kernels.tearing.mesh_bends`.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import inlined, routine
from cape.kernels.tearing.in_plane import Fits, cross_stiffness, edge_length, edge_stiffness, is_alone, next_side

FloatArray = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


class Torn(NamedTuple):
    """The mesh as it is now: `faces` (T, 3), which of its N vertices have `split` (N,), and where they are, `positions`
    (N, 3) [m]. What is not seen by the arrays that follow it."""

    faces: Indices
    split: Flags
    positions: FloatArray


class Found(NamedTuple):
    """What has changed, as `split_springs.Changed` has it: triangles (T,), sides (3 T,), E slots and vertices (N,), of
    each the first `counts` (7,), in order; after those, triangles at edges that have parted, `near`, and those without
    neighbours, `alone`. `stored` (2,) is the energy before and after [J]. The flags are scratch, all down."""

    triangles: Indices
    parted: Indices
    slots: Indices
    bent: Indices
    near: Indices
    alone: Indices
    rows: Indices
    counts: Indices
    stored: FloatArray
    of_triangle: Flags
    of_side: Flags
    of_slot: Flags
    of_vertex: Flags


TRIANGLES, PARTED, SLOTS, BENT, NEAR, ALONE, ROWS = range(7)  # places in `counts`


class MembraneParts(NamedTuple):
    """A membrane that follows, as `cape.assembly.membrane.Membrane` has it; `stiffness` (1, 3, 3) or (T, 3, 3)."""

    faces: Indices
    slopes: FloatArray
    area: FloatArray
    neighbours: Indices
    own: FloatArray
    share: FloatArray
    stiffness: FloatArray


class Bends(NamedTuple):
    """Bend springs, three of each triangle: `vertices` and `coefficients` (3 T, M), `stiffness` (3 T,) [N/m]."""

    vertices: Indices
    coefficients: FloatArray
    stiffness: FloatArray


class SpringParts(NamedTuple):
    """Springs that follow, as `split_springs.SplitMeshSprings` has them; `carrying` is their stiffness, or that of the
    nearest where a membrane takes their place."""

    faces: Indices
    fits: Fits
    neighbour: Indices
    along: Flags
    over: Indices
    first: Indices
    second: Indices
    stiffness: FloatArray
    carrying: FloatArray
    rest: FloatArray
    measured: Flags
    membrane: MembraneParts | None
    bends: Bends | None
    torn: Torn
    found: Found


@routine
def part_springs(g):
    """Find what has changed, and have all follow but what is fitted: stiffness, rest lengths, bends."""
    found = g.found
    find_parted(g)
    find_slots(g)
    find_bent(g.bends, g.torn, found)
    found.stored[0] = stored(g)
    for k in range(found.counts[TRIANGLES]):
        t = found.triangles[k]
        for corner in range(3):
            g.faces[t, corner] = g.torn.faces[t, corner]
    for k in range(found.counts[PARTED]):
        part(g, found.parted[k])
    for k in range(found.counts[TRIANGLES]):
        for side in range(3 * found.triangles[k], 3 * found.triangles[k] + 3):
            g.first[side], g.second[side] = in_order(g.faces, side, next_side(side, 1))
            if g.over[side] >= 0:
                cross = g.over[side]
                opposite = next_side(side, 2), next_side(g.fits.mate[side], 2)
                g.first[cross], g.second[cross] = in_order(g.faces, opposite[0], opposite[1])
    part_membrane(g.membrane, g.faces, found)
    # What is alone by now is to be fitted before anything asks for it.
    found.counts[ALONE] = 0
    for k in range(found.counts[NEAR]):
        if is_alone(g.fits, found.near[k]):
            found.alone[found.counts[ALONE]] = found.near[k]
            found.counts[ALONE] += 1


@routine
def stiffen_springs(g):
    """Set what is fitted of edges and cross springs around edges that have parted, and tell what is stored then."""
    found, fits = g.found, g.fits
    for k in range(found.counts[NEAR]):
        t = found.near[k]
        for side in range(3 * t, 3 * t + 3):
            # The edges of these triangles, and of those beside them: some more than once.
            u = fits.mate[side] // 3
            for beside in range(3 * u, 3 * u + 3):
                stiffen(g, min(beside, fits.mate[beside]))
            stiffen(g, min(side, fits.mate[side]))
            if g.over[side] >= 0:
                g.stiffness[g.over[side]] = cross_stiffness(fits, side)
    found.stored[1] = stored(g)


@inlined
def stiffen(g, edge):
    """Set what is fitted of an edge, given by its first side."""
    g.carrying[edge], g.rest[edge] = edge_stiffness(g.fits, edge), edge_length(g.fits, edge)


@routine
def find_parted(g):
    """Find triangles with other corners than before, sides that have parted, and triangles that these belong to."""
    found, mate, now, triangles = g.found, g.fits.mate, g.torn.faces, 0
    for t in range(now.shape[0]):
        if (now[t, 0] != g.faces[t, 0]) | (now[t, 1] != g.faces[t, 1]) | (now[t, 2] != g.faces[t, 2]):
            found.triangles[triangles] = t
            triangles += 1
    found.counts[TRIANGLES] = triangles
    for k in range(triangles):
        for side in range(3 * found.triangles[k], 3 * found.triangles[k] + 3):
            other = mate[side]
            if in_order(now, side, next_side(side, 1)) != in_order(now, other, next_side(other, 1)):
                found.of_side[side] = found.of_side[other] = True
                found.of_triangle[side // 3] = found.of_triangle[other // 3] = True
    found.counts[PARTED] = collect(found.of_side, found.parted)
    found.counts[NEAR] = collect(found.of_triangle, found.near)


@routine
def find_slots(g):
    """Find the slots of springs that may have changed, and mark the triangles around edges that have parted."""
    found, mate = g.found, g.fits.mate
    for k in range(found.counts[PARTED]):
        found.of_slot[found.parted[k]] = True
    for k in range(found.counts[TRIANGLES]):
        mark_slots(g, found.triangles[k])
    for k in range(found.counts[NEAR]):
        t = found.near[k]
        found.of_triangle[t] = True
        mark_slots(g, t)
        for side in range(3 * t, 3 * t + 3):
            found.of_triangle[mate[side] // 3] = True
            mark_slots(g, mate[side] // 3)
    found.counts[SLOTS] = collect(found.of_slot, found.slots)
    for k in range(found.counts[TRIANGLES]):
        found.of_triangle[found.triangles[k]] = True


@inlined
def mark_slots(g, t):
    """Mark the slots of the edges of a triangle, and of the cross springs over them."""
    for side in range(3 * t, 3 * t + 3):
        g.found.of_slot[min(side, g.fits.mate[side])] = True
        if g.over[side] >= 0:
            g.found.of_slot[g.over[side]] = True


@routine
def find_bent(bends, torn, found):
    """Find triangles whose bends, if there are any, lead to vertices that have split, with those that are marked; and
    mark all that these lead to."""
    marked = found.of_triangle
    if bends is not None:
        for t in range(marked.size):
            for m in range(bends.vertices.shape[1]):
                marked[t] |= torn.split[bends.vertices[3 * t, m]]
        found.counts[BENT] = collect(marked, found.bent)
        for k in range(found.counts[BENT]):
            for m in range(bends.vertices.shape[1]):
                found.of_vertex[bends.vertices[3 * found.bent[k], m]] = True
    else:
        marked[:] = False


@inlined
def part(g, side):
    """Have a side be a border."""
    fits, cross = g.fits, g.over[side]
    if cross >= 0:
        g.stiffness[cross], g.second[cross] = 0.0, g.first[cross]
        g.over[side] = -1
    fits.mate[side], fits.cross[side], fits.trust[side] = side, 0.0, 0.0
    for k in range(3):
        fits.weight[side, k] = 0.0
    g.neighbour[side // 3, side % 3] = -1
    g.measured[side] = g.along[side]


@routine
def part_membrane(membrane, faces, found):
    """Have a membrane follow, if there is one."""
    if membrane is not None:
        for k in range(found.counts[TRIANGLES]):
            t = found.triangles[k]
            for corner in range(3):
                membrane.faces[t, corner] = faces[t, corner]
        for k in range(found.counts[PARTED]):
            t, c = found.parted[k] // 3, found.parted[k] % 3
            membrane.neighbours[t, c], membrane.share[t, c] = t, 0.0
        for k in range(found.counts[NEAR]):
            t = found.near[k]
            membrane.own[t] = 1.0 - (membrane.share[t, 0] + membrane.share[t, 1] + membrane.share[t, 2])


@routine
def stored(g):
    """Energy of what has changed, or will [J]."""
    found, x, energy = g.found, g.torn.positions, 0.0
    for k in range(found.counts[SLOTS]):
        e = found.slots[k]
        i, j = g.first[e], g.second[e]
        length = math.sqrt((x[j, 0] - x[i, 0]) ** 2 + (x[j, 1] - x[i, 1]) ** 2 + (x[j, 2] - x[i, 2]) ** 2)
        energy += 0.5 * g.stiffness[e] * (length - g.rest[e]) ** 2
    return energy + bending(g.bends, found, x) + drawing(g.membrane, found, x)


@routine
def bending(bends, found, x):
    """Energy of bends that have changed, if there are any [J]."""
    energy = 0.0
    if bends is not None:
        for k in range(found.counts[BENT]):
            for row in range(3 * found.bent[k], 3 * found.bent[k] + 3):
                a = b = c = 0.0
                for m in range(bends.vertices.shape[1]):
                    i, times = bends.vertices[row, m], bends.coefficients[row, m]
                    a, b, c = a + times * x[i, 0], b + times * x[i, 1], c + times * x[i, 2]
                energy += 0.5 * bends.stiffness[row] * (a * a + b * b + c * c)
    return energy


@routine
def drawing(membrane, found, x):
    """Energy that triangles at edges which have parted add to that of a membrane, if there is one [J]."""
    energy = 0.0
    if membrane is not None:
        for k in range(found.counts[NEAR]):
            energy += drawn(membrane, found.near[k], x)
    return energy


@routine
def drawn(membrane, t, x):
    """Energy that a triangle adds to that of a membrane [J]."""
    weft, warp, shear = strains(membrane, t, x)
    own = membrane.own[t]
    u, v, w = own * weft, own * warp, own * shear
    for side in range(3):
        share = membrane.share[t, side]
        if share != 0.0:
            a, b, c = strains(membrane, membrane.neighbours[t, side], x)
            u, v, w = u + share * a, v + share * b, w + share * c
    k = membrane.stiffness[t if membrane.stiffness.shape[0] > 1 else 0]
    p = k[0, 0] * u + k[0, 1] * v + k[0, 2] * w
    q = k[1, 0] * u + k[1, 1] * v + k[1, 2] * w
    r = k[2, 0] * u + k[2, 1] * v + k[2, 2] * w
    return 0.5 * membrane.area[t] * (weft * p + warp * q + shear * r)


@routine
def strains(membrane, t, x):
    """Strains of a triangle along weft and warp, and the shear angle."""
    faces, slopes = membrane.faces, membrane.slopes[t]
    weft = warp = shear = 0.0
    for axis in range(3):
        start = x[faces[t, 0], axis]
        p, q = x[faces[t, 1], axis] - start, x[faces[t, 2], axis] - start
        u, v = slopes[0, 0] * p + slopes[1, 0] * q, slopes[0, 1] * p + slopes[1, 1] * q
        weft, warp, shear = weft + u * u, warp + v * v, shear + u * v
    return 0.5 * (weft - 1.0), 0.5 * (warp - 1.0), shear


@inlined
def in_order(faces, one, other):
    """The vertices at two corners, given by their places 3 t + c, the lower one first."""
    i, j = faces[one // 3, one % 3], faces[other // 3, other % 3]
    return min(i, j), max(i, j)


@routine
def collect(flags, numbers):
    """List the numbers of flags that are up, and take them down; gives how many there were."""
    count = 0
    for k in range(flags.size):
        if flags[k]:
            numbers[count] = k
            flags[k] = False
            count += 1
    return count
