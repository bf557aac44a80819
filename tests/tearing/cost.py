"""What tearing costs: the CPU time of each frame of a sheet that a ball falls through, beside one that does not tear.

`python -m tests.tearing.cost [SPACING ...]`. Of several runs in turn the least time of each frame counts.
"""

import sys
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import cape
from cape.scene.poses import poses_of
from cape.scene.tearing_scenes import torn

REPEATS = 5
SPACINGS = (0.03, 0.02, 0.015)


def run(spacing: float, *, tears: bool) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """CPU time [s], and edges that have parted by then, of each frame."""
    standard = torn(spacing=spacing)
    scene = standard.scene if tears else replace(standard.scene, tearing=None)
    simulation = cape.Simulation(scene, threads=1)
    first, *poses = poses_of(standard.track, simulation.bones)
    simulation.compile(first)
    simulation.start(first)
    seconds, parted = [], []
    for pose, dt in zip(poses, np.diff(standard.track.times).tolist(), strict=True):
        begun = time.process_time()
        simulation.step(pose, dt)
        seconds.append(time.process_time() - begun)
        parted.append(simulation.tears)
    return np.array(seconds), np.array(parted)


def main(spacings: Sequence[float]) -> None:
    """Print a row for each spacing."""
    print(f"{'spacing':>8} {'tears':>6} {'before':>7} {'tearing':>8} {'worst':>6} {'after':>6}  times the untorn frame")
    for spacing in spacings:
        runs = [(run(spacing, tears=True), run(spacing, tears=False)) for _ in range(REPEATS)]
        torn_s, whole_s = (np.min([pair[k][0] for pair in runs], axis=0) for k in range(2))
        parted = runs[0][0][1]
        new = np.diff(parted, prepend=0) > 0
        last = int(np.flatnonzero(new)[-1])
        frames = np.arange(len(new))
        before, after = (frames > 0) & (frames < np.flatnonzero(new)[0]), frames > last
        # Until the ball is through both are drawn alike; then the torn sheet is compared with a whole one at rest.
        ratio = torn_s[new] / whole_s[new]
        # The worst may have been taken twice, in shorter steps the second time, which has nothing to do with tearing.
        kinds = [torn_s[before].sum() / whole_s[before].sum(), np.median(ratio), ratio.max()]
        kinds.append(np.median(torn_s[after]) / np.median(whole_s[after]))
        print(f"{spacing:8g} {parted[-1]:6d} {kinds[0]:7.2f} {kinds[1]:8.2f} {kinds[2]:6.2f} {kinds[3]:6.2f}")


if __name__ == "__main__":
    main([float(argument) for argument in sys.argv[1:]] or SPACINGS)
