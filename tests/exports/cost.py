"""What it costs to keep a take of 280 frames and some 1,500 vertices, to read it, and to export it in each format.

    python -m tests.exports.cost

The cape is a real cut, so that its texture is drawn as well; it waves beside the shipped walk with the body's capsules.
Baked to joints it is also told how far the vertices are off.
Of three runs the best counts, in CPU seconds; the first, which imports what a format needs, is left out.
"""

import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import Cloth
from cape.exports import FORMATS
from cape.exports.skinned.fit import fit
from cape.exports.skinned.joints import spread
from cape.results.take import Take
from tests.bench import recording

FRAMES, RUNS = 280, 3
JOINTS = (32, 128)


def make_take() -> Take:
    """The recordings' take with the positions of a waving cape."""
    whole = recording.make_take()
    bones, frames = whole.bones.first(FRAMES), slice(FRAMES)
    cloth = Cloth.cape(spacing=0.0218)
    waves = 0.1 * np.sin(5.0 * bones.times[:, None] + 9.0 * cloth.positions[:, 0])
    positions = np.repeat(cloth.positions[None], FRAMES, axis=0)
    positions[..., 2] += waves + np.random.default_rng(0).normal(scale=1e-3, size=waves.shape)
    return Take(
        name="exports",
        bones=bones,
        colliders=whole.colliders,
        triangles=cloth.triangles,
        texcoords=cloth.texcoords,
        positions=positions.astype(np.float32),
        stretch_max=whole.stretch_max[frames],
        stretch_p99=0.0,
        penetration=whole.penetration[frames],
        penetrated=whole.penetrated[frames],
        kinetic_energy=whole.kinetic_energy[frames],
        solver="none",
        substeps=1,
        compile_s=0.0,
        settle_s=0.0,
        solve_s=0.0,
        cloth=cloth,
    )


def cpu_seconds(work: Callable[[], object]) -> float:
    """The least of several runs after a first one [s]."""
    work()
    taken = []
    for _ in range(RUNS):
        begin = time.process_time()
        work()
        taken.append(time.process_time() - begin)
    return min(taken)


def distances(take: Take, joints: int) -> NDArray[np.float64]:
    """How far joints put the vertices from where they are in a take [m], shape (F, V)."""
    chains = spread(take.positions[0].astype(np.float64), take.triangles, take.held, joints)
    skin = fit(take.positions.astype(np.float64), chains)
    return np.linalg.norm(skin.positions() - take.positions, axis=2)


def main() -> None:
    """Print a row for each format."""
    take = make_take()
    print(f"{FRAMES} frames, {take.positions.shape[1]} vertices, {len(take.colliders)} capsules")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "take.npz")
        print(f"{'keep':6} {cpu_seconds(lambda: take.keep(path)):5.2f} s {path.stat().st_size / 1e6:6.1f} MB")
        print(f"{'load':6} {cpu_seconds(lambda: Take.load(path)):5.2f} s")
        for suffix in FORMATS:
            place = Path(folder, suffix[1:])
            place.mkdir()
            seconds = cpu_seconds(lambda out=place / f"take{suffix}": take.export(out))
            size = sum(file.stat().st_size for file in place.iterdir())
            print(f"{suffix[1:]:6} {seconds:5.2f} s {size / 1e6:6.1f} MB, {len(list(place.iterdir()))} files")
        baked = Path(folder, "baked.glb")
        warnings.simplefilter("ignore")
        for joints in JOINTS:
            seconds = cpu_seconds(lambda count=joints: take.export(baked, joints=count))
            off = 1000.0 * distances(take, joints)
            print(
                f"{seconds:12.2f} s {baked.stat().st_size / 1e6:6.1f} MB, baked to {joints} joints, off by "
                f"{np.sqrt(np.square(off).mean()):.4f} mm (root mean square), {off.max():.3f} mm at most"
            )


if __name__ == "__main__":
    main()
