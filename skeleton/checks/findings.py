"""What a check finds: a sentence, and what it is about as data."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from motions.border import checked

Kind = Literal["glitch", "speed", "crossing", "floor", "unit", "start"]


@checked
@dataclass(frozen=True)
class Finding:
    """Something about a motion that deserves a look.

    Attributes:
        kind: "glitch" for frames out of line, "speed" for motion beyond human limits, "crossing" for limbs that pass
            through each other, "floor" for feet under or off it, "unit" for a doubt about the scale, "start" for what
            overlaps before the first step.
        text: what was found, where and when, as a sentence.
        figure: how much of it, in `unit`.
        unit: of the figure.
        frames: first and last frame of where it is worst, None for the motion as a whole.
        parts: names of the bones or colliders that it is about.
    """

    kind: Kind
    text: str
    figure: float
    unit: str
    frames: tuple[int, int] | None
    parts: tuple[str, ...]


def runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of each run of true values among flags (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]])))
    return [(int(first), int(after) - 1) for first, after in zip(edges[::2], edges[1::2], strict=True)]


def run_of(flags: NDArray[np.bool_], index: int) -> tuple[tuple[int, int], int]:
    """The run of true values that holds an index, and how many other runs there are."""
    all_runs = runs(flags)
    return next(run for run in all_runs if run[0] <= index <= run[1]), len(all_runs) - 1


def in_frames(run: tuple[int, int], others: int = 0) -> str:
    """In words: "at frame 7", or "in frames 7 to 9, and 2 more times"."""
    first, last = run
    when = f"at frame {first}" if first == last else f"in frames {first} to {last}"
    return when + (f", and {others} more time{'s' if others > 1 else ''}" if others else "")
