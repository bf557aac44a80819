"""A stiff strip as a pendulum at large angles, its period against the complete elliptic integral.

It hangs from its top row, which is held as a hinge is, and is let go at rest at an angle t0. A rigid body of the moment
of inertia I about the hinge and the weight M g at the distance d from it takes T = 4 sqrt(I / (M g d)) K(sin^2(t0 / 2))
(Landau and Lifshitz, Mechanics, section 11, problem 1, for the simple pendulum of the length I / (M d)), K with the
parameter m, which is the modulus squared. I and d are those of the strip's own vertices, so that what is left is the
error of the time step and what the strip gives way.
"""

import math

import numpy as np

from cape.cloth.cloth import Cloth
from cape.cloth.fabric import Fabric
from cape.report.measured.world.rest import HAND, STILL
from cape.report.measured.world.rows import Row
from cape.run.simulation import Simulation
from cape.run.whereabouts import Diverged
from cape.scene.holding.attachments import attach
from cape.scene.scene import GRAVITY, Scene
from cape.solvers import SOLVERS

TEST = "pendulum"
ANGLES = (30.0, 90.0, 150.0)  # degrees
LENGTH, WIDTH = 0.3, 0.1  # m, in cells of 0.1 m
# So stiff that the strip bends with a period of milliseconds and stretches by 3e-5 under its own pull.
STIFF = Fabric(density=0.2, stretch=1e5, shear=1e4, bend=300.0, damping_time=0.0, bend_damping_time=0.0)
FRAME = 1.0 / 240.0  # s
SUBSTEPS = 64
ALLOWED = 0.005  # of the period
SOURCE = "4 sqrt(I / (M g d)) K(sin^2(t0 / 2)) of a rigid body"


def measure(angle: float, solver: str) -> Row:
    """Swing from an angle [degrees] with a solver, by its name, in double precision."""
    cloth = _strip(math.radians(angle))
    expected = _expected(cloth, math.radians(angle))
    found, result = math.nan, "finished"
    try:
        found = period_of(_swing(cloth, solver, expected))
    except Diverged as error:
        result = f"diverged: {error}"
    return Row(
        test=TEST, subject=f"{angle:g} degrees", variant=solver, quantity="period", unit="s", simulated=found,
        expected=expected, allowed=ALLOWED, relative=True, result=result, source=SOURCE,
    )  # fmt: skip


def period_of(angles: np.ndarray) -> float:
    """Period [s] from angles at each `FRAME` of a swing that is let go at rest: four times its first quarter.

    A swing is straight where it hangs straight down, so that the line between frames finds that time to third order.
    """
    before = np.flatnonzero(angles[:-1] * angles[1:] <= 0.0)
    if len(before) == 0:
        return math.nan
    first = before[0]
    return 4.0 * FRAME * float(first + angles[first] / (angles[first] - angles[first + 1]))


def _strip(angle: float) -> Cloth:
    down = (math.sin(angle), 0.0, -math.cos(angle))
    return Cloth.rectangle(width=WIDTH, height=LENGTH, spacing=WIDTH, fabric=STIFF, right=(0.0, 1.0, 0.0), down=down)


def _expected(cloth: Cloth, angle: float) -> float:
    from scipy.special import ellipk

    masses, radii = cloth.masses(), cloth.pattern[:, 1]
    gravity = float(np.linalg.norm(GRAVITY))
    slow = math.sqrt(masses @ radii**2 / (gravity * (masses @ radii)))
    return 4.0 * slow * float(ellipk(math.sin(angle / 2.0) ** 2))


def _swing(cloth: Cloth, solver: str, period: float) -> np.ndarray:
    """Angles of the lower edge to the vertical at each frame [rad], through a little more than a quarter."""
    hinge, edge = np.flatnonzero(cloth.pattern[:, 1] == 0.0), cloth.pattern[:, 1] > LENGTH - 1e-6
    scene = Scene(cloth, [attach(cloth, HAND, hinge)])
    simulation = Simulation(scene, solver=SOLVERS[solver](precision="double", substeps=SUBSTEPS), threads=1)
    simulation.start(STILL)
    angles = []
    for _ in range(math.ceil(0.3 * period / FRAME)):
        out, _, up = simulation.positions[edge].mean(axis=0)
        angles.append(math.atan2(out, -up))
        simulation.step(STILL, FRAME)
    return np.array(angles)
