"""XPBD's constraints on a mesh that splits: what has changed gets colours anew, and all are laid out by theirs again.

What stays as it is keeps its colour: where a vertex splits, constraints that shared it share one of its copies at most.
To lay all out is one pass over them, and leaves no gaps to go through in every step.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import inlined, routine
from cape.kernels.xpbd.bending import ROWS, BendConstraints
from cape.kernels.xpbd.membrane import NUMBERS, MembraneConstraints
from cape.kernels.xpbd.mesh import SpringConstraints
from cape.kernels.xpbd.packed import LANES

Array = NDArray[np.floating]
FloatArray = NDArray[np.float64]
Indices = NDArray[np.int64]

IDLE, UNKNOWN = -2, -1  # instead of a colour


class Colored(NamedTuple):
    """E constraints on up to m of V vertices each, some of them idle: their `members` (E, m), -1 for none, and `colors`
    (E,), `IDLE` or `UNKNOWN` for none.

    The first `counts` (1,) of `changed` (E,) are those that have changed. And scratch: `met` (V, W) has a bit for each
    colour that a vertex has met, enough words W for all; `filled` (64 W,) how many constraints there are of each.
    """

    members: Indices
    colors: Indices
    changed: Indices
    counts: Indices
    met: NDArray[np.uint64]
    filled: Indices


class SplitSprings(NamedTuple):
    """The springs of a mesh by slots, see `cape.assembly.mesh.split_springs`, the inverse masses of its vertices
    [1/kg], and room for its constraints."""

    first: Indices
    second: Indices
    stiffness: FloatArray
    rest: FloatArray
    mate: Indices
    inverse_mass: FloatArray
    colored: Colored
    laid: SpringConstraints


class SplitMembrane(NamedTuple):
    """The membrane of a mesh of T triangles, see `cape.assembly.membrane`, `numbers` (3 T, 11) of the edges that its
    sides are, and room for its constraints; for one that an edge lacks stands vertex `nobody`."""

    faces: Indices
    slopes: FloatArray
    area: FloatArray
    neighbours: Indices
    numbers: FloatArray
    nobody: int
    colored: Colored
    laid: MembraneConstraints


class SplitBends(NamedTuple):
    """Bend springs of a mesh, three of each of T triangles: `vertices`, `coefficients` (3 T, M), `stiffness` (3 T,);
    inverse masses [1/kg] and room for constraints. And scratch: how many vertices a patch has, `sizes` (T,), where
    patches of each size begin, `begin` (M + 2,), and two orders of patches (2, T)."""

    vertices: Indices
    coefficients: FloatArray
    stiffness: FloatArray
    inverse_mass: FloatArray
    colored: Colored
    sizes: Indices
    begin: Indices
    orders: Indices
    laid: BendConstraints


@routine
def split_springs(g):
    """Lay out springs some of which have changed; False where there is no room, and what was there is of no use."""
    c, laid, sides = g.colored, g.laid, g.mate.size
    for k in range(c.counts[0]):
        e = c.changed[k]
        acts = g.mate[e] >= e if e < sides else g.stiffness[e] > 0.0
        c.colors[e] = UNKNOWN if acts else IDLE
        c.members[e, 0], c.members[e, 1] = g.first[e], g.second[e]
    stretch = laid.stretch
    room = min(laid.ends.shape[0], stretch.stiffness.size // LANES)
    if not give_colors(c) or not begin_blocks(c, laid.starts, room):
        return False
    for e in range(c.colors.size):
        if c.colors[e] >= 0:
            place = next_place(c, e, laid.starts)
            block, lane, a, b = place // LANES, place % LANES, g.first[e], g.second[e]
            laid.ends[block, lane], laid.ends[block, LANES + lane] = a, b
            stretch.stiffness[place], stretch.rest[place] = g.stiffness[e], g.rest[e]
            stretch.mobility[place] = g.inverse_mass[a] + g.inverse_mass[b]
    for k in range(laid.starts.size - 1):
        for place in range(LANES * laid.starts[k] + filled_of(c, k), LANES * laid.starts[k + 1]):
            block, lane = place // LANES, place % LANES
            laid.ends[block, lane] = laid.ends[block, LANES + lane] = g.inverse_mass.size
            stretch.stiffness[place] = stretch.rest[place] = stretch.mobility[place] = 0.0
    for place in range(LANES * laid.starts[-1], stretch.stiffness.size):
        stretch.stiffness[place] = 0.0
    return True


@routine
def split_membrane(g):
    """Lay out the edges of a membrane some of which have changed; False where there is no room."""
    c, laid = g.colored, g.laid
    for k in range(c.counts[0]):
        measure_edge(g, c.changed[k])
    if not give_colors(c) or not begin_blocks(c, laid.starts, laid.vertices.shape[0]):
        return False
    for e in range(c.colors.size):
        if c.colors[e] >= 0:
            place = next_place(c, e, laid.starts)
            block, lane = place // LANES, place % LANES
            for a in range(4):
                vertex = c.members[e, a]
                laid.vertices[block, LANES * a + lane] = vertex if vertex >= 0 else g.nobody
            for a in range(NUMBERS):
                laid.numbers[block, LANES * a + lane] = g.numbers[e, a]
    for k in range(laid.starts.size - 1):
        for place in range(LANES * laid.starts[k] + filled_of(c, k), LANES * laid.starts[k + 1]):
            block, lane = place // LANES, place % LANES
            for a in range(4):
                laid.vertices[block, LANES * a + lane] = g.nobody
            for a in range(NUMBERS):
                laid.numbers[block, LANES * a + lane] = 0.0
    return True


@inlined
def measure_edge(g, e):
    """Set vertices and numbers of the edge that a side is, if it is the first one of it."""
    c, t, corner = g.colored, e // 3, e % 3
    beyond = g.neighbours[t, corner]
    if beyond < t:
        c.colors[e] = IDLE
        return
    first, second, own = g.faces[t, corner], g.faces[t, (corner + 1) % 3], g.numbers[e]
    total = g.area[t] if beyond == t else g.area[t] + g.area[beyond]
    c.colors[e] = UNKNOWN
    c.members[e, 0], c.members[e, 1] = first, second
    c.members[e, 2] = slopes_from(g, t, first, second, own, 0)
    third = slopes_from(g, beyond, first, second, own, 4)
    own[8] = g.area[t] / total
    own[9] = 1.0 - own[8]
    own[10] = total / 3.0
    c.members[e, 3] = third if own[9] != 0.0 else -1


@inlined
def slopes_from(g, t, first, second, own, place):
    """Put slopes of an edge's second end, and of the third corner, into its numbers; gives that corner's vertex."""
    third = 0
    for k in range(3):
        vertex = g.faces[t, k]
        if vertex == first:
            continue
        at = place if vertex == second else place + 2
        if vertex != second:
            third = vertex
        for axis in range(2):
            own[at + axis] = -(g.slopes[t, 0, axis] + g.slopes[t, 1, axis]) if k == 0 else g.slopes[t, k - 1, axis]
    return third


@routine
def split_bends(g):
    """Lay out patches of bend springs some of which have changed; False where there is no room."""
    c, laid = g.colored, g.laid
    for k in range(c.counts[0]):
        p, size = c.changed[k], 0
        for m in range(g.vertices.shape[1]):
            if acting(g, p, 0, m) != 0.0 or acting(g, p, 1, m) != 0.0 or acting(g, p, 2, m) != 0.0:
                c.members[p, size] = g.vertices[ROWS * p, m]
                size += 1
        for m in range(size, g.vertices.shape[1]):
            c.members[p, m] = -1
        g.sizes[p], c.colors[p] = size, UNKNOWN if size > 0 else IDLE
    if not give_colors(c):
        return False
    count = sort_patches(g)
    if count < 0:
        return False
    n, place, patches, bend = 0, g.orders[0], g.orders[1], laid.bend
    for k in range(count):
        p, laid.first[k] = patches[k], n
        n, place[p] = n + g.sizes[p], k
    if n > min(laid.members.size, laid.coefficients.size // ROWS):
        return False
    for k in range(count, laid.first.size):
        laid.first[k] = n
    # In the order in which they are read, as more is read than is written.
    for p in range(c.colors.size):
        if c.colors[p] >= 0:
            lay_patch(g, p, place[p])
    bend.stiffness[ROWS * count :] = 0.0
    return True


@inlined
def acting(g, p, row, m):
    """The coefficient of a spring of patch p for its vertex m, nothing where it is idle."""
    return g.coefficients[ROWS * p + row, m] if g.stiffness[ROWS * p + row] > 0.0 else 0.0


@inlined
def lay_patch(g, p, k):
    """Lay out patch p as the k-th."""
    laid, bend, n = g.laid, g.laid.bend, g.laid.first[k]
    aa = bb = cc = ab = ac = bc = 0.0
    for m in range(g.vertices.shape[1]):
        a, b, c = acting(g, p, 0, m), acting(g, p, 1, m), acting(g, p, 2, m)
        if a != 0.0 or b != 0.0 or c != 0.0:
            vertex = g.vertices[ROWS * p, m]
            w = g.inverse_mass[vertex]
            aa, bb, cc = aa + w * a * a, bb + w * b * b, cc + w * c * c
            ab, ac, bc = ab + w * a * b, ac + w * a * c, bc + w * b * c
            laid.members[n] = vertex
            laid.coefficients[ROWS * n], laid.coefficients[ROWS * n + 1], laid.coefficients[ROWS * n + 2] = a, b, c
            n += 1
    laid.mixed[k, 0], laid.mixed[k, 1], laid.mixed[k, 2] = ab, ac, bc
    at = ROWS * k
    bend.mobility[at], bend.mobility[at + 1], bend.mobility[at + 2] = aa, bb, cc
    for row in range(ROWS):
        bend.stiffness[at + row] = g.stiffness[ROWS * p + row]


@routine
def sort_patches(g):
    """Order patches by colour, those of one by how many vertices they have, so that loops end as foreseen; gives how
    many there are, or -1 where there is no room for them."""
    c, starts, begin, total = g.colored, g.laid.starts, g.begin, 0
    begin[:] = 0
    for p in range(c.colors.size):
        if c.colors[p] >= 0:
            begin[g.sizes[p] + 1] += 1
            total += 1
    room = min(g.laid.first.size - 1, g.laid.mixed.shape[0], g.laid.bend.stiffness.size // ROWS)
    if total > room or not has_room(c, starts):
        return -1
    for k in range(begin.size - 1):
        begin[k + 1] += begin[k]
    for p in range(c.colors.size):
        if c.colors[p] >= 0:
            g.orders[0, begin[g.sizes[p]]] = p
            begin[g.sizes[p]] += 1
    starts[0] = 0
    for k in range(starts.size - 1):
        starts[k + 1] = starts[k] + filled_of(c, k)
    c.filled[:] = 0
    for k in range(total):
        p = g.orders[0, k]
        g.orders[1, starts[c.colors[p]] + c.filled[c.colors[p]]] = p
        c.filled[c.colors[p]] += 1
    return total


@routine
def give_colors(c):
    """Give constraints of unknown colour the first one that none of their vertices has met, in the order in which they
    have changed, and count those of each; tells whether there are enough colours."""
    one, full, met = np.uint64(1), ~np.uint64(0), c.met
    met[:] = np.uint64(0)
    c.filled[:] = 0
    for e in range(c.colors.size):
        if c.colors[e] >= 0:
            mark(c, e)
    for k in range(c.counts[0]):
        e = c.changed[k]
        if c.colors[e] != UNKNOWN:
            continue
        word, taken = 0, full
        while taken == full:
            if word == met.shape[1]:
                return False
            taken = np.uint64(0)
            for a in range(c.members.shape[1]):
                if c.members[e, a] >= 0:
                    taken |= met[c.members[e, a], word]
            word += 1
        colour = 0
        while (taken >> np.uint64(colour)) & one:
            colour += 1
        c.colors[e] = 64 * (word - 1) + colour
        mark(c, e)
    return True


@inlined
def mark(c, e):
    """Have the vertices of a constraint meet its colour, and count it."""
    word, bit = c.colors[e] // 64, np.uint64(1) << np.uint64(c.colors[e] % 64)
    for a in range(c.members.shape[1]):
        if c.members[e, a] >= 0:
            c.met[c.members[e, a], word] |= bit
    c.filled[c.colors[e]] += 1


@routine
def begin_blocks(c, starts, room):
    """Set where the blocks of each colour begin, none of which is filled yet; tells whether there are as many."""
    if not has_room(c, starts):
        return False
    starts[0] = 0
    for k in range(starts.size - 1):
        starts[k + 1] = starts[k] + (filled_of(c, k) + LANES - 1) // LANES
    c.filled[:] = 0
    return starts[-1] <= room


@inlined
def has_room(c, starts):
    """Whether no colour is more than there are places where one starts."""
    colours = 0
    for k in range(c.filled.size):
        if c.filled[k] > 0:
            colours = k + 1
    return colours < starts.size


@inlined
def next_place(c, e, starts):
    """The next place in the blocks of a constraint's colour."""
    colour = c.colors[e]
    c.filled[colour] += 1
    return LANES * starts[colour] + c.filled[colour] - 1


@inlined
def filled_of(c, k):
    """How many constraints of a colour there are, or have been laid out."""
    return c.filled[k] if k < c.filled.size else 0
