"""Brings a cloth to rest: where the energy of its stretch, its bending and its weight is least.

From a state without velocity a step h of backward Euler ends where E(x) + |x - x0|^2 M / 2 h^2 is stationary, by
algebra from its equations. The first step of its Newton method, z = -(K + M / h^2)^-1 dE/dx with K the stiffness of the
implicit solvers, leads downhill, and for a long h about as far as the cloth is from rest. K leaves out what compression
takes from it, and a cloth that buckles is in a valley of that energy, soft along, stiff across and curved, where such
steps are short and many. They are made the gradients of nonlinear conjugate gradients (Polak and Ribiere's, begun anew
where their factor is negative: Nocedal and Wright 2006, section 5.2), each direction followed to where its slope is
little. The rest so found is that of the forces which all solvers share, and of
no step.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cape.report.measured.world.forces import Forces
from cape.run.simulation import Simulation
from cape.scene.poses import Pose
from cape.scene.scene import Scene
from cape.solvers import BackwardEuler

FloatArray = NDArray[np.float64]

FALLING = 0.005  # s, of the steps in which a cloth falls: their own damping stands for the air's
SLOW = 5e-5  # m, by which a cloth that has fallen moves in a step
WITHIN = 1e-5  # m, to which such steps are solved
LONG = 1.0  # s, in which every cloth comes to rest
NEWTON = BackwardEuler(substeps=1, iterations=1, tolerance=1.0)  # a step of Newton's method alone
# How far its linear system is solved: at first what is left the next directions make good; then it tells how far the
# cloth is from rest, also in modes so slow that next to no force is left of them.
ROUGHLY, SURELY = 0.05, 1e-3
LEVEL = 0.3  # share of the slope at the start of a line, at which a place on it will do
FARTHER = 3.0  # times as far at most, as the place before
NARROWEST, WIDEST = 0.1, 0.9  # share of what is left of a line that a place is looked for in
TRIES = 8  # places on a line at most
HAND = "hand"  # the bone that holds the cloth, at the world's origin
STILL = Pose(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]))


def started(scene: Scene) -> Simulation:
    """A simulation of a scene whose one bone, if any, stands still."""
    simulation = Simulation(scene, solver=BackwardEuler(substeps=1, tolerance=WITHIN), threads=1)
    simulation.start(Pose(*(part[: len(scene.bones)] for part in STILL)))
    return simulation


def fall(simulation: Simulation, steps: int) -> None:
    """Let a cloth fall, in so many steps at most, so that what buckles does so as a falling cloth.

    Raises:
        Diverged: it explodes.
    """
    for _ in range(steps):
        before = simulation.positions
        simulation.step(STILL, FALLING)
        if float(np.abs(simulation.positions - before).max()) < SLOW:
            return


def relax(simulation: Simulation, forces: Forces, *, within: float = 1e-6, patience: int = 3000) -> bool:
    """Bring a cloth to rest on a bone that stands still, and tell whether it came there.

    Args:
        simulation: by `started`, which goes on with another solver.
        forces: of its cloth.
        within: how far a Newton step would still move a vertex [m].
        patience: directions at most.

    Raises:
        Diverged: it explodes.
    """
    weight = simulation.scene.cloth.masses()[:, None] * np.asarray(simulation.scene.gravity)
    free = simulation.assembly.outwards(simulation.assembly.inverse_mass)[:, None] > 0.0
    still = np.zeros_like(weight)

    def pull(places: FloatArray) -> FloatArray:
        return np.where(free, forces(places) + weight, 0.0)

    for forcing in (ROUGHLY, SURELY):
        simulation.change_solver(replace(NEWTON, forcing=forcing))
        places, force = simulation.positions, pull(simulation.positions)
        way, force_before, gain_before = still, force, np.inf
        for _ in range(patience):
            simulation.draw(places, still, 1.0)
            simulation.step(STILL, LONG)
            newton = simulation.positions - places
            if float(np.abs(newton).max()) < within:
                break
            share = max(0.0, float(np.sum((force - force_before) * newton)) / gain_before)
            way = newton + share * way
            if float(np.sum(force * way)) <= 0.0:
                way = newton
            force_before, gain_before = force, float(np.sum(force * newton))
            places, force = _along(places, way, force, pull)
        else:
            return False
    return True


def _along(
    places: FloatArray, way: FloatArray, force: FloatArray, pull: Callable[[FloatArray], FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Where the force along a way is little, and the forces there: by secants, within what is known to be downhill."""
    first = pulled = float(np.sum(force * way))
    near, far, pushed, share = 0.0, np.inf, 0.0, 1.0
    there, found = places, force
    for _ in range(TRIES):
        there = places + share * way
        found = pull(there)
        slope = float(np.sum(found * way))
        if abs(slope) < LEVEL * first:
            break
        if slope < 0.0:
            far, pushed = share, slope
        else:
            ahead = (share - near) * slope / (pulled - slope) if slope < pulled else np.inf
            near, pulled, share = share, slope, min(share + ahead, FARTHER * share)
        if far < np.inf:
            share = near + (far - near) * min(max(pulled / (pulled - pushed), NARROWEST), WIDEST)
    return there, found
