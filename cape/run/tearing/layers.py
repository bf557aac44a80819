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
from cape.kernels.tearing.patches import Listed, Relisted, relist

IntArray = NDArray[np.int64]


class SplitLayers:
    """Has what keeps one cloth off itself follow; what that asks for is made once for the same lists of pairs."""

    def __init__(self, layers: Layers | None, cloth: Cloth) -> None:
        """Make it ahead, so that no frame takes the time."""
        self._known: Layers | None = None
        self._relist: Bound | None = None
        if layers is not None:
            self._bind(layers, cloth)

    def follow(self, layers: Layers, cloth: Cloth) -> bool:
        """Follow a cloth that has split; False, with nothing changed, where there is no room, where it has no spare
        vertices, or where its patches are not those of the whole cloth."""
        self._bind(layers, cloth)
        if self._relist is None or not isinstance(cloth, SplitGrid | SplitMesh):
            return False
        self._triangles[:] = cloth.triangles[self._order].T
        if not self._relist():
            return False
        patches = layers.patches
        patches.rest[:, : cloth.in_use] = patches.rest[:, cloth.parents]
        layers.sight.places[:] = np.nan  # so that pairs are searched for
        return True

    @property
    def requests(self) -> list[Request]:
        """The code that `follow` needs, to be compiled together with other code."""
        return [] if self._relist is None else [self._relist.request]

    def _bind(self, layers: Layers, cloth: Cloth) -> None:
        if self._known is layers:
            return
        self._known, self._relist, patches = layers, None, layers.patches
        if not isinstance(cloth, SplitGrid | SplitMesh):
            return
        self._order, whole = patch_order(cloth.whole)
        # Whatever has split, corners are copies of those of the whole.
        if np.array_equal(cloth.parents[patches.triangles], whole):
            self._triangles = patches.triangles.copy()
            group = Relisted(self._triangles, patches, layers.edges, _room(layers))
            self._relist = Bound(relist, group, layers.sight.picked.shape[1])


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
