"""What compiling costs: the first replay with nothing compiled, what each option adds, and a run with all of it there.

    python -m tests.bench.first_run [CHECKOUT ...] [--repeats 3] [--only WORD]

Each checkout, this one if none is named, is run in turn in new processes, by this Python, with a folder of compiled
code of its own; one that has no such option says so. CPU seconds are of all processes; what is spent on compiling is
what a run takes beyond one that finds everything compiled. Wall times are the least of the repeats.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).parents[2]

REPLAY = "from cape.cli import main; main()"
HANGING = """
import sys
import numpy as np
import cape
sheet = cape.Cloth.rectangle(width=1.0, height=1.5, spacing=0.02)
wind = cape.Wind() if "wind" in sys.argv else None
simulation = cape.Simulation(
    cape.Scene(sheet, [cape.attach(sheet, "rod", "top")], wind=wind), threads=2 if "threads" in sys.argv else 1
)
for _ in range(3):
    simulation.step({"rod": (np.zeros(3), [1.0, 0.0, 0.0, 0.0])}, 1 / 60)
"""
BOX = """
[[solid]]
name = "seat"
kind = "box"
bone = "Hips"
center = [0.0, -0.1, 0.0]
half_sizes = [0.15, 0.1, 0.1]
"""
TAPERED = """
[[solid]]
name = "trunk"
kind = "tapered_capsule"
bone = "Hips"
start = [0.0, 0.0, 0.0]
end = [0.0, 0.4, 0.0]
start_radius = 0.15
end_radius = 0.12
"""


class Run(NamedTuple):
    """A command: Python code and its arguments, what it must find compiled, and the file of colliders that it reads."""

    name: str
    code: str
    arguments: tuple[str, ...] = ()
    after: str | None = None
    colliders: str | None = None


RUNS = (
    Run("replay", REPLAY, ("replay",)),
    Run("replay --no-self-contact", REPLAY, ("replay", "--no-self-contact")),
    Run("replay --self-contact", REPLAY, ("replay", "--self-contact"), "replay --no-self-contact"),
    Run("replay --solver xpbd", REPLAY, ("replay", "--solver", "xpbd"), "replay"),
    Run("replay --solver backward_euler", REPLAY, ("replay", "--solver", "backward_euler"), "replay"),
    Run("replay --solver tr_bdf2", REPLAY, ("replay", "--solver", "tr_bdf2"), "replay"),
    Run("replay --hitboxes, a box", REPLAY, ("replay",), "replay", BOX),
    Run("replay --hitboxes, a tapered capsule", REPLAY, ("replay",), "replay", TAPERED),
    Run("a sheet", HANGING),
    Run("a sheet, wind", HANGING, ("wind",), "a sheet"),
    Run("a sheet, two threads", HANGING, ("threads",), "a sheet"),
)


class Spent(NamedTuple):
    """Seconds of a process and all that it started."""

    wall: float
    cpu: float


def spend(checkout: Path, run: Run, cache: Path) -> Spent:
    """Run it once in a checkout, with a folder of compiled code."""
    with tempfile.TemporaryDirectory() as folder:
        arguments = list(run.arguments)
        if run.code is REPLAY:
            arguments += ["-o", "out.rrd"]
        if run.colliders is not None:
            (Path(folder) / "colliders.toml").write_text(run.colliders)
            arguments += ["--hitboxes", "colliders.toml"]
        environment = {**os.environ, "PYTHONPATH": str(checkout), "NUMBA_CACHE_DIR": str(cache)}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # bytecode is kept, as a user's is
        before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-c", run.code, *arguments], cwd=folder, env=environment, capture_output=True, text=True
        )
        wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0:
        raise RuntimeError(f"{run.name} in {checkout}: {done.stderr[-500:]}")
    return Spent(wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def measure(checkout: Path, run: Run, earlier: Run | None, repeats: int) -> tuple[Spent, Spent]:
    """The least of a run's first time, after an earlier one, and of its second time."""
    firsts, seconds = [], []
    for _ in range(repeats):
        with tempfile.TemporaryDirectory() as cache:
            if earlier is not None:
                spend(checkout, earlier, Path(cache))
            firsts.append(spend(checkout, run, Path(cache)))
            seconds.append(spend(checkout, run, Path(cache)))
    return _least(firsts), _least(seconds)


def _least(spent: list[Spent]) -> Spent:
    return Spent(min(s.wall for s in spent), min(s.cpu for s in spent))


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkouts", nargs="*", type=Path, default=[HERE])
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    named = {run.name: run for run in RUNS}
    print("| run | checkout | first, wall s | first, compiling CPU s | again, wall s |\n|---|---|---|---|---|")
    for run in RUNS:
        if given.only not in run.name:
            continue
        for checkout in given.checkouts:
            try:
                first, second = measure(checkout.resolve(), run, named.get(run.after or ""), given.repeats)
            except RuntimeError as error:
                print(f"| {run.name} | {checkout} | {' '.join(str(error).split())[-100:]} | | |", flush=True)
                continue
            print(
                f"| {run.name} | {checkout} | {first.wall:.1f} | {first.cpu - second.cpu:.1f} | {second.wall:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
