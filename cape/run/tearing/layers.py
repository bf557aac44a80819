"""How what keeps a cloth off itself follows what has split, in place.

Triangles stay in their patches. Edges and vertices that are new go to the patches of their triangles, all are listed
anew, and what was known of pairs is kept, but for edges that are no more.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cape.assembly.self_contact import cut_into_patches, rest_shape
from cape.cloth.cloth import Cloth
from cape.cloth.split_grid import SplitGrid
from cape.cloth.split_mesh import SplitMesh
from cape.kernels.self_contact.near_pairs import Pairs
from cape.kernels.self_contact.self_contact import Layers

IntArray = NDArray[np.int64]


def split_layers(layers: Layers, cloth: Cloth) -> bool:
    """Follow a cloth that has split; False, with nothing changed, where there is no room, where it has no spare
    vertices, or where its patches are not those of the whole cloth."""
    if not isinstance(cloth, SplitGrid | SplitMesh):
        return False
    patches, count, (order, whole) = layers.patches, cloth.vertices, patch_order(cloth.whole)
    if not np.array_equal(cloth.parents[patches.triangles], whole):
        return False
    pieces = len(patches.triangle_start) - 1
    owner = np.repeat(np.arange(pieces), np.diff(patches.triangle_start))
    triangles = cloth.triangles[order].astype(np.int64)
    ahead = np.roll(triangles, -1, axis=1)
    sides = (np.minimum(triangles, ahead) * count + np.maximum(triangles, ahead)).ravel()
    edges, edge_start = _by_patch(sides, np.repeat(owner, 3), pieces)
    vertices, vertex_start = _by_patch(triangles.ravel(), np.repeat(owner, 3), pieces)
    most = layers.sight.picked.shape[1] - 1
    if len(edges) > patches.edges.shape[1] or max(np.diff(edge_start).max(), np.diff(vertex_start).max()) > most:
        return False
    before = patches.edges[:, : patches.edge_start[-1]].astype(np.int64)
    _renumber(layers.edges, before[0] * count + before[1], edges)
    patches.triangles[:] = triangles.T
    patches.edges[:, : len(edges)] = np.divmod(edges, count)
    patches.edge_start[:], patches.vertex_start[:] = edge_start, vertex_start
    patches.vertices[: len(vertices)] = vertices
    patches.rest[:, : cloth.in_use] = patches.rest[:, cloth.parents]
    layers.sight.places[:] = np.nan  # so that pairs are searched for
    return True


@lru_cache(maxsize=8)
def patch_order(whole: Cloth) -> tuple[IntArray, IntArray]:
    """The triangles of a whole cloth in the order of its patches (T,), and their vertices (3, T)."""
    triangles, count = whole.triangles.astype(np.int64), whole.vertices
    patches, _ = cut_into_patches(whole.triangles, rest_shape(whole))
    place, key = np.array([count * count, count, 1]), patches.triangles.T.astype(np.int64)
    order = np.empty(len(triangles), np.int64)
    order[np.argsort(key @ place)] = np.argsort(triangles @ place)
    return order, np.ascontiguousarray(triangles[order].T)


def _by_patch(items: IntArray, owner: IntArray, pieces: int) -> tuple[IntArray, IntArray]:
    """Items that are there several times (n,), each once and in the first of its patches, and where each begins."""
    both = np.sort(items * pieces + owner)
    item, patch = np.divmod(both, pieces)
    first = np.append(True, item[1:] != item[:-1])
    item, patch = item[first], patch[first]
    order = np.argsort(patch, kind="stable")
    return item[order], np.searchsorted(patch[order], np.arange(pieces + 1))


def _renumber(pairs: Pairs, before: IntArray, now: IntArray) -> None:
    """Keep the pairs of edges that are still there, by their new numbers; edges are told by keys (E,)."""
    order = np.argsort(now)
    place = np.minimum(np.searchsorted(now, before, sorter=order), len(now) - 1)
    number = np.where(now[order[place]] == before, order[place], -1)
    count = int(pairs.counts[0])
    first, second = number[pairs.first[:count]], number[pairs.second[:count]]
    kept = np.flatnonzero((first >= 0) & (second >= 0))
    pairs.first[: len(kept)], pairs.second[: len(kept)] = first[kept], second[kept]
    for values in (pairs.apart, pairs.due, pairs.force):
        values[: len(kept)] = values[kept]
    pairs.counts[0] = len(kept)
