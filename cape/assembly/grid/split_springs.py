"""Springs of a grid that may have split: by family where they lead to a vertex's neighbours, one by one where not.

Each spring of a grid is made of what cells add to it (`cape.assembly.grid.springs`): half an edge, a diagonal, a strip
that bends. What a cell adds goes along with its corners. A strip of two cells bends as long as they have the corner in
their middle in common. So the springs of such a grid are listed by what cells add: their number never changes, and
where a few cells split a few of them change, in place.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.grid.springs import cell_stiffness, grid_springs
from cape.assembly.springs import Families, Springs
from cape.cloth.cloth import GridCloth
from cape.cloth.split_grid import SplitGrid

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Family, right, down and both diagonals, with the corners of a cell, around it, between which it adds to a spring.
SIDES = ((0, 0, 1), (0, 3, 2), (1, 0, 3), (1, 1, 2), (2, 0, 2), (3, 1, 3))
ACROSS, DOWN, TWIST = range(3)  # families of bends
# Families, with the corners of two cells beside each other, in both the same, along strips of theirs that bend.
STRIPS = ((ACROSS, 0, 1), (ACROSS, 3, 2), (DOWN, 0, 3), (DOWN, 1, 2))
CORNERS_OF_TWIST = (0, 1, 3, 2)
BEND_WEIGHTS, TWIST_WEIGHTS = (1.0, -2.0, 1.0, 0.0), (1.0, -1.0, -1.0, 1.0)


class Parts(NamedTuple):
    """What the cells of a grid add to its springs, n parts; and to its bends, m parts.

    Of a spring: `ends` (n, 2) in the whole grid, the cell and its corners that these are (`cell` (n,), `corners`
    (n, 2)), `slot`, which is the family times V plus the vertex it starts from, `stiffness` [N/m] and `rest` [m], (n,).
    Of a bend: the same with `bent` (m, 4), `bend_cells` and `bend_corners` (m, 4), `bend_slot`, `bend_stiffness`;
    `joint` (m, 2) are the cell and the corner that must be the bend's second vertex, too. Then the parts of a slot,
    `of_slot` (4 V, 2) and `of_bend_slot` (3 V, 2), and the bends of a cell, `bends_of_cell` (P, 9), -1 for none.
    """

    ends: IntArray
    cell: IntArray
    corners: IntArray
    slot: IntArray
    stiffness: FloatArray
    rest: FloatArray
    bent: IntArray
    bend_cells: IntArray
    bend_corners: IntArray
    joint: IntArray
    bend_slot: IntArray
    bend_stiffness: FloatArray
    weights: FloatArray
    of_slot: IntArray
    of_bend_slot: IntArray
    bends_of_cell: IntArray


@dataclass(frozen=True, eq=False, kw_only=True)
class SplitSprings(Springs):
    """The springs of a grid that may have split, each as its parts; `families` has those that are at home there.

    Attributes:
        home: which springs the families have, (n,); the others are astray.
        bends_home: which bends they have, (m,); others are astray, or gone.
    """

    parts: Parts
    home: NDArray[np.bool_]
    bends_home: NDArray[np.bool_]


class Changed(NamedTuple):
    """Slots of springs (s,), and of bends (b,), whose stiffness has changed; and bends that are gone: their `vertices`
    and `weights` (l, 4), and `stiffness` [N/m] (l,)."""

    slots: IntArray
    bend_slots: IntArray
    vertices: IntArray
    weights: FloatArray
    stiffness: FloatArray

    def energy(self, positions: FloatArray) -> float:
        """What was stored in bends that are gone, at positions of the vertices [m], shape (N, 3) [J]."""
        bent = np.einsum("lm,lmc->lc", self.weights, positions[self.vertices])
        return 0.5 * float(self.stiffness @ np.sum(bent**2, axis=1))


def split_springs(cloth: SplitGrid) -> SplitSprings:
    """Derive the springs of a grid that may have split."""
    whole, parts, count = grid_families(cloth.whole), parts_of(cloth.whole), cloth.vertices
    first = cloth.whole.vertices
    stiffness, rest, bends, twist = np.zeros((4, count)), np.ones((4, count)), np.zeros((2, count)), np.zeros(count)
    stiffness[:, :first], rest[:, :first] = whole.stiffness, whole.rest
    bends[:, :first], twist[:first] = whole.bend_stiffness, whole.twist_stiffness
    springs = SplitSprings(
        first=np.ascontiguousarray(parts.ends[:, 0]),
        second=np.ascontiguousarray(parts.ends[:, 1]),
        stiffness=parts.stiffness,
        rest=parts.rest,
        measured=parts.slot < 2 * first,
        bend_vertices=parts.bent.copy(),
        bend_coefficients=parts.weights,
        bend_stiffness=parts.bend_stiffness.copy(),
        families=Families(whole.offsets, stiffness, rest, whole.bend_offsets, bends, twist),
        parts=parts,
        home=np.ones(len(parts.slot), bool),
        bends_home=np.ones(len(parts.bend_slot), bool),
    )
    move_springs(springs, cloth, np.flatnonzero((cloth.corners != cloth.whole.cells).any(axis=1)))
    return springs


def move_springs(springs: SplitSprings, cloth: SplitGrid, cells: IntArray) -> Changed:
    """Have springs follow some cells (c,) of a grid, in place."""
    parts, now, first, families = springs.parts, cloth.corners, cloth.whole.vertices, springs.families
    assert families is not None
    moved = (cells[:, None] + len(now) * np.arange(len(SIDES))).ravel()
    ends = now[parts.cell[moved, None], parts.corners[moved]]
    springs.first[moved], springs.second[moved] = ends.T
    springs.home[moved] = (ends == parts.ends[moved]).all(axis=1)
    slots = np.unique(parts.slot[moved])
    families.stiffness[slots // first, slots % first] = _sums(parts.of_slot[slots], springs.home, parts.stiffness)

    bends = np.unique(parts.bends_of_cell[cells])
    bends = bends[bends >= 0]
    bent = now[parts.bend_cells[bends], parts.bend_corners[bends]]
    before = springs.bend_vertices[bends]
    springs.bend_vertices[bends] = bent
    whole = now[parts.joint[bends, 0], parts.joint[bends, 1]] == bent[:, 1]
    gone = ~whole & (springs.bend_stiffness[bends] > 0.0)
    springs.bend_stiffness[bends] = np.where(whole, parts.bend_stiffness[bends], 0.0)
    springs.bends_home[bends] = whole & (bent == parts.bent[bends]).all(axis=1)
    bend_slots = np.unique(parts.bend_slot[bends])
    stiffness = _sums(parts.of_bend_slot[bend_slots], springs.bends_home, parts.bend_stiffness)
    twisted = bend_slots >= TWIST * first
    families.twist_stiffness[bend_slots[twisted] - TWIST * first] = stiffness[twisted]
    family, start = np.divmod(bend_slots[~twisted], first)
    families.bend_stiffness[family, start] = stiffness[~twisted]
    lost = bends[gone]
    return Changed(slots, bend_slots, before[gone], parts.weights[lost], parts.bend_stiffness[lost])


@lru_cache(maxsize=8)
def grid_families(whole: GridCloth) -> Families:
    """The springs of a whole grid by family."""
    families = grid_springs(whole).families
    assert families is not None
    return families


@lru_cache(maxsize=8)
def parts_of(whole: GridCloth) -> Parts:
    """What the cells of a whole grid add."""
    added, fabric, count, cells = cell_stiffness(whole), whole.fabric, whole.vertices, whole.cells
    rest = grid_families(whole).rest
    numbers = np.arange(len(cells))
    by_family = [part.ravel() for part in (added.right, added.down, added.diagonal, added.diagonal)]
    families = np.repeat([family for family, _, _ in SIDES], len(cells))
    corners = np.repeat([(a, b) for _, a, b in SIDES], len(cells), axis=0)
    cell = np.tile(numbers, len(SIDES))
    ends = cells[cell[:, None], corners]
    slot = families * count + ends[:, 0]

    table = numbers.reshape(added.twist.shape)
    beside = {ACROSS: (table[:, :-1], table[:, 1:]), DOWN: (table[:-1], table[1:])}
    widths = {ACROSS: fabric.bend_weft * added.height.ravel(), DOWN: fabric.bend_warp * added.width.ravel()}
    bend_cells, bend_corners, joint, kinds, stiffness = [], [], [], [], []
    for family, a, b in STRIPS:
        near, far = (part.ravel() for part in beside[family])
        lengths = (rest[family, cells[near, a]] + rest[family, cells[far, a]]) / 2.0
        stiffness.append((widths[family][near] + widths[family][far]) / 2.0 / lengths**3)
        bend_cells.append(np.stack([near, near, far, far], axis=1))
        bend_corners.append(np.tile((a, b, b, b), (len(near), 1)))
        joint.append(np.stack([far, np.full(len(far), a)], axis=1))
        kinds.append(np.full(len(near), family))
    bend_cells.append(np.repeat(numbers[:, None], 4, axis=1))
    bend_corners.append(np.tile(CORNERS_OF_TWIST, (len(numbers), 1)))
    joint.append(np.stack([numbers, np.full(len(numbers), CORNERS_OF_TWIST[1])], axis=1))
    kinds.append(np.full(len(numbers), TWIST))
    stiffness.append(added.twist.ravel())
    kind, of_cells, of_corners = np.concatenate(kinds), np.concatenate(bend_cells), np.concatenate(bend_corners)
    bent = cells[of_cells, of_corners]
    bend_slot = kind * count + bent[:, 0]
    both = np.concatenate([np.arange(len(kind)), np.arange(len(kind))])
    belongs = np.concatenate([of_cells[:, 0], np.where(kind == TWIST, -1, of_cells[:, 2])])
    return Parts(
        ends=ends,
        cell=cell,
        corners=corners,
        slot=slot,
        stiffness=np.stack(by_family)[families, cell],
        rest=rest[families, ends[:, 0]],
        bent=bent,
        bend_cells=of_cells,
        bend_corners=of_corners,
        joint=np.concatenate(joint),
        bend_slot=bend_slot,
        bend_stiffness=np.concatenate(stiffness),
        weights=np.where((kind == TWIST)[:, None], TWIST_WEIGHTS, BEND_WEIGHTS),
        of_slot=_members(slot, np.arange(len(slot)), 4 * count),
        of_bend_slot=_members(bend_slot, np.arange(len(kind)), 3 * count),
        bends_of_cell=_members(belongs[belongs >= 0], both[belongs >= 0], len(cells)),
    )


def _members(owner: IntArray, member: IntArray, owners: int) -> IntArray:
    """The members that each owner has, in their order, shape (owners, most), filled up with -1."""
    order = np.lexsort((member, owner))
    counts = np.bincount(owner, minlength=owners)
    table = np.full((owners, counts.max()), -1)
    table[owner[order], np.arange(len(order)) - (np.cumsum(counts) - counts)[owner[order]]] = member[order]
    return table


def _sums(members: IntArray, home: NDArray[np.bool_], stiffness: FloatArray) -> FloatArray:
    """What those of some parts (s, k) that are at home add up to, shape (s,); -1 is no part."""
    return np.where((members >= 0) & home[members], stiffness[members], 0.0).sum(axis=1)
