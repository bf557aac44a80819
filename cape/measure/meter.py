"""Measures of a running cloth: strain, penetration, contacts, kinetic energy."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.assembly.assemble import Assembly
from cape.assembly.contact import colliders_of, link_distances
from cape.kernels.bones import MotionRoom
from cape.kernels.calling import Bound
from cape.kernels.cloth import measure
from cape.kernels.linking import Linker
from cape.kernels.state import State
from cape.kernels.store import Request
from cape.measure.contact_points import ContactPoints
from cape.measure.energy import kinetic_energy_of
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
        self._measure_springs()
        self._meet_colliders()
        bones = len(self.scene.bones) + 1
        self._bones = MotionRoom.blank(bones)
        self._pose = Pose(np.zeros((bones, 3)), np.zeros((bones, 4)))
        self._room = _ContactRoom(ROOM)

    def _measure_springs(self) -> None:
        springs = self._assembly.springs
        chosen = springs.measured
        self._first, self._second, self._rest = springs.first[chosen], springs.second[chosen], springs.rest[chosen]
        self._calls: _Calls | None = None

    def follow(self, assembly: Assembly) -> None:
        """Go on with the cloth as it has torn, which may have other springs and more vertices."""
        if assembly.springs is self._assembly.springs:
            return
        grown = assembly.cloth.vertices > self._assembly.cloth.vertices
        self._assembly = assembly
        self._measure_springs()
        if grown:
            self._meet_colliders()

    def _meet_colliders(self) -> None:
        self._colliders = colliders_of(self.scene, self._assembly.cloth.vertices)
        self._linker = Linker()
        if self._colliders is not None:
            link_distances(self.scene, self._colliders, None, self._linker)

    def requests(self, state: State) -> list[Request]:
        """The code that reading such a state needs, to be compiled together with other code."""
        return [*self._linker.requests, *(call.request for call in self._calls_for(state)[1:] if call is not None)]

    def read(self, state: State, pose: Pose, *, origin: ArrayLike = (0.0, 0.0, 0.0)) -> Reading:
        """Measure a state.

        Args:
            state: the vertices as the assembly numbers them, about `origin`.
            pose: of the scene's bones, and of the world as the last one, about `origin`.
            origin: that positions refer to, in the world [m], shape (3,).
        """
        self._linker.link()
        for kept, given in zip(self._pose, pose, strict=True):
            kept[:] = given
        stretch = self._calls_for(state).strain()
        penetration, collider, count = self._touching(state)
        return Reading(
            stretch=float(stretch),
            penetration=penetration,
            collider=collider,
            contacts=self._in_scene(count, np.asarray(origin, dtype=float)),
            kinetic_energy=float(self._calls_for(state).kinetic_energy()),
        )

    def read_still(self, positions: FloatArray, pose: Pose, dtype: type[np.floating]) -> Reading:
        """Measure a cloth that stands still, in a precision.

        Args:
            positions: of the vertices as the scene numbers them, in the world [m], shape (V, 3).
            pose: of the scene's bones, and of the world as the last one, in the world.
            dtype: of the arrays in which it is measured.
        """
        origin = np.round(positions.mean(axis=0))
        state = State.at_rest(self._assembly.inwards(positions - origin), dtype)
        return self.read(state, pose.moved(-origin), origin=origin)

    def stretch_quantile(self, share: float) -> float:
        """Strain that a share of all strains read so far does not exceed, to a bin of the histogram (1e-4)."""
        counts = np.cumsum(self._histogram)
        if counts[-1] == 0:
            return 0.0
        return float((np.searchsorted(counts, share * counts[-1]) + 1) * measure.WIDEST / measure.BINS)

    def _touching(self, state: State) -> tuple[float, int, int]:
        """Deepest penetration [m], the collider, -1 for none, and how many contacts there are in the room.

        Makes the room larger should they not fit.
        """
        while (touching := self._calls_for(state).touching) is not None:
            depth, which, count = touching()
            if count <= self._room.size:
                return float(depth), int(which), int(count)
            self._room, self._calls = _ContactRoom(2 * count), None
        return 0.0, -1, 0

    def _calls_for(self, state: State) -> "_Calls":
        """What measures a state; the same as before for one whose arrays have stayed."""
        known = self._calls
        if known is None or known.state is not state:
            known = self._calls = _Calls(
                state,
                Bound(measure.strain, *state[:3], self._first, self._second, self._rest, self._histogram),
                kinetic_energy_of(self._assembly, state),
                None
                if self._colliders is None
                else Bound(
                    measure.touching,
                    measure.Touch(
                        state, self._assembly.loose, self._colliders, self._bones, *self._pose, *self._room.arrays
                    ),
                ),
            )
        return known

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


class _Calls(NamedTuple):
    """What measures a state; `touching` is None where there are no colliders."""

    state: State
    strain: Bound
    kinetic_energy: Bound
    touching: Bound | None


class _ContactRoom:
    """Room for contacts: vertices (n,), colliders (n,), and points, normals and depths (n, 7)."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.arrays = (np.zeros(size, np.int64), np.zeros(size, np.int64), np.zeros((size, 7)))
