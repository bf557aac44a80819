"""Measures of a running cloth: strain, penetration, contacts, kinetic energy."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.assembly.assemble import Assembly
from cape.assembly.contact import contacts_of
from cape.kernels.bones import blank_motion
from cape.kernels.cloth import measure
from cape.kernels.contact.shapes import Shapes
from cape.kernels.records import MotionRoom, State
from cape.measure.contact_points import ContactPoints
from cape.scene.poses import Pose
from cape.scene.scene import Scene

FloatArray = NDArray[np.float64]

ROOM = 512  # contacts of a kind of collider that there is room for at first


@dataclass(frozen=True)
class Reading:
    """A cloth at one instant.

    Attributes:
        stretch: largest strain along the threads.
        penetration: deepest penetration of a vertex that no bone holds [m].
        collider: index of the collider it is in, -1 for none.
        contacts: of vertices that no bone holds, as one frame.
        kinetic_energy: [J].
    """

    stretch: float
    penetration: float
    collider: int
    contacts: ContactPoints
    kinetic_energy: float


class Meter:
    """Reads a cloth frame by frame, and keeps a histogram of all strains."""

    def __init__(self, assembly: Assembly, scene: Scene | None = None) -> None:
        """Prepare to read an assembled cloth; `scene` has the colliders to measure, None for the assembly's own."""
        self.scene = scene or assembly.scene
        self._assembly = assembly
        self._histogram = np.zeros(measure.BINS, dtype=np.int64)
        springs = assembly.springs
        chosen = springs.measured
        self._first, self._second, self._rest = springs.first[chosen], springs.second[chosen], springs.rest[chosen]
        contacts, self._order = contacts_of(self.scene, assembly.cloth, assembly.free)
        self._groups = contacts.groups or ()
        self._bones = MotionRoom(*blank_motion(len(self.scene.bones) + 1))
        self._room = _ContactRoom(ROOM)

    def read(self, state: State, pose: Pose, *, origin: ArrayLike = (0.0, 0.0, 0.0)) -> Reading:
        """Measure a state.

        Args:
            state: the vertices as the assembly numbers them, about `origin`.
            pose: of the scene's bones, and of the world as the last one, about `origin`.
            origin: that positions refer to, in the world [m], shape (3,).
        """
        stretch = measure.strain(state.x, state.y, state.z, self._first, self._second, self._rest, self._histogram)
        penetration, collider, parts = 0.0, -1, []
        for order, shapes in zip(self._order, self._groups, strict=True):
            depth, which, count = self._touching(state, shapes, pose)
            if depth > penetration:
                penetration, collider = float(depth), order[which]
            parts.append(self._room.contacts(count, order))
        return Reading(
            stretch=float(stretch),
            penetration=penetration,
            collider=collider,
            contacts=self._in_scene(parts, np.asarray(origin, dtype=float)),
            kinetic_energy=float(measure.kinetic_energy(self._assembly.mass, state.vx, state.vy, state.vz)),
        )

    def stretch_quantile(self, share: float) -> float:
        """Strain that a share of all strains read so far does not exceed, to a bin of the histogram (1e-4)."""
        counts = np.cumsum(self._histogram)
        if counts[-1] == 0:
            return 0.0
        return float((np.searchsorted(counts, share * counts[-1]) + 1) * measure.WIDEST / measure.BINS)

    def _touching(self, state: State, shapes: Shapes, pose: Pose) -> tuple[float, int, int]:
        """Fill the room with contacts, in a larger one should they not fit."""
        while True:
            depth, which, count = measure.touching(
                *state[:3], self._assembly.free, shapes, *pose, self._bones, *self._room.arrays
            )
            if count <= self._room.size:
                return depth, which, count
            self._room = _ContactRoom(2 * count)

    def _in_scene(self, parts: list["_Contacts"], origin: FloatArray) -> ContactPoints:
        """Contacts with the vertices as the scene numbers them, in the world."""
        if not parts:
            return ContactPoints.none(1)
        vertices, colliders, places = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        order = self._assembly.order
        return ContactPoints(
            starts=np.array([0, len(vertices)]),
            points=(places[:, :3] + origin).astype(np.float32),
            normals=places[:, 3:6].astype(np.float32),
            depths=places[:, 6].astype(np.float32),
            colliders=colliders.astype(np.int32),
            vertices=(vertices if order is None else order[vertices]).astype(np.int32),
        )


_Contacts = tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]
"""Vertices (n,), colliders (n,), and points, normals and depths (n, 7)."""


class _ContactRoom:
    """Room for the contacts with one kind of collider."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.arrays: _Contacts = (np.zeros(size, np.int64), np.zeros(size, np.int64), np.zeros((size, 7)))

    def contacts(self, count: int, order: list[int]) -> _Contacts:
        """Copies of the first `count`; `order` gives the scene's index of each collider of the kind."""
        vertices, colliders, places = self.arrays
        return vertices[:count].copy(), np.array(order)[colliders[:count]], places[:count].copy()
