"""A cloth as cells that share corners, and how it splits along edges.

Cells are those of a grid, or triangles. An edge lies between two neighbouring corners of a cell. Where edges part, each
of their vertices is given out to the cells around it: those that still hang together by edges that end there have it
in common, others get a copy. So no vertex ever joins cells that don't share an edge there.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Edge = tuple[int, int]
"""Two vertices, the lower one first."""
Way = tuple[float, float]
"""A unit vector along weft and warp."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """P cells of k corners each.

    Attributes:
        cells: vertices of each cell, one side after the other, shape (P, k).
        around: the cells that have each of the V vertices as a corner, in their order.
        ways: from each corner of each cell to the next, at rest.
        area: of each cell at rest, one layer of it [m2], shape (P,).
        parents: the vertex of the whole cloth that each of the V vertices is, or is a copy of, shape (V,).
        fixed: which of the V vertices never split, shape (V,).
        tears: how many edges have parted.
        torn: which vertices lie at edges that have parted, shape (V,).
    """

    cells: IntArray
    around: Sequence[Sequence[int]]
    ways: Sequence[Sequence[Way]]
    area: FloatArray
    parents: IntArray
    fixed: NDArray[np.bool_]
    tears: int
    torn: NDArray[np.bool_]

    @staticmethod
    def whole(cells: IntArray, ways: Sequence[Sequence[Way]], area: FloatArray, fixed: NDArray[np.bool_]) -> "Sheet":
        """One that has not parted; see the attributes."""
        around = cells_around(cells, len(fixed))
        return Sheet(cells, around, ways, area, np.arange(len(fixed)), fixed, 0, np.zeros(len(fixed), bool))

    @property
    def vertices(self) -> int:
        """How many there are."""
        return len(self.parents)

    def edges_at(self, vertex: int) -> dict[int, list[tuple[int, Way]]]:
        """By the other end of each edge at a vertex: those cells that have it, with the way to there."""
        edges: dict[int, list[tuple[int, Way]]] = {}
        k = self.cells.shape[1]
        for cell in self.around[vertex]:
            corners, ways = self.cells[cell].tolist(), self.ways[cell]
            at = corners.index(vertex)
            u, v = ways[at - 1]
            edges.setdefault(corners[(at + 1) % k], []).append((cell, ways[at]))
            edges.setdefault(corners[at - 1], []).append((cell, (-u, -v)))
        return edges

    def split(self, parted: Iterable[Edge]) -> tuple["Sheet", IntArray]:
        """Part some edges.

        Returns:
            The sheet that is left, itself where no vertex splits, and the vertices that its new ones are copies of.
        """
        edges = {(min(a, b), max(a, b)) for a, b in parted}
        cells, around, copies = self.cells.copy(), list(self.around), []
        for vertex in sorted({vertex for edge in edges for vertex in edge}):
            if self.fixed[vertex]:
                continue
            first, *others = self._groups(vertex, edges)
            around[vertex] = first
            for group in others:
                for cell in group:
                    cells[cell][self.cells[cell] == vertex] = len(around)
                around.append(group)
                copies.append(vertex)
        if not copies:
            return self, np.zeros(0, np.int64)
        grown = {
            name: np.concatenate([getattr(self, name), getattr(self, name)[copies]])
            for name in ("parents", "fixed", "torn")
        }
        torn = grown["torn"]
        torn[self.vertices :] = True
        torn[sorted({vertex for edge in edges for vertex in edge})] = True
        opened = sum(self._opens(edge, cells) for edge in edges)
        return replace(self, cells=cells, around=around, tears=self.tears + opened, **grown), np.array(copies)

    def _groups(self, vertex: int, parted: set[Edge]) -> list[list[int]]:
        """The cells around a vertex that hang together by edges at it, those with the first cell first."""
        own = self.around[vertex]
        group = {cell: cell for cell in own}

        def lowest(cell: int) -> int:
            while group[cell] != cell:
                cell = group[cell]
            return cell

        for other, sides in self.edges_at(vertex).items():
            if (min(vertex, other), max(vertex, other)) not in parted and len(sides) == 2:
                low, high = sorted(lowest(cell) for cell, _ in sides)
                group[high] = low
        by_lowest: dict[int, list[int]] = {}
        for cell in own:
            by_lowest.setdefault(lowest(cell), []).append(cell)
        return [by_lowest[low] for low in sorted(by_lowest)]

    def _opens(self, edge: Edge, cells: IntArray) -> bool:
        """Whether both cells at an edge have one of their own, as cells (P, k) are now."""
        first, second = edge
        ends = set()
        sides = self.edges_at(first).get(second, [])
        for cell, _ in sides:
            before, now = self.cells[cell].tolist(), cells[cell].tolist()
            ends.add((now[before.index(first)], now[before.index(second)]))
        return len(sides) == 2 and len(ends) == 2


def cells_around(cells: IntArray, vertices: int) -> list[list[int]]:
    """The cells (P, k) that have each of so many vertices as a corner, in their order."""
    around: list[list[int]] = [[] for _ in range(vertices)]
    for cell, corners in enumerate(cells.tolist()):
        for vertex in corners:
            around[vertex].append(cell)
    return around
