"""How errors in contact differ from part to part, and from what half as many steps tell of them.

    python -m tests.bench.accuracy.parts [--scene pushed plain] [--seed 11] [--seconds 3]

`cape.run.auto` goes by both (`prediction`, `choice`). A line for each scene of `tests.support.error_scenes` and number
of steps, of Euler: standard deviations of how logarithms of true errors change from part to part, as they are and in
units of the parts' jolts; and by which factor true errors exceed those told, in half of the parts and in one of twenty.
"""

import argparse
from collections.abc import Sequence

import numpy as np

from cape.run.auto.ahead import Coming
from cape.run.auto.part import Part
from cape.run.simulation import Simulation
from cape.run.step_error import Schedule, ScheduledWatch, distance, window_of
from cape.run.whereabouts import Mark
from cape.scene.poses import Pose, poses_of
from cape.scene.standard_scenes import StandardScene
from cape.solvers import SymplecticEuler
from tests.support.error_scenes import TOUCHED

TIMES = 2, 4, 8  # as many steps as stability needs


def end_of(twin: Simulation, start: Mark, poses: Sequence[Pose], dt: float) -> np.ndarray:
    """Where a part ends [m] (V, 3) that begins where a run was."""
    twin.go_back(start)
    for pose in poses:
        twin.step(pose, dt)
    return twin.positions


def measure(given: StandardScene, times: int) -> str:
    """What the parts of a run tell, in words."""
    poses, dt = poses_of(given.track, given.scene.bones), float(np.diff(given.track.times)[0])
    first = Simulation(given.scene)
    first.start(poses[0])
    stable, frames = first.forecast(dt).substeps, round(window_of(given.scene) / dt)
    run, twin = (Simulation(given.scene, solver=SymplecticEuler(substeps=n * stable)) for n in (times, times // 2))
    for simulation in (run, twin):
        simulation.start_from(first.snapshot())
    starts = range(1, len(poses) - frames + 1, frames)
    watch = ScheduledWatch(run, Schedule(window_of(given.scene), tuple(start - 1 for start in starts)))
    told, jolts = [], []
    for start in starts:
        part = Part(run.mark())
        for pose in poses[start : start + frames]:
            run.step(pose, dt)
            watch.note(pose, dt)
            part.note(Coming(pose, dt), run.substeps, list(run.assembly.inwards(run.velocities).T))
        jolts.append(part.jolt)
        told.append(distance(run.positions, end_of(twin, part.start, poses[start : start + frames], dt)))
    true = np.array([error.rms for error in watch.errors])
    own, shaken = (float(np.std(np.diff(np.log(each)))) for each in (true, true / np.array(jolts)))
    half, many = np.quantile(true / np.array(told), [0.5, 0.95])
    return (
        f"{times * stable:5} steps, {len(true)} parts: change by {own:.2f}, in units of jolts {shaken:.2f}; "
        f"true over told {half:.2f}, one in twenty above {many:.2f}"
    )


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--scene", nargs="+", choices=TOUCHED, default=list(TOUCHED))
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--seconds", type=float, default=3.0)
    arguments = parser.parse_args()
    for name in arguments.scene:
        for times in TIMES:
            print(f"{name:8} {measure(TOUCHED[name](arguments.seed, arguments.seconds), times)}", flush=True)


if __name__ == "__main__":
    main()
