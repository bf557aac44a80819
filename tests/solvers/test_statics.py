"""Cloth at rest against closed forms: catenary, own weight, cantilever; its stiffness as energies of pure strains."""

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np
import pytest

from cape import Cloth, Fabric, Scene, attach
from cape.assembly.grid.springs import LEAST_SHARE
from cape.assembly.springs import springs_of
from cape.solvers import Solver
from tests.support.scenes import Run, bend_energy, both_solvers, grid_cloth, mesh_cloth, spring_energy

G = 9.81  # m/s2
UNEVEN = (np.array([0, 0.05, 0.13, 0.16, 0.26]), np.array([0, 0.07, 0.1, 0.2]))


def strained(cloth: Cloth, gradient: list[list[float]]) -> np.ndarray:
    """Positions after a uniform strain: the pattern times a displacement gradient, in the world's x-y plane."""
    flat = cloth.pattern @ (np.eye(2) + np.array(gradient)).T
    return np.column_stack([flat, np.zeros(len(flat))])


STRAIN = 1e-5
STRAINS = {
    "along a row": ([[STRAIN, 0], [0, 0]], "stretch"),
    "down a column": ([[0, 0], [0, STRAIN]], "stretch"),
    "shear": ([[0, STRAIN], [0, 0]], "shear"),
    "shear the other way": ([[0, 0], [-STRAIN, 0]], "shear"),
}


@pytest.mark.parametrize("threads", [(np.linspace(0, 0.4, 5), np.linspace(0, 0.3, 6)), UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("strain", STRAINS)
def test_a_uniform_strain_stores_the_energy_of_the_fabric(threads: tuple[np.ndarray, np.ndarray], strain: str):
    fabric = Fabric(stretch=1000.0, shear=80.0)
    cloth = grid_cloth(*threads, fabric)
    gradient, property_name = STRAINS[strain]
    area = np.ptp(threads[0]) * np.ptp(threads[1])
    expected = 0.5 * getattr(fabric, property_name) * STRAIN**2 * area
    # Terms of the next order in the strain of 1e-5, with a geometric factor of a few.
    assert spring_energy(cloth, strained(cloth, gradient)) == pytest.approx(expected, rel=1e-4)


THREADS = {
    "weft": ([[STRAIN, 0], [0, 0]], 400.0),
    "warp": ([[0, 0], [0, STRAIN]], 1500.0),
    "both": ([[STRAIN, 0], [0, STRAIN]], 400.0 + 1500.0 + 2 * 20.0),  # Cauchy: what couples them is the shear
    "shear": ([[0, STRAIN], [0, 0]], 20.0),
}


@pytest.mark.parametrize("threads", [(np.linspace(0, 0.4, 5), np.linspace(0, 0.3, 6)), UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("strain", THREADS)
def test_warp_and_weft_store_energy_each_by_its_own_stretch(threads: tuple[np.ndarray, np.ndarray], strain: str):
    gradient, stiffness = THREADS[strain]
    cloth = grid_cloth(*threads, Fabric(stretch=(1500.0, 400.0), shear=20.0))
    expected = 0.5 * stiffness * STRAIN**2 * np.ptp(threads[0]) * np.ptp(threads[1])
    # As above; 20 N/m are lost among those of the next order of 1,500 N/m the sooner.
    assert spring_energy(cloth, strained(cloth, gradient)) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("strain", THREADS)
def test_a_split_grid_stores_the_energy_of_either_thread(strain: str):
    gradient, stiffness = THREADS[strain]
    cloth = mesh_cloth(np.linspace(0, 0.4, 9), np.linspace(0, 0.4, 9), Fabric(stretch=(1500.0, 400.0), shear=20.0))
    expected = 0.5 * stiffness * STRAIN**2 * 0.16
    # Patches across cells take up to SHARPNESS of the area, 1e-6 over a squared misfit of some percent.
    energy = spring_energy(cloth, strained(cloth, gradient))
    assert energy == pytest.approx(expected, abs=1e-3 * 0.5 * 1500.0 * STRAIN**2 * 0.16)


def test_both_layers_of_a_doubled_cloth_store_energy():
    one = grid_cloth(*UNEVEN, Fabric())
    two = dataclasses.replace(one, layers=np.full((one.rows - 1, one.columns - 1), 2.0))
    bent = one.positions + 0.01 * np.random.default_rng(1).standard_normal(one.positions.shape)
    assert spring_energy(two, bent) == pytest.approx(2 * spring_energy(one, bent), rel=1e-12)
    assert bend_energy(two, bent) == pytest.approx(2 * bend_energy(one, bent), rel=1e-12)
    assert two.masses().sum() == pytest.approx(2 * one.masses().sum(), rel=1e-12)


def test_a_thread_keeps_a_share_of_its_stiffness_in_long_cells():
    cloth = grid_cloth([0, 1.0], [0, 0.1], Fabric(stretch=1000.0, shear=100.0))
    right = springs_of(cloth).stiffness[0]
    # The formula asks for 1000 - 100 * 10^2 < 0.
    assert right == pytest.approx(0.5 * LEAST_SHARE * 1000.0 * 0.1 / 1.0)


@pytest.mark.parametrize("axis", [0, 1], ids=["across", "down"])
@pytest.mark.parametrize("spacing", [0.02, 0.01])
def test_a_cylinder_stores_the_energy_of_its_curvature(axis: int, spacing: float):
    radius, bend = 0.25, 3e-4
    around, straight = np.linspace(0, 0.4, round(0.4 / spacing) + 1), np.linspace(0, 0.1, 4)
    u, v = (around, straight) if axis == 0 else (straight, around)
    cloth = grid_cloth(u, v, Fabric(bend=bend))
    angle = cloth.pattern[:, axis] / radius
    rolled = np.stack([radius * np.sin(angle), cloth.pattern[:, 1 - axis], radius * np.cos(angle)], axis=1)
    # There is no curvature at the ends: a cell's length is missing from the area.
    area = (0.4 - spacing) * 0.1
    # |p0 - 2 p1 + p2| = 2 R (1 - cos(a / R)) = a^2 / R (1 - a^2 / 12 R^2), squared.
    error = 1.1 * spacing**2 / (6 * radius**2)
    assert bend_energy(cloth, rolled) == pytest.approx(0.5 * bend / radius**2 * area, rel=error)


@pytest.mark.parametrize(("axis", "bend"), [(0, 2e-4), (1, 7e-4)], ids=["weft", "warp"])
@pytest.mark.parametrize("make", [grid_cloth, mesh_cloth])
def test_a_cylinder_stores_the_energy_of_the_thread_that_bends(make: Callable[..., Cloth], axis: int, bend: float):
    radius, spacing = 0.25, 0.01
    around, straight = np.linspace(0, 0.4, 41), np.linspace(0, 0.1, 11)
    u, v = (around, straight) if axis == 0 else (straight, around)
    cloth = make(u, v, Fabric(bend=(7e-4, 2e-4)))
    angle = cloth.pattern[:, axis] / radius
    rolled = np.stack([radius * np.sin(angle), cloth.pattern[:, 1 - axis], radius * np.cos(angle)], axis=1)
    # The area and the error as above; a mesh has the curvature of all its triangles, also along the border, where it is
    # that of some three cells further in, with chords of as much as six cells.
    missing, chords = (0.0, 6.0) if make is mesh_cloth else (spacing, 1.0)
    error = 1.1 * (chords * spacing) ** 2 / (6 * radius**2)
    assert bend_energy(cloth, rolled) == pytest.approx(0.5 * bend / radius**2 * (0.4 - missing) * 0.1, rel=error)


@both_solvers
@pytest.mark.parametrize("rows", [5, 11], ids=["4 cells", "10 cells"])
@pytest.mark.parametrize("width", [0.02, 0.4], ids=["tall cells", "wide cells"])
def test_a_hanging_strip_stretches_under_its_own_weight(solver: Solver, rows: int, width: float):
    density, length = 0.2, 1.0
    # Along a column tension grows by the weight of a cell, which the midpoint rule sums exactly for linear springs.
    fabric = Fabric(density=density, stretch=60.0, shear=0, bend=0, damping_time=1e-4)
    cloth = grid_cloth([0, width / 2, width], np.linspace(0, length, rows), fabric)
    run = Run(Scene(cloth, [attach(cloth, "hand", [0, 1, 2])]), solver)
    run.settle(480, max(100, run.stable_substeps()), damping=0.93)
    expected = density * G * length**2 / (2 * fabric.stretch_warp)
    elongation = -run.positions[-2, 2] - length
    # Exact but for what is left of the motion. XPBD's single sweep per step leaves constraints unsolved by a share of
    # (w h)^2 with w below 2 sqrt(Y / rho) / 0.1 m = 350 rad/s and h = 0.17 ms.
    assert elongation == pytest.approx(expected, rel=2e-6 if solver.name == "euler" else 0.004)


def catenary(length: float, span: float, points: np.ndarray) -> np.ndarray:
    """Heights, below the supports [m], of points at the given lengths along a chain hanging between equal heights."""
    low, high = 0.05, 10.0
    a = high
    while high - low > 1e-12:
        a = (low + high) / 2
        low, high = (a, high) if 2 * a * np.sinh(span / 2 / a) > length else (low, a)
    along = points - length / 2
    # Arc length from the lowest point is a sinh(x / a); the height is a cosh(x / a) = sqrt(a^2 + s^2).
    return np.sqrt(a**2 + along**2) - np.sqrt(a**2 + (length / 2) ** 2)


@both_solvers
def test_a_strip_held_at_both_ends_hangs_in_a_catenary(solver: Solver):
    length, span, cells = 1.0, 0.6, 20
    fabric = Fabric(density=0.2, stretch=5000.0, shear=0, bend=0, damping_time=1e-4)
    straight = grid_cloth(np.linspace(0, length, cells + 1), [0, 0.1], fabric, down=(0, 1, 0))
    # Start in a V of the right length, its ends `span` apart.
    u = straight.pattern[:, 0]
    folded = straight.positions.copy()
    folded[:, 0] = span * u / length
    folded[:, 2] = -np.minimum(u, length - u) * np.sqrt(1 - (span / length) ** 2)
    strip = dataclasses.replace(straight, positions=folded)
    ends = [0, cells, cells + 1, 2 * cells + 1]
    run = Run(Scene(strip, [attach(strip, "hand", ends)]), solver)
    run.settle(240, 2 * run.stable_substeps())
    sag = run.positions[: cells + 1, 2]
    np.testing.assert_allclose(sag, run.positions[cells + 1 :, 2], atol=1e-6)
    # A link of l = 50 mm spans an arc of curvature up to 1 / a = 1 / 0.25 m: it lies off by l^2 / 8 a = 1.3 mm at most.
    # Tension, at most 1 N/m, stretches by 2e-4: a few tenths of a millimetre in a sag of 0.37 m.
    expected = catenary(length, span, u[: cells + 1])
    np.testing.assert_allclose(sag, expected, atol=0.0015)
    assert -expected.min() > 0.35


@both_solvers
def test_a_clamped_strip_sags_as_a_beam(solver: Solver):
    density, bend, gravity, length, cells = 0.1, 0.01, 0.07, 0.5, 15
    fabric = Fabric(density=density, stretch=100.0, shear=0, bend=bend, damping_time=0, bend_damping_time=0)
    spacing = length / cells
    strip = grid_cloth(np.linspace(0, length, cells + 1), [0, 0.05], fabric, down=(0, 1, 0))
    clamp = [0, 1, cells + 1, cells + 2]
    run = Run(Scene(strip, [attach(strip, "hand", clamp)], gravity=(0, 0, -gravity)), solver)
    run.settle(300, (8 if solver.name == "xpbd" else 1) * run.stable_substeps())
    # The slope is zero between the two clamped rows, from where the beam counts.
    expected = density * gravity * (length - spacing / 2) ** 4 / (8 * bend)
    assert expected < 0.01 * length
    # Both corners together carry what half a cell weighs. Second differences and lumped loads are of second order,
    # 1 / 15^2; XPBD's single sweep leaves a share of (w h)^2 with w = 4 sqrt(B / rho) / a^2 = 1140/s and h = 0.1 ms.
    tolerance = (1 / cells) ** 2 + (0.01 if solver.name == "xpbd" else 0.0)
    assert -run.positions[[cells, -1], 2].mean() == pytest.approx(expected, rel=tolerance)


@both_solvers
def test_an_unloaded_cloth_stays_as_cut(solver: Solver):
    cloth = grid_cloth([0, 0.05, 0.1, 0.15, 0.2], [0, 0.07, 0.14], Fabric())
    run = Run(Scene(cloth, [attach(cloth, "hand", range(5))], gravity=(0, 0, 0)), solver)
    for _ in range(10):
        run.step(1 / 60, run.stable_substeps())
    np.testing.assert_allclose(run.positions, cloth.positions, atol=1e-13)


def test_stiffness_is_never_negative():
    shares = np.array([0.1, 0.5, 1.0, 2.0, 10.0])
    for a, b in itertools.product(shares, shares):
        springs = springs_of(grid_cloth([0, a, 2 * a], [0, b, 2 * b], Fabric(stretch=100.0, shear=90.0)))
        assert (springs.stiffness >= 0).all()
        assert (springs.bend_stiffness >= 0).all()
