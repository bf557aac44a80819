"""How long `Take.save` takes and how large the recording gets, for a take of 524 frames and 1,536 vertices.

    python -m tests.bench.recording

The bones are those of the shipped walk, repeated to the length, with the body's own capsules. Of each choice of layers
the best of five runs counts; the first, which imports Rerun, is left out.
"""

import tempfile
import time
from pathlib import Path

import numpy as np

import motions
import skeleton
from cape.results.take import Take

FRAMES, ROWS, COLUMNS = 524, 48, 32
CHOICES = [None, ["cape"], ["body"], ["skeleton"], ["hitboxes"], ["floor"], ["plots"], []]


def make_take() -> Take:
    """A waving sheet beside a walker."""
    clip = motions.load(motions.clip_path("walk"))
    body = skeleton.Skeleton.from_clip(clip)
    cycle = np.resize(np.arange(clip.frames), FRAMES)
    walk = body.track(clip)
    bones = skeleton.BoneTrack(
        walk.names,
        np.arange(FRAMES) / clip.fps,
        walk.positions[cycle],
        walk.rotations_wxyz[cycle],
        walk.parents,
        walk.roles,
    )
    row, column = (axis.ravel() for axis in np.mgrid[:ROWS, :COLUMNS])
    sheet = np.stack([np.zeros(len(row)), column / COLUMNS, 1.5 - row / ROWS], axis=-1)
    waves = 0.1 * np.sin(bones.times[:, None] * 5 + sheet[:, 2] * 9)
    positions = np.broadcast_to(sheet, (FRAMES, *sheet.shape)).astype(np.float32)
    positions[..., 0] += waves
    # As in a simulation, no two frames share digits: a file of repeated numbers would shrink to a fourth.
    positions += np.random.default_rng(0).normal(scale=1e-3, size=positions.shape).astype(np.float32)
    corner = np.arange(ROWS * COLUMNS).reshape(ROWS, COLUMNS)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]))
    curve = np.linspace(0, 1, FRAMES)
    return Take(
        name="recording",
        bones=bones,
        colliders=body.capsules(),
        triangles=np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]).astype(np.int32),
        texcoords=np.stack([column / (COLUMNS - 1), row / (ROWS - 1)], axis=-1).astype(np.float32),
        positions=positions,
        stretch_max=curve,
        stretch_p99=0.0,
        penetration=curve,
        penetrated=np.zeros(FRAMES, np.int64),
        kinetic_energy=curve,
        solver="none",
        substeps=1,
        compile_s=0.0,
        settle_s=0.0,
        solve_s=0.0,
    )


def main() -> None:
    """Print a row for each choice of layers."""
    take = make_take()
    print(f"{FRAMES} frames, {take.positions.shape[1]} vertices, {len(take.colliders)} capsules")
    print(f"{'layers':10} {'ms':>6} {'kB':>8}")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "take.rrd"
        for layers in CHOICES:
            seconds = []
            for _ in range(6):
                start = time.perf_counter()
                take.save(path, layers=layers)
                seconds.append(time.perf_counter() - start)
            name = "all" if layers is None else " ".join(layers) or "none"
            print(f"{name:10} {1e3 * min(seconds[1:]):6.0f} {path.stat().st_size / 1e3:8.0f}")


if __name__ == "__main__":
    main()
