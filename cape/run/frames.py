"""The frames of a run, as they are stepped and kept."""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cape.measure.contact_points import ContactPoints
from cape.reach import Reach
from cape.results.take import StepError, Take
from cape.run.auto import AutoSimulation
from cape.run.simulation import Simulation
from cape.run.step_error import ScheduledWatch, schedule
from cape.scene.poses import poses_of
from cape.scene.scene import Scene
from skeleton.track import BoneTrack


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
        """Keep the first frame, of a simulation that was started; `scene` has all colliders, also those left out."""
        self._simulation, self._scene, self._track = simulation, scene, track
        self._poses, self._all_poses = poses_of(track, simulation.bones), poses_of(track, scene.bones)
        self._steps = np.diff(track.times)
        self._meter = simulation.meter(scene)
        self._positions: list[NDArray[np.float32]] = []
        self._readings = []
        self._jumps: list[int] = []
        self._renewed: list[int] = []
        self._solve_s = 0.0
        self._checks = ScheduledWatch(simulation, schedule(scene, track.times)) if check_steps else None
        self._keep(0)

    @property
    def count(self) -> int:
        """How many there are."""
        return min(len(self._positions), len(self._readings))

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
        if self._simulation.jumps > len(self._jumps):
            self._jumps.append(frame)
        if self._simulation.renewed > len(self._renewed):
            self._renewed.append(frame)
        self._keep(frame)

    def take(self, name: str, times: Times, reach: Reach | None) -> Take:
        """All frames so far; `reach` tells what was left out."""
        simulation, scene, frames = self._simulation, self._scene, self.count
        readings = self._readings[:frames]
        return Take(
            name=name,
            bones=self._track.first(frames),
            colliders=tuple(scene.colliders),
            triangles=scene.cloth.triangles,
            texcoords=scene.cloth.texcoords,
            positions=np.stack(self._positions[:frames]),
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
            left_out={} if reach is None else reach.left_out,
            contacts=ContactPoints.joined([r.contacts for r in readings]),
            jumps=tuple(frame for frame in self._jumps if frame < frames),
            renewed=tuple(frame for frame in self._renewed if frame < frames),
            step_errors=self._errors,
        )

    @property
    def _errors(self) -> tuple[StepError, ...]:
        if self._checks is not None:
            return tuple(self._checks.errors)
        return tuple(self._simulation.errors) if isinstance(self._simulation, AutoSimulation) else ()

    def _keep(self, frame: int) -> None:
        self._readings.append(self._simulation.read(self._meter, self._all_poses[frame]))
        self._positions.append(self._simulation.positions.astype(np.float32))
