"""Whether `cape.Auto` keeps the error that was asked for, and what that takes, against fixed settings.

    python -m tests.bench.accuracy.tolerance [--scene soft stiff pushed] [--mm 10 1 0.1] [--seconds 10] [--seed 1]

Errors are true ones: in smooth scenes of the whole run, root mean square over vertices and frames, from a run of far
shorter steps, which is to be three times as sure as what was asked for; in touched ones of each tenth of a second, as
`cape.run.step_error` tells it in shorter steps, and shown are the worst part and the share of parts beyond 1.1 times
what was asked for. A fixed setting is as good that keeps the same; settings are a factor of 1.41 apart. Times are CPU
time of the steps: of the fastest that is as good, and of what was chosen, both run again in turn, the best of their
runs.
"""

import argparse
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cape.run.auto import Auto, AutoSimulation
from cape.run.simulation import Simulation
from cape.run.step_error import Schedule, ScheduledWatch, is_touched, window_of
from cape.run.whereabouts import Diverged, Snapshot
from cape.scene.poses import poses_of
from cape.scene.standard_scenes import StandardScene
from cape.solvers import TRBDF2, XPBD, Solver, SymplecticEuler
from tests.support.error_scenes import TOUCHED, gentle

KEPT = 1.1  # times what was asked for
SURE = 1.0 / 3.0  # of what was asked for, that a reference may be off by
SPREAD = math.sqrt(2.0)
STIFF = 500  # stable steps of Euler in a frame, from which on implicit ones are worth a try
STRETCH = {"soft": 2e3, "stiff": 1e5, "stiffer": 1e6}  # N/m, of the smooth scenes


@dataclass(frozen=True)
class Run:
    """A run: its solver and steps in words, CPU time of its steps [s], its error [mm], and the share of bad parts."""

    setting: str
    seconds: float
    error_mm: float
    errors_mm: NDArray[np.float64]
    make: Callable[[], Simulation]

    def beyond(self, mm: float) -> float:
        """Share of its parts that are off by more than is kept to."""
        return float(np.mean(self.errors_mm > KEPT * mm))


class Bench:
    """A scene, put on once, and what its runs are compared with."""

    def __init__(self, given: StandardScene, repeats: int) -> None:
        self.given, self.repeats = given, repeats
        self.poses, self.steps = poses_of(given.track, given.scene.bones), np.diff(given.track.times)
        self.touched = is_touched(given.scene)
        first = Simulation(given.scene)
        first.start(self.poses[0])
        self.start: Snapshot = first.snapshot()
        self.stable = first.forecast(float(self.steps[0])).substeps
        self.exact, self.unsure_mm = None, math.nan
        if not self.touched:
            coarse, self.exact = (self._reference(times) for times in (2, 4))
            self.unsure_mm = 1e3 * float(np.sqrt(np.mean(np.sum((self.exact - coarse) ** 2, axis=2))))

    def _reference(self, times: int) -> NDArray[np.float64]:
        """Positions of all frames but the first, (F, V, 3) [m]."""
        solver = SymplecticEuler(precision="double", substeps=times * self.stable)
        run = Simulation(self.given.scene, solver=solver)
        run.start_from(self.start)
        return self._positions(run)[0]

    def _positions(self, run: Simulation) -> tuple[NDArray[np.float64], float]:
        # One look at the clock: on a busy machine each takes as long as frames of a small cloth do.
        taken, begun = [], time.process_time()
        for pose, dt in zip(self.poses[1:], self.steps, strict=True):
            run.step(pose, float(dt))
            taken.append(run.positions)
        return np.array(taken), time.process_time() - begun

    def run(self, make: Callable[[], Simulation], words: str = "") -> Run:
        """Run what `make` gives, which is started; its error and time."""
        simulation = self._set_out(make)
        positions, spent = self._positions(simulation)
        words = words or f"{simulation.solver.name} {simulation.substeps}"
        if self.exact is not None:
            error = 1e3 * float(np.sqrt(np.mean(np.sum((positions - self.exact) ** 2, axis=2))))
            return Run(words, spent, error, np.array([error]), make)
        simulation = self._set_out(make)
        frames = round(window_of(self.given.scene) / float(self.steps[0]))
        starts = tuple(range(0, len(self.steps) - frames + 1, frames))
        watch = ScheduledWatch(simulation, Schedule(window_of(self.given.scene), starts))
        for pose, dt in zip(self.poses[1:], self.steps, strict=True):
            simulation.step(pose, float(dt))
            watch.note(pose, float(dt))
        errors = np.array([1e3 * error.rms for error in watch.errors])
        return Run(words, spent, float(errors.max()), errors, make)

    def seconds(self, *runs: Run) -> list[float]:
        """CPU time of the steps of runs [s], taken again in turn."""
        best = [run.seconds for run in runs]
        for _ in range(self.repeats):
            taken = [self._positions(self._set_out(run.make))[1] for run in runs]
            best = [min(pair) for pair in zip(best, taken, strict=True)]
        return best

    def _set_out(self, make: Callable[[], Simulation]) -> Simulation:
        simulation = make()
        simulation.start_from(self.start)
        simulation.forecast(float(self.steps[0]))
        if isinstance(simulation, AutoSimulation):
            simulation.expect(self.poses[1:], self.steps)
        return simulation

    def fixed(self) -> Iterator[Run]:
        """The settings to compare with."""
        solvers: list[Solver] = [TRBDF2(substeps=n) for n in (1, 2, 4, 8, 16) if self.stable > STIFF]
        solvers += [XPBD(substeps=round(8 * SPREAD**k)) for k in range(14)]
        usual = SymplecticEuler()
        solvers += [replace(usual, margin=usual.margin / SPREAD**k) for k in range(11 if self.touched else 5)]
        for solver in solvers:
            try:
                yield self.run(partial(Simulation, self.given.scene, solver=solver))
            except Diverged:
                continue


def scenes(arguments: argparse.Namespace) -> Iterator[StandardScene]:
    """Those that were asked for."""
    for name in arguments.scene:
        if name in STRETCH:
            yield gentle(name, arguments.seed, arguments.seconds, stretch=STRETCH[name], spacing=arguments.spacing)
        else:
            yield TOUCHED[name](arguments.seed, arguments.seconds)


def main() -> None:
    """Measure what is asked for, a line each."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--scene", nargs="+", choices=[*STRETCH, *TOUCHED], default=[*STRETCH, "pushed", "plain"])
    parser.add_argument("--mm", nargs="+", type=float, default=[10.0, 3.0, 1.0, 0.3, 0.1])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--spacing", type=float, default=0.05, help="of the smooth scenes [m]")
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    print("scene       asked  error mm  beyond  CPU s   chosen              fastest fixed             CPU s   times")
    for given in scenes(arguments):
        bench = Bench(given, arguments.repeats)
        print(f"{given.name}: {given.scene.cloth.vertices} vertices, reference within {bench.unsure_mm:.2g} mm")
        fixed = list(bench.fixed())
        for mm in arguments.mm:
            if bench.unsure_mm > SURE * mm:
                print(f"{given.name:10} {mm:6.1f}   the reference is not as sure")
                continue
            chosen = bench.run(partial(AutoSimulation, given.scene, Auto(tolerance=1e-3 * mm)))
            good = [run for run in fixed if run.error_mm <= mm]
            best = min(good, key=lambda run: run.seconds, default=None)
            own, beside = chosen.seconds, "none"
            if best is not None:
                own, other = bench.seconds(chosen, best)
                beside = f"{best.setting:25} {other:6.2f} {own / other:7.2f}"
            print(
                f"{given.name:10} {mm:6.1f} {chosen.error_mm:9.4f} {chosen.beyond(mm):7.1%} {own:6.2f}   "
                f"{chosen.setting:19} {beside}", flush=True,
            )  # fmt: skip


if __name__ == "__main__":
    main()
