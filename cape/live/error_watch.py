"""What the time step of a live run costs: now and then, a tenth of a second is taken once more beside it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.live.builder import Builder
from cape.live.rig import Rig
from cape.run.simulation import Simulation
from cape.run.whereabouts import Snapshot
from cape.scene.poses import Pose
from cape.scene.scene import Scene
from cape.solvers import Solver

FloatArray = NDArray[np.float64]

FRAMES = 6  # a tenth of a second at 60 frames a second
EVERY = 300  # frames
NAME = "error estimate"


class _Part(NamedTuple):
    """A stretch of the run: where it began, the poses of its frames, how long each is [s], and in how many steps."""

    begin: Snapshot
    poses: list[Pose]
    dt: float
    solver: Solver
    substeps: int
    threads: int | None


class ErrorWatch:
    """Estimates the error of the time step from the same stretch in as many steps and in twice as many.

    Where a method is of first order, as many steps are twice as far off as the two are from each other (L. F.
    Richardson, "The approximate arithmetical solution by finite differences", Phil. Trans. A 210 (1911)).

    There is none while a hand holds the cloth, or once it has torn.

    Attributes:
        rms: root mean square over the vertices, after a tenth of a second [m]; not a number where it is not known.
    """

    def __init__(self, rig: Rig, builder: Builder) -> None:
        """Watch a rig; what takes time is done by the builder."""
        self._rig, self._builder = rig, builder
        self._begin: Snapshot | None = None
        self._simulation: Simulation | None = None
        self._poses: list[Pose] = []
        self._frame, self._twin = 0, _Twin()
        self.rms = float("nan")

    def note(self, dt: float) -> None:
        """Take a frame of `dt` [s] that has been stepped."""
        simulation = self._rig.simulation
        self._frame += 1
        if simulation is not self._simulation or simulation.tears or self._rig.in_hand:
            self._simulation, self._begin, self.rms = simulation, None, float("nan")
            return
        if self._begin is not None:
            self._poses.append(self._rig.pose_for(self._rig.scene))
            if len(self._poses) == FRAMES:
                part = _Part(self._begin, self._poses, dt, simulation.solver, simulation.substeps, simulation.threads)
                self._begin = None
                self._builder.ask(NAME, lambda: self._twin.error(part), self._take)
        elif self._frame % EVERY == 0 and not self._builder.making:
            self._begin, self._poses = simulation.snapshot(), []

    def _take(self, rms: float) -> None:
        self.rms = rms


class _Twin:
    """A simulation of the same scene, kept for as long as that stays."""

    def __init__(self) -> None:
        self._scene: Scene | None = None
        self._simulation: Simulation | None = None

    def error(self, part: _Part) -> float:
        """The estimate for a stretch [m]."""
        if self._simulation is None or part.begin.scene is not self._scene:
            self._scene = part.begin.scene
            self._simulation = Simulation(self._scene, solver=part.solver, threads=part.threads)
        ends = [self._end(self._simulation, part, factor) for factor in (1, 2)]
        return 2.0 * float(np.sqrt(np.mean(np.sum((ends[1] - ends[0]) ** 2, axis=1))))

    def _end(self, twin: Simulation, part: _Part, factor: int) -> FloatArray:
        twin.start_from(part.begin)
        twin.change_solver(part.solver.in_steps(factor * part.substeps, part.dt))
        for pose in part.poses:
            twin.step(pose, part.dt)
        return twin.positions.copy()
