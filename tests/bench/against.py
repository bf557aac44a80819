"""What steps cost here and in another checkout, in turn: all solvers, layouts and precisions, the walk, contact.

    python -m tests.bench.against CHECKOUT [--rounds 8] [--processes 2] [--only WORD]

A process for each checkout, run by this Python, steps the same frames of the same scene; the two take turns, since the
clock of a machine wanders, and every frame counts at its fastest, in CPU time. Where in memory a process has its arrays
shows as well, so that further pairs of processes take part. What is compiled counts in no figure. Membranes are left
out against a checkout that has none.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

HERE = Path(__file__).parents[2]

SOLVERS = ("SymplecticEuler", "XPBD", "BackwardEuler", "TRBDF2")

# Reads a line whenever it is to step all frames once, and prints the seconds that each has taken.
WORKER = """
import inspect, json, sys, time
import cape, motions, skeleton
try:
    from cape.scene.standard_scenes import plain
except ImportError:
    from cape.scenes import plain
import numpy as np
from cape.bench.sheets import sheet
scene, solver, precision, frames, substeps, untimed = json.loads(sys.argv[1])
if scene == "walk":
    clip = motions.load("walk")
    body = skeleton.Skeleton.from_clip(clip)
    track = body.track(clip)
    # The cape that all checkouts know, without what only some of them do.
    plainly = {"garment": "back_cape", "self_contact": False, "strain_limit": False}
    known = inspect.signature(cape.dress).parameters
    scene = cape.dress(body, track, **{name: value for name, value in plainly.items() if name in known})
elif scene == "plain":
    standard = plain(seconds=10.0)
    scene, track = standard.scene, standard.track
elif scene == "membrane":
    try:
        from tests.support.scenes import irregular_swing
    except ImportError:
        sys.exit(print("null"))
    assembly, track = irregular_swing(1536)
    scene = assembly.scene
elif scene in ("box", "capsule"):
    flat = cape.Cloth.rectangle(
        width=0.9, height=0.9, spacing=0.9 / 38, origin=(-0.45, 0.45, 0.32), right=(0, -1, 0), down=(1, 0, 0)
    )
    along = np.array([0.3, 0.0, 0.0])
    below = {
        "box": cape.Box(bone="ground", center=np.zeros(3), half_sizes=np.full(3, 0.3)),
        "capsule": cape.Capsule(name="log", bone="ground", start=-along, end=along, radius=0.3),
    }
    scene, track = cape.Scene(flat, [], [below[scene]]), None
else:
    standard = sheet(1536, scene)
    scene, track = standard.scene, standard.track
options = {} if precision is None else {"precision": precision}
if substeps is not None:
    options["substeps"] = substeps
simulation = cape.Simulation(scene, solver=getattr(cape, solver)(**options), threads=1)
def pose(frame):
    if track is None:
        return {bone: (np.zeros(3), [1.0, 0.0, 0.0, 0.0]) for bone in simulation.bones}
    places = [track.index(bone) for bone in simulation.bones]
    return {bone: (track.positions[frame, k], track.rotations_wxyz[frame, k])
            for bone, k in zip(simulation.bones, places)}
frames = frames if track is None else min(frames, track.frames - 1)
poses = [pose(frame) for frame in range(frames + 1)]
for line in sys.stdin:
    simulation.start(poses[0])
    taken = []
    for frame in range(1, frames + 1):
        begun = time.process_time()
        simulation.step(poses[frame], 1 / 60)
        taken.append(time.process_time() - begun)
    print(json.dumps([scene.cloth.vertices, simulation.substeps, taken[untimed:]]), flush=True)
"""


class Case(NamedTuple):
    """A scene, a solver by the name of its class, and how its frames are stepped; the first ones may be untimed."""

    name: str
    scene: str
    solver: str
    precision: str | None
    frames: int
    substeps: int | None = None
    untimed: int = 0


SHEETS = [
    Case(f"sheet, {layout}, {solver}, {precision}", layout, solver, precision, 12 if solver in SOLVERS[2:] else 40)
    for layout in ("grid", "mesh", "membrane")
    for solver in SOLVERS
    for precision in ("single", "double")
]
CASES = [
    *SHEETS,
    Case("the walk", "walk", "SymplecticEuler", None, 240),
    Case("the peers' scene", "plain", "SymplecticEuler", None, 240),
    Case("a sheet on a box", "box", "SymplecticEuler", None, 90, 100, 60),
    Case("a sheet on a capsule", "capsule", "SymplecticEuler", None, 90, 100, 60),
]


def start(checkout: Path, case: Case) -> "subprocess.Popen[str]":
    """A process that steps a case in a checkout."""
    return subprocess.Popen(
        [sys.executable, "-c", WORKER, json.dumps(case[1:])],
        env={**os.environ, "PYTHONPATH": str(checkout)},
        cwd=checkout,  # which Python looks into before that path
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def turn(worker: "subprocess.Popen[str]") -> tuple[int, int, np.ndarray] | None:
    """Vertices, substeps, and the seconds of each frame; None where the checkout does not know the scene."""
    assert worker.stdin is not None
    assert worker.stdout is not None
    worker.stdin.write("\n")
    worker.stdin.flush()
    answer = json.loads(worker.stdout.readline())
    if answer is None:
        return None
    vertices, substeps, taken = answer
    return vertices, substeps, np.array(taken)


def measure(case: Case, checkouts: list[Path], rounds: int, processes: int) -> list[tuple[float, float]] | None:
    """Milliseconds per frame, and nanoseconds per vertex and substep, of each checkout; None if one lacks the scene."""
    least: list[np.ndarray | float] = [np.inf] * len(checkouts)
    sizes = [0] * len(checkouts)
    for _ in range(processes):
        workers = [start(checkout, case) for checkout in checkouts]
        for _ in range(rounds + 1):
            for k, worker in enumerate(workers):
                answer = turn(worker)
                if answer is None:
                    for each in workers:
                        each.kill()
                    return None
                vertices, substeps, taken = answer
                sizes[k] = vertices * substeps
                least[k] = np.minimum(least[k], taken)
        for worker in workers:
            worker.communicate()
    means = [float(np.mean(taken)) for taken in least]
    return [(1e3 * mean, 1e9 * mean / size) for mean, size in zip(means, sizes, strict=True)]


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkout", type=Path)
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    print("| case | there, ms per frame | here | there, ns per vertex and substep | here | here / there |")
    print("|---|---|---|---|---|---|")
    for case in CASES:
        measured = None
        if given.only in case.name:
            measured = measure(case, [given.checkout.resolve(), HERE], given.rounds, given.processes)
        if measured is not None:
            (there, theirs), (here, ours) = measured
            row = f"{there:.3f} | {here:.3f} | {theirs:.2f} | {ours:.2f} | {ours / theirs:.3f}"
            print(f"| {case.name} | {row} |", flush=True)


if __name__ == "__main__":
    main()
