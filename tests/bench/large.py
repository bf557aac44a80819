"""How long large inputs take to be read and checked, and the memory that takes; each in a process of its own.

    python -m tests.bench.large [NAME ...]

Each must end, or be refused, within 10 s of CPU time and 1 GB. What is only run when it is named takes minutes and must
hold under 1.5 GB: `replay` replays 28 minutes at 60 frames a second in a coarse cape, `replay_usual` a tenth of it,
and `replay_usual_whole` all of it, in the usual one, whose frames go to the recording as they come.
"""

import resource
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

import cape
import motions
import skeleton
from cape.reach import reach_of
from motions.errors import UserError
from skeleton.robot.solid_files import read_solids
from tests.support.processes import python_within

FRAMES = 100_000
LONGEST = 7200.0  # s that any may take
ROWS = 708  # of squares along each side of a mesh of a million triangles


def colliders(_: Path) -> Callable[[], object]:
    """100,000 balls about the walk, and which of them its cape can reach."""
    clip = motions.load("walk")
    body = skeleton.Skeleton.from_clip(clip)
    track = body.track(clip)
    scene = cape.dress(body, track)
    places = np.random.default_rng(0).uniform(-30.0, 30.0, (100_000 - len(scene.colliders), 3))
    balls = [cape.Sphere(name=f"{k}", bone=None, center=place, radius=0.1) for k, place in enumerate(places)]
    return lambda: reach_of(replace(scene, colliders=(*scene.colliders, *balls)), track)


def configurations(folder: Path) -> Callable[[], object]:
    """28 minutes of a robot's motion as text."""
    robot = skeleton.Skeleton.from_urdf("g1")
    rows = np.zeros((FRAMES, 36))
    rows[:, 2], rows[:, 6] = 0.8, 1.0
    rows[:, 7:] = 0.1 * np.sin(0.01 * np.arange(FRAMES)[:, None] + np.arange(29))
    np.savetxt(folder / "long.csv", rows, delimiter=",", fmt="%.6f", header=",".join(skeleton.column_names(robot)))
    text = (folder / "long.csv").read_text().removeprefix("# ")
    (folder / "long.csv").write_text(text)
    return lambda: robot.track(skeleton.load_configurations(folder / "long.csv", robot))


def clip(folder: Path) -> Callable[[], object]:
    """28 minutes of the shipped walk, over and over."""
    path = write_long_clip(folder)

    def read() -> object:
        found = motions.load(path)
        return skeleton.Skeleton.from_clip(found).track(found)

    return read


def solids(folder: Path) -> Callable[[], object]:
    """20,000 solids in a file."""
    table = '[[solid]]\nname = "{}"\nkind = "sphere"\nbone = "Hips"\ncenter = [0.0, 0.0, 0.0]\nradius = 0.1\n'
    (folder / "solids.toml").write_text("".join(map(table.format, range(20_000))))
    return lambda: read_solids(folder / "solids.toml")


def mesh(_: Path) -> Callable[[], object]:
    """A cloth of a million triangles."""
    points, triangles = waves()
    return lambda: cape.Cloth.from_mesh(points, triangles)


def link(folder: Path) -> Callable[[], object]:
    """A robot's link of a million triangles, fitted with hitboxes."""
    import trimesh

    trimesh.Trimesh(*waves(), process=False).export(folder / "link.stl")
    shape = f'<geometry><mesh filename="{folder / "link.stl"}"/></geometry>'
    parts = f"<visual>{shape}</visual><collision>{shape}</collision>"
    (folder / "robot.urdf").write_text(f'<robot name="r"><link name="base">{parts}</link></robot>')
    return lambda: skeleton.hitboxes_of(skeleton.Skeleton.from_urdf(folder / "robot.urdf"), which="all")


def replay(folder: Path) -> Callable[[], object]:
    """28 minutes of the walk, in a cape of 104 vertices."""
    path = write_long_clip(folder)

    def run() -> object:
        found = motions.load(path)
        body = skeleton.Skeleton.from_clip(found)
        track = body.track(found)
        take = cape.simulate(cape.dress(body, track, garment="back_cape", spacing=0.1), track)
        return take.save(folder / "long.rrd")

    return run


def replay_usual(folder: Path, frames: int = FRAMES // 10) -> Callable[[], object]:
    """3 minutes of the walk in the usual cape, written while it is simulated, as the command does."""
    from cape.record.growing import growing_file

    path = write_long_clip(folder, frames)

    def run() -> object:
        found = motions.load(path)
        body = skeleton.Skeleton.from_clip(found)
        track = body.track(found)
        scene = cape.dress(body, track)
        with growing_file(folder / "long.rrd", scene, track, name="long") as file:
            file.finish(cape.simulate(scene, track, on_frame=file.note))
        return None

    return run


def replay_usual_whole(folder: Path) -> Callable[[], object]:
    """28 minutes of it."""
    return replay_usual(folder, FRAMES)


def waves() -> tuple[np.ndarray, np.ndarray]:
    """Vertices [m] and triangles of a wavy sheet 30 cm wide."""
    u, v = np.meshgrid(np.linspace(0.0, 0.3, ROWS + 1), np.linspace(0.0, 0.3, ROWS + 1))
    points = np.stack([u, v, 0.02 * np.sin(30.0 * u)], axis=-1).reshape(-1, 3)
    first = (np.arange(ROWS)[:, None] * (ROWS + 1) + np.arange(ROWS)).ravel()
    corners = np.array([[0, 1, ROWS + 2], [0, ROWS + 2, ROWS + 1]])
    return points, (first[:, None, None] + corners).reshape(-1, 3)


def write_long_clip(folder: Path, frames: int = FRAMES) -> Path:
    lines = motions.clip_path("walk").read_text().splitlines()
    count = next(k for k, line in enumerate(lines) if line.startswith("Frames"))
    rows = lines[count + 2 :]
    repeated = (rows * (frames // len(rows) + 1))[:frames]
    path = folder / "long.bvh"
    path.write_text("\n".join([*lines[:count], f"Frames: {frames}", lines[count + 1], *repeated]) + "\n")
    return path


USUAL = {each.__name__: each for each in (colliders, configurations, clip, solids, mesh, link)}
ALL = {**USUAL, **{each.__name__: each for each in (replay, replay_usual, replay_usual_whole)}}


def measure(name: str) -> None:
    """Print CPU time [s], most memory so far [MB], and what came of it."""
    with tempfile.TemporaryDirectory() as folder:
        run = ALL[name](Path(folder))
        begun, came = time.process_time(), "read"
        try:
            run()
        except UserError as error:
            came = f"refused: {error}"
        seconds = time.process_time() - begun
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{name:15} {seconds:7.1f} {peak:7.0f}  {came}")


def main() -> None:
    """Print a row for each."""
    print(f"{'input':15} {'CPU s':>7} {'MB':>7}")
    for name in sys.argv[1:] or USUAL:
        told = python_within(LONGEST, f"from tests.bench.large import measure; measure({name!r})")
        print(told, end="", flush=True)


if __name__ == "__main__":
    main()
