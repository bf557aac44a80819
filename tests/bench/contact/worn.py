"""How the default cape sits and holds in many motions, and how far that hangs on the last digit.

`python -m tests.bench.contact.worn [--clip walk ...] [--varied 8] [--frames 120]` prints a row for each motion, and as
many more as `--varied` says with fabric lighter by 0.001 % each: what limbs pinch, and where folds fall, hang on the
last digit. Motions are the shipped ones and, in a folder that `CAPE_CLIPS` names, BVH files, and the G1's g1_*.csv.

Told are the share of frames in which both shoulders are covered, the largest gap of the collar, folds of the hem at
rest and in the first frame, the largest stretch and the 99th percentile, that percentile at rest and how many times its
weight pulls at whatever the chest carries in all but 1 % of the frames, the deepest penetration, the share of frames in
which layers are crossed, and times real time, by the time of one core that frames take.

At rest is on a body that stands as the cape is put on, with lowered arms and in still air: in the first frame one that
runs has it blown out by its own wind, and spread arms stretch it like a tent. Strains by weight grow with the load, to
that at rest times so many; what is beyond that limbs have drawn out.
"""

import argparse
import os
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

import cape
import motions
from cape.assembly.putting_on import dressing_pose
from cape.assembly.springs import springs_of
from cape.cli.character import Character, read_character
from cape.cli.reading import Reading
from cape.measure.self_crossings import share_crossed
from cape.measure.wearing import folds
from cape.results.fit import fit_of
from cape.scene.poses import Pose, poses_of
from skeleton.track import BoneTrack

LOOKED_AT = 60  # frames in which layers may be crossed
LIGHTER = 1e-5
OVER = 0.05  # s to either side, over which an acceleration is taken
GRAVITY = 9.81  # m/s2


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clip", action="append")
    parser.add_argument("--varied", type=int, default=0)
    parser.add_argument("--frames", type=int)
    asked = parser.parse_args()
    print(
        "| motion | covered | collar | folds, first | stretch, 99 % | at rest, load "
        "| penetration | crossed | x real time |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name, reading in readings(asked.clip):
        who = read_character(reading)
        for k in range(asked.varied + 1):
            report(f"{name} {k}" if asked.varied else name, who, k * LIGHTER, asked.frames)


def readings(chosen: list[str] | None) -> Iterator[tuple[str, Reading]]:
    """The motions of those names, or all there are."""
    found = {name: Reading(name) for name in motions.clip_names()}
    if folder := os.environ.get("CAPE_CLIPS"):
        found |= {path.stem: Reading(str(path)) for path in sorted(Path(folder).glob("*.bvh"))}
        found |= {path.stem: Reading(str(path), skeleton="g1") for path in sorted(Path(folder).glob("g1_*.csv"))}
    for name in chosen or found:
        yield name, found[name]


def report(name: str, who: Character, lighter: float, frames: int | None) -> None:
    """Have somebody wear the default cape, of fabric lighter by a share, and print what came of it."""
    track = who.track if frames is None else who.track.first(min(frames, who.track.frames))
    fabric = replace(cape.Fabric(), density=(1.0 - lighter) * cape.Fabric().density)
    scene = cape.dress(who.body, track, colliders=who.hitboxes.solids, fabric=fabric)
    spent: list[float] = []
    take = cape.simulate(scene, track, threads=1, name=name, progress=lambda *_: spent.append(time.process_time()))
    fit, still = fit_of(take, scene.cloth, scene.wearer), at_rest(scene, track)
    crossed = share_crossed(take.positions, take.triangles_at, most=LOOKED_AT)
    span = float(take.bones.times[-1] - take.bones.times[1])
    pace = span / (spent[-1] - spent[0]) if len(spent) > 1 else np.nan
    covered = "" if fit.shoulders_covered is None else f"{fit.shoulders_covered:.2f}"
    gap = "" if fit.collar_gap is None else f"{1e3 * fit.collar_gap:.0f} mm"
    print(
        f"| {name} | {covered} | {gap} | {still.folds}, {fit.folds} "
        f"| {take.stretch_max.max():.2%}, {take.stretch_p99:.2%} | {still.strain:.2%}, {load_of(track):.1f} "
        f"| {1e3 * take.penetration.max():.1f} mm | {crossed:.0%} | {pace:.1f} |",
        flush=True,
    )


class AtRest(NamedTuple):
    """A cape on a body that stands as the cape is put on: folds of its hem, and the 99th percentile of its strains."""

    folds: int
    strain: float


def at_rest(scene: cape.Scene, track: BoneTrack) -> AtRest:
    """Have the cape come to rest there."""
    simulation = cape.Simulation(scene)
    pose = dressing_pose(scene, poses_of(track.first(1), simulation.bones)[0])
    simulation.start(Pose(pose.positions[:-1], pose.rotations_wxyz[:-1]))  # the last is the world's
    left, right, pelvis = (pose.positions[scene.bones.index(bone)] for bone in scene.wearer)
    trunk = (left + right) / 2.0 - pelvis
    places, springs = simulation.positions, springs_of(scene.cloth)
    strains = np.linalg.norm(places[springs.second] - places[springs.first], axis=1) / springs.rest - 1.0
    strains = strains[springs.measured]
    hem = places[scene.cloth.region("bottom")]
    return AtRest(folds(hem, pelvis, trunk / np.linalg.norm(trunk)), float(np.percentile(strains, 99)))


def load_of(track: BoneTrack) -> float:
    """How many times its own weight whatever the chest carries pulls at it, in all but 1 % of the frames."""
    times, places = track.times, track.positions[:, track.index("chest")]

    def at(when: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(when, times, axis) for axis in places.T], axis=1)

    inner = times[(times >= times[0] + OVER) & (times <= times[-1] - OVER)]
    pull = (at(inner + OVER) - 2.0 * at(inner) + at(inner - OVER)) / OVER**2 + [0.0, 0.0, GRAVITY]
    return float(np.percentile(np.linalg.norm(pull, axis=1), 99) / GRAVITY)


if __name__ == "__main__":
    main()
