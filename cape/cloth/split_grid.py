"""A grid whose cells may have corners of their own: the form in which a grid comes apart.

Its first vertices are those of the whole grid, and stay where they are in it; those that split off come behind them, in
rows that no cell starts from. So kernels for grids go on with all cells that are whole, and what has split is little.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import GridCloth, areas
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False, kw_only=True)
class SplitGrid(GridCloth):
    """A grid that may have split, with rows of spare vertices.

    Attributes:
        whole: the grid before.
        corners: vertices of its cells as they are now, as in `GridCloth.cells`, shape (P, 4).
        parents: the vertex of the whole that each vertex in use is or was, shape (n,); those behind are spare.
        whole_cells: the cells of the grid before.
        weights: mass that each corner of the cells gets [kg], corner by corner, shape (4 P,).
    """

    whole: GridCloth
    corners: IntArray
    parents: IntArray
    whole_cells: IntArray
    weights: FloatArray

    @staticmethod
    def of(whole: GridCloth, rows: int) -> "SplitGrid":
        """A grid, whole as yet, with so many rows of spare vertices."""
        first = np.zeros(rows * whole.columns, np.int64)
        grown: dict[str, Any] = {
            "pattern": np.concatenate([whole.pattern, whole.pattern[first]]),
            "positions": np.concatenate([whole.positions, whole.positions[first]]),
        }
        kept = {name: getattr(whole, name) for name in ("frame", "fabric", "regions", "columns", "darted")}
        sheets = np.ones(len(whole.cells)) * whole.fabric.density / 3.0
        for thicker in (whole.layers, whole.gathers):
            sheets *= 1.0 if thicker is None else thicker.ravel()
        upper, lower = (sheets * area for area in np.split(areas(whole.corners_at_rest), 2))
        return SplitGrid(
            **kept,
            **grown,
            rows=whole.rows + rows,
            whole=whole,
            corners=whole.cells,
            parents=np.arange(whole.vertices),
            whole_cells=whole.cells,
            weights=np.concatenate([upper, upper + lower, lower, upper + lower]),
        )

    def split(self, corners: IntArray, parents: IntArray) -> "SplitGrid":
        """The same grid with other corners of its cells (P, 4), and vertices in use (n,).

        Raises:
            ValueRangeError: there are more of them than there is room for.
        """
        if len(parents) > self.vertices:
            raise ValueRangeError(f"a grid with room for {self.vertices} vertices can't have {len(parents)}")
        where = np.zeros(self.vertices, np.int64)
        where[: len(parents)] = parents
        return replace(
            self, corners=corners, parents=parents, pattern=self.pattern[where], positions=self.positions[where]
        )

    @property
    def in_use(self) -> int:
        """How many vertices are no spare ones."""
        return len(self.parents)

    @property
    def cells(self) -> IntArray:
        """Vertex indices of the cells as they are now, shape (P, 4)."""
        return self.corners

    @property
    def cells_in_place(self) -> NDArray[np.bool_]:
        """Whether a cell starts from each vertex whose corners are this one and its neighbours, shape (V,)."""
        starts = np.zeros(self.vertices, bool)
        starts[self.whole_cells[(self.corners == self.whole_cells).all(axis=1), 0]] = True
        return starts

    @property
    def corners_at_rest(self) -> FloatArray:
        """Corners of each triangle where it has no tension [m], shape (T, 3, 2), (T, 3, 3) where it has darts."""
        return self.whole.corners_at_rest

    @property
    def texcoords(self) -> NDArray[np.float32]:
        """Texture coordinates, those of the whole grid, of the vertices in use, shape (n, 2)."""
        return self.whole.texcoords[self.parents]

    def masses(self) -> FloatArray:
        """Mass of each vertex [kg], shape (V,): a third of that of its triangles, none of spare ones."""
        return np.bincount(self.corners.T.ravel(), self.weights, self.vertices).astype(float)
