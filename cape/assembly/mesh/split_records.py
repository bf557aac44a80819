"""The records of a mesh that may split, laid out with room, and how they follow what has split in place."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.mesh.links import (
    Rows,
    air_in_rows,
    bend_rows,
    membrane_in_rows,
    mesh_bends_record,
    smoothing_of,
    springs_in_rows,
    turned_slopes,
)
from cape.assembly.mesh.places import NoRoom, Places
from cape.assembly.mesh.split_springs import Changed, SplitMeshSprings
from cape.cloth.split_mesh import SplitMesh
from cape.kernels.cloth.membrane import MeshMembrane
from cape.kernels.cloth.mesh import ENDS, MeshAir, MeshSprings
from cape.kernels.cloth.mesh_bending import MeshBends

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MORE = 1.5  # times the room for bending that a mesh takes before it splits


class Splits(NamedTuple):
    """Where springs stand by slot, triangles of a membrane, triangles in the air; None for what a record lacks."""

    springs: Places | None = None
    membrane: Places | None = None
    air: Places | None = None


def split_springs_record(
    springs: SplitMeshSprings, cloth: SplitMesh, dtype: type[np.floating]
) -> tuple[MeshSprings, Splits]:
    """Lay out springs."""
    acting, slots = springs.acting, springs.acting_slots
    record, ends, rows = springs_in_rows(acting, cloth.vertices, dtype, cloth.in_use)
    order = _in_order(rows)
    return record, Splits(springs=Places(record, ends, slots, order, len(springs.first)))


def split_membrane_record(
    springs: SplitMeshSprings, cloth: SplitMesh, dtype: type[np.floating]
) -> tuple[MeshMembrane, Splits]:
    """Lay out a membrane."""
    assert springs.membrane is not None
    record, ends, rows = membrane_in_rows(springs.membrane, cloth.vertices, dtype, cloth.in_use)
    every = np.arange(len(ends))
    return record, Splits(membrane=Places(record, ends, every, _in_order(rows), len(ends), apart=True))


def split_air_record(
    cloth: SplitMesh, wind: FloatArray, drag: float, lift: float, dtype: type[np.floating]
) -> tuple[MeshAir, Splits]:
    """Lay out triangles in the air; see `mesh_air_record`."""
    record, ends, rows = air_in_rows(cloth, wind, drag, lift, dtype, cloth.in_use)
    return record, Splits(air=Places(record, ends, np.arange(len(ends)), _in_order(rows), len(ends)))


def split_bends_record(springs: SplitMeshSprings, vertices: int, dtype: type[np.floating]) -> MeshBends:
    """Lay out bending, with room for wider rows."""
    record = mesh_bends_record(springs, vertices, dtype)
    room = round(MORE * len(record.others)) - len(record.others)
    return record._replace(others=np.pad(record.others, (0, room)), weight=np.pad(record.weight, (0, room)))


def move_springs(record: MeshSprings, places: Places, springs: SplitMeshSprings, slots: IntArray) -> None:
    """Have the springs of some slots (n,) stand where they are now.

    Raises:
        NoRoom: they find no room, and the record is of no use any more.
    """
    for table, blank in ((record.stiffness, 0.0), (record.rest, 1.0)):
        table[places.at(slots[places.row[slots] >= 0])] = blank
    acting = springs.acts(slots)
    ends = np.stack([springs.first[slots], springs.second[slots]], axis=1).tolist()
    wanted = [own if acts else [] for own, acts in zip(ends, acting.tolist(), strict=True)]
    moved = [
        k for k, (slot, own) in enumerate(zip(slots.tolist(), wanted, strict=True)) if sorted(places.ends[slot]) != own
    ]
    places.move(slots[moved], [wanted[k] for k in moved])
    slots = slots[acting]
    at = places.at(slots)
    record.stiffness[at], record.rest[at] = springs.stiffness[slots], springs.rest[slots]


def move_triangles(places: Places, faces: IntArray, triangles: IntArray) -> None:
    """Have some triangles (n,), whose vertices are given of all (T, 3), stand where they are now.

    Raises:
        NoRoom: they find no room, and the record is of no use any more.
    """
    places.move(triangles, faces[triangles].tolist())


def move_membrane(record: MeshMembrane, places: Places, springs: SplitMeshSprings, changed: Changed) -> None:
    """Have a membrane follow what has split.

    Raises:
        NoRoom: its triangles find no room, and the record is of no use any more.
    """
    membrane, moved, near = springs.membrane, changed.triangles, np.unique(changed.parted // 3)
    assert membrane is not None
    for table in (record.slopes, record.neighbours, record.smoothing):
        block, row, lane = places.at(moved)
        table[block, row, :, lane] = 0
    move_triangles(places, membrane.faces, moved)
    around = np.unique(np.concatenate([moved, near, membrane.neighbours[moved].ravel()]))
    (block, row, lane), beyond = places.at(around), membrane.neighbours[around]
    owner = block, row, slice(None), lane
    there, under, beside = (each.reshape(beyond.shape) for each in places.at(beyond.ravel()))
    record.neighbours[owner] = (there * record.second.shape[1] + under) * ENDS + beside
    record.slopes[owner] = turned_slopes(membrane, around, block * record.second.shape[2] + lane)
    record.smoothing[owner] = smoothing_of(membrane, around)


def move_bends(record: MeshBends, springs: SplitMeshSprings, rows: IntArray) -> None:
    """Write the rows of some vertices (n,), in their order, anew.

    Raises:
        NoRoom: rows are too wide by now.
    """
    vertices = len(record.start) - 1
    own = bend_rows(springs, rows, vertices, record.weight.dtype.type)
    width = np.diff(record.start)
    width[rows] = np.diff(own.start)
    start = np.concatenate([[0], np.cumsum(width)])
    if start[-1] > len(record.others):
        raise NoRoom
    kept_from = np.concatenate([[0], record.start[rows + 1]])
    kept_to = np.concatenate([record.start[rows], record.start[-1:]])
    for table, new in ((record.others, own.others), (record.weight, own.weight)):
        kept = [table[a:b] for a, b in zip(kept_from.tolist(), kept_to.tolist(), strict=True)]
        fresh = [*np.split(new, own.start[1:-1]), new[:0]]
        table[: start[-1]] = np.concatenate([piece for pair in zip(kept, fresh, strict=True) for piece in pair])
    record.start[:] = start


def _in_order(rows: Rows) -> IntArray:
    """The row of each item, shape (L,)."""
    order = np.empty(len(rows.item), np.int64)
    order[rows.item] = rows.row
    return order
