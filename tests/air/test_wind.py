"""The air's force on a cloth against its formula: terminal velocity, lift, and what substeps must not change."""

import numpy as np
import pytest

from cape import Fabric, Scene, Wind
from cape.forces.registry import forces_of
from cape.forces.viscous_air import ViscousAir
from cape.solvers import Solver
from tests.support.scenes import Run, both_solvers, grid_cloth

G = 9.81  # m/s2
FABRIC = Fabric(density=0.2, stretch=500.0, shear=50.0)


def sheet(angle: float, wind: Wind, solver: Solver, *, gravity: float = 0.0) -> Run:
    """A free sheet of half a square metre, its normal turned from +Z towards +X by an angle [rad]."""
    cloth = grid_cloth(
        np.linspace(0, 1.0, 5),
        np.linspace(0, 0.5, 4),
        FABRIC,
        right=(np.cos(angle), 0, -np.sin(angle)),
        down=(0, -1, 0),
    )
    return Run(Scene(cloth, gravity=(0, 0, -gravity), wind=wind), solver)


@both_solvers
@pytest.mark.parametrize("viscous", [0.0, 0.6])
def test_a_falling_sheet_reaches_its_terminal_velocity(solver: Solver, viscous: float):
    wind = Wind(density=1.2, drag=1.1, lift=0.7, viscous=viscous)
    run = sheet(0.0, wind, solver, gravity=G)
    # Drag on each triangle goes to its corners as its mass does, so the sheet falls flat: with d the density,
    # d v' = d g - viscous v - rho/2 Cd v^2, whose right side vanishes at the terminal velocity and at the other root.
    quadratic = wind.density * wind.drag / 2
    root = np.sqrt(viscous**2 + 4 * quadratic * FABRIC.density * G)
    terminal, other = (root - viscous) / (2 * quadratic), -(root + viscous) / (2 * quadratic)
    rate = root / FABRIC.density
    substeps = 20
    for frame in range(1, 121):
        run.step(1 / 60, substeps)
        left = np.exp(-rate * frame / 60)
        expected = -terminal * (1 - left) / (1 - terminal / other * left)
        # First order in the step: at most g h / 2.
        np.testing.assert_allclose(run.velocities[:, 2], expected, atol=G / 60 / substeps / 2)
    # What is left to gain falls to exp(-23), or less, after two seconds.
    np.testing.assert_allclose(run.velocities, np.tile([0, 0, -terminal], (20, 1)), atol=1e-9)


@both_solvers
def test_slow_motion_dies_out_in_viscous_air(solver: Solver):
    # Without any other drag v' = -viscous v / density.
    run = sheet(0.5, Wind(drag=0.0, lift=0.0, viscous=0.5), solver)
    run.state.vx[:] = 0.3
    for frame in range(1, 31):
        run.step(1 / 60, 20)
        # First order: a step of h = 1/1200 s takes (1 - r h) for exp(-r h), r^2 h t / 2 of it away.
        rate, time = 0.5 / FABRIC.density, frame / 60
        np.testing.assert_allclose(run.velocities[:, 0], 0.3 * np.exp(-rate * time), rtol=0.51 * rate**2 * time / 1200)


def test_air_without_viscosity_has_no_skin():
    cloth = grid_cloth(np.linspace(0, 1.0, 3), np.linspace(0, 0.5, 3), FABRIC)
    for viscous in (0.0, 0.025):
        assert (ViscousAir in forces_of(Scene(cloth, wind=Wind(viscous=viscous)))) == (viscous > 0.0)
    assert ViscousAir not in forces_of(Scene(cloth))


@both_solvers
@pytest.mark.parametrize("degrees", [0, 30, 45, 60, 90, 135])
@pytest.mark.parametrize("side", [1, -1], ids=["wind from the front", "wind from behind"])
def test_drag_and_lift_follow_the_angle_of_attack(solver: Solver, degrees: int, side: int):
    angle, speed = np.radians(degrees), 3.0
    wind = Wind(velocity=(0.0, 0.0, side * speed), density=1.3, drag=1.1, lift=0.6, viscous=0.3)
    run = sheet(angle, wind, solver)
    step = 1e-4
    run.step(step, 1)
    force = run.momentum / step
    # With the normal at the angle a from the wind, A cos a is seen by it; lift is of size Cl sin a across the wind, to
    # the side that the normal leans to when it is turned along the wind.
    pressure = 0.5 * wind.density * speed**2 * 0.5
    drag = side * pressure * wind.drag * abs(np.cos(angle))
    lift = side * pressure * wind.lift * np.cos(angle) * np.sin(angle)
    # Exact but for roundings of 1e-16 m divided by the step twice: 1e-8 m/s2 on 0.1 kg.
    skin = side * wind.viscous * 0.5 * speed
    np.testing.assert_allclose(force, [lift, 0, drag + skin], atol=2e-8)


@both_solvers
def test_only_the_relative_wind_counts(solver: Solver):
    still = sheet(0.6, Wind(), solver)
    moving = sheet(0.6, Wind(velocity=(2.0, -1.0, 0.5)), solver)
    for component, speed in zip(moving.state[3:], (2.0, -1.0, 0.5), strict=True):
        component += speed
    still.step(1 / 60, 10)
    moving.step(1 / 60, 10)
    np.testing.assert_allclose(moving.velocities - [2.0, -1.0, 0.5], still.velocities, atol=1e-12)
    np.testing.assert_allclose(still.velocities, 0.0, atol=1e-12)


@both_solvers
def test_the_force_does_not_depend_on_the_number_of_substeps(solver: Solver):
    gained = []
    for substeps in (20, 40, 80):
        run = sheet(0.7, Wind(velocity=(0.0, 1.0, 4.0)), solver)
        run.step(1 / 60, substeps)
        gained.append(run.momentum)
    # First order: halving the step halves the difference, and it is small, below the share of a step in the frame.
    first, second = np.linalg.norm(gained[0] - gained[1]), np.linalg.norm(gained[1] - gained[2])
    assert np.log2(first / second) == pytest.approx(1.0, abs=0.2)
    assert first < np.linalg.norm(gained[0]) / 20


@both_solvers
def test_each_triangle_feels_its_own_wind(solver: Solver):
    # A sheet turning about its middle line meets the air with one half and leaves it with the other: no net force.
    run = sheet(0.0, Wind(lift=0.0), solver)
    middle = run.positions.mean(axis=0)
    run.state.vz[:] = 2.0 * (run.positions - middle)[:, 0]
    before = run.angular_momentum
    run.step(1e-4, 1)
    np.testing.assert_allclose(run.momentum, 0.0, atol=1e-12)
    assert run.angular_momentum[1] / before[1] < 1
