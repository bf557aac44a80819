"""What frames cost in which a cloth tears, and those after, against the same frames of the same cloth untorn.

    python -m tests.bench.tearing [--rounds 5] [--spacing 0.03] [--solver euler] [--layout mesh]

The scene `torn`, as a grid, as a mesh of the same cells, as one of triangles without order, whose membrane resists,
with contact of the cloth with itself, and with another cloth aside, of the same fabric or of another. Runs that tear
and runs that do not take turns; every frame counts at its fastest, in CPU time. Frames are compared one by one with
those of a cloth that may tear but bears all: the ball falls on it as fast, and through it. `tearing` are the frames
in which edges part, `after` the rest once the first has. A torn cloth whips about, as an untorn one does when the
ball is past it, and then its layers are looked for more often: `parting` is what frames that tear take against what
they would without all that looks for tears and follows them.
"""

import argparse
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np
from numpy.random import default_rng

import cape
from cape.cloth.meshing import as_mesh
from cape.run.tearing.tears import Tears
from cape.scene.standard_scenes import StandardScene
from cape.scene.tearing_scenes import torn
from cape.solvers import SOLVERS
from tests.support.scenes import irregular
from tests.tearing.to_tear import with_another_aside

BEARS_ALL = 1e6  # strain
LAYOUTS = ("grid", "mesh", "irregular mesh", "self-contact", "outfit", "several fabrics")
FRAME = 1.0 / 60.0  # s


def scene_of(layout: str, spacing: float, *, tears: bool) -> StandardScene:
    """The scene, in which the cloth tears or bears all."""
    standard = torn(spacing=spacing) if tears else torn(spacing=spacing, strain=BEARS_ALL)
    scene = standard.scene
    if layout in ("mesh", "irregular mesh"):
        assert isinstance(scene.cloth, cape.GridCloth)
        regular = layout == "mesh"
        scene = replace(scene, cloth=as_mesh(scene.cloth) if regular else irregular(scene.cloth, default_rng(0)))
    if layout in ("outfit", "several fabrics"):
        fabric = replace(scene.cloth.fabric, damping_time=1e-4) if layout == "several fabrics" else None
        scene = with_another_aside(scene, fabric)
    layers = cape.SelfContact() if layout == "self-contact" else None
    return replace(standard, scene=replace(scene, self_contact=layers))


@contextmanager
def clocked() -> Iterator[list[float]]:
    """CPU times [s] of all that looks for tears and follows them, one after the other."""
    taken: list[float] = []

    def timed(method: Callable[..., None]) -> Callable[..., None]:
        def call(*arguments: Any) -> None:
            begun = time.process_time()
            method(*arguments)
            taken.append(time.process_time() - begun)

        return call

    with mock.patch.multiple(Tears, look=timed(Tears.look), end_frame=timed(Tears.end_frame)):
        yield taken


def run(standard: StandardScene, solver: cape.Solver) -> np.ndarray:
    """CPU time [s] of each frame, what of it was for tears, and how many edges parted within, shape (3, F)."""
    simulation, track = cape.Simulation(standard.scene, solver=solver, threads=1), standard.track
    places = {bone: track.index(bone) for bone in simulation.bones}
    poses = [
        {bone: (track.positions[k, place], track.rotations_wxyz[k, place]) for bone, place in places.items()}
        for k in range(track.frames)
    ]
    simulation.start(poses[0])
    frames = []
    with clocked() as taken:
        for pose in poses[1:]:
            taken.clear()
            before, begun = simulation.tears, time.process_time()
            simulation.step(pose, FRAME)
            frames.append((time.process_time() - begun, sum(taken), simulation.tears - before))
    return np.array(frames).T


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--spacing", type=float, default=0.03)
    parser.add_argument("--solver", default="euler", choices=SOLVERS)
    parser.add_argument("--layout", choices=LAYOUTS, help="all, unless told")
    given = parser.parse_args()
    solver = SOLVERS[given.solver]()
    print(
        "| layout | edges | frames that tear | untorn, ms | tearing: median | worst | parting: median | worst | "
        "after: median | worst |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for layout in LAYOUTS if given.layout is None else [given.layout]:
        both = [scene_of(layout, given.spacing, tears=tears) for tears in (False, True)]
        for each in both:
            run(each, solver)
        rounds = np.array([[run(each, solver) for each in both] for _ in range(given.rounds)])
        (untorn, _, _), (torn_frames, own, tears) = rounds.min(axis=0)
        ratio, parting, parts = torn_frames / untorn, torn_frames / (torn_frames - own), tears > 0
        rest = ratio[(np.arange(len(tears)) > np.flatnonzero(parts)[0]) & ~parts]
        figures = [float(kind(of)) for of in (ratio[parts], parting[parts], rest) for kind in (np.median, np.max)]
        print(
            f"| {layout} | {tears.sum():.0f} | {parts.sum()} | {1e3 * np.median(untorn):.2f} | "
            f"{' | '.join(f'{figure:.2f}' for figure in figures)} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
