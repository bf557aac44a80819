"""A run of a standard scene at one setting of a solver: where the vertices go, and how long it takes."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.measure.ledger import Balance, Ledger
from cape.report.measured.clock import Clock, quickest
from cape.run.auto import Auto, AutoSimulation
from cape.run.simulation import Simulation
from cape.run.whereabouts import Diverged, Snapshot
from cape.scene.poses import poses_of
from cape.scene.scene import Scene
from cape.scene.standard_scenes import StandardScene
from cape.solvers import SOLVERS

FloatArray = NDArray[np.float64]
Stopped = Callable[[float], bool]

WINDOW = 0.1  # s, length of the parts of a motion that are taken from the reference's own states,
WINDOWS = 10  # and how many there are
SHORTEST = 1.0  # s of motion, which the windows fill


@dataclass(frozen=True)
class Setting:
    """A solver and what is asked of it.

    Attributes:
        solver: its name, or "auto".
        substeps: steps in each frame, None to let the solver choose.
        options: other fields of the solver, or of `Auto`.
    """

    solver: str
    substeps: int | None = None
    options: tuple[tuple[str, Any], ...] = ()

    def simulation(self, scene: Scene, *, threads: int, ledger: Ledger | None = None) -> Simulation:
        """A simulation of a scene with the solver, or that chooses one."""
        options = dict(self.options)
        if self.solver == Auto.name:
            return AutoSimulation(scene, Auto(**options), threads=threads)
        solver = SOLVERS[self.solver](substeps=self.substeps, **options)
        return Simulation(scene, solver=solver, threads=threads, ledger=ledger)

    def __str__(self) -> str:
        """Such as "20 substeps, iterations 4" or "3 mm"; "default" where nothing is asked for."""
        if self.solver == Auto.name:
            return f"{1e3 * dict(self.options)['tolerance']:g} mm"
        steps = "default" if self.substeps is None else f"{self.substeps} substep" + "s" * (self.substeps > 1)
        return ", ".join([steps, *(f"{name} {value}" for name, value in self.options)])


EXACT = Setting("euler", options=(("precision", "double"),))
"""What a reference is made of."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Where a cloth went.

    Attributes:
        setting: what was asked for.
        substeps: steps in a frame, as the last one was begun.
        times: of the frames [s], shape (F,); fewer than the motion has if the run broke off.
        positions: of the vertices [m], shape (F, V, 3).
        stretch: largest strain of each frame, shape (F,).
        penetration: deepest penetration of each frame [m], shape (F,).
        kinetic_energy: [J], shape (F,).
        seconds: wall time of the steps per second of motion, of the quickest whole run [s].
        spent: CPU time of all repeats [s].
        retaken: frames that were taken again in shorter steps, or did not converge.
        cpu_seconds: CPU time of that run, as `seconds` [s].
        disturbed: whether something else had the processor in all runs (`clock.Timing`).
        snapshots: by frame, where each of the stage's windows begins.
        result: "finished", or why it broke off.
    """

    setting: Setting
    substeps: int
    times: FloatArray
    positions: FloatArray
    stretch: FloatArray
    penetration: FloatArray
    kinetic_energy: FloatArray
    seconds: float
    spent: float
    retaken: int
    cpu_seconds: float = np.nan
    disturbed: bool = False
    snapshots: dict[int, Snapshot] = field(default_factory=dict)
    result: str = "finished"


class Stage:
    """A standard scene, put on and settled once, from which every run of it sets out.

    Attributes:
        standard: the scene.
        threads: that share the cloth.
        times: of the frames [s], shape (F,).
        window: frames in a window, a part of the motion that is taken from a reference's own state.
        window_starts: the frames at which windows begin.
    """

    def __init__(
        self,
        standard: StandardScene,
        *,
        seconds: float | None = None,
        reference_s: float | None = None,
        threads: int = 1,
    ) -> None:
        """Settle the cloth; all runs begin there, so that it matters to none how well.

        Args:
            standard: the scene.
            seconds: of its motion at most [s].
            reference_s: wall time that a reference's first two runs may take [s], with `first_refinement` times the
                steps that are needed and twice as many; a motion that takes longer is cut, but not below `SHORTEST`.
            threads: that share the cloth in all runs.

        Raises:
            Diverged: the cloth explodes while it settles.
        """
        self.standard, self.threads = standard, threads
        first = self._simulation(Setting(EXACT.solver))
        track = standard.track
        if seconds is not None:
            track = track.first(int(np.sum(track.times <= track.times[0] + seconds + 1e-9)))
        self.times, self._poses = track.times, poses_of(track, first.bones)
        first.start(self._poses[0])
        self._start = first.snapshot()
        if reference_s is not None:
            first = self._simulation(EXACT)
            first.start_from(self._start)
            frame_s = 3 * self.first_refinement * first.forecast(self._step(1)).seconds
            span = max(SHORTEST, reference_s / frame_s * self._step(1))
            kept = int(np.sum(self.times <= self.times[0] + span + 1e-9))
            self.times, self._poses = self.times[:kept], self._poses[:kept]
        self.window = max(1, round(WINDOW / self._step(1)))
        starts = np.linspace(0, self.frames - 1 - self.window, WINDOWS + 1)[1:] if self.frames > self.window else []
        self.window_starts = tuple(dict.fromkeys(int(frame) for frame in starts))

    @property
    def frames(self) -> int:
        """Frames of the motion."""
        return len(self._poses)

    @property
    def first_refinement(self) -> int:
        """How many times as many steps as are needed the first run of a reference takes.

        Smooth motion needs no more; where errors grow, the first halving should tell something.
        """
        return 1 if self.standard.smooth else 2

    @property
    def seconds(self) -> float:
        """Length of the motion [s]."""
        return float(self.times[-1] - self.times[0])

    def needed_substeps(self, solver: str) -> int:
        """Substeps in a frame that a solver chooses for the cloth as it sets out."""
        simulation = self._simulation(Setting(solver))
        simulation.start_from(self._start)
        return simulation.forecast(self._step(1)).substeps

    def run(self, setting: Setting, *, repeats: int = 1, enough: Stopped = lambda spent: False) -> Trajectory:
        """Take the motion at a setting.

        Args:
            setting: of the solver.
            repeats: times that the run is taken, all with the same result; again where it was disturbed.
            enough: told after each repeat how much CPU time all have taken [s]; True ends them.
        """
        simulation = self._simulation(setting)
        simulation.start_from(self._start)
        simulation.forecast(self._step(1))  # compiles
        snapshots: dict[int, Snapshot] = {}
        first, taken, result = self._once(simulation, snapshots)
        retaken = simulation.retried + simulation.refined + simulation.unconverged
        clocks = [first]

        def again() -> Clock:
            if clocks:
                return clocks.pop()
            simulation.start_from(self._start)
            return self._once(simulation)[0]

        timing = quickest(again, repeats=repeats, threads=self.threads, enough=enough)
        done = len(taken)
        span = float(self.times[done - 1] - self.times[0])
        return Trajectory(
            setting=setting,
            substeps=simulation.substeps,
            times=self.times[:done],
            positions=np.stack([where for where, _ in taken]),
            stretch=np.array([reading.stretch for _, reading in taken]),
            penetration=np.array([reading.penetration for _, reading in taken]),
            kinetic_energy=np.array([reading.kinetic_energy for _, reading in taken]),
            seconds=timing.wall / span if span > 0.0 else np.inf,
            spent=timing.spent,
            retaken=retaken,
            cpu_seconds=timing.cpu / span if span > 0.0 else np.inf,
            disturbed=timing.disturbed,
            snapshots=snapshots,
            result=result,
        )

    def account(self, setting: Setting) -> tuple[Balance, int, str]:
        """Take the motion at a setting, and give its energy accounts, substeps in a frame, and its result."""
        ledger = Ledger()
        simulation = self._simulation(setting, ledger)
        simulation.start_from(self._start)
        result = "finished"
        for frame in range(1, self.frames):
            try:
                simulation.step(self._poses[frame], self._step(frame))
            except Diverged as error:
                result = f"diverged at frame {frame}: {error}"
                break
        return ledger.balance, simulation.substeps, result

    def run_windows(self, setting: Setting, reference: Trajectory) -> FloatArray:
        """Take each window from the reference's state at its start, and give the positions at all ends, (W, V, 3).

        Not a number from the first window on that breaks off.
        """
        simulation = self._simulation(setting)
        ends = np.full((len(reference.snapshots), *reference.positions.shape[1:]), np.nan)
        for k, (start, snapshot) in enumerate(reference.snapshots.items()):
            simulation.start_from(snapshot)
            try:
                for frame in range(start + 1, start + self.window + 1):
                    simulation.step(self._poses[frame], self._step(frame))
            except Diverged:
                break
            ends[k] = simulation.positions
        return ends

    def _once(
        self, simulation: Simulation, snapshots: dict[int, Snapshot] | None = None
    ) -> tuple[Clock, list[Any], str]:
        """Take the motion; readings and snapshots are taken where these are asked for, apart from the clock."""
        clock = Clock()
        if isinstance(simulation, AutoSimulation):
            with clock.running():
                simulation.expect(self._poses[1:], np.diff(self.times))  # as `simulate` does
        meter = simulation.meter()
        readings = [(simulation.positions, simulation.read(meter))]
        for frame in range(1, self.frames):
            try:
                with clock.running():
                    simulation.step(self._poses[frame], self._step(frame))
            except Diverged as error:
                return clock, readings, f"diverged at frame {frame}: {error}"
            if snapshots is not None:
                readings.append((simulation.positions, simulation.read(meter)))
                if frame in self.window_starts:
                    snapshots[frame] = simulation.snapshot()
        return clock, readings, "finished"

    def _step(self, frame: int) -> float:
        return float(self.times[frame] - self.times[frame - 1])

    def _simulation(self, setting: Setting, ledger: Ledger | None = None) -> Simulation:
        return setting.simulation(self.standard.scene, threads=self.threads, ledger=ledger)
