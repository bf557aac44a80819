"""Limp cloth and solvers in steps so short, or solved so well, that closed forms tell what they do."""

import pytest

from cape import TRBDF2, XPBD, BackwardEuler, Fabric, SymplecticEuler

G = 9.81  # m/s2
FRAME = 1 / 60  # s
EVERY = (
    SymplecticEuler(precision="double", substeps=20),
    XPBD(precision="double", substeps=20),
    BackwardEuler(tolerance=1e-11, forcing=1e-6, substeps=20),
    TRBDF2(tolerance=1e-11, forcing=1e-6, substeps=20),
)
every_solver = pytest.mark.parametrize("solver", EVERY, ids=lambda s: s.name)
LIMP = Fabric(density=0.2, stretch=50.0, shear=10.0, bend=1e-4, damping_time=0.0, bend_damping_time=0.0)
