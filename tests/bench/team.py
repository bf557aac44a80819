"""What it costs that threads share a cloth, and what it brings that they share many capes.

    python -m tests.bench.team [capes]

A meeting of two ranks, inside one compiled loop, and of two and three beside a process that never rests; the launch of
a team that does nothing, over a plain call; a step of a single substep, which is nearly all Python and holds the
interpreter's lock; and the throughput of a batch on two threads over that on one, beside what the machine gives two
threads that share nothing. Times are minima of repeats, ratios are medians over the frames before which the machine
had two cores to give.
"""

import subprocess
import sys
import threading
import time
from collections.abc import Callable

import numpy as np

from cape import Pose, Simulation, SymplecticEuler
from cape.kernels.calling import Bound
from cape.kernels.jit import routine
from cape.kernels.linking import arrivals_for
from cape.kernels.team import Team, meet
from cape.run.batch import Batch
from cape.scene.standard_scenes import plain
from cape.solvers.threads import run

MEETINGS, FEW = 10_000, 500
QUIET = 0.2  # how far the throughput of two threads that share nothing may be from 2, for a ratio to count


@routine
def meet_often(times, team):
    for _ in range(times):
        meet(team)


@routine
def sum_often(times):
    total = 0.0
    for i in range(times):
        total += i % 7 * 1.1
    return total


def team_of(ranks: int, times: int) -> Callable[[], object]:
    """A team whose ranks meet so often; what calls it."""
    arrivals = arrivals_for(ranks)
    each = [Bound(meet_often, times, Team(rank, ranks, 0, 0, arrivals)) for rank in range(ranks)]
    alone = Bound(meet_often, times, Team.alone(0))
    return lambda: run(lambda rank: each[rank](), alone, arrivals)


def seconds(act: Callable[[], object], repeats: int = 200) -> float:
    """Least time of a call [s]."""
    best = np.inf
    for _ in range(repeats):
        start = time.perf_counter()
        act()
        best = min(best, time.perf_counter() - start)
    return best


def side_by_side(times: int) -> float:
    """Throughput of two threads that share nothing, over that of one."""

    def both() -> None:
        other = threading.Thread(target=sum_often, args=(times,))
        other.start()
        sum_often(times)
        other.join()

    return 2.0 * seconds(lambda: sum_often(times), 1) / seconds(both, 1)


def main(capes: int = 64) -> None:
    """Print a row a figure."""
    team_of(2, 1)()
    many = seconds(team_of(2, MEETINGS), 20)
    print(f"meeting of two ranks      {many / MEETINGS * 1e9:8.0f} ns")
    alone, two = (seconds(team_of(size, 1), 2000) for size in (1, 2))
    print(f"launch of two ranks       {(two - alone) * 1e6:8.1f} us")

    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as restless:
        for ranks in (2, 3):
            few = seconds(team_of(ranks, FEW), 5)
            print(f"meeting of {ranks}, one core busy {few / FEW * 1e6:6.1f} us")
        restless.kill()

    scene, track = plain(seconds=2.0).scene, plain(seconds=2.0).track
    chosen = [track.index(bone) for bone in scene.bones]
    poses = [Pose(track.positions[f, chosen], track.rotations_wxyz[f, chosen]) for f in range(track.frames)]
    short = Simulation(scene, solver=SymplecticEuler(substeps=1))
    short.start(poses[0], settle=0.0)
    print(f"step of a single substep  {seconds(lambda: short.step(poses[0], 1e-6)) * 1e6:8.0f} us")

    batches = {threads: Batch([Simulation(scene) for _ in range(capes)], threads=threads) for threads in (1, 2)}
    for batch in batches.values():
        batch.start([poses[0]] * capes)
    sum_often(1)
    steps: dict[int, list[float]] = {threads: [] for threads in batches}
    machine = []
    for pose in poses[1:]:
        machine.append(side_by_side(5_000_000))
        for threads, batch in batches.items():
            steps[threads].append(seconds(lambda batch=batch, pose=pose: batch.step([pose] * capes, 1 / 60), 1))
    one, both = np.array(steps[1]), np.array(steps[2])
    quiet = np.abs(np.array(machine) - 2.0) < QUIET
    print(f"step of a cape            {one.min() / capes * 1e6:8.0f} us, {scene.cloth.vertices} vertices")
    print(f"{capes:3d} capes on two threads  {np.median((one / both)[quiet]) if quiet.any() else np.nan:8.2f} x")
    print(f"two that share nothing    {np.median(np.array(machine)[quiet]) if quiet.any() else np.nan:8.2f} x")
    print(f"frames that count         {quiet.sum():8d} of {len(quiet)}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
