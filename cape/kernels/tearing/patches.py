"""What patches of a cloth are made of, listed anew where it has split."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import inlined, routine
from cape.kernels.self_contact.near_pairs import Pairs
from cape.kernels.self_contact.patches import Patches

Indices = NDArray[np.int64]


KEY = 32  # bits of a key that tell the upper vertex


class Listed(NamedTuple):
    """The edges and vertices of P patches of a cloth of N vertices, each in the first of its patches, there in order.

    An edge goes by a key, its lower vertex and then its upper one. `edges` (E,) has room for as many as there may be,
    `vertices` (N,) for all; `edge_start` and `vertex_start` (P + 1,) tell where each patch starts.

    And scratch: `found` (E,), the keys in the order in which they were met; chains of edges with the same lower vertex,
    `head` (N,) and `following` (E,); which vertices were `seen` (N,).
    """

    edges: Indices
    edge_start: Indices
    vertices: Indices
    vertex_start: Indices
    found: Indices
    head: Indices
    following: Indices
    seen: NDArray[np.bool_]


class Relisted(NamedTuple):
    """The triangles of a cloth as they are now, in the order of its patches, `triangles` (3, T), those patches, pairs
    of edges, and room."""

    triangles: NDArray[np.uint32]
    patches: Patches
    pairs: Pairs
    listed: Listed


@routine
def relist(g, most):
    """Have patches be made of what triangles have by now, and pairs of edges be those that are still there.

    Nothing is changed, and False is given, where there is no room for the edges, or where a patch had more than `most`
    edges or vertices.
    """
    patches, listed = g.patches, g.listed
    widest = list_by_patch(g.triangles, patches.triangle_start, listed)
    if not 0 <= widest < most:
        return False
    renumber(g.pairs, patches.edges, listed)
    for corner in range(3):
        for t in range(g.triangles.shape[1]):
            patches.triangles[corner, t] = g.triangles[corner, t]
    for p in range(listed.edge_start.size):
        patches.edge_start[p], patches.vertex_start[p] = listed.edge_start[p], listed.vertex_start[p]
    for e in range(listed.edge_start[-1]):
        patches.edges[0, e], patches.edges[1, e] = lower_of(listed.edges[e]), upper_of(listed.edges[e])
    for k in range(listed.vertex_start[-1]):
        patches.vertices[k] = listed.vertices[k]
    return True


@routine
def list_by_patch(triangles, start, listed):
    """List the edges and vertices of triangles (3, T), whose patches start at `start` (P + 1,).

    Returns how many edges, or vertices, a patch has at most; -1 where there is no room for the edges.
    """
    edges, vertices, most = 0, 0, 0
    listed.head[:] = -1
    listed.seen[:] = False
    for patch in range(start.size - 1):
        first_edge, first_vertex = edges, vertices
        for t in range(start[patch], start[patch + 1]):
            for corner in range(3):
                i, j = np.int64(triangles[corner, t]), np.int64(triangles[(corner + 1) % 3, t])
                if not listed.seen[i]:
                    listed.seen[i] = True
                    listed.vertices[vertices] = i
                    vertices += 1
                key = key_of(i, j)
                if place_of(listed, listed.found, key) >= 0:
                    continue
                if edges == listed.found.size:
                    return -1
                listed.found[edges] = listed.edges[edges] = key
                chain(listed, edges, key)
                edges += 1
        put_in_order(listed.edges, first_edge, edges)
        put_in_order(listed.vertices, first_vertex, vertices)
        listed.edge_start[patch + 1], listed.vertex_start[patch + 1] = edges, vertices
        most = max(most, max(edges - first_edge, vertices - first_vertex))
    # From now on they are found where they have come to stand.
    listed.head[:] = -1
    for edge in range(edges):
        chain(listed, edge, listed.edges[edge])
    return most


@routine
def renumber(pairs, before, listed):
    """Keep the pairs of edges that are still there, by their new numbers; the edges were `before` (2, E)."""
    kept = 0
    for k in range(pairs.counts[0]):
        i, j = pairs.first[k], pairs.second[k]
        first = place_of(listed, listed.edges, key_of(np.int64(before[0, i]), np.int64(before[1, i])))
        second = place_of(listed, listed.edges, key_of(np.int64(before[0, j]), np.int64(before[1, j])))
        if first < 0 or second < 0:
            continue
        pairs.first[kept], pairs.second[kept], pairs.due[kept] = first, second, pairs.due[k]
        for axis in range(3):
            pairs.apart[kept, axis], pairs.force[kept, axis] = pairs.apart[k, axis], pairs.force[k, axis]
        kept += 1
    pairs.counts[0] = kept


@inlined
def key_of(i, j):
    """The key of an edge between two vertices."""
    return (min(i, j) << KEY) | max(i, j)


@inlined
def lower_of(key):
    """The lower vertex of an edge."""
    return key >> KEY


@inlined
def upper_of(key):
    """The upper vertex of an edge."""
    return key & ((1 << KEY) - 1)


@inlined
def place_of(listed, keys, key):
    """Where an edge stands among `keys` (E,), -1 where it does not."""
    place = listed.head[lower_of(key)]
    while place >= 0 and keys[place] != key:
        place = listed.following[place]
    return place


@inlined
def chain(listed, edge, key):
    """Have an edge be found by its lower vertex."""
    lower = lower_of(key)
    listed.following[edge] = listed.head[lower]
    listed.head[lower] = edge


@inlined
def put_in_order(values, begin, end):
    """Sort a few values in place."""
    for k in range(begin + 1, end):
        value, place = values[k], k
        while place > begin and values[place - 1] > value:
            values[place] = values[place - 1]
            place -= 1
        values[place] = value
