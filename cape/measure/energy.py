"""The energy of a cloth, from the definition of its springs, in double precision."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.forces.registry import forces_of
from cape.kernels.calling import Bound
from cape.kernels.cloth.measure import kinetic_energy
from cape.kernels.state import State

FloatArray = NDArray[np.float64]


class Energy(NamedTuple):
    """Energies [J]: of motion, of stretched and bent springs, and of height, 0 at the origin of the world."""

    kinetic: float
    elastic: float
    potential: float

    @property
    def total(self) -> float:
        """All of it [J]."""
        return self.kinetic + self.elastic + self.potential


def kinetic_energy_of(assembly: Assembly, state: State) -> Bound:
    """What tells the kinetic energy [J] of a state whenever it is called."""
    return Bound(kinetic_energy, assembly.mass, state.vx, state.vy, state.vz)


def energy_of(assembly: Assembly, state: State, origin: FloatArray) -> Energy:
    """Energies of an assembled cloth; positions refer to `origin`, in the world [m], shape (3,)."""
    positions = np.stack(state[:3], axis=1).astype(float)
    mass = assembly.mass
    return Energy(
        kinetic=float(kinetic_energy(mass, state.vx, state.vy, state.vz)),
        elastic=sum(force.energy(assembly, positions) for force in forces_of(assembly.scene)),
        potential=-float(mass @ ((positions + origin) @ np.asarray(assembly.scene.gravity))),
    )
