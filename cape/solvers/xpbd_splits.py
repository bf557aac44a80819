"""XPBD's constraints on a mesh that may split: with room behind them, where they are laid out anew in place."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.assembly.chains import Chain, chain_of, spacing_of, ways_of
from cape.assembly.coloring import by_color
from cape.assembly.mesh.places import NoRoom
from cape.assembly.mesh.split_springs import Changed, SplitMeshSprings
from cape.kernels.calling import Bound
from cape.kernels.store import Request
from cape.kernels.tearing.ways import measure_ways
from cape.kernels.xpbd.bending import ROWS
from cape.kernels.xpbd.formulas import Constraints
from cape.kernels.xpbd.membrane import NUMBERS
from cape.kernels.xpbd.mesh import MeshConstraints
from cape.kernels.xpbd.recoloring import (
    IDLE,
    Colored,
    SplitBends,
    SplitMembrane,
    SplitSprings,
    split_bends,
    split_membrane,
    split_springs,
)

Array = NDArray[Any]
IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]

MORE = 0.125  # of the room that constraints of a mesh take before it splits, that there is more
COLOURS, FEW = 8, 256  # more colours, and other rows more at least, that there is room for
WORD = 64  # colours
ENDS = ("starts", "first")  # of pieces: there is nothing in those behind the last


class Part(NamedTuple):
    """Constraints of one kind, and what lays them out in a colour each; that tells whether there is room."""

    colored: Colored
    lay: Bound


class Bends(NamedTuple):
    """The same of patches of bend springs, with their `group`."""

    colored: Colored
    lay: Bound
    group: SplitBends


class SplitConstraints:
    """The constraints of a mesh that may split, of one fabric or of some that are alike, and its chains.

    Attributes:
        laid: as steps go through them; their arrays stay where they are.
    """

    def __init__(self, assembly: Assembly, laid: MeshConstraints) -> None:
        """Make room behind constraints that have been laid out, and know their colours.

        What becomes of the assembly's masses, and of its springs in place, is seen.
        """
        springs, inverse_mass = assembly.springs, assembly.inverse_mass
        if not isinstance(springs, SplitMeshSprings):
            raise TypeError("only the springs of a mesh with room to split have constraints that follow")
        self.laid: MeshConstraints = _with_room(laid)
        self._inverse_mass, of_edges = inverse_mass, _of_membrane if laid.springs is None else _of_springs
        self._edges = of_edges(springs, inverse_mass, self.laid)
        self._bends = None if laid.bends is None else _of_bends(springs, inverse_mass, self.laid)
        self._bent = springs.bend_vertices
        self._ways, self._spacing = ways_of(assembly), spacing_of(assembly)
        self._measure_ways = Bound(measure_ways, self._ways)

    def follow(self, assembly: Assembly, changed: Changed) -> None:
        """Lay out anew what springs are by now, some of which have changed.

        Raises:
            NoRoom: it does not do, and what was there is of no use any more.
        """
        springs = assembly.springs
        assert isinstance(springs, SplitMeshSprings)
        sides = len(springs.fitted.mate)
        _lay(self._edges, changed.slots if self.laid.springs is not None else changed.slots[changed.slots < sides])
        if self._bends is not None:
            if springs.bend_vertices is not self._bent:
                colored = _widened(self._bends.colored, springs.bend_vertices.shape[1])
                self._bends = _bends_in(springs, self._inverse_mass, self.laid, colored, self._bends.group.sizes)
                self._bent = springs.bend_vertices
            _lay(self._bends, changed.bent)

    def chain(self, assembly: Assembly) -> Chain:
        """The longest chain of the springs that are left; an edge that parts leaves two as long as it was."""
        self._measure_ways()
        return chain_of(assembly, self._ways, self._spacing)

    @property
    def requests(self) -> list[Request]:
        """The code that `follow` needs."""
        parts = (self._edges, self._bends)
        return [self._measure_ways.request, *(part.lay.request for part in parts if part is not None)]


def _lay(part: Part | Bends, changed: IntArray) -> None:
    part.colored.counts[0] = len(changed)
    part.colored.changed[: len(changed)] = changed
    if not part.lay():
        raise NoRoom


def _of_springs(springs: SplitMeshSprings, inverse_mass: FloatArray, laid: MeshConstraints) -> Part:
    assert laid.springs is not None
    acts = springs.acts(np.arange(len(springs.first)))
    colored = _colored(np.stack([springs.first, springs.second], axis=1), acts, len(inverse_mass))
    own = springs.first, springs.second, springs.stiffness, springs.rest, springs.fitted.mate
    return Part(colored, Bound(split_springs, SplitSprings(*own, inverse_mass, colored, laid.springs)))


def _of_membrane(springs: SplitMeshSprings, inverse_mass: FloatArray, laid: MeshConstraints) -> Part:
    membrane, edges = springs.membrane, laid.membrane
    assert membrane is not None
    assert edges is not None
    within = membrane.neighbours.ravel() >= np.repeat(np.arange(len(membrane.faces)), 3)
    strains = membrane.edges()
    members, numbers = np.full((len(within), 4), -1), np.zeros((len(within), NUMBERS))
    members[within] = strains.vertices
    numbers[within] = strains.numbers
    colored, nobody = _colored(members, within, len(inverse_mass)), len(inverse_mass)
    colored.members[members[:, 2] == members[:, 3], 3] = -1
    own = membrane.faces, membrane.slopes, membrane.area, membrane.neighbours, numbers, nobody
    return Part(colored, Bound(split_membrane, SplitMembrane(*own, colored, edges)))


def _of_bends(springs: SplitMeshSprings, inverse_mass: FloatArray, laid: MeshConstraints) -> Bends:
    vertices, stiffness = springs.bend_vertices[::ROWS], springs.bend_stiffness
    resists = np.where(stiffness[:, None] > 0.0, springs.bend_coefficients != 0.0, False)
    led_to = resists.reshape(len(vertices), ROWS, -1).any(axis=1)
    acts = np.asarray((stiffness > 0.0).reshape(-1, ROWS).any(axis=1))
    colored = _colored(vertices, acts, len(inverse_mass))
    colored.members[~led_to] = -1
    return _bends_in(springs, inverse_mass, laid, colored, led_to.sum(axis=1))


def _bends_in(
    springs: SplitMeshSprings, inverse_mass: FloatArray, laid: MeshConstraints, colored: Colored, sizes: IntArray
) -> Bends:
    assert laid.bends is not None
    patches, most = colored.members.shape
    bends = SplitBends(
        springs.bend_vertices, springs.bend_coefficients, springs.bend_stiffness, inverse_mass, colored, sizes,
        np.zeros(most + 2, np.int64), np.zeros((2, patches), np.int64), laid.bends,
    )  # fmt: skip
    return Bends(colored, Bound(split_bends, bends), bends)


def _colored(members: IntArray, acts: NDArray[np.bool_], vertices: int) -> Colored:
    """Constraints (E, m), as many as act coloured as `by_color` does; with room for some more colours."""
    known, count = by_color(members[acts]), len(members)
    colors, numbers = np.full(count, IDLE), np.flatnonzero(acts)
    colors[numbers[known.order]] = np.repeat(np.arange(len(known.starts) - 1), np.diff(known.starts))
    words = -(-(len(known.starts) - 1 + COLOURS) // WORD)
    return Colored(
        members=members.astype(np.int64),
        colors=colors,
        changed=np.zeros(count, np.int64),
        counts=np.zeros(1, np.int64),
        met=np.zeros((vertices, words), np.uint64),
        filled=np.zeros(WORD * words, np.int64),
    )


def _widened(colored: Colored, most: int) -> Colored:
    """The same for constraints of up to so many vertices."""
    more = most - colored.members.shape[1]
    return colored._replace(members=np.pad(colored.members, ((0, 0), (0, more)), constant_values=-1))


def _with_room(group: Any) -> Any:
    """Constraints with room for those of the mesh once it has split, but not their scratch.

    Along rows more would be listed: impulses of some come by axis first.
    """
    grown = {}
    for name in group._fields:
        value = getattr(group, name)
        if name in ("packed", "rows"):
            continue
        if isinstance(value, np.ndarray):
            by_axis = isinstance(group, Constraints) and value.ndim == 2
            rows = _longer(name, value.T if by_axis else value)
            grown[name] = np.ascontiguousarray(rows.T if by_axis else rows)
        elif hasattr(value, "_fields"):
            grown[name] = _with_room(value)
    return group._replace(**grown)


def _longer(name: str, rows: Array) -> Array:
    more = COLOURS if name == "starts" else max(FEW, round(MORE * len(rows)))
    return np.pad(rows, [(0, more)] + [(0, 0)] * (rows.ndim - 1), "edge" if name in ENDS else "constant")
