"""The forces of a cloth's stretch and bending, wherever its vertices are: those of the solvers' own kernels.

They are what vertices at rest gain in momentum in a short explicit step, once nothing holds them and nothing else acts.
"""

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import Cloth
from cape.run.simulation import Simulation
from cape.scene.poses import Pose
from cape.scene.scene import Scene
from cape.solvers import SymplecticEuler

FloatArray = NDArray[np.float64]

INSTANT = 1e-7  # s, in which nothing moves
NOBODY = Pose(np.zeros((0, 3)), np.zeros((0, 4)))


class Forces:
    """Forces of a cloth on its vertices at rest."""

    def __init__(self, cloth: Cloth) -> None:
        """Set out with the `cloth`, wherever it is."""
        self._mass = cloth.masses()[:, None]
        self._still = np.zeros_like(cloth.positions)
        self._free = Simulation(
            Scene(cloth, gravity=(0.0, 0.0, 0.0)), solver=SymplecticEuler(precision="double", substeps=1), threads=1
        )
        self._free.start(NOBODY)

    def __call__(self, places: FloatArray) -> FloatArray:
        """Forces [N] at places (V, 3) [m] of the vertices, shape (V, 3)."""
        self._free.draw(places, self._still, 1.0)
        self._free.step(NOBODY, INSTANT)
        return self._mass * self._free.velocities / INSTANT
