"""Chains of springs: how many carry a cloth's weight."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.assembly.geodesics import geodesic_distances
from cape.kernels.tearing.ways import Ways


@dataclass(frozen=True)
class Chain:
    """The longest chain of springs between what holds a cloth and its farthest vertex.

    Attributes:
        length: [m].
        springs: their number N, not less than 1.
        gravity: [m/s2].
    """

    length: float
    springs: float
    gravity: float

    @property
    def sag(self) -> float:
        """What one sweep a step leaves a hanging chain too long by, over the square of the step [m/s2]: g N^2.

        In a step of h gravity gives each vertex a velocity of g h, and one sweep over a chain of N springs takes back
        what an impulse C / (h (w + w')) does, for a length C too much of a spring between vertices of inverse masses w
        and w'. The spring above n vertices of mass m must bear n m g h, so that it is too long by C = 2 n g h^2: in sum
        by g h^2 N^2, less what springs swept one after the other pass on, about half of it.
        """
        return self.gravity * self.springs**2


def spacing_of(assembly: Assembly) -> float:
    """How long springs along threads are at rest [m]: the median."""
    return float(np.median(assembly.springs.rest[assembly.springs.measured]))


def chain_of(assembly: Assembly, ways: Ways | None = None, spacing: float | None = None) -> Chain:
    """Find the longest chain of a cloth; of one that nothing holds, half its side.

    `ways_of` it are given where they have been measured, and its `spacing_of` where that is known.
    """
    springs, cloth, held = assembly.springs, assembly.cloth, _held(assembly) if ways is None else ways.held
    spacing = spacing_of(assembly) if spacing is None else spacing
    if len(held):
        distances = geodesic_distances(cloth, held, springs=springs)[0] if ways is None else ways.distances
        length = float(distances[np.isfinite(distances)].max())
    else:
        length = 0.5 * spacing * math.sqrt(assembly.in_use)
    gravity = float(np.linalg.norm(assembly.scene.gravity))
    return Chain(length, max(length / spacing, 1.0), gravity)


def ways_of(assembly: Assembly) -> Ways:
    """The springs of a cloth, and room for how far its vertices are from what holds it, to be measured by a kernel."""
    springs, count = assembly.springs, assembly.cloth.vertices
    ends = springs.first, springs.second, springs.rest
    return Ways(*ends, _held(assembly), np.zeros(count), np.zeros(count, np.int64))


def _held(assembly: Assembly) -> NDArray[np.int64]:
    """Vertices that bones hold, hard or not (n,)."""
    fixed = np.flatnonzero(~assembly.free[: assembly.in_use])
    return np.unique(np.concatenate([fixed, *(carried.vertices for carried in assembly.carried)]))
