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
from cape.kernels.calling import Bound
from cape.kernels.self_contact.self_contact import Layers
from cape.kernels.store import Request
from cape.kernels.tearing.patches import Listed, list_by_patch, renumber

IntArray = NDArray[np.int64]


def split_layers(layers: Layers, cloth: Cloth) -> bool:
    """Follow a cloth that has split; False, with nothing changed, where there is no room, where it has no spare
    vertices, or where its patches are not those of the whole cloth."""
    if not isinstance(cloth, SplitGrid | SplitMesh):
        return False
    patches, (order, whole) = layers.patches, patch_order(cloth.whole)
    if not np.array_equal(cloth.parents[patches.triangles], whole):
        return False
    triangles, listed = np.ascontiguousarray(cloth.triangles[order].T.astype(np.uint32)), _room(layers)
    most = list_by_patch(triangles, patches.triangle_start, listed)
    if not 0 <= most < layers.sight.picked.shape[1]:
        return False
    edges, vertices = int(listed.edge_start[-1]), int(listed.vertex_start[-1])
    renumber(layers.edges, patches.edges, listed)
    patches.triangles[:] = triangles
    patches.edges[:, :edges] = np.divmod(listed.edges[:edges], cloth.vertices)
    patches.edge_start[:], patches.vertex_start[:] = listed.edge_start, listed.vertex_start
    patches.vertices[:vertices] = listed.vertices[:vertices]
    patches.rest[:, : cloth.in_use] = patches.rest[:, cloth.parents]
    layers.sight.places[:] = np.nan  # so that pairs are searched for
    return True


def requests(layers: Layers | None) -> list[Request]:
    """The code that `split_layers` needs, to be compiled together with other code."""
    if layers is None:
        return []
    patches, listed = layers.patches, _room(layers)
    calls = (
        Bound(list_by_patch, patches.triangles, patches.triangle_start, listed),
        Bound(renumber, layers.edges, patches.edges, listed),
    )
    return [call.request for call in calls]


def _room(layers: Layers) -> Listed:
    """Room to list what patches are made of."""
    edges, vertices, starts = layers.patches.edges.shape[1], layers.patches.rest.shape[1], layers.patches.edge_start
    return Listed(
        edges=np.zeros(edges, np.int64),
        edge_start=np.zeros_like(starts),
        vertices=np.zeros(vertices, np.int64),
        vertex_start=np.zeros_like(starts),
        found=np.zeros(edges, np.int64),
        head=np.zeros(vertices, np.int64),
        following=np.zeros(edges, np.int64),
        seen=np.zeros(vertices, np.bool_),
    )


@lru_cache(maxsize=8)
def patch_order(whole: Cloth) -> tuple[IntArray, IntArray]:
    """The triangles of a whole cloth in the order of its patches (T,), and their vertices (3, T)."""
    triangles, count = whole.triangles.astype(np.int64), whole.vertices
    patches, _ = cut_into_patches(whole.triangles, rest_shape(whole))
    place, key = np.array([count * count, count, 1]), patches.triangles.T.astype(np.int64)
    order = np.empty(len(triangles), np.int64)
    order[np.argsort(key @ place)] = np.argsort(triangles @ place)
    return order, np.ascontiguousarray(triangles[order].T)
