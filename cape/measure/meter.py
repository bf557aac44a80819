"""Measures of a running cloth: strain, penetration, contacts, kinetic energy."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.assembly.assemble import Assembly
from cape.assembly.contact import contacts_of, link_distances
from cape.kernels.bones import MotionRoom
from cape.kernels.cloth import measure
from cape.kernels.linking import Linker
from cape.kernels.state import State
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
        self._colliders = contacts_of(self.scene, assembly.cloth, assembly.free).colliders
        if self._colliders is not None:
            linker = Linker()
            link_distances(self.scene, self._colliders, None, linker)
            linker.link()
        self._bones = MotionRoom.blank(len(self.scene.bones) + 1)
        self._room = _ContactRoom(ROOM)

    def read(self, state: State, pose: Pose, *, origin: ArrayLike = (0.0, 0.0, 0.0)) -> Reading:
        """Measure a state.

        Args:
            state: the vertices as the assembly numbers them, about `origin`.
            pose: of the scene's bones, and of the world as the last one, about `origin`.
            origin: that positions refer to, in the world [m], shape (3,).
        """
        stretch = measure.strain(state.x, state.y, state.z, self._first, self._second, self._rest, self._histogram)
        penetration, collider, count = self._touching(state, pose)
        return Reading(
            stretch=float(stretch),
            penetration=penetration,
            collider=collider,
            contacts=self._in_scene(count, np.asarray(origin, dtype=float)),
            kinetic_energy=float(measure.kinetic_energy(self._assembly.mass, state.vx, state.vy, state.vz)),
        )

    def stretch_quantile(self, share: float) -> float:
        """Strain that a share of all strains read so far does not exceed, to a bin of the histogram (1e-4)."""
        counts = np.cumsum(self._histogram)
        if counts[-1] == 0:
            return 0.0
        return float((np.searchsorted(counts, share * counts[-1]) + 1) * measure.WIDEST / measure.BINS)

    def _touching(self, state: State, pose: Pose) -> tuple[float, int, int]:
        """Deepest penetration [m], the collider, -1 for none, and how many contacts there are in the room.

        Makes the room larger should they not fit.
        """
        if self._colliders is None:
            return 0.0, -1, 0
        while True:
            vertices, colliders, places = self._room.arrays
            touch = measure.Touch(
                state, self._assembly.free, self._colliders, self._bones, pose.positions, pose.rotations_wxyz,
                vertices, colliders, places,
            )  # fmt: skip
            depth, which, count = measure.touching(touch)
            if count <= self._room.size:
                return float(depth), int(which), int(count)
            self._room = _ContactRoom(2 * count)

    def _in_scene(self, count: int, origin: FloatArray) -> ContactPoints:
        """The contacts in the room with the vertices as the scene numbers them, in the world."""
        if self._colliders is None:
            return ContactPoints.none(1)
        vertices, colliders, places = self._room.arrays
        vertices, colliders, places = vertices[:count], colliders[:count], places[:count]
        order = self._assembly.order
        return ContactPoints(
            starts=np.array([0, len(vertices)]),
            points=(places[:, :3] + origin).astype(np.float32),
            normals=places[:, 3:6].astype(np.float32),
            depths=places[:, 6].astype(np.float32),
            colliders=colliders.astype(np.int32),
            vertices=(vertices if order is None else order[vertices]).astype(np.int32),
        )


class _ContactRoom:
    """Room for contacts: vertices (n,), colliders (n,), and points, normals and depths (n, 7)."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.arrays = (np.zeros(size, np.int64), np.zeros(size, np.int64), np.zeros((size, 7)))
