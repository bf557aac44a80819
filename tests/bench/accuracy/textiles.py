"""What each textile test of the full report takes, and finds.

    python -m tests.bench.accuracy.textiles [drape] [cantilever] ... [--only worsted]

CPU times beside wall times: on idle cores the wall time of all is that of the CPU over the cores, or a little more, as
starts of a drape are shared out to them. What is compiled first counts for the first test that needs it.
"""

import argparse
import time

from cape.report.measured.world.trials import TESTS, trials_of
from cape.solvers.threads import available_cores


def main() -> None:
    """Run the tests, one line each, and tell the sum and the dearest."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("tests", nargs="*", default=tuple(TESTS), help=", ".join(TESTS))
    parser.add_argument("--only", default="", help="part of a trial's name")
    arguments = parser.parse_args()
    taken: dict[str, float] = {}
    begun = time.perf_counter()
    for trial in trials_of(arguments.tests):
        if arguments.only not in trial.name:
            continue
        wall, cpu = time.perf_counter(), time.process_time()
        rows = trial.run()
        taken[trial.name] = time.process_time() - cpu
        found = ", ".join(f"{row.quantity} {row.simulated:.5g} {row.unit} {row.verdict}".rstrip() for row in rows)
        broken = "".join(f"; {row.result}" for row in rows[:1] if row.result != "finished")
        wall = time.perf_counter() - wall
        print(f"{taken[trial.name]:6.1f} s CPU, {wall:6.1f} s: {trial.name}: {found}{broken}", flush=True)
    dearest = sorted(taken, key=lambda name: -taken[name])[:5]
    print(
        f"{len(taken)} trials: {sum(taken.values()):.0f} s of CPU, {time.perf_counter() - begun:.0f} s on "
        f"{available_cores()} cores; dearest: " + ", ".join(f"{name} {taken[name]:.0f} s" for name in dearest)
    )


if __name__ == "__main__":
    main()
