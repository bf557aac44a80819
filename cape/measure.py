"""Measures of a running cloth: strain, penetration, kinetic energy."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cape.assemble import Assembly
from cape.kernels import measure
from cape.kernels.records import Array, State

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Reading:
    """A cloth at one instant.

    Attributes:
        stretch: largest strain along the threads.
        penetration: deepest penetration of a vertex that no bone holds [m].
        collider: index of the collider it is in, -1 for none.
        kinetic_energy: [J].
    """

    stretch: float
    penetration: float
    collider: int
    kinetic_energy: float


@dataclass(eq=False)
class Meter:
    """Reads a cloth frame by frame, and keeps a histogram of all strains."""

    assembly: Assembly
    histogram: NDArray[np.int64] = field(default_factory=lambda: np.zeros(measure.BINS, dtype=np.int64))

    def __post_init__(self) -> None:
        """Collect the springs along the threads."""
        springs = self.assembly.springs
        chosen = springs.measured
        self._first, self._second, self._rest = springs.first[chosen], springs.second[chosen], springs.rest[chosen]

    def read(self, state: State, positions: FloatArray, rotations_wxyz: FloatArray) -> Reading:
        """Measure the state with the bones at positions [m] (B, 3) and rotations bone_to_world (B, 4)."""
        stretch = measure.strain(state.x, state.y, state.z, self._first, self._second, self._rest, self.histogram)
        penetration, collider = deepest(
            self.assembly, state[:3], self.assembly.contacts.free, (positions, rotations_wxyz)
        )
        return Reading(
            stretch=float(stretch),
            penetration=penetration,
            collider=collider,
            kinetic_energy=float(measure.kinetic_energy(self.assembly.mass, state.vx, state.vy, state.vz)),
        )

    def stretch_quantile(self, share: float) -> float:
        """Strain that a share of all strains read so far does not exceed, to a bin of the histogram (1e-4)."""
        counts = np.cumsum(self.histogram)
        if counts[-1] == 0:
            return 0.0
        return float((np.searchsorted(counts, share * counts[-1]) + 1) * measure.WIDEST / measure.BINS)


def deepest(
    assembly: Assembly,
    vertices: tuple[Array, Array, Array],
    counted: NDArray[np.bool_],
    bones: tuple[FloatArray, FloatArray],
    *,
    margin: float = 0.0,
) -> tuple[float, int]:
    """Find the deepest penetration of points into the scene's colliders.

    Args:
        assembly: whose colliders.
        vertices: x, y and z in the world [m], each of shape (N,).
        counted: which of them count, shape (N,).
        bones: positions in the world [m] (B, 3) and rotations bone_to_world wxyz (B, 4).
        margin: by how much the colliders are grown [m].

    Returns:
        The depth [m], 0 where no point is inside, and the index of the collider, -1 for none.
    """
    positions, rotations_wxyz = bones
    matrices = np.zeros((len(positions), 3, 3))
    measure.place_bones(positions, rotations_wxyz, matrices)
    contacts = assembly.contacts
    groups = (
        (measure.depth_in_capsules, contacts.capsules),
        (measure.depth_in_planes, contacts.planes),
        (measure.depth_in_boxes, contacts.boxes),
    )
    most, collider = 0.0, -1
    for order, (depth_in, shapes) in zip(assembly.collider_order, groups, strict=True):
        if shapes is None:
            continue
        depth, which = depth_in(*vertices, counted, shapes, margin, positions, matrices)
        if depth > most:
            most, collider = float(depth), order[which]
    return most, collider
