"""What steps of the solvers cost beside each other, which `cape.Auto` chooses by (`cape.run.auto.choice`, `course`).

    python -m tests.bench.accuracy.costs [--spacing 0.025]

CPU times of whole runs of a hanging sheet, the best of a few in turn. Two numbers of steps tell what a step costs, and
what the rest of a frame does.
"""

import argparse
import math
import time

from cape.run.auto.choice import USUAL
from cape.run.simulation import Simulation
from cape.run.whereabouts import Snapshot
from cape.scene.poses import poses_of
from cape.scene.standard_scenes import StandardScene
from cape.solvers import TRBDF2, XPBD, Solver, SymplecticEuler
from tests.support.error_scenes import gentle

REPEATS = 5
FEW, MANY = 8, 128  # steps in a frame


def seconds(given: StandardScene, start: Snapshot, solvers: list[Solver]) -> list[float]:
    """CPU time of a frame with each solver [s]."""
    poses, best = poses_of(given.track, given.scene.bones), [math.inf] * len(solvers)
    for _ in range(REPEATS):
        for k, solver in enumerate(solvers):
            run = Simulation(given.scene, solver=solver)
            run.start_from(start)
            run.step(poses[1], 1.0 / 60.0)
            begun = time.process_time()
            for pose in poses[2:]:
                run.step(pose, 1.0 / 60.0)
            best[k] = min(best[k], (time.process_time() - begun) / (len(poses) - 2))
    return best


def main() -> None:
    """Measure on a soft sheet, and on one of 1e6 N/m."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--spacing", type=float, default=0.025, help="[m]")
    arguments = parser.parse_args()
    for stretch in (2e3, 1e6):
        given = gentle("stiff", 1, 1.0, stretch=stretch, spacing=arguments.spacing)
        first = Simulation(given.scene)
        first.start(poses_of(given.track, given.scene.bones)[0])
        stable = first.forecast(1.0 / 60.0).substeps
        solvers = [
            SymplecticEuler(substeps=stable), SymplecticEuler(substeps=2 * stable),
            XPBD(substeps=FEW), XPBD(substeps=MANY), TRBDF2(substeps=USUAL),
        ]  # fmt: skip
        slow, slower, few, many, implicit = seconds(given, first.snapshot(), solvers)
        vertices = given.scene.cloth.vertices
        euler, xpbd = (slower - slow) / stable, (many - few) / (MANY - FEW)
        print(
            f"{vertices} vertices, {stretch:.0e} N/m: a step of Euler {1e9 * euler / vertices:.1f} ns a vertex, "
            f"of XPBD {xpbd / euler:.2f} times that; the rest of a frame as long as XPBD moves "
            f"{(few - FEW * xpbd) / xpbd * vertices:.0f} vertices; a frame of TR-BDF2 as long as "
            f"{implicit / xpbd:.0f} steps of XPBD",
            flush=True,
        )


if __name__ == "__main__":
    main()
