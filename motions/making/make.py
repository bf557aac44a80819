"""Makes the shipped clips again: `python -m motions.making.make [FOLDER]`, by default in place of motions/clips."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from motions.bvh.writer import save
from motions.clip import Clip
from motions.making import gait
from motions.making.performances.idle import idle
from motions.making.performances.jump import jump
from motions.making.performances.kick import kick
from motions.making.performances.spin import spin

MAKERS: dict[str, Callable[[], Clip]] = {
    "idle": idle,
    "walk": gait.walk,
    "run": gait.run,
    "jump": jump,
    "kick": kick,
    "spin": spin,
}

DIGITS = 7


def make(folder: Path) -> list[Path]:
    """Write all clips as BVH files into the folder; the same bytes every time."""
    paths = []
    for name, maker in MAKERS.items():
        paths.append(folder / f"{name}.bvh")
        save(_rounded(maker()), paths[-1], digits=DIGITS)
    return paths


def _rounded(clip: Clip) -> Clip:
    """The clip without the last digits, in which processors and mathematical libraries differ."""
    return replace(
        clip,
        root_positions=np.round(clip.root_positions, 7) + 0.0,
        rotations_wxyz=np.round(clip.rotations_wxyz, 8) + 0.0,
    )


if __name__ == "__main__":
    for path in make(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "clips"):
        print(path)
