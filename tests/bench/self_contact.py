"""What it costs that a cloth keeps off itself: loop time with self-contact over that without, in the same run.

    python -m tests.bench.self_contact [frames] [solver ...]

Scenes with a cape, and sheets that lie on themselves in two layers and in four. Both simulations go through the same
frames, step by step in turn; processor time of the thread, the least of a few repeats.
"""

import sys
import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cape import Cloth, Plane, Pose, SelfContact, Simulation, solver
from cape.kernels.self_contact.self_contact import SEARCHES
from cape.scene.scene import Scene
from cape.scene.standard_scenes import StandardScene, standard_scene
from skeleton.track import BoneTrack

REPEATS = 3
SETTLING = 60  # frames in which sheets fall, which aren't timed


def heap(frames: int, *, layers: int) -> StandardScene:
    """A sheet of 1 x 1 m on the ground, folded in half once or twice, loosely, so that it falls into layers."""
    cloth = Cloth.rectangle(width=1.0, height=1.0, spacing=0.025, right=(1.0, 0.0, 0.0), down=(0.0, 1.0, 0.0))
    x, y = cloth.pattern.T
    x, first = _fold(x, 0.5, 0.03)
    y, second = _fold(y, 0.5, 0.09) if layers == 4 else (y, np.zeros_like(y))
    cloth = replace(cloth, positions=np.stack([x, y, 0.02 + first + second], axis=1))
    still = np.zeros((frames, 1, 3))
    track = BoneTrack(("ground",), np.arange(frames) / 60.0, still, np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1, 1)))
    floor = Plane(point=np.zeros(3), normal=np.array([0.0, 0.0, 1.0]))
    return StandardScene(f"{layers} layers", Scene(cloth, [], [floor]), track)


def _fold(x: NDArray[np.float64], middle: float, gap: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where points of a line are when it is folded around a bend of that diameter [m], along it and above it."""
    start = middle - np.pi * gap / 4.0
    bend = np.clip((x - start) / (gap / 2.0), 0.0, np.pi)
    along = np.where(bend == 0.0, x, np.where(bend == np.pi, 2.0 * middle - x, start + gap / 2.0 * np.sin(bend)))
    return along, gap / 2.0 * (1.0 - np.cos(bend))


def row(standard: StandardScene, method: str, frames: int, skipped: int) -> str:
    """Run a scene with and without, and time both."""
    track = standard.track
    runs = [
        Simulation(replace(standard.scene, self_contact=contact), solver=solver(method), threads=1)
        for contact in (None, SelfContact())
    ]
    chosen = [track.index(bone) for bone in runs[0].bones]
    poses = [Pose(track.positions[f, chosen], track.rotations_wxyz[f, chosen]) for f in range(track.frames)]
    frame, timed = float(track.times[1]), poses[1 : skipped + frames + 1]
    best = [np.inf, np.inf]
    searches = 0.0
    for _ in range(REPEATS):
        seconds = np.zeros((len(timed), 2))
        for run in runs:
            run.start(poses[0])
        for k, pose in enumerate(timed):
            for j, run in enumerate(runs):
                begun = time.thread_time()
                run.step(pose, frame)
                seconds[k, j] = time.thread_time() - begun
        best = np.minimum(best, seconds[skipped:].mean(axis=0))
    layers = runs[1].assembly.layers
    assert layers is not None
    searches = layers.pressure.clock[SEARCHES] / len(timed)
    bare, touching = best
    speed = 1e3 * np.sqrt(np.mean(np.sum(runs[1].velocities ** 2, axis=1)))
    return (
        f"{standard.name:9} {method:14} {len(runs[1].positions):8} {runs[1].substeps:8} {bare * 1e3:8.2f} "
        f"{touching * 1e3:8.2f} {touching / bare:6.2f} {searches:9.1f} {layers.faces.counts[0]:7} "
        f"{layers.edges.counts[0]:7} {speed:10.2f}"
    )


def main(frames: str = "120", *methods: str) -> None:
    """Print a row a scene and solver."""
    print("scene     solver         vertices substeps  without     with  ratio searches/frame  faces   edges  rms mm/s")
    for method in methods or ("euler",):
        for name in ("plain", "walk", "run", "spin", "kick"):
            print(row(standard_scene(name), method, int(frames), 0), flush=True)
        for layers in (2, 4):
            standard = heap(SETTLING + int(frames) + 1, layers=layers)
            print(row(standard, method, int(frames), SETTLING), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
