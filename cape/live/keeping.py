"""What a live run leaves: all of its frames, on the disk from early on, to be made into a take."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cape.live.rig import Rig
from cape.live.sources import dressed_in
from cape.measure.meter import Meter, Reading
from cape.results.kept import Kept
from cape.results.kept_contacts import KeptContacts
from cape.results.take import Take
from cape.results.topology import Topology, all_vertices, most_split, padded, with_room
from cape.run.simulation import Simulation
from motions.skin import Skin
from skeleton.track import BoneTrack, worn_by

FloatArray = NDArray[np.float64]

IN_MEMORY = 2**20  # bytes of each array
READINGS = 5  # numbers of a frame: time, stretch, penetration, collider, kinetic energy


class Keeper:
    """Keeps frames as a rig steps.

    Attributes:
        solve_s: time that was spent on their steps [s].
    """

    def __init__(self, rig: Rig, name: str, *, skin: Skin | None = None) -> None:
        """Keep nothing yet, of a rig that has been started, whose bones may move a skin."""
        self._rig, self._name, self._skin = rig, name, skin
        self.solve_s = 0.0
        source = rig.hands.source
        bones = len(source.names)
        self._dressed = dressed_in(source, skin)
        self._positions = Kept((rig.scene.cloth.vertices, 3), np.float32, in_memory=IN_MEMORY)
        self._poses = Kept((bones, 7), np.float64, in_memory=IN_MEMORY)
        self._readings = Kept((READINGS,), np.float64, in_memory=IN_MEMORY)
        self._morphs: Kept | None = None
        if self._dressed is not None and len(self._dressed.morphs):
            self._morphs = Kept((len(self._dressed.morphs),), np.float64, in_memory=IN_MEMORY)
        self._contacts = KeptContacts(in_memory=IN_MEMORY)
        self._topologies: list[Topology] = []
        self._tears, self._most_tears = -1, 0
        self._simulation: Simulation | None = None
        self._meter: Meter | None = None
        self._mass = rig.simulation.mass
        self.keep()

    @property
    def frames(self) -> int:
        """How many there are."""
        return len(self._readings)

    @property
    def size(self) -> int:
        """What they take as a recording, roughly [bytes]."""
        return 2 * self._positions.size + 2 * self._poses.size + self._contacts.size

    def keep(self) -> None:
        """Keep the frame that the rig is at."""
        simulation = self._rig.simulation
        if self._meter is None or simulation is not self._simulation:
            self._simulation, self._meter = simulation, simulation.meter(self._rig.scene)
            self._tears = -1
        if simulation.tears != self._tears:
            self._tears = simulation.tears
            self._most_tears = max(self._most_tears, self._tears)
            topology = simulation.topology
            if not self._topologies or not topology.is_as(self._topologies[-1]):
                self._topologies.append(replace(topology, frame=self.frames))
        reading: Reading = simulation.read(self._meter)
        places = simulation.positions.astype(np.float32)
        if len(places) > self._positions.shape[0]:
            self._positions = with_room(self._positions, len(places) + len(places) // 8)
        pose = self._rig.bones
        self._positions.add(padded(places, self._positions.shape[0])[None])
        self._poses.add(np.concatenate([pose.positions, pose.rotations_wxyz], axis=1)[None])
        if self._dressed is not None and self._morphs is not None:
            self._morphs.add(self._dressed.morphs[None])
        self._contacts.add(reading.contacts)
        row = self._rig.time, reading.stretch, reading.penetration, reading.collider, reading.kinetic_energy
        self._readings.add(np.array([row]))

    def take(self, frames: int | None = None, *, result: str = "finished", warnings: Sequence[str] = ()) -> Take:
        """The first so many frames, or all, as a take."""
        count = self.frames if frames is None else min(frames, self.frames)
        readings, poses = self._readings.array()[:count], self._poses.array()[:count]
        source, scene = self._rig.hands.source, self._rig.scene
        parents = None if source.parents is None else np.array(source.parents)
        worn = worn_by(source.names, self._skin, None if self._morphs is None else self._morphs.array()[:count])
        topologies = [t for t in self._topologies if t.frame < count]
        split = most_split(topologies)
        return Take(
            name=self._name,
            bones=BoneTrack(
                source.names, readings[:, 0], poses[:, :, :3], poses[:, :, 3:], parents, source.roles, **worn
            ),
            colliders=tuple(scene.colliders),
            triangles=topologies[0].triangles,
            texcoords=scene.cloth.texcoords[split.parents],
            positions=all_vertices(self._positions.array()[:count], topologies),
            stretch_max=readings[:, 1],
            stretch_p99=0.0 if self._meter is None else self._meter.stretch_quantile(0.99),
            penetration=readings[:, 2],
            penetrated=readings[:, 3].astype(np.int64),
            kinetic_energy=readings[:, 4],
            solver=self._rig.simulation.solver.name,
            substeps=self._rig.simulation.substeps,
            compile_s=0.0,
            settle_s=0.0,
            solve_s=self.solve_s,
            thickness=scene.thickness,
            held=np.zeros(0, np.int64),
            contacts=self._contacts.all(count),
            cloth=scene.cloth,
            topologies=tuple(topologies),
            tears=self._most_tears,
            mass=(self._mass, self._rig.simulation.mass),
            result=result,
            warnings=tuple(warnings),
        )
