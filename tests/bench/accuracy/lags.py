"""How far XPBD lags behind in a second, which `cape.run.auto.sagging` expects of cloth before anything is measured.

    python -m tests.bench.accuracy.lags [--seed 1] [--stretch 1e5] [--seconds 0.6 1.2 3 10]

True errors of whole runs of swinging sheets, as `tolerance` measures them, in so many steps a frame that they hardly
sag: over the step, the length of the motion and the speed of its bones, as a share of the usual one.
"""

import argparse
from functools import partial

import numpy as np

from cape.run.auto.sagging import USUAL_SPEED
from cape.run.simulation import Simulation
from cape.solvers import XPBD
from tests.bench.accuracy.tolerance import Bench
from tests.support.error_scenes import gentle

STEPS = 64, 128  # in a frame at 60 Hz


def main() -> None:
    """Measure motions of several lengths, a line each."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--stretch", type=float, default=1e5, help="[N/m]")
    parser.add_argument("--spacing", type=float, default=0.05, help="[m]")
    parser.add_argument("--seconds", nargs="+", type=float, default=[0.6, 1.2, 3.0, 10.0])
    arguments = parser.parse_args()
    for seconds in arguments.seconds:
        given = gentle("stiff", arguments.seed, seconds, stretch=arguments.stretch, spacing=arguments.spacing)
        bench = Bench(given, 1)
        places = np.array([pose.positions for pose in bench.poses])
        ways = np.sum(np.diff(places, axis=0) ** 2, axis=2).mean(axis=1) / bench.steps
        speed, found = float(np.sqrt(ways.sum() / bench.steps.sum())), []
        for steps in STEPS:
            error = bench.run(partial(Simulation, given.scene, solver=XPBD(substeps=steps))).error_mm
            found.append(f"{1e-3 * error * 60.0 * steps / seconds * USUAL_SPEED / speed:.2f} in {steps} steps")
        print(f"{seconds:5.1f} s, bones at {speed:.2f} m/s: lags by {', '.join(found)} [m/s in a second]", flush=True)


if __name__ == "__main__":
    main()
