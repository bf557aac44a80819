"""Bending of a grid is the same in every direction: energies of cylinders, and plates at rest against closed forms."""

import dataclasses

import numpy as np
import pytest

from cape import XPBD, BackwardEuler, Fabric, Scene, SymplecticEuler, attach
from cape.cloth.cloth import GridCloth
from cape.solvers import Solver
from tests.support.scenes import Run, bend_energy, grid_cloth

DIRECTIONS = np.arange(8) * np.pi / 8
DEGREES = [f"{degrees:g} degrees" for degrees in np.rad2deg(DIRECTIONS)]
DENSITY, BEND = 0.1, 0.01
SIZE, CELLS = np.array([0.5, 0.75]), 16


@pytest.mark.parametrize("angle", DIRECTIONS, ids=DEGREES)
@pytest.mark.parametrize("height", [0.01, 0.015], ids=["square cells", "oblong cells"])
def test_a_cylinder_stores_the_same_energy_whatever_the_direction_of_its_axis(angle: float, height: float):
    width, radius, bend, cells = 0.01, 0.5, 3e-4, 60
    cloth = grid_cloth(width * np.arange(cells + 1), height * np.arange(cells + 1), Fabric(bend=bend))
    around, straight = _turned(cloth, angle)
    rolled = np.stack([radius * np.sin(around / radius), straight, radius * np.cos(around / radius)], axis=1)
    expected = 0.5 * bend / radius**2 * np.ptp(cloth.pattern, axis=0).prod()
    # There are no second differences at the border, half a cell wide on each side; chords are shorter than arcs by
    # l^2 / 24 R^2 with l the diagonal of two cells.
    missing, chords = 1.0 / cells, 4.0 * (width**2 + height**2) / radius**2 / 6.0
    assert (1.0 - missing - chords) * expected < bend_energy(cloth, rolled) < (1.0 + 1e-9) * expected


@pytest.mark.parametrize("angle", DIRECTIONS, ids=DEGREES)
def test_a_plate_bends_under_its_weight_as_stiffly_in_every_direction(angle: float):
    """A plate whose border, two vertices wide, is held on the quartic cylinder into which its weight bends a strip.

    D w'''' = q in the direction of bending has the solution w = q t^4 / 24 D, on which differences are exact.
    """
    flat, gravity = _plate(), 0.01
    load, held = DENSITY * gravity, _border(flat, 2)
    across = _turned(flat, angle)[0]
    expected = -load * (across - across.mean()) ** 4 / (24.0 * BEND)
    start = flat.positions.copy()
    start[held, 2] = expected[held]
    plate = dataclasses.replace(flat, positions=start)
    scene = Scene(plate, [attach(plate, "hand", held)], gravity=(0, 0, -gravity))
    run = Run(scene, SymplecticEuler(precision="double"))
    run.settle(100, run.stable_substeps(), damping=0.7)
    # With another rigidity it would hang lower or higher by that share of what a clamped plate sags: 0.0022 q a^4 / D
    # for sides of 1 to 1.5, by second differences on 32 and 48 cells a side. Some 1e-4 of it are left of the motion.
    sag = 0.0022 * load * (SIZE[0] * (1.0 - 2.0 / CELLS)) ** 4 / BEND
    np.testing.assert_allclose(run.positions[:, 2], expected, atol=0.003 * sag)


@pytest.mark.parametrize(
    ("solver", "steps"),
    [(SymplecticEuler(precision="double"), 1.0), (XPBD(precision="double"), 8.0), (BackwardEuler(), 0.1)],
    ids=["euler", "xpbd", "backward Euler"],
)
def test_a_plate_on_simple_supports_sags_as_navier_s(solver: Solver, steps: float):
    """All solvers find the same rest; `steps` are theirs for each that is stable."""
    plate, gravity = _plate(), 0.01
    run = Run(Scene(plate, [attach(plate, "hand", _border(plate, 1))], gravity=(0, 0, -gravity)), solver)
    run.settle(60, int(steps * run.stable_substeps()), damping=0.5)
    expected = -_navier(plate.pattern, DENSITY * gravity / BEND)
    # Second differences are too soft by pi^2 / 12 n^2 for the lowest mode, twice; a load by vertices does less to it by
    # as much, and more to higher ones. XPBD's single sweep leaves a share of (w h)^2, at most 4 / 8^2, of stiff modes.
    tolerance = 2.0 / CELLS**2 + (0.01 if isinstance(solver, XPBD) else 0.0)
    np.testing.assert_allclose(run.positions[:, 2], expected, atol=tolerance * -expected.min())


def _plate() -> GridCloth:
    """A sheet in the world's x-y plane, that a millionth of its size deforms: nothing pulls in it."""
    fabric = Fabric(density=DENSITY, stretch=100.0, shear=10.0, bend=BEND, damping_time=0.0, bend_damping_time=2e-4)
    across, down = np.linspace(0.0, SIZE, CELLS + 1).T
    return grid_cloth(across, down, fabric, down=(0, 1, 0))


def _turned(cloth: GridCloth, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates in the pattern along a direction and across it [m]."""
    return cloth.pattern @ [np.cos(angle), np.sin(angle)], cloth.pattern @ [-np.sin(angle), np.cos(angle)]


def _border(cloth: GridCloth, wide: int) -> np.ndarray:
    """Vertices at most so many from the edges, the edge itself being the first."""
    row, column = np.divmod(np.arange(cloth.vertices), cloth.columns)
    inside = np.minimum(np.minimum(row, cloth.rows - 1 - row), np.minimum(column, cloth.columns - 1 - column))
    return np.flatnonzero(inside < wide)


def _navier(points: np.ndarray, load: float) -> np.ndarray:
    """Deflection of a simply supported plate by a load q, given as q / D: Navier's series.

    w = 16 q / (pi^6 D) sum over odd m, n of sin(m pi x / a) sin(n pi y / b) / (m n (m^2 / a^2 + n^2 / b^2)^2)
    """
    x, y = (np.pi * points / SIZE).T
    result = np.zeros(len(points))
    for m in range(1, 60, 2):
        for n in range(1, 60, 2):
            weight = m * n * (m**2 / SIZE[0] ** 2 + n**2 / SIZE[1] ** 2) ** 2
            result += np.sin(m * x) * np.sin(n * y) / weight
    return 16.0 * load / np.pi**6 * result
