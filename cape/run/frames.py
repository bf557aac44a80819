"""The frames of a run, as they are stepped and kept."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cape.measure.contact_points import ContactPoints
from cape.measure.meter import Reading
from cape.reach import Reach
from cape.results.kept import Kept
from cape.results.kept_contacts import KeptContacts
from cape.results.take import StepError, Take
from cape.results.topology import Topology, all_vertices, most_split, padded, since, with_room
from cape.run.auto import AutoSimulation
from cape.run.simulation import Simulation
from cape.run.step_error import ScheduledWatch, schedule
from cape.scene.poses import poses_of, read_pose
from cape.scene.scene import Scene
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

NO_CONTACTS = ContactPoints.none(1)


@dataclass(frozen=True)
class Times:
    """What a run spent before its first frame [s]: compiling or loading code, and settling the cloth."""

    compile_s: float
    settle_s: float


class Frames:
    """Steps a simulation along a track, and keeps what each frame leaves.

    Attributes:
        count: of the frames that are whole.
    """

    def __init__(self, simulation: Simulation, scene: Scene, track: BoneTrack, *, check_steps: bool) -> None:
        """Keep the first frame, where the simulation is; `scene` has all colliders, also those left out."""
        self._simulation, self._scene, self._track = simulation, scene, track
        self._poses, self._all_poses = poses_of(track, simulation.bones), poses_of(track, scene.bones)
        self._steps = np.diff(track.times)
        self._meter = simulation.meter(scene)
        self._positions = Kept((scene.cloth.vertices, 3), np.float32)
        self._contacts = KeptContacts()
        self._readings: list[Reading] = []  # without contacts
        self._jumps: list[int] = []
        self._renewed: list[int] = []
        self._counted = simulation.jumps, simulation.renewed
        self._topologies: list[Topology] = [simulation.topology]
        self._tears = simulation.tears
        self._mass = simulation.mass
        self._solve_s = 0.0
        self._checks = ScheduledWatch(simulation, schedule(scene, track.times)) if check_steps else None
        self._keep(0)

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self._readings)

    @property
    def positions(self) -> NDArray[np.float32]:
        """Of the vertices in the world at each of them [m], shape (F, V, 3)."""
        return self._positions.array()[: self.count]

    @property
    def deepest(self) -> float:
        """How deep a vertex is in a collider in any of them at most [m]."""
        return max(reading.penetration for reading in self._readings)

    @property
    def solve_s(self) -> float:
        """Time spent on their steps [s]."""
        return self._solve_s

    def step(self, frame: int) -> None:
        """Step to a frame of the track, which is the next.

        Raises:
            Diverged: the cloth explodes; the frames before are kept.
        """
        pose, dt = self._poses[frame], float(self._steps[frame - 1])
        begun = time.perf_counter()
        self._simulation.step(pose, dt)
        self._solve_s += time.perf_counter() - begun
        if self._checks is not None:
            self._checks.note(pose, dt)
        jumps, renewed = self._simulation.jumps, self._simulation.renewed
        if jumps > self._counted[0]:
            self._jumps.append(frame)
        if renewed > self._counted[1]:
            self._renewed.append(frame)
        self._counted = jumps, renewed
        self._keep(frame)

    def run(self, progress: Callable[[int], None]) -> None:
        """Step through all frames of the track, telling after each how many there are.

        Raises:
            Diverged: the cloth explodes; the frames before are kept.
        """
        for frame in range(self.count, self._track.frames):
            self.step(frame)
            progress(frame + 1)

    def go_back(self, frame: int) -> None:
        """Keep no frame after one."""
        self._positions.cut(frame + 1)
        self._contacts.cut(frame + 1)
        del self._readings[frame + 1 :]
        for jumps in (self._jumps, self._renewed):
            jumps[:] = [k for k in jumps if k <= frame]
        self._counted = self._simulation.jumps, self._simulation.renewed

    def pass_over(self, other: "Frames", shares: FloatArray) -> None:
        """Pass over to a share of the same frames of another run, shape (F,), and measure all of them anew.

        Kinetic energies are mixed by the same shares.
        """
        simulation, bones = self._simulation, self._scene.bones
        self._meter, dtype = simulation.meter(self._scene), simulation.solver.dtype(simulation.assembly)
        energies = [np.array([r.kinetic_energy for r in run._readings]) for run in (self, other)]
        mixed = energies[0] + shares * (energies[1] - energies[0])
        mixed_positions = mix(self.positions, other.positions, shares)
        self._positions, self._contacts, self._readings = Kept(self._positions.shape, np.float32), KeptContacts(), []
        for places, pose, energy in zip(mixed_positions, self._all_poses, mixed.tolist(), strict=True):
            reading = self._meter.read_still(places.astype(float), read_pose(pose, bones), dtype)
            self._note(places, replace(reading, kinetic_energy=energy))

    def take(self, name: str, times: Times, reach: Reach | None, first: int = 0) -> Take:
        """All frames so far, or those from one of them on; `reach` tells what was left out."""
        simulation, scene, frames = self._simulation, self._scene, self.count
        readings, topologies = self._readings[first:frames], since(self._topologies, first)
        split = most_split(self._topologies)
        return Take(
            name=name,
            bones=self._track.part(first, frames),
            colliders=tuple(scene.colliders),
            triangles=topologies[0].triangles,
            texcoords=scene.cloth.texcoords[split.parents],
            positions=all_vertices(self.positions[first:], topologies),
            stretch_max=np.array([r.stretch for r in readings]),
            stretch_p99=self._meter.stretch_quantile(0.99),
            penetration=np.array([r.penetration for r in readings]),
            penetrated=np.array([r.collider for r in readings]),
            kinetic_energy=np.array([r.kinetic_energy for r in readings]),
            solver=simulation.solver.name,
            substeps=simulation.substeps,
            compile_s=times.compile_s,
            settle_s=times.settle_s,
            solve_s=self._solve_s,
            thickness=scene.thickness,
            held=np.flatnonzero(simulation.assembly.outwards(simulation.assembly.inverse_mass) == 0.0),
            left_out={**scene.left_out, **({} if reach is None else reach.left_out)},
            contacts=self._contacts.all(frames, first),
            jumps=tuple(frame - first for frame in self._jumps if first <= frame < frames),
            renewed=tuple(frame - first for frame in self._renewed if first <= frame < frames),
            step_errors=self.step_errors,
            cloth=scene.cloth,
            topologies=topologies,
            tears=simulation.tears,
            mass=(self._mass, simulation.mass),
        )

    @property
    def step_errors(self) -> tuple[StepError, ...]:
        """What the time step has cost in accuracy, where that was measured."""
        if self._checks is not None:
            return tuple(self._checks.errors)
        return tuple(self._simulation.errors) if isinstance(self._simulation, AutoSimulation) else ()

    def _keep(self, frame: int) -> None:
        reading = self._simulation.read(self._meter, self._all_poses[frame])
        self._note(self._simulation.positions.astype(np.float32), reading)
        if self._simulation.tears != self._tears:
            self._tears = self._simulation.tears
            self._topologies.append(replace(self._simulation.topology, frame=frame))

    def _note(self, places: NDArray[np.float32], reading: Reading) -> None:
        if len(places) > self._positions.shape[0]:
            self._positions = with_room(self._positions, self._simulation.assembly.cloth.vertices)
        self._positions.add(padded(places, self._positions.shape[0])[None])
        self._contacts.add(reading.contacts)
        self._readings.append(replace(reading, contacts=NO_CONTACTS))


def mix(first: NDArray[np.float32], second: NDArray[np.float32], shares: FloatArray) -> Iterator[NDArray[np.float32]]:
    """Positions between those of two runs [m], (F, V, 3) each: a share of the second's, shape (F,); (V, 3) a frame."""
    for a, b, share in zip(first, second, shares, strict=True):
        yield a if share == 0.0 else b if share == 1.0 else (a + share * (b - a)).astype(np.float32)
