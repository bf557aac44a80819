"""What frames cost in which a cloth tears, and those after, against the same frames of the same cloth untorn.

    python -m tests.bench.tearing [--rounds 5] [--spacing 0.03] [--solver euler]

The scene `torn`, as a grid, as a mesh of the same cells, as one of triangles without order, whose membrane resists, and
with contact of the cloth with itself. Runs that tear and
runs that do not take turns; every frame counts at its fastest, in CPU time. Frames are compared one by one with those
of a cloth that may tear but bears all: the ball falls on it as fast, and through it. `tearing` are the frames in which
edges part, `after` the rest once the first has.
"""

import argparse
import time
from dataclasses import replace

import numpy as np
from numpy.random import default_rng

import cape
from cape.cloth.meshing import as_mesh
from cape.scene.standard_scenes import StandardScene
from cape.scene.tearing_scenes import torn
from cape.solvers import SOLVERS
from tests.support.scenes import irregular

BEARS_ALL = 1e6  # strain
FRAME = 1.0 / 60.0  # s


def scene_of(layout: str, spacing: float, *, tears: bool) -> StandardScene:
    """The scene, in which the cloth tears or bears all."""
    standard = torn(spacing=spacing) if tears else torn(spacing=spacing, strain=BEARS_ALL)
    scene = standard.scene
    if layout in ("mesh", "irregular mesh"):
        assert isinstance(scene.cloth, cape.GridCloth)
        regular = layout == "mesh"
        scene = replace(scene, cloth=as_mesh(scene.cloth) if regular else irregular(scene.cloth, default_rng(0)))
    layers = cape.SelfContact() if layout == "self-contact" else None
    return replace(standard, scene=replace(scene, self_contact=layers))


def run(standard: StandardScene, solver: cape.Solver) -> tuple[np.ndarray, np.ndarray]:
    """CPU time [s] of each frame, and how many edges parted within."""
    simulation, track = cape.Simulation(standard.scene, solver=solver, threads=1), standard.track
    places = {bone: track.index(bone) for bone in simulation.bones}
    poses = [
        {bone: (track.positions[k, place], track.rotations_wxyz[k, place]) for bone, place in places.items()}
        for k in range(track.frames)
    ]
    simulation.start(poses[0])
    taken, tears = [], []
    for pose in poses[1:]:
        before, begun = simulation.tears, time.process_time()
        simulation.step(pose, FRAME)
        taken.append(time.process_time() - begun)
        tears.append(simulation.tears - before)
    return np.array(taken), np.array(tears)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--spacing", type=float, default=0.03)
    parser.add_argument("--solver", default="euler", choices=SOLVERS)
    given = parser.parse_args()
    solver = SOLVERS[given.solver]()
    print("| layout | edges | frames that tear | untorn, ms | tearing: median | worst | after: median | worst |")
    print("|---|---|---|---|---|---|---|---|")
    for layout in ("grid", "mesh", "irregular mesh", "self-contact"):
        whole, tearing = (scene_of(layout, given.spacing, tears=tears) for tears in (False, True))
        best: list[np.ndarray] = [run(each, solver)[0] for each in (whole, tearing)]
        tears = np.zeros(0)
        for _ in range(given.rounds):
            for k, each in enumerate((whole, tearing)):
                taken, tears = run(each, solver)
                best[k] = np.minimum(best[k], taken)
        ratio, parts = best[1] / best[0], tears > 0
        after = np.arange(len(tears)) > np.flatnonzero(parts)[0]
        rest = ratio[after & ~parts]
        print(
            f"| {layout} | {tears.sum()} | {parts.sum()} | {1e3 * np.median(best[0]):.2f} | "
            f"{np.median(ratio[parts]):.2f} | {ratio[parts].max():.2f} | {np.median(rest):.2f} | {rest.max():.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
