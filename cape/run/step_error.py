"""What the time step costs a run in accuracy, measured while it runs.

A part of the motion is taken a second time, from the run's own state at its start, with another number of steps. As a
solver's error falls like n^-p with the number n of its steps, the distance d of both ends from each other tells the
error that the run has gathered in that part (Richardson extrapolation: Hairer, Norsett, Wanner, Solving Ordinary
Differential Equations I, section II.4), with m steps in the second time:

    e = d / |1 - (n / m)^p|

Contact, wind and buckling magnify any error, however short the step; so parts are short (`window_of`).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cape.results.take import StepError
from cape.run.simulation import Diverged, Simulation, Snapshot
from cape.scene.poses import Bones, Pose, read_pose
from cape.scene.scene import Scene
from cape.solvers import Solver, SymplecticEuler
from motions.errors import ValueRangeError

FREE_WINDOW = 1.0  # s: errors of cloth that only swings need so long to show
TOUCHED_WINDOW = 0.1  # s, of cloth that touches something or flutters: later, chaos tells more than the step


def window_of(scene: Scene) -> float:
    """How long a part of a scene's motion is [s]."""
    touched = scene.colliders or scene.wind is not None or scene.self_contact is not None
    return TOUCHED_WINDOW if touched else FREE_WINDOW


class Watch:
    """Takes parts of a run a second time; `begin` a part, `note` each frame of it, `end` it once it is `full`.

    Attributes:
        errors: of the parts that have ended.
    """

    def __init__(self, run: Simulation) -> None:
        """Watch a run that has been started."""
        self.errors: list[StepError] = []
        self._run, self._window = run, 0.0
        self._twin = Simulation(run.scene, solver=run.solver, threads=run.threads, cuts=None)
        self._twin.start_from(run.snapshot())
        self._start: Snapshot | None = None
        self._frames: list[tuple[Pose, float]] = []
        self._time = self._span = 0.0
        self._jumps = 0

    @property
    def watching(self) -> bool:
        """Whether a part has begun."""
        return self._start is not None

    @property
    def full(self) -> bool:
        """Whether the part that has begun is long enough."""
        return self.watching and self._span > self._window - 1e-9

    def begin(self, seconds: float | None = None) -> None:
        """Begin a part of the motion where the run is, of that length [s], or as long as the scene needs."""
        self._window = seconds or window_of(self._run.scene)
        self._start, self._frames, self._span, self._jumps = self._run.snapshot(), [], 0.0, self._run.jumps

    def note(self, bones: Bones, dt: float) -> None:
        """Note a frame of `dt` [s] that the run has taken, to a pose."""
        self._time += dt
        if self.watching:
            self._frames.append((read_pose(bones, self._run.bones).without_world(), dt))
            self._span += dt
        if self._run.jumps != self._jumps:
            self._start = None

    def end(self) -> StepError:
        """End a part: take it a second time, and tell the error.

        Raises:
            ValueRangeError: none has begun, or the bones have jumped within it.
        """
        if self._start is None:
            raise ValueRangeError("no part of the motion has begun, or its bones have jumped")
        substeps = max(self._run.substeps, 1)
        solver = other_steps(self._run.solver, substeps)
        rms = np.inf
        self._twin.change_solver(solver)
        self._twin.start_from(self._start)
        try:
            for bones, dt in self._frames:
                self._twin.step(bones, dt)
            apart = _distance(self._twin.positions, self._run.positions)
            rms = apart / abs(1.0 - (substeps / (solver.substeps or 1)) ** solver.order)
        except Diverged:
            pass
        self._start = None
        self.errors.append(StepError(self._time, rms, self._run.solver.name, substeps))
        return self.errors[-1]


def other_steps(solver: Solver, substeps: int) -> Solver:
    """The solver with half as many steps in a frame as it took, twice as many where half would be none or explode."""
    twice = isinstance(solver, SymplecticEuler) or substeps == 1
    return replace(solver, substeps=2 * substeps if twice else substeps // 2)


def _distance(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.sum((first - second) ** 2, axis=1))))
