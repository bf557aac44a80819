"""A part of the motion that a run has taken, and what its frames tell of the error in it."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.run.auto.ahead import Coming
from cape.run.whereabouts import Mark

STILL = 1e-3  # m/s: of less than this, changes of velocity tell nothing but rounding


class End(NamedTuple):
    """Where a part has ended [m], (V, 3), in steps of a length of a solver."""

    solver: str
    length: float
    positions: NDArray[np.float64]


class Part:
    """The frames of a part, in their order.

    Attributes:
        start: where it began.
        frames: each with the number of its steps.
    """

    def __init__(self, start: Mark) -> None:
        """Begin where a run is marked."""
        self.start = start
        self.frames: list[tuple[Coming, int]] = []
        self._before, self._squares = start.frame.moment.state[3:], 0.0

    def note(self, coming: Coming, substeps: int, velocities: Sequence[NDArray[np.floating]]) -> None:
        """Note a frame that the run has taken in so many steps, and the velocities at its end [m/s], three of (N,)."""
        changes = [after - before for after, before in zip(velocities, self._before, strict=True)]
        self._squares += sum(float(change @ change) for change in changes) / changes[0].size
        self._before = tuple(component.copy() for component in velocities)
        self.frames.append((coming, substeps))

    @property
    def seconds(self) -> float:
        """How long it is [s]."""
        return sum(coming.dt for coming, _ in self.frames)

    @property
    def jolt(self) -> float:
        """By how much velocities have changed in a frame, root mean square over vertices and frames [m/s].

        What touches a cloth shakes it, and steps miss when exactly: errors are about in proportion.
        """
        return max(math.sqrt(self._squares / max(len(self.frames), 1)), STILL)

    @property
    def fewest(self) -> int:
        """The number of steps in the frame that has the fewest."""
        return min(substeps for _, substeps in self.frames)
