"""How long the threads of a mesh may get, and in which order that is seen to."""

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.assembly.fabrics import longest_allowed, of_vertices
from cape.assembly.geodesics import geodesic_distances
from cape.cloth.cloth import MeshCloth
from cape.kernels.solve.link_limit import Links

IntArray = NDArray[np.int64]


def limited_links(assembly: Assembly, dtype: type[np.floating]) -> Links | None:
    """The links of the threads of a mesh, from where it is held outwards.

    None in a scene that does not limit strain, or whose cloth is a grid.
    """
    cloth, springs = assembly.cloth, assembly.springs
    if not assembly.scene.strain_limit or not isinstance(cloth, MeshCloth):
        return None
    threads = springs.measured
    first, second, rest = springs.first[threads], springs.second[threads], springs.rest[threads]
    weft, warp = (of_vertices(cloth, limit, first) for limit in (lambda f: f.limit_weft, lambda f: f.limit_warp))
    limits = np.where(_along_weft(cloth, first, second), weft, warp)
    held = np.unique(np.concatenate([[0] * (not assembly.carried), *(c.vertices for c in assembly.carried)]))
    distances, _ = geodesic_distances(cloth, held.astype(np.int64), springs=springs)
    ways = np.minimum(distances[first], distances[second])
    order = np.argsort(ways, kind="stable")
    chain = int(np.ceil(ways[np.isfinite(ways)].max(initial=0.0) / np.median(rest))) + 1
    return Links(
        first[order].astype(np.uint32),
        second[order].astype(np.uint32),
        longest_allowed(rest, limits)[order].astype(dtype),
        chain,
    )


def _along_weft(cloth: MeshCloth, first: IntArray, second: IntArray) -> NDArray[np.bool_]:
    """Whether edges between vertices (n,), the lower one first, go along the weft rather than the warp."""
    ends = np.sort(np.stack([cloth.faces, np.roll(cloth.faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    ways = np.abs(np.roll(cloth.corners, -1, axis=1) - cloth.corners).reshape(-1, 2)
    keys, place = np.unique(ends @ [cloth.vertices, 1], return_index=True)
    way = ways[place[np.searchsorted(keys, first * cloth.vertices + second)]]
    return way[:, 0] > way[:, 1]
