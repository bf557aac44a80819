"""From a scene to the arrays that kernels work on."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.assembly.contact import Contacts, contacts_of, for_another_thread
from cape.assembly.fabrics import patchwork_of
from cape.assembly.holding import attached_of, by_kind, confined_of, pull_of, rails_of, tethers_of, ties_of
from cape.assembly.springs import Springs, springs_of
from cape.cloth.cloth import Cloth, GridCloth, MeshCloth
from cape.cloth.split_grid import SplitGrid
from cape.cloth.split_mesh import SplitMesh
from cape.kernels.bones import MotionRoom
from cape.kernels.cloth.grid import MOST_COLUMNS, GridRoom, grid_room
from cape.kernels.cloth.stream import Stream
from cape.kernels.self_contact.self_contact import Layers
from cape.kernels.solve.attachments import Attached
from cape.kernels.solve.confine import Confined
from cape.kernels.solve.lift import Ties
from cape.kernels.solve.slide import Rails
from cape.kernels.solve.soft import Pull
from cape.kernels.solve.tethers import Tethers
from cape.kernels.state import Inertia, State
from cape.scene.holding.attachments import Attachment
from cape.scene.scene import Scene
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Rank:
    """What each thread of a run has of its own: the colliders with their scratch, and room for the bones' motion."""

    contacts: Contacts
    room: MotionRoom


@dataclass(frozen=True, eq=False)
class Assembly:
    """A scene as arrays; bones are numbered as in `scene.bones`, and one more stands for the world.

    Attributes:
        scene: what was assembled.
        cloth: the scene's cloth, its vertices renumbered where that keeps neighbours close in memory.
        order: the scene's vertex that each of the N vertices here is, shape (N,); None where they are the same.
        springs: the cloth's springs.
        mass: of the vertices [kg], shape (N,).
        inverse_mass: [1/kg], shape (N,), zero for attached vertices.
        free: False for attached vertices, shape (N,).
        attached: what bones hold hard; its points change while the cloth is put on. None for nothing.
        ties: threads between that, which keep it together where it is led out of colliders; None for nothing.
        pull: what they hold by springs, in the same way; None for nothing.
        rails: curves along which vertices slide, in the same way; None for nothing.
        confined: what may not get far from where bones would carry it; None for nothing.
        tethers: from what bones hold hard to all that hangs on it; None for none.
        hands: that may take hold of vertices as the cloth moves, in place; None for none.
        wind: velocity of the air [m/s], shape (3,), in place: it changes while the cloth is put on. 0 in a stream.
        stream: of a wind that is not everywhere and always alike, from frame to frame; None for one that is.
        ranks: for each thread of a run.
    """

    scene: Scene
    cloth: Cloth
    order: NDArray[np.int64] | None
    springs: Springs
    mass: FloatArray
    inverse_mass: FloatArray
    free: NDArray[np.bool_]
    attached: Attached | None
    ties: Ties | None
    pull: Pull | None
    rails: Rails | None
    confined: Confined | None
    tethers: Tethers | None
    hands: Pull | None
    wind: FloatArray
    stream: Stream | None
    ranks: tuple[Rank, ...]

    @property
    def contacts(self) -> Contacts:
        """What the cloth can't enter, as the first thread notes it."""
        return self.ranks[0].contacts

    @property
    def carried(self) -> tuple[Attached, ...]:
        """All that bones carry along: what they hold hard, what springs hold, what slides."""
        return tuple(attached for attached in self._by_kind if attached is not None)

    @property
    def pulls(self) -> tuple[Pull, ...]:
        """All springs that hold vertices: those of bones, and those of hands."""
        return tuple(pull for pull in (self.pull, self.hands) if pull is not None)

    def place_of(self, vertex: int) -> int:
        """The number here of a vertex that is numbered as the scene's, or behind those as one that has split off."""
        return vertex if self.order is None else int(np.flatnonzero(self.order == vertex)[0])

    @property
    def _by_kind(self) -> tuple[Attached | None, Attached | None, Attached | None]:
        pulled = None if self.pull is None else self.pull.attached
        return self.attached, pulled, None if self.rails is None else self.rails.attached

    @property
    def loose(self) -> NDArray[np.bool_]:
        """Which vertices no bone holds hard or on a curve, shape (N,): those that colliders keep out."""
        loose = self.free.copy()
        if self.rails is not None:
            loose[self.rails.attached.vertices] = False
        return loose

    def carried_with(
        self, held: list[NDArray[np.int64]]
    ) -> list[tuple[Attached, list[tuple[Attachment, NDArray[np.int64]]]]]:
        """The same, each with its attachments and the vertices of the scene that these hold, given those of all."""
        pairs = list(zip(self.scene.attachments, held, strict=True))
        return [
            (attached, own) for attached, own in zip(self._by_kind, by_kind(pairs), strict=True) if attached is not None
        ]

    @property
    def layers(self) -> Layers | None:
        """What keeps the cloth off itself; None where nothing does."""
        return self.contacts.layers

    def with_layers(self, layers: Layers) -> "Assembly":
        """The same with other notes on how the cloth touches itself."""
        ranks = (replace(rank, contacts=rank.contacts._replace(layers=layers)) for rank in self.ranks)
        return replace(self, ranks=tuple(ranks))

    @property
    def in_use(self) -> int:
        """How many vertices are no spare ones, which come last."""
        return self.cloth.in_use if isinstance(self.cloth, SplitGrid | SplitMesh) else self.cloth.vertices

    def carry_spares(self, state: State) -> None:
        """Have spare vertices go along with the first, in place, so that they are never far."""
        for component in state if self.in_use < self.cloth.vertices else ():
            component[self.in_use :] = component[0]

    def inwards(self, values: NDArray[Any]) -> NDArray[Any]:
        """Renumber rows that belong to the scene's vertices, shape (n, ...), as they are numbered here, shape (N, ...).

        Spare vertices get what the first has.
        """
        spare = self.cloth.vertices - len(values)
        values = np.concatenate([values, values[np.zeros(spare, np.int64)]]) if spare else values
        return values if self.order is None else values[self.order]

    def outwards(self, values: NDArray[Any]) -> NDArray[Any]:
        """Renumber rows that belong to vertices here, shape (N, ...), as the scene numbers them, without spare ones."""
        if self.order is None:
            return values[: self.in_use]
        result = np.empty_like(values)
        result[self.order] = values
        return result[: self.in_use]


def assemble(
    scene: Scene,
    vertices: list[NDArray[np.int64]],
    *,
    threads: int = 1,
    spare: bool = False,
    split: SplitGrid | SplitMesh | None = None,
    springs: Springs | None = None,
    hands: Pull | None = None,
) -> Assembly:
    """Build the arrays of a scene whose attachments hold the given vertices, for so many threads.

    A grid that may tear has `spare` vertices, and a mesh of one fabric that may if they are asked for: of several it is
    laid out anew whenever it tears, as its pieces have arrays of their own. One that has been torn is
    given as it has split, a mesh with its springs. `hands` are those that may take hold of it.
    """
    cloth, order, spare = scene.cloth, None, spare and patchwork_of(scene.cloth) is None
    if isinstance(cloth, MeshCloth):
        cloth, order = _in_order(scene, cloth, split, spare=spare)
        rank = np.argsort(order)
        places = [rank[indices] for indices in vertices]
    else:
        places = vertices
        if scene.tearing is not None and isinstance(cloth, GridCloth):
            cloth = split if isinstance(split, SplitGrid) else SplitGrid.of(cloth, spare_rows(cloth))
    holds = list(zip(scene.attachments, vertices, places, strict=True))
    mass = cloth.masses()
    free = mass > 0.0  # all but spare vertices
    loose = free.copy()
    for attachment, _, indices in holds:
        free[indices] = not attachment.hard
        loose[indices] = attachment.soft
    contacts = contacts_of(scene, cloth, loose)
    hard, soft, sliding = by_kind(holds)
    attached, springs = attached_of(scene, hard), springs or springs_of(cloth)
    springs = springs if spare else springs.acting
    varies = scene.wind is not None and scene.wind.varies
    stream = Stream(*np.zeros((3, 3, cloth.vertices))) if varies else None
    return Assembly(
        scene=scene,
        cloth=cloth,
        order=order,
        springs=springs,
        mass=mass,
        inverse_mass=inverse_of(mass, free),
        free=free,
        attached=attached,
        ties=None if attached is None else ties_of(cloth, springs, attached),
        pull=pull_of(scene, soft, mass),
        rails=rails_of(scene, sliding),
        confined=confined_of(scene, cloth, vertices, np.arange(cloth.vertices) if order is None else np.argsort(order)),
        tethers=tethers_of(scene, cloth, springs, attached),
        hands=hands,
        wind=np.array((0.0, 0.0, 0.0) if stream or scene.wind is None else scene.wind.velocity, dtype=float),
        stream=stream,
        ranks=tuple(
            Rank(for_another_thread(contacts) if rank else contacts, MotionRoom.blank(len(scene.bones) + 1))
            for rank in range(threads)
        ),
    )


def _in_order(
    scene: Scene, mesh: MeshCloth, split: SplitGrid | SplitMesh | None, *, spare: bool
) -> tuple[MeshCloth, NDArray[np.int64]]:
    """A mesh with its neighbours close in memory, as it has split if it may, and the order of its vertices."""
    from cape.cloth.triangle_mesh import locality_order, reordered

    if not isinstance(split, SplitMesh):
        order = locality_order(mesh.faces, mesh.positions)
        if scene.tearing is None:
            return reordered(mesh, order), order
        split = SplitMesh.of(mesh, order, spare_vertices(mesh) if spare else 0)
    return split, np.concatenate([split.order, np.arange(len(split.order), split.vertices)])


SPARE = 0.0625  # of a cloth's vertices, that it may get by splitting until more room is made
FEWEST = 16  # spare vertices of a mesh


def spare_rows(cloth: GridCloth) -> int:
    """How many rows of spare vertices a grid gets that may split."""
    return max(2, round(SPARE * cloth.rows))


def spare_vertices(mesh: MeshCloth) -> int:
    """How many spare vertices a mesh gets that may split."""
    return max(FEWEST, round(SPARE * mesh.vertices))


def inverse_of(mass: FloatArray, free: NDArray[np.bool_]) -> FloatArray:
    """[1/kg] of vertices, zero for those that aren't free, shape (N,)."""
    return np.divide(1.0, mass, out=np.zeros_like(mass), where=free)


def inertia_of(assembly: Assembly, dtype: type[np.floating]) -> Inertia:
    """Masses and gravity in a solver's precision."""
    return Inertia(
        mass=assembly.mass.astype(dtype),
        inverse_mass=assembly.inverse_mass.astype(dtype),
        free=assembly.free.astype(dtype),
        gravity=np.array(assembly.scene.gravity, dtype=float),
    )


def force_scratch(assembly: Assembly, dtype: type[np.floating]) -> tuple[GridRoom | None, ...]:
    """Scratch of the forces for each thread; None where they need none of their own.

    Raises:
        ValueRangeError: a grid has a single column, or more than there is room for.
    """
    cloth = assembly.cloth
    if not isinstance(cloth, GridCloth):
        return (None,) * len(assembly.ranks)
    if not 2 <= cloth.columns <= MOST_COLUMNS:
        raise ValueRangeError(f"a grid of cloth has 2 to {MOST_COLUMNS} columns, not {cloth.columns}")
    return tuple(grid_room(dtype) for _ in assembly.ranks)
