"""Which vertices the triangles of a cloth have, as it tears."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cape.results.kept import Kept, blocks


@dataclass(frozen=True, eq=False)
class Topology:
    """The triangles of a cloth from some frame on.

    Attributes:
        frame: the first in which they are so.
        triangles: vertex indices of the T triangles, shape (T, 3); their number and order never change.
        parents: the vertex of the whole cloth that each of the vertices so far is, or has split off from, shape (n,).
    """

    frame: int
    triangles: NDArray[np.int32]
    parents: NDArray[np.int64]

    def is_as(self, other: "Topology") -> bool:
        """Tell whether triangles and vertices are those of another one, from whatever frame on."""
        return np.array_equal(self.triangles, other.triangles) and np.array_equal(self.parents, other.parents)


def most_split(topologies: Sequence[Topology]) -> Topology:
    """The one of most vertices."""
    return max(topologies, key=lambda topology: len(topology.parents))


def since(topologies: Sequence[Topology], first: int) -> tuple[Topology, ...]:
    """Those of the frames from one on, which is 0 for them; of topologies in order of their frames."""
    before = [topology for topology in topologies if topology.frame <= first][-1:]
    later = [topology for topology in topologies if topology.frame > first]
    return tuple(replace(topology, frame=max(topology.frame - first, 0)) for topology in [*before, *later])


def all_vertices(positions: NDArray[np.float32], topologies: Sequence[Topology]) -> NDArray[np.float32]:
    """Set where vertices are before they split off: at those that they will split off from.

    Args:
        positions: in F frames [m], with room for vertices to come, shape (F, N, 3); changed in place.
        topologies: of a cloth that tears, frame by frame.

    Returns:
        Those of the V vertices that there are in the end, shape (F, V, 3).
    """
    parents = most_split(topologies).parents
    if len(topologies) > 1:
        ends = [topology.frame for topology in topologies[1:]] + [len(positions)]
        for topology, end in zip(topologies, ends, strict=True):
            count, part = len(topology.parents), positions[topology.frame : end]
            part[:, count : len(parents)] = part[:, parents[count:]]
    return positions if positions.shape[1] == len(parents) else positions[:, : len(parents)]


def padded(places: NDArray[np.float32], count: int) -> NDArray[np.float32]:
    """Positions of vertices (V, 3), and zeros for so many as there will be."""
    missing = count - len(places)
    return np.concatenate([places, np.zeros((missing, 3), np.float32)]) if missing else places


def with_room(kept: Kept, vertices: int) -> Kept:
    """Frames of positions that are kept, with room for so many vertices."""
    larger, before = Kept((vertices, 3), np.float32, in_memory=kept.in_memory), kept.array()
    for part in blocks(before):
        larger.add(np.pad(before[part], ((0, 0), (0, vertices - before.shape[1]), (0, 0))))
    return larger
