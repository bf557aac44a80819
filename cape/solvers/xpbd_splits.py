"""XPBD's constraints on a mesh that may split: with room behind them, where they are written anew in place.

Where edges part, colours of constraints far from there may be others than before: all are coloured anew. That takes
little beside all else that a mesh is laid out with, which stays.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.assembly.mesh.places import NoRoom
from cape.kernels.xpbd.formulas import Constraints
from cape.kernels.xpbd.mesh import MeshConstraints

Array = NDArray[Any]

MORE = 0.125  # of the room that constraints of a mesh take before it splits, that there is more
COLOURS, FEW = 8, 64  # more colours, and other rows more at least, that there is room for
ENDS = ("starts", "first")  # of pieces: there is nothing in those behind the last


def with_room(constraints: MeshConstraints) -> MeshConstraints:
    """The same constraints, with room for those of the mesh once it has split."""

    def grow(name: str, rows: Array) -> Array:
        more = COLOURS if name == "starts" else max(FEW, round(MORE * len(rows)))
        return np.pad(rows, [(0, more)] + [(0, 0)] * (rows.ndim - 1), "edge" if name in ENDS else "constant")

    return _changed(constraints, constraints, lambda name, rows, _: grow(name, rows))


def refill(room: MeshConstraints, constraints: MeshConstraints) -> None:
    """Write the constraints of a mesh as it is now over those of before, which have room.

    Raises:
        NoRoom: it does not do, and what was there is of no use any more.
    """

    def write(name: str, rows: Array, now: Array) -> Array:
        if len(now) > len(rows):
            raise NoRoom
        rows[: len(now)] = now
        rows[len(now) :] = now[-1] if name in ENDS else 0
        return rows

    _changed(room, constraints, write)


def _changed(group: Any, other: Any, change: Callable[[str, Array, Array], Array]) -> Any:
    """Constraints with their arrays changed, each by its name, its rows and those of another's; but not its scratch.

    Along rows more or fewer constraints would be listed: impulses of some come by axis first.
    """
    changed = {}
    for name in group._fields:
        value, with_it = getattr(group, name), getattr(other, name)
        if name in ("packed", "rows"):
            continue
        if isinstance(value, np.ndarray):
            by_axis = isinstance(group, Constraints) and value.ndim == 2
            rows, others = (value.T, with_it.T) if by_axis else (value, with_it)
            rows = change(name, rows, others)
            changed[name] = np.ascontiguousarray(rows.T if by_axis else rows)
        elif hasattr(value, "_fields"):
            changed[name] = _changed(value, with_it, change)
    return group._replace(**changed)
