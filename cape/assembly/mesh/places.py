"""Where springs or triangles stand in the rows of a mesh that may split, so that a few can change their vertices.

See `cape.assembly.mesh.links` for rows and lists. One more row than there would be, and lists of spare vertices as long
as any, leave room for what splits off.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.kernels.cloth.mesh import BLOCK, ENDS, SLICE

IntArray = NDArray[np.int64]


class NoRoom(Exception):
    """Rows or lists are full where an item was to be put: all are to be laid out anew."""


class Places:
    """The places of items in a record, which changes in place.

    Attributes:
        ends: vertices of each item, its owner first, as lists; empty for one that stands nowhere.
        row: of each item below its owner, -1 for none, shape (L,).
    """

    def __init__(
        self, record: Any, ends: IntArray, items: IntArray, row: IntArray, slots: int, *, apart: bool = False
    ) -> None:
        """Find some items (L,), of so many that may come, in a record, with their ends (L, m) and rows (L,).

        They keep something for each of their other ends where these are taken `apart`.
        """
        self._record, self._others = record, [record.second, *([record.third] if ends.shape[1] == 3 else [])]
        self._kept = ends.shape[1] - 1 if apart else 1
        blocks, self._rows, _ = record.second.shape
        self._nobody = blocks * self._rows * self._kept * ENDS
        self._position = np.argsort(record.sorted_vertices)
        self._filled = np.zeros((blocks * BLOCK, self._rows), bool)
        self._filled[ends[:, 0], row] = True
        self._free: list[int] = (self._rows - self._filled.sum(axis=1)).tolist()
        self.row = np.full(slots, -1)
        self.row[items] = row
        self.ends: list[list[int]] = [[]] * slots
        for item, own in zip(items.tolist(), ends.tolist(), strict=True):
            self.ends[item] = own

    def at(self, items: IntArray) -> tuple[IntArray, IntArray, IntArray]:
        """Block, row and lane of some items that stand somewhere (n,), each of shape (n,)."""
        owner = np.array([self.ends[item][0] for item in items.tolist()], dtype=np.int64)
        return owner // BLOCK, self.row[items], owner % BLOCK

    def move(self, items: IntArray, ends: list[list[int]]) -> None:
        """Have some items (n,) stand at other vertices; those that get none are taken out.

        One stays with its owner where that is one of them, and goes to the one with the emptiest rows otherwise; they
        keep the direction in which they follow each other.

        Raises:
            NoRoom: no row, or no list, has room for one.
        """
        before = [self.ends[item] for item in items.tolist()]
        for item, own in zip(items.tolist(), before, strict=True):
            if own:
                self._take_out(item, own)
        for item, own, now in zip(items.tolist(), before, ends, strict=True):
            if now:
                self._put(item, now, own[0] if own else -1)

    def _put(self, item: int, ends: list[int], usual: int) -> None:
        """Have an item stand at some vertices, with its usual owner or another one."""
        free = self._free
        for owner in sorted(ends, key=lambda vertex: (vertex != usual, -free[vertex])):
            first = ends.index(owner)
            turned = ends[first:] + ends[:first]
            lists = [self._list_of(other) for other in turned[1:]]
            gaps = [np.flatnonzero(own == self._nobody) for own in lists]
            if free[owner] and all(len(gap) for gap in gaps):
                break
        else:
            raise NoRoom
        row = int(np.argmin(self._filled[owner]))
        self.ends[item], self.row[item], self._filled[owner, row] = turned, row, True
        free[owner] -= 1
        for other, table in zip(turned[1:], self._others, strict=True):
            table[owner // BLOCK, row, owner % BLOCK] = other
        for own, gap, place in zip(lists, gaps, self._kept_at(owner, row), strict=True):
            own[gap[0]] = place
        used = getattr(self._record, "rows", None)
        if used is not None:
            used[owner // BLOCK] = max(used[owner // BLOCK], row + 1)

    def _take_out(self, item: int, ends: list[int]) -> None:
        owner, row = ends[0], int(self.row[item])
        self.ends[item], self.row[item], self._filled[owner, row] = [], -1, False
        self._free[owner] += 1
        for table in self._others:
            table[owner // BLOCK, row, owner % BLOCK] = owner
        for other, place in zip(ends[1:], self._kept_at(owner, row), strict=True):
            own = self._list_of(other)
            own[own == place] = self._nobody

    def _kept_at(self, owner: int, row: int) -> list[int]:
        """Where what an item keeps for its other ends begins."""
        start = (owner // BLOCK * self._rows + row) * self._kept * ENDS + owner % BLOCK
        return [start + k * ENDS * (self._kept - 1) for k in range(len(self._others))]

    def _list_of(self, vertex: int) -> NDArray[np.uint32]:
        """The places that a vertex collects from."""
        piece, nth = divmod(int(self._position[vertex]), SLICE)
        start, end = self._record.start[piece : piece + 2].tolist()
        width = (end - start) // SLICE
        return self._record.incoming[start + nth * width : start + (nth + 1) * width]
