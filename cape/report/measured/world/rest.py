"""Brings a cloth to rest with the implicit solver, in steps that grow as far as they are solved.

From a state without velocity a step h of backward Euler ends where E(x) + |x - x0|^2 M / 2 h^2 is stationary, by
algebra from its equations: it descends the energy of the cloth and its weight, and what is left of a mode of angular
frequency w shrinks by 1 + w^2 h^2 in each. The rest so found is that of the forces which all solvers share, and of no
step.
"""

import numpy as np

from cape.report.measured.braking import brake
from cape.run.simulation import Simulation
from cape.scene.poses import Pose
from cape.scene.scene import Scene
from cape.solvers import BackwardEuler

FIRST = 0.02  # s
FALLING = 0.005  # s, of the steps in which a cloth falls, at most: their own damping stands for the air's
SLOW = 5e-5  # m, by which a cloth that has fallen moves in a step
LONGEST = 0.2  # s
SHORTER, LONGER = 0.5, 1.5  # next step after one that was hard to solve, and after any other
HAND = "hand"  # the bone that holds the cloth, at the world's origin
STILL = Pose(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]))


def started(scene: Scene, *, tolerance: float = BackwardEuler.tolerance) -> Simulation:
    """A simulation of a scene whose one bone, if any, stands still, its steps solved to a tolerance [m]."""
    simulation = Simulation(scene, solver=BackwardEuler(substeps=1, tolerance=tolerance), threads=1)
    simulation.start(Pose(*(part[: len(scene.bones)] for part in STILL)))
    return simulation


def relax(simulation: Simulation, *, falls: int = 0, within: float = 1e-6, patience: int = 900) -> bool:
    """Bring a cloth to rest on a bone that stands still, and tell whether it came there.

    Args:
        simulation: by `started`.
        falls: steps at most in which it keeps its velocity, so that what buckles does so as a falling cloth.
        within: how far a vertex moves in the last step, of `LONGEST` [m].
        patience: steps at most.

    Raises:
        Diverged: it explodes.
    """
    falling = falls > 0
    step = FALLING if falling else FIRST
    for count in range(patience):
        before = simulation.positions
        simulation.step(STILL, step)
        moved = float(np.abs(simulation.positions - before).max())
        if not falling and step >= LONGEST and moved < within:
            return True
        hard = simulation.refined + simulation.unconverged + simulation.retried > 0
        falling = falling and count < falls and moved > SLOW
        brake(simulation, 1.0 if falling else 0.0)  # which also counts anew
        step = SHORTER * step if hard else min(LONGER * step, FALLING if falling else LONGEST)
    return False
