"""Which vertices and triangles, and which edges, of a cloth may touch soon.

A search looks only into pairs of patches whose boxes overlap and that aren't calm neighbours, lists there what comes
within reach while the vertices go on as they move now, and lets pairs that were listed before keep what is known of
them. A list serves until a vertex has strayed, relative to the cloth's mean motion, from the way that it was foreseen
to go by half of the margin that was allowed for.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import inlined, routine
from cape.kernels.self_contact.closest import (
    from_edge,
    from_triangle,
    is_beyond_edge,
    is_beyond_triangle,
    speed_to_edge,
    speed_to_triangle,
)
from cape.kernels.self_contact.patches import (
    Indices,
    are_neighbors,
    is_calm,
    set_cones,
    sweep_all,
)
from cape.kernels.self_contact.tree import begin_pairs, next_pair, set_boxes

TOUCHING = -1.0  # instead of a time


class Pairs(NamedTuple):
    """Listed pairs: `first` and `second` (room,), vertex and triangle or edge and edge; in `apart` (room, 3) the vector
    [m] from the second's to the first's closest point when they were last on their proper sides; when to look at them
    again, `due` (room,) [s], `TOUCHING` at every beat; and the `force` (room, 3) [N] on the first's point that holds
    touching ones until then. `counts` (2,): how many there are, and how many had no room so far.

    The same once more for the list before, chained by first partners in `head` and `following`.
    """

    counts: Indices
    first: NDArray[np.uint32]
    second: NDArray[np.uint32]
    apart: NDArray[np.float32]
    due: NDArray[np.float64]
    force: NDArray[np.float64]
    old_first: NDArray[np.uint32]
    old_second: NDArray[np.uint32]
    old_apart: NDArray[np.float32]
    old_due: NDArray[np.float64]
    old_force: NDArray[np.float64]
    head: NDArray[np.int32]
    following: NDArray[np.int32]


@routine
def search(layers, inverse_mass):
    """List all pairs that may come within reach of each other on the ways that were looked at last.

    Left out are those that share a vertex, that nothing can move, or that are nearer than the thickness at rest.
    """
    patches, sight, faces, edges = layers.patches, layers.sight, layers.faces, layers.edges
    reach = layers.thickness + layers.margin
    sweep_all(patches.triangles, patches.edges, sight, reach)
    set_cones(patches.triangle_start, sight.normals, sight.cones)
    set_boxes(sight.tree, patches.triangle_start, sight.triangle_boxes)
    put_aside(faces)
    put_aside(edges)
    find_pairs(layers, inverse_mass, reach)
    remember(faces)
    remember(edges)


@routine
def find_pairs(layers, inverse_mass, reach):
    """List the pairs of all patches that come near, until a list is full: then it is all done again with more room."""
    patches, sight, faces, edges = layers.patches, layers.sight, layers.faces, layers.edges
    tree, picked, matched = sight.tree, sight.picked, sight.matched
    waiting = begin_pairs(tree)
    while faces.counts[1] + edges.counts[1] == 0:
        m, n, waiting = next_pair(tree, waiting)
        if m < 0:
            return
        a, b = tree.first[m], tree.first[n]
        if are_neighbors(patches, a, b) and is_calm(sight.cones, a, b):
            continue
        mine, theirs = tree.boxes[m], tree.boxes[n]
        x0, y0, z0 = max(mine[0], theirs[0]), max(mine[1], theirs[1]), max(mine[2], theirs[2])
        x1, y1, z1 = min(mine[3], theirs[3]), min(mine[4], theirs[4]), min(mine[5], theirs[5])
        common = x0, y0, z0, x1, y1, z1
        ta = pick(patches.triangle_start, a, None, sight.triangle_boxes, common, picked[1])
        tb = pick(patches.triangle_start, b, None, sight.triangle_boxes, common, picked[4])
        if ta == 0 or tb == 0:  # vertices and edges are those of triangles
            continue
        va = pick(patches.vertex_start, a, patches.vertices, sight.vertex_boxes, common, picked[0])
        ea = pick(patches.edge_start, a, None, sight.edge_boxes, common, picked[2])
        vb = pick(patches.vertex_start, b, patches.vertices, sight.vertex_boxes, common, picked[3])
        eb = pick(patches.edge_start, b, None, sight.edge_boxes, common, picked[5])
        count = match(picked[0], va, sight.vertex_boxes, picked[4], tb, sight.triangle_boxes, False, matched)
        list_faces(layers, count, inverse_mass, reach)
        if a != b:
            count = match(picked[3], vb, sight.vertex_boxes, picked[1], ta, sight.triangle_boxes, False, matched)
            list_faces(layers, count, inverse_mass, reach)
        count = match(picked[2], ea, sight.edge_boxes, picked[5], eb, sight.edge_boxes, a == b, matched)
        list_edges(layers, count, inverse_mass, reach)


@routine
def pick(start, p, names, boxes, common, picked):
    """Write what of patch p overlaps a common box; returns how many. `names` are None for what is sorted by patch."""
    count = 0
    for k in range(start[p], start[p + 1]):
        i = np.uint32(k) if names is None else names[k]
        picked[count] = i
        count += (
            (boxes[0, i] < common[3])
            & (boxes[1, i] < common[4])
            & (boxes[2, i] < common[5])
            & (boxes[3, i] > common[0])
            & (boxes[4, i] > common[1])
            & (boxes[5, i] > common[2])
        )
    return count


@routine
def match(mine, count, my_boxes, theirs, others, their_boxes, once, matched):
    """Write the pairs whose boxes overlap, each `once` where both lists are the same; returns how many."""
    found = 0
    for k in range(count):
        i = mine[k]
        x0, y0, z0 = my_boxes[0, i], my_boxes[1, i], my_boxes[2, i]
        x1, y1, z1 = my_boxes[3, i], my_boxes[4, i], my_boxes[5, i]
        for m in range(k + 1 if once else 0, others):
            j = theirs[m]
            matched[0, found], matched[1, found] = i, j
            found += (
                (their_boxes[0, j] < x1)
                & (their_boxes[1, j] < y1)
                & (their_boxes[2, j] < z1)
                & (their_boxes[3, j] > x0)
                & (their_boxes[4, j] > y0)
                & (their_boxes[5, j] > z0)
            )
    return found


@routine
def list_faces(layers, count, inverse_mass, reach):
    """List those of matched vertices and triangles that come near."""
    matched, triangles, rest, p = (
        layers.sight.matched,
        layers.patches.triangles,
        layers.patches.rest,
        layers.sight.places,
    )
    for k in range(count):
        i, t = matched[0, k], matched[1, k]
        a, b, c = triangles[0, t], triangles[1, t], triangles[2, t]
        if (i == a) | (i == b) | (i == c):
            continue
        most = reach + speed_to_triangle(i, a, b, c, p[3], p[4], p[5])
        if is_beyond_triangle(i, a, b, c, p[0], p[1], p[2], most):
            continue
        gx, gy, gz, _, _, _, _ = from_triangle(i, a, b, c, p[0], p[1], p[2])
        if gx * gx + gy * gy + gz * gz > most * most:
            continue
        if not is_beyond_triangle(i, a, b, c, rest[0], rest[1], rest[2], layers.thickness):
            rx, ry, rz, _, _, _, _ = from_triangle(i, a, b, c, rest[0], rest[1], rest[2])
            if rx * rx + ry * ry + rz * rz < layers.thickness**2:
                continue
        if is_movable(i, a, b, c, inverse_mass):
            append(layers.faces, i, t, gx, gy, gz)


@routine
def list_edges(layers, count, inverse_mass, reach):
    """List those of matched edges that come near."""
    patches, matched, p = layers.patches, layers.sight.matched, layers.sight.places
    ends, rest = patches.edges, patches.rest
    for k in range(count):
        e, f = matched[0, k], matched[1, k]
        a, b, c, d = ends[0, e], ends[1, e], ends[0, f], ends[1, f]
        if (a == c) | (a == d) | (b == c) | (b == d):
            continue
        most = reach + speed_to_edge(a, b, c, d, p[3], p[4], p[5])
        if is_beyond_edge(a, b, c, d, p[0], p[1], p[2], most):
            continue
        gx, gy, gz, _, _, _ = from_edge(a, b, c, d, p[0], p[1], p[2])
        if gx * gx + gy * gy + gz * gz > most * most:
            continue
        if not is_beyond_edge(a, b, c, d, rest[0], rest[1], rest[2], layers.thickness):
            rx, ry, rz, _, _, _ = from_edge(a, b, c, d, rest[0], rest[1], rest[2])
            if rx * rx + ry * ry + rz * rz < layers.thickness**2:
                continue
        if is_movable(a, b, c, d, inverse_mass):
            append(layers.edges, e, f, gx, gy, gz)


@inlined
def is_movable(a, b, c, d, inverse_mass):
    """Tell whether not all of four vertices are attached."""
    return inverse_mass[a] + inverse_mass[b] + inverse_mass[c] + inverse_mass[d] > 0.0


@inlined
def append(pairs, first, second, gx, gy, gz):
    """Write a pair that is g apart [m] behind the list, or count it as surplus where there is no room."""
    k = pairs.counts[0]
    if k == pairs.first.size:
        pairs.counts[1] += 1
        return
    pairs.first[k], pairs.second[k] = first, second
    pairs.apart[k, 0], pairs.apart[k, 1], pairs.apart[k, 2] = gx, gy, gz
    pairs.counts[0] = k + 1


@routine
def put_aside(pairs):
    """Start a new list, keeping the old one where `remember` finds it."""
    for k in range(pairs.counts[0] - 1, -1, -1):
        i = pairs.first[k]
        pairs.old_first[k], pairs.old_second[k], pairs.old_due[k] = i, pairs.second[k], pairs.due[k]
        for axis in range(3):
            pairs.old_apart[k, axis], pairs.old_force[k, axis] = pairs.apart[k, axis], pairs.force[k, axis]
        pairs.following[k] = pairs.head[i]
        pairs.head[i] = k
    pairs.counts[0] = 0


@routine
def remember(pairs):
    """Give the pairs that were on the old list, too, what was known of them; the others are due at once."""
    for k in range(pairs.counts[0]):
        m = pairs.head[pairs.first[k]]
        while m >= 0 and pairs.old_second[m] != pairs.second[k]:
            m = pairs.following[m]
        pairs.due[k] = pairs.old_due[m] if m >= 0 else 0.0
        for axis in range(3):
            pairs.force[k, axis] = pairs.old_force[m, axis] if m >= 0 else 0.0
            if m >= 0:
                pairs.apart[k, axis] = pairs.old_apart[m, axis]
    pairs.head[:] = -1
