"""Coulomb friction with every solver, on slopes and on surfaces that move, at any number of substeps."""

from functools import cache

import numpy as np
import pytest

from cape import TRBDF2, XPBD, BackwardEuler, Fabric, GridCloth, Plane, Scene, Simulation, Solver, SymplecticEuler
from cape.kernels.contact.penalty import SLIP
from tests.support.scenes import Run, grid_cloth, turn_about
from tests.support.shapes import FloatArray

G = 9.81  # m/s2
THICKNESS = 0.005  # m
FRAMES, FPS = 15, 60.0
TIME = FRAMES / FPS  # s
# So soft that symplectic Euler is stable at five steps a frame; a patch that moves as one piece strains nothing.
SOFT = Fabric(density=0.2, stretch=1.0, shear=0.1, bend=0.0)
# Steps of 0.4 ms change the velocity on a gentle slope by 0.1 mm/s: implicit stages must be solved to far less.
SOLVERS = (
    SymplecticEuler(precision="double"),
    XPBD(precision="double"),
    BackwardEuler(tolerance=1e-10),
    TRBDF2(tolerance=1e-10),
)
every_solver = pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: s.name)
DEFAULTS = (BackwardEuler(), TRBDF2())
and_by_default = pytest.mark.parametrize(
    "solver", SOLVERS + DEFAULTS, ids=[s.name for s in SOLVERS] + [f"{s.name} by default" for s in DEFAULTS]
)
IMPLICIT = ("backward_euler", "tr_bdf2")


def slid(solver: Solver, substeps: int, angle: float, friction: float) -> tuple[FloatArray, FloatArray]:
    """How far the vertices of a patch have slid down a slope from rest [m], and how fast they are [m/s]."""
    across, along = np.array([0.0, 1.0, 0.0]), np.array([np.cos(angle), 0.0, -np.sin(angle)])
    normal = np.cross(along, across)
    cloth = grid_cloth([0, 0.05, 0.1], [0, 0.05], SOFT, right=across, down=along, origin=THICKNESS * normal)
    scene = Scene(cloth, colliders=[Plane(normal=normal, friction=friction)], thickness=THICKNESS)
    simulation = Simulation(scene, solver=type(solver)(**{**vars(solver), "substeps": substeps}))
    simulation.start({})
    start = simulation.positions
    for _ in range(FRAMES):
        simulation.step({}, 1 / FPS)
    assert simulation.retried == simulation.unconverged == 0
    return (simulation.positions - start) @ along, simulation.velocities @ along


@and_by_default
@pytest.mark.parametrize(("degrees", "friction"), [(20, 0.0), (30, 0.3)])
def test_the_slide_is_as_long_at_any_number_of_substeps(solver: Solver, degrees: float, friction: float):
    angle = np.radians(degrees)
    acceleration = G * (np.sin(angle) - friction * np.cos(angle))
    # First order methods are half a step ahead: all velocities are those at a step's end.
    ahead = 0.0 if solver.name == "tr_bdf2" else 1.0
    for substeps in (5, 10, 20, 40):
        h = 1 / FPS / substeps
        distance, speed = slid(solver, substeps, angle, friction)
        # Implicit friction lacks a part of itself until the patch is as fast as SLIP.
        slack = (0.02 * acceleration * h + 0.3 * friction * SLIP) if solver.name in IMPLICIT else 1e-9
        np.testing.assert_allclose(speed, acceleration * TIME, atol=slack)
        np.testing.assert_allclose(distance, acceleration * TIME * (TIME + ahead * h) / 2, atol=slack * TIME)


@every_solver
@pytest.mark.parametrize("degrees", [5.0, 15.0, 21.5])
def test_it_sticks_below_the_angle_of_friction(solver: Solver, degrees: float):
    # The angle of friction of 0.4 is 21.8 degrees.
    friction, angle = 0.4, np.radians(degrees)
    for substeps in (5, 20):
        distance, speed = slid(solver, substeps, angle, friction)
        if solver.name in IMPLICIT:
            # It creeps at the speed at which smoothed friction balances gravity: 2 s - s^2 = tan / mu, s = u / SLIP.
            creep = SLIP * (1 - np.sqrt(1 - np.tan(angle) / friction))
            np.testing.assert_allclose(speed, creep, rtol=0.01)
            np.testing.assert_allclose(distance, creep * TIME, rtol=0.05)
        else:
            np.testing.assert_allclose(distance, 0.0, atol=1e-13)
            np.testing.assert_allclose(speed, 0.0, atol=1e-12)


@pytest.mark.parametrize("solver", DEFAULTS, ids=lambda s: s.name)
@pytest.mark.parametrize("degrees", [10.0, 21.0])
def test_by_default_it_creeps_no_faster_than_slip(solver: Solver, degrees: float):
    friction, angle = 0.4, np.radians(degrees)
    for substeps in (5, 8, 20):
        distance, speed = slid(solver, substeps, angle, friction)
        np.testing.assert_allclose(speed, SLIP * (1 - np.sqrt(1 - np.tan(angle) / friction)), rtol=0.01)
        assert (distance < SLIP * TIME).all()


@and_by_default
def test_it_slips_above_the_angle_of_friction(solver: Solver):
    friction, angle = 0.4, np.radians(22.5)
    acceleration = G * (np.sin(angle) - friction * np.cos(angle))
    for substeps in (5, 20):
        distance, speed = slid(solver, substeps, angle, friction)
        # What smoothed friction lacks below SLIP lets it go a little earlier.
        slack = 2 * SLIP if solver.name in IMPLICIT else 1e-9
        assert (np.abs(speed - acceleration * TIME) < slack).all()
        assert (
            np.abs(distance - acceleration * TIME**2 / 2) < acceleration * TIME / FPS / substeps + slack * TIME
        ).all()


# -- surfaces that move --


def lying(where: float) -> GridCloth:
    """A patch of 1 cm that lies level at x = `where` [m], as thick as it is above the origin."""
    sides = [-0.005, 0.005]
    return grid_cloth(sides, sides, SOFT, down=(0, -1, 0), origin=(where, 0, THICKNESS))


@and_by_default
@pytest.mark.parametrize("substeps", [5, 8, 20])
def test_a_belt_takes_along_at_mu_g_until_its_speed_is_reached(solver: Solver, substeps: int):
    speed, friction, frames = 0.6, 0.25, 20
    scene = Scene(lying(0.0), colliders=[Plane(bone="belt", friction=friction)], thickness=THICKNESS)
    run, h = Run(scene, solver), 1 / FPS / substeps
    reached, slack = speed / (friction * G), SLIP if solver.name in IMPLICIT else 1e-9
    assert reached < frames / FPS
    for frame in range(1, frames + 1):
        run.step(1 / FPS, substeps, ([[0.0, speed * frame / FPS, 0.0]], [[1, 0, 0, 0]]))
        expected = friction * G * min(frame / FPS, reached)
        np.testing.assert_allclose(run.velocities[:, 1], expected, atol=slack)
    behind = speed**2 / (2 * friction * G)
    moved = (run.positions - scene.cloth.positions)[:, 1]
    np.testing.assert_allclose(moved, speed * frames / FPS - behind, atol=0.51 * h * speed + slack * frames / FPS)
    np.testing.assert_allclose(run.velocities[:, 0], 0.0, atol=0.1 * slack)


@cache
def on_turntable(where: float, spin: float, friction: float, time: float) -> FloatArray:
    """Where a point (2,) [m] that set out with a turntable at x = `where` is after a time [s], in tiny steps."""
    place, steps = np.array([where, 0.0]), 20_000
    velocity, most = spin * np.array([0.0, where]), friction * G * time / steps
    for _ in range(steps):
        place = place + velocity * time / steps
        slide = velocity - spin * np.array([-place[1], place[0]])
        velocity = velocity - slide * min(1.0, most / max(np.linalg.norm(slide), 1e-12))
    return place


@and_by_default
@pytest.mark.parametrize("substeps", [5, 8, 20])
@pytest.mark.parametrize("share", [0.6, 0.9, 1.1, 1.5])
def test_a_turntable_holds_what_is_nearer_than_mu_g_over_its_spin_squared(solver: Solver, share: float, substeps: int):
    spin, friction, frames = 4.0, 0.4, 30
    radius, time, h = share * friction * G / spin**2, frames / FPS, 1 / FPS / substeps
    cloth = lying(radius)
    scene = Scene(cloth, colliders=[Plane(bone="table", friction=friction)], thickness=THICKNESS)
    run = Run(scene, solver, velocities=np.cross([0, 0, spin], cloth.positions))
    for frame in range(1, frames + 1):
        run.step(1 / FPS, substeps, ([[0.0, 0.0, 0.0]], [turn_about((0, 0, 1), spin * frame / FPS)]))
    place = run.positions.mean(axis=0)[:2]
    # First order methods follow the tangent: the radius changes by w^2 h / 2 a second. What slides, slides further by
    # what that takes off the force that holds it.
    follows = spin**2 * radius * h / 2 * time * (1.0 if share < 1.0 else 1.0 + spin * time)
    slack = 1.1 * follows + (SLIP * time if solver.name in IMPLICIT else 0.0)
    np.testing.assert_allclose(place, on_turntable(radius, spin, friction, time), atol=slack)
    turn = np.array([np.cos(spin * time), np.sin(spin * time)])
    away = np.linalg.norm(place - radius * turn)
    assert (away < slack) if share < 1.0 else (away > 0.03 and np.linalg.norm(place) > radius + 0.02)
