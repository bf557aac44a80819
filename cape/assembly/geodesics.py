"""How far vertices are from each other along a cloth."""

import heapq

import numpy as np
from numpy.typing import NDArray

from cape.assembly.springs import Springs, springs_of
from cape.cloth.cloth import Cloth

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def geodesic_distances(
    cloth: Cloth, sources: IntArray, *, springs: Springs | None = None
) -> tuple[FloatArray, IntArray]:
    """Distance of each vertex from the nearest of the sources along the springs at rest, after Dijkstra (1959).

    Args:
        cloth: the cloth.
        sources: vertices (n,).
        springs: those of the cloth where they are known, None to derive them.

    Returns:
        The distances [m], infinite where no spring leads, shape (V,), and the places of the nearest sources in
        `sources`, -1 for none, shape (V,).
    """
    springs = springs or springs_of(cloth)
    neighbours: list[list[tuple[float, int]]] = [[] for _ in range(cloth.vertices)]
    for i, j, length in zip(springs.first.tolist(), springs.second.tolist(), springs.rest.tolist(), strict=True):
        neighbours[i].append((length, j))
        neighbours[j].append((length, i))
    distances, nearest = np.full(cloth.vertices, np.inf), np.full(cloth.vertices, -1)
    heap = [(0.0, vertex, k) for k, vertex in enumerate(sources.tolist())]
    while heap:
        distance, vertex, source = heapq.heappop(heap)
        if nearest[vertex] >= 0:
            continue
        distances[vertex], nearest[vertex] = distance, source
        for length, other in neighbours[vertex]:
            if nearest[other] < 0:
                heapq.heappush(heap, (distance + length, other, source))
    return distances, nearest
