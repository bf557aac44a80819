"""Whether the errors that are told of time steps are the true ones.

    python -m tests.bench.accuracy.stated_errors [--kind touched] [--scene worn] [--solver xpbd] [--seed 1] [--json F]

A run tells its error by `cape.run.step_error`, part by part. The true one is the distance, at the end of the same
parts, from where they lead from the same states: in smooth scenes by scipy's DOP853 with force code of its own
(`tests.support.exact`); in touched ones by the same solver in 8, 16, 32, 64 times as many steps, the finer of the two
that are closest to each other, whose distance is the uncertainty. Usually those are the last two; but implicit solvers
fail to solve their equations in contact in some 128 steps a frame and more. Runs whose true error is not three times as
large as its uncertainty are shown, and left out of the count. Scenes are those of `tests.support.error_scenes`; a seed
is a set of them.
"""

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cape.run.simulation import Simulation
from cape.run.step_error import ScheduledWatch, distance, schedule
from cape.run.whereabouts import Snapshot
from cape.scene.poses import poses_of
from cape.scene.standard_scenes import StandardScene
from cape.solvers import SOLVERS, TRBDF2, XPBD, BackwardEuler, Solver, SymplecticEuler
from tests.support.error_scenes import SMOOTH, TOUCHED
from tests.support.exact import ExactModel

SETTINGS: tuple[Solver, ...] = (
    SymplecticEuler(), XPBD(substeps=20), XPBD(substeps=80),
    BackwardEuler(substeps=4), BackwardEuler(substeps=16), TRBDF2(substeps=4), TRBDF2(substeps=16),
)  # fmt: skip
SECONDS = {"smooth": 3.0, "touched": 2.0}
RUN, PART = (0.8, 2.0), (0.3, 4.0)  # times the true error, that a told one should be
TRUTH = (8, 16, 32, 64)  # times as many steps
SURE = 1.0 / 3.0  # of the true error, that its uncertainty may be


@dataclass(frozen=True)
class Row:
    """A run: its true error [mm] and how sure that is [mm], the one told, and what the quotient is, also by part.

    `inside` is the share of the parts whose quotient lies within `PART`, `work` how many times the run's own steps
    were taken to find what is told.
    """

    scene: str
    solver: str
    substeps: int
    parts: int
    true_mm: float
    unsure_mm: float
    told_mm: float
    told_over_true: float
    inside: float
    seconds: float


class Truth:
    """Where parts of a scene's motion truly lead from a run's states."""

    def __init__(self, given: StandardScene, run: Simulation) -> None:
        self._given, self._run = given, run
        self._poses = poses_of(given.track, given.scene.bones)
        self._steps = np.diff(given.track.times)
        self._model = ExactModel(run.assembly) if given.smooth else None
        self._twin = Simulation(given.scene, solver=run.solver, cuts=None)
        self._twin.start_from(run.snapshot())

    def of(self, start: Snapshot, frames: range, substeps: int) -> tuple[NDArray[np.float64], float]:
        """Positions [m] (V, 3) after frames that a run took in so many steps, and how sure they are [m]."""
        if self._model is not None:
            assembly, place = self._run.assembly, start.place
            x, v = place.state[:, :3] + place.origin, place.state[:, 3:]
            rod = [self._poses[frame].positions[0] for frame in (frames[0] - 1, *frames)]
            moved = self._model.motion(assembly.inwards(x), assembly.inwards(v), rod, float(self._steps[0]))
            return assembly.outwards(moved[-1]), 0.0
        ends = [self._again(start, frames, times * substeps) for times in TRUTH]
        apart = [distance(first, second) for first, second in pairwise(ends)]
        surest = int(np.argmin(apart))
        return ends[surest + 1], apart[surest]

    def _again(self, start: Snapshot, frames: range, substeps: int) -> NDArray[np.float64]:
        self._twin.change_solver(self._run.solver.in_steps(substeps, float(self._steps[0])))
        self._twin.start_from(start)
        for frame in frames:
            self._twin.step(self._poses[frame], float(self._steps[frame - 1]))
        return self._twin.positions


def measure(given: StandardScene, start: Snapshot, solver: Solver) -> Row:
    """Run a scene from a state, and compare the errors told with the true ones."""
    poses, steps = poses_of(given.track, given.scene.bones), np.diff(given.track.times)
    run = Simulation(given.scene, solver=solver, cuts=None)
    run.start_from(start)
    planned = schedule(given.scene, given.track.times)
    length = round(planned.seconds / float(steps[0]))
    watch, begun, snapshots, ends = ScheduledWatch(run, planned), time.perf_counter(), {0: run.snapshot()}, {}
    for frame in range(1, given.track.frames):
        run.step(poses[frame], float(steps[frame - 1]))
        watch.note(poses[frame], float(steps[frame - 1]))
        if frame in planned.starts:
            snapshots[frame] = run.snapshot()
        if frame - length in planned.starts:
            ends[frame - length] = run.positions
    seconds, truth, true, unsure = time.perf_counter() - begun, Truth(given, run), [], []
    for frame in planned.starts:
        place, doubt = truth.of(snapshots[frame], range(frame + 1, frame + length + 1), run.substeps)
        true.append(distance(place, ends[frame]))
        unsure.append(doubt)
    told = np.array([error.rms for error in watch.errors])
    ratios = told / np.array(true)
    return Row(
        scene=given.name,
        solver=solver.name,
        substeps=run.substeps,
        parts=len(true),
        true_mm=1e3 * _rms(true),
        unsure_mm=1e3 * _rms(unsure),
        told_mm=1e3 * _rms(told),
        told_over_true=_rms(told) / _rms(true),
        inside=float(np.mean((ratios > PART[0]) & (ratios < PART[1]))),
        seconds=seconds,
    )


def _rms(values: list[float] | NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def rows(arguments: argparse.Namespace) -> Iterator[Row]:
    """All runs that were asked for."""
    for kind in arguments.kind:
        for name, build in {"smooth": SMOOTH, "touched": TOUCHED}[kind].items():
            if arguments.scene and name not in arguments.scene:
                continue
            given = build(arguments.seed, SECONDS[kind])
            first = Simulation(given.scene)
            first.start(poses_of(given.track, given.scene.bones)[0])
            for solver in SETTINGS:
                if not arguments.solver or solver.name in arguments.solver:
                    yield measure(given, first.snapshot(), solver)


def main() -> None:
    """Measure what is asked for, and say how many runs and parts are told well."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--kind", nargs="+", choices=SECONDS, default=list(SECONDS))
    parser.add_argument("--scene", nargs="+", choices=[*SMOOTH, *TOUCHED], default=[])
    parser.add_argument("--solver", nargs="+", choices=SOLVERS, default=[])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="file to write all figures to")
    arguments = parser.parse_args()
    found = []
    for row in rows(arguments):
        if not found:
            print(
                "scene     solver          steps parts   true mm  unsure mm   told mm  told/true  parts inside      s"
            )
        found.append(row)
        print(
            f"{row.scene:9} {row.solver:15} {row.substeps:5} {row.parts:5} {row.true_mm:9.4f} {row.unsure_mm:10.4f} "
            f"{row.told_mm:9.4f} {row.told_over_true:10.2f} {row.inside:13.0%} {row.seconds:6.1f}", flush=True,
        )  # fmt: skip
    sure = [row for row in found if row.unsure_mm <= SURE * row.true_mm]
    ratios, parts = np.array([row.told_over_true for row in sure]), np.array([row.parts for row in sure])
    inside = np.array([row.inside for row in sure])
    well = (ratios >= RUN[0]) & (ratios <= RUN[1])
    print(
        f"{well.sum()} of {len(sure)} runs are told within {RUN[0]} to {RUN[1]} times the true error "
        f"({ratios.min():.2f} to {ratios.max():.2f}), {inside @ parts / parts.sum():.1%} of all parts within "
        f"{PART[0]} to {PART[1]} times; {(inside >= 0.9).sum()} runs have nine in ten so; "
        f"{len(found) - len(sure)} runs have no true error that is sure enough"
    )
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(row) for row in found], indent=1) + "\n")


if __name__ == "__main__":
    main()
