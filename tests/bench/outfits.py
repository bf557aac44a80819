"""What it costs that garments over each other are of different fabrics: time of a frame, against the same of one.

    python -m tests.bench.outfits [--spacing METRES]

A cloak over a skirt, and a tabard between them, in the walk, under each solver on one thread. Fabrics differ by less
than can be seen in any motion, but are treated as different ones. Both take turns in frames; CPU time, of which the
fastest frame counts.
"""

import argparse
import time
from dataclasses import replace

import motions
from cape.cloth.fabric import Fabric
from cape.cloth.fabrics import FABRICS
from cape.outfits.combined import Outfit, combined
from cape.run.simulation import Simulation
from cape.scene.dress import dress
from cape.scene.poses import poses_of
from cape.scene.scene import Scene
from cape.solvers import SOLVERS
from skeleton import Skeleton

GARMENTS = ("cloak", "tabard", "skirt")
FRAMES, FIRST = 24, 4  # frames, and those of them that are not counted
UNSEEN = 1e-9  # by which the shear of a fabric differs from that of the next, relative


def several(scene: Scene, fabric: Fabric) -> Scene:
    """A scene of an outfit with a fabric for each of its garments."""
    outfit = scene.cloth
    assert isinstance(outfit, Outfit)
    parts = [
        replace(part.cloth, fabric=replace(fabric, shear=fabric.shear * (1.0 + UNSEEN * number)))
        for number, part in enumerate(outfit.parts)
    ]
    places = [outfit.positions[part.vertices] for part in outfit.parts]
    return replace(scene, cloth=combined([part.name for part in outfit.parts], parts, places))


def main() -> None:
    """Measure, and print a line for each solver."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--spacing", type=float, default=0.04)
    clip = motions.load("walk").trim(0.0, 0.5)
    body = Skeleton.from_clip(clip)
    track, fabric = body.track(clip), FABRICS["worsted"]
    one = dress(body, track, garments=GARMENTS, fabric=fabric, spacing=parser.parse_args().spacing)
    print(f"{one.cloth.vertices} vertices: ms a frame of one fabric, of {len(GARMENTS)}, and times as long")
    for name, kind in SOLVERS.items():
        runs = [Simulation(scene, solver=kind(), threads=1) for scene in (one, several(one, fabric))]
        poses, best = poses_of(track, runs[0].bones), [float("inf")] * 2
        for run in runs:
            run.start(poses[0], settle=0.0)
        for frame in range(1, FRAMES + 1):
            for k, run in enumerate(runs):
                start = time.process_time()
                run.step(poses[frame], 1.0 / track.fps)
                if frame > FIRST:
                    best[k] = min(best[k], time.process_time() - start)
        print(f"{name:15} {1e3 * best[0]:8.1f} {1e3 * best[1]:8.1f} {best[1] / best[0]:6.2f}")


if __name__ == "__main__":
    main()
