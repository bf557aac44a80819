"""How the springs of a mesh follow what has split, by compiled code on arrays that stay where they are."""

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.fabrics import of_triangles
from cape.assembly.mesh.curvature import FALL, ROOM, flat_of, room_of
from cape.assembly.mesh.springs import plate_of
from cape.cloth.split_mesh import SplitMesh
from cape.kernels.calling import Bound
from cape.kernels.cloth.slopes import Patch
from cape.kernels.store import Request
from cape.kernels.tearing.mesh_bends import WIDER_ROWS, WIDER_SLOPES, BendRoom, BentParts, bend_anew
from cape.kernels.tearing.mesh_springs import (
    ALONE,
    BENT,
    PARTED,
    ROWS,
    SLOTS,
    TRIANGLES,
    Bends,
    Found,
    MembraneParts,
    SpringParts,
    Torn,
    part_springs,
    stiffen_springs,
)

if TYPE_CHECKING:
    from cape.assembly.mesh.split_springs import SplitMeshSprings

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

WIDER = 4  # more vertices that bends get room for where one needs more than there is


class Changed(NamedTuple):
    """What has changed where edges have parted.

    `triangles` (t,) have other corners, `parted` (p,) are the sides of edges that have parted, `slots` (s,) those of
    springs that may have changed, `bent` (b,) triangles that bend otherwise, `rows` (r,) the vertices that these do or
    did lead to. `released` is by how much less energy is stored [J].
    """

    triangles: IntArray
    parted: IntArray
    slots: IntArray
    bent: IntArray
    rows: IntArray
    released: float


class Following:
    """Has the springs of one mesh follow; what it asks for once is made when it is first needed."""

    def __init__(self) -> None:
        """Nothing is known yet."""
        self._bent: IntArray | None = None
        self._bending_parts: BentParts | None = None
        self._slopes = ROOM

    def requests(self, springs: "SplitMeshSprings", cloth: SplitMesh) -> list[Request]:
        """The code that this needs."""
        self._bind(springs, cloth)
        return [bound.request for bound in (self._part, self._stiffen, self._bend) if bound is not None]

    def follow(
        self, springs: "SplitMeshSprings", cloth: SplitMesh, copied: IntArray, positions: FloatArray
    ) -> "tuple[SplitMeshSprings, Changed]":
        """See `split_springs.follow_split`."""
        self._bind(springs, cloth)
        torn, found = self._torn, self._found
        torn.faces[:], torn.positions[:], torn.split[:] = cloth.faces, positions, False
        torn.split[copied] = True
        self._part()
        if found.counts[ALONE] > 0:
            springs.fitted.fit_alone(found.alone[: found.counts[ALONE]])
        while self._bend is not None and (missing := self._bend()) < 0:
            if missing == WIDER_SLOPES:
                self._slopes *= 2
            springs = _widened(springs) if missing == WIDER_ROWS else springs
            self._bind(springs, cloth, anew=True)
        self._stiffen()
        lists = (found.triangles, TRIANGLES), (found.parted, PARTED), (found.slots, SLOTS), (found.bent, BENT)
        changed = [of[: found.counts[which]].copy() for of, which in (*lists, (found.rows, ROWS))]
        return replace(springs), Changed(*changed, released=float(found.stored[0] - found.stored[1]))

    def _bind(self, springs: "SplitMeshSprings", cloth: SplitMesh, *, anew: bool = False) -> None:
        """Know the arrays of springs, and make what they ask for; what has been found stays."""
        if not anew and self._bent is springs.bend_vertices and len(self._torn.split) == cloth.vertices:
            return
        if self._bent is None or len(self._torn.split) != cloth.vertices:
            self._torn, self._found = _room_to_find(springs, cloth.vertices)
        self._bent = springs.bend_vertices
        stiff, membrane, bends = springs.stiffness, springs.membrane, None
        if len(springs.bend_stiffness):
            bends = Bends(springs.bend_vertices, springs.bend_coefficients, springs.bend_stiffness)
        parts = None
        if membrane is not None:
            own = membrane.faces, membrane.slopes, membrane.area, membrane.neighbours, membrane.own, membrane.share
            parts = MembraneParts(*own, membrane.stiffness.reshape(-1, 3, 3))
        group = SpringParts(
            springs.faces, springs.fitted.fits, springs.unfolded.neighbour, springs.along, springs.over, springs.first,
            springs.second, stiff, stiff if springs.nearest is None else springs.nearest, springs.rest,
            springs.measured, parts, bends, self._torn, self._found,
        )  # fmt: skip
        self._part, self._stiffen = Bound(part_springs, group), Bound(stiffen_springs, group)
        self._bend = None if bends is None else self._bending(springs, cloth, bends)

    def _bending(self, springs: "SplitMeshSprings", cloth: SplitMesh, bends: Bends) -> Bound:
        area, known = springs.fitted.area, self._bending_parts
        if known is not None and len(known.room.place) == cloth.vertices and known.room.slopes.shape[1] == self._slopes:
            parts = known._replace(bends=bends)
        else:
            parts = BentParts(
                flat=flat_of(cloth, springs.unfolded)._replace(faces=springs.faces),
                patch=Patch.room(len(area), cloth.vertices),
                half=FALL // 2,
                area=area,
                plate=np.broadcast_to(of_triangles(cloth, plate_of), (len(area), 3)).copy(),
                bends=bends,
                found=self._found,
                room=_room_to_bend(len(area), cloth.vertices, self._slopes),
            )
        self._bending_parts = parts
        return Bound(bend_anew, parts)


def _room_to_find(springs: "SplitMeshSprings", vertices: int) -> tuple[Torn, Found]:
    """Room for how a mesh of so many vertices has split, and for what changes."""
    triangles, slots = len(springs.faces), len(springs.first)
    torn = Torn(np.zeros((triangles, 3), np.int64), np.zeros(vertices, np.bool_), np.zeros((vertices, 3)))

    def numbers(size: int) -> IntArray:
        return np.zeros(size, np.int64)

    def flags(size: int) -> NDArray[np.bool_]:
        return np.zeros(size, np.bool_)

    found = Found(
        triangles=numbers(triangles),
        parted=numbers(3 * triangles),
        slots=numbers(slots),
        bent=numbers(triangles),
        near=numbers(triangles),
        alone=numbers(triangles),
        rows=numbers(vertices),
        counts=numbers(7),
        stored=np.zeros(2),
        of_triangle=flags(triangles),
        of_side=flags(3 * triangles),
        of_slot=flags(slots),
        of_vertex=flags(vertices),
    )
    return torn, found


def _room_to_bend(triangles: int, vertices: int, slopes: int) -> BendRoom:
    """Room for as many triangles as there are, whose slopes have up to so many vertices: few of it is ever touched."""
    most = room_of(slopes)
    return BendRoom(
        number=np.full(3 * triangles, -1),
        sides=np.zeros(3 * triangles, np.int64),
        of=np.zeros((triangles, 3), np.int64),
        slopes=np.zeros((3 * triangles, slopes)),
        vertices=np.zeros((3 * triangles, slopes), np.int64),
        across=np.zeros((triangles, 3, 3)),
        ends=np.zeros((triangles, 3, 3)),
        faces=np.zeros((triangles, 3), np.int64),
        place=np.full(vertices, -1),
        members=np.zeros((triangles, most), np.int64),
        rows=np.zeros((triangles, 3, most)),
    )


def _widened(springs: "SplitMeshSprings") -> "SplitMeshSprings":
    """The same with room for wider bends."""
    first = np.repeat(springs.bend_vertices[:, :1], WIDER, axis=1)
    return replace(
        springs,
        bend_vertices=np.concatenate([springs.bend_vertices, first], axis=1),
        bend_coefficients=np.concatenate([springs.bend_coefficients, np.zeros(first.shape)], axis=1),
    )
