"""What becomes of a cape on robots: every shipped clip on each of them, and motions of their own.

`python -m tests.bench.characters [--robot g1 ...] [--clip walk ...] [--solver euler] [--varied 8]` prints a row for
each run, and as many more as `--varied` says with fabric lighter by 0.001 % each, as pinches hang on the last digit:
how far hands and feet are from the scaled source (RMS and at most), deepest penetration, largest stretch, speed in
times real time, and the result. Motions of one's own (`CAPE_CLIPS`, a folder with g1_*.csv) run on the G1.
"""

import argparse
import os
import time
from pathlib import Path

import numpy as np

import cape
import motions
from skeleton import Hitboxes, RobotMotion, Skeleton, hitboxes_of, load_configurations, retarget

ROBOTS = ("g1", "talos", "human")
LIMBS = ("hand", "foot")
MOST_FPS = 60.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", action="append", choices=ROBOTS)
    parser.add_argument("--clip", action="append")
    parser.add_argument("--solver", default="euler")
    parser.add_argument("--varied", type=int, default=0)
    asked = parser.parse_args()
    print("| robot | motion | hands, feet: RMS, at most | penetration | stretch | x real time | retarget | result |")
    print("|---|---|---|---|---|---|---|---|")
    for name in asked.robot or ROBOTS:
        body = Skeleton.from_urdf(name)
        begun = time.perf_counter()
        hitboxes = hitboxes_of(body)
        print(f"| {name} | {len(hitboxes.solids)} hitboxes in {time.perf_counter() - begun:.1f} s | | | | | | |")
        for clip_name in asked.clip or motions.clip_names():
            clip = motions.load(clip_name)
            clip = clip.resample(MOST_FPS) if clip.fps > MOST_FPS else clip
            begun = time.perf_counter()
            found = retarget(clip, body, hitboxes=hitboxes)
            spent = time.perf_counter() - begun
            errors = [e for role, e in found.errors.items() if role.rpartition("_")[2] in LIMBS]
            off = f"{100 * max(e.rms for e in errors):.1f}, {100 * max(e.max for e in errors):.1f} cm"
            report(name, clip_name, body, hitboxes, found.motion, asked.solver, off, f"{spent:.1f} s")
            for k in range(1, asked.varied + 1):
                report(name, clip_name, body, hitboxes, found.motion, asked.solver, "", "", lighter=1e-5 * k)
        if name == "g1" and not asked.clip and (folder := os.environ.get("CAPE_CLIPS")):
            for path in sorted(Path(folder).glob("g1_*.csv")):
                report(name, path.stem, body, hitboxes, load_configurations(path, body), asked.solver, "", "")


def report(
    robot: str,
    motion_name: str,
    body: Skeleton,
    hitboxes: Hitboxes,
    motion: RobotMotion,
    solver: str,
    off: str,
    spent: str,
    *,
    lighter: float = 0.0,
) -> None:
    """Hang a cape on the robot, of fabric lighter by a share, and print what came of it."""
    track = body.track(motion)
    fabric = cape.Fabric(density=(1.0 - lighter) * cape.Fabric().density)
    scene = cape.dress(body, track, garment="back_cape", colliders=hitboxes.solids, fabric=fabric)
    take = cape.simulate(scene, track, solver=cape.solver(solver), name=motion_name)
    span = float(take.bones.times[-1] - take.bones.times[0])
    finite = "" if np.isfinite(take.positions).all() else "not finite, "
    print(
        f"| {robot} | {motion_name} | {off} | {1e3 * take.penetration.max():.1f} mm | {take.stretch_max.max():.1%} "
        f"| {span / take.solve_s:.1f} | {spent} | {finite}{take.result} {'; '.join(take.warnings)} |",
        flush=True,
    )


if __name__ == "__main__":
    main()
