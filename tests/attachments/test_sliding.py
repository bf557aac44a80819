"""Vertices that slide along curves: a bead on a rod, a pendulum on a ring, a curtain, each against a closed form."""

import dataclasses

import numpy as np
import pytest

from cape import (
    TRBDF2,
    Ledger,
    Pose,
    Scene,
    Simulation,
    Solver,
    Sphere,
    attach,
)
from motions import quaternions
from motions.errors import ValueRangeError
from tests.attachments.closely import EVERY, FRAME, LIMP, G, every_solver
from tests.support.scenes import grid_cloth, turn_about

UNTURNED = np.array([[1.0, 0.0, 0.0, 0.0]])


def at(place, turn=UNTURNED[0]) -> Pose:
    return Pose(np.array([place], float), np.array([turn], float))


def plate():
    """3 x 3 vertices of 0.2 m; 8 g in all."""
    return grid_cloth(np.linspace(0, 0.2, 3), np.linspace(0, 0.2, 3), LIMP)


def beads(solver: Solver, curve: np.ndarray, **options) -> Simulation:
    """A plate whose vertices slide along a curve (m, 3) [m], laid through each: it moves as a whole, unstrained."""
    cloth = plate()
    holds = [attach(cloth, "rail", [k], along=place + curve) for k, place in enumerate(cloth.positions)]
    return Simulation(Scene(cloth, holds), solver=solver, cuts=None, **options)


@every_solver
@pytest.mark.parametrize("slope", [0.0, 30.0, 90.0])
def test_a_bead_slides_down_a_rod_by_its_slope(solver: Solver, slope: float):
    way = np.array([np.cos(np.radians(slope)), 0.0, -np.sin(np.radians(slope))])
    simulation = beads(solver, np.array([-5.0, 20.0])[:, None] * way)
    simulation.start(at((0, 0, 0)))
    for _ in range(30):
        simulation.step(at((0, 0, 0)), FRAME)
    time, step = 30 * FRAME, FRAME / 20
    # What steps of the first order are ahead, all alike as they have only accelerated: h / 2 of their speed.
    ahead = 0.0 if isinstance(solver, TRBDF2) else step
    expected = 0.5 * G * np.sin(np.radians(slope)) * time * (time + ahead)
    moved = simulation.positions - plate().positions
    np.testing.assert_allclose(moved, np.tile(expected * way, (9, 1)), atol=1e-7)
    # Never off the rod, by any digit but the last few.
    np.testing.assert_allclose(moved - (moved @ way)[:, None] * way, 0.0, atol=1e-13)


def ring(radius: float, segments: int) -> np.ndarray:
    """A closed curve in the plane of X and Z, whose lowest point is the origin."""
    angles = np.linspace(0.0, 2 * np.pi, segments + 1)
    points = radius * np.stack([np.sin(angles), np.zeros(segments + 1), 1.0 - np.cos(angles)], axis=1)
    points[-1] = points[0]
    return points


@every_solver
def test_a_bead_on_a_ring_is_a_pendulum(solver: Solver):
    radius, swing = 0.4, 0.6  # m, rad
    simulation = beads(dataclasses.replace(solver, substeps=40), ring(radius, 40), ledger=Ledger())
    simulation.start(at((0, 0, 0)))
    simulation.disturb(np.tile([radius * np.sin(swing), 0.0, radius * (1.0 - np.cos(swing))], (9, 1)))
    begun, angles, heights = plate().positions[4], [], []
    for _ in range(180):
        simulation.step(at((0, 0, 0)), FRAME)
        x, _, z = simulation.positions[4] - begun
        angles.append(np.arctan2(x, radius - z))
        heights.append(np.hypot(x, z - radius))
    angles = np.array(angles)
    crossings = np.flatnonzero((angles[:-1] > 0.0) != (angles[1:] > 0.0))
    times = FRAME * (crossings + angles[crossings] / (angles[crossings] - angles[crossings + 1]))
    period = 2.0 * np.diff(times).mean()
    # Gauss: the period is that of small swings over the arithmetic-geometric mean of 1 and cos(swing / 2).
    a, b = 1.0, np.cos(swing / 2)
    for _ in range(6):
        a, b = (a + b) / 2, np.sqrt(a * b)
    # Between 40 points cubics with slopes of a chord's length are off a ring by R (2 pi / 40)^4 / 128 = 4.75e-6 R.
    assert period == pytest.approx(2 * np.pi * np.sqrt(radius / G) / a, rel=2e-2 if solver.order == 1.0 else 5e-3)
    np.testing.assert_allclose(heights, radius, rtol=4.8e-6)
    assert simulation.ledger is not None
    balance = simulation.ledger.balance
    lost = (balance.total[1] - balance.total[-1]) / (0.2 * 0.04 * G * radius * (1.0 - np.cos(swing)))
    # A ring does no work. But steps of first order turn the weight to where it will be: by w^2 h t of the energy.
    damped = 1.0 - np.exp(-G / radius * FRAME / 40 * 3.0) if solver.order == 1.0 else 0.0
    assert lost == pytest.approx(damped, abs=2e-3 if solver.order == 2.0 else 0.2 * damped)


@every_solver
def test_a_bead_stops_at_the_end_of_a_rod(solver: Solver):
    simulation = beads(solver, np.array([[0.0, 0.0, 0.1], [0.0, 0.0, -0.1]]))
    simulation.start(at((0, 0, 0)))
    for _ in range(30):
        simulation.step(at((0, 0, 0)), FRAME)
    np.testing.assert_allclose(simulation.positions - plate().positions, np.tile([0, 0, -0.1], (9, 1)), atol=1e-12)
    # It weighs on the end no longer than it is let.
    for frame in range(1, 31):
        simulation.step(at((0, 0, -0.5 * 2.0 * G * (frame * FRAME) ** 2)), FRAME)
    assert (simulation.positions[:, 2] - plate().positions[:, 2] > -0.5 * 2.0 * G * 0.25 - 0.1 + 1e-3).all()


@every_solver
def test_a_rod_takes_its_beads_along_across_but_not_along(solver: Solver):
    simulation = beads(solver, np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    simulation.start(at((0, 0, 0)))
    for frame in range(1, 31):
        simulation.step(at((0.4 * frame * FRAME, 0.3 * frame * FRAME, 0.1 * np.sin(6.0 * frame * FRAME))), FRAME)
    moved = simulation.positions - plate().positions
    # Implicit stages leave 1e-11 m, and with it some 1e-8 m/s.
    np.testing.assert_allclose(moved, np.tile([0.0, 0.15, 0.1 * np.sin(3.0)], (9, 1)), atol=1e-7)
    np.testing.assert_allclose(simulation.velocities[:, 1], 0.3, atol=1e-7)


@every_solver
def test_a_rod_that_turns_throws_its_beads_out(solver: Solver):
    cloth = plate()
    spin, start = 3.0, cloth.positions[4, 0] + 0.1  # rad/s; m from the axis
    rail = np.array([[-1.0, 0.0, 0.0], [3.0, 0.0, 0.0]]) + cloth.positions[4]
    # A single vertex slides, and the cloth is too limp and light to matter to it.
    axis = cloth.positions[4] - [start, 0.0, 0.0]
    hold = attach(cloth, "rail", [4], along=rail - axis)
    flimsy = dataclasses.replace(cloth, fabric=dataclasses.replace(LIMP, stretch=1e-6, shear=0.0, bend=0.0))
    scene = Scene(flimsy, [hold], gravity=(0.0, 0.0, 0.0))
    simulation = Simulation(scene, solver=dataclasses.replace(solver, substeps=80), cuts=None)
    simulation.start(at(axis))
    for frame in range(1, 31):
        simulation.step(at(axis, turn_about((0, 0, 1), spin * frame * FRAME)), FRAME)
    out = quaternions.rotate(turn_about((0, 0, -1), spin * 0.5), simulation.positions[4] - axis)
    np.testing.assert_allclose(out[1:], 0.0, atol=1e-12)
    # Along the rod the bead was at rest: r'' = spin^2 r, so that r = r0 cosh(spin t).
    assert out[0] == pytest.approx(start * np.cosh(spin * 0.5), rel=1e-2)


@every_solver
def test_a_curtain_keeps_its_momentum_along_its_rail(solver: Solver):
    cloth = grid_cloth(np.linspace(0, 0.3, 4), np.linspace(0, 0.3, 4), LIMP)
    rings = attach(cloth, "rail", range(4), along=[[-5.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    simulation = Simulation(Scene(cloth, [rings]), solver=solver, cuts=None)
    simulation.start(at((0, 0, 0)))
    offsets = np.zeros((16, 3))
    offsets[12:, 0] = 0.03  # its hem is let go to one side
    simulation.disturb(offsets)
    mass, centers = cloth.masses(), []
    for _ in range(60):
        simulation.step(at((0, 0, 0)), FRAME)
        centers.append(mass @ simulation.positions[:, 0] / mass.sum())
        np.testing.assert_allclose(simulation.positions[:4, 1:], 0.0, atol=1e-13)
    # Nothing pushes it along: its centre stays where it was, and its rings do not.
    np.testing.assert_allclose(centers, mass @ (cloth.positions + offsets)[:, 0] / mass.sum(), atol=1e-7)
    assert np.abs(simulation.positions[:4, 0] - cloth.positions[:4, 0]).max() > 1e-3
    # It hangs down by its weight, from the rail and nothing else.
    assert -0.5 < simulation.positions[:, 2].min() < -0.3


def test_what_starts_beside_its_curve_comes_to_it_at_3_m_s():
    cloth = plate()
    rings = attach(cloth, "rail", range(3), along=[[-1.0, 0.2, 0.0], [1.0, 0.2, 0.0]])
    simulation = Simulation(Scene(cloth, [rings], gravity=(0.0, 0.0, 0.0)), solver=EVERY[0], cuts=None)
    simulation.start(at((0, 0, 0)))
    simulation.step(at((0, 0, 0)), FRAME)
    np.testing.assert_allclose(simulation.positions[:3, 1], 3.0 * FRAME, rtol=1e-9)
    for _ in range(5):
        simulation.step(at((0, 0, 0)), FRAME)
    np.testing.assert_allclose(simulation.positions[:3, 1], 0.2, rtol=1e-12)


def test_rings_are_the_bones_and_not_the_colliders_business():
    cloth = plate()
    rings = attach(cloth, "rail", range(3), along=[[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    ball = Sphere(center=np.array([0.1, 0.0, 0.0]), radius=0.05)
    simulation = Simulation(Scene(cloth, [rings], [ball]), solver=EVERY[0], cuts=None)
    simulation.start(at((0, 0, 0)))
    meter = simulation.meter()
    simulation.step(at((0, 0, 0)), FRAME)
    np.testing.assert_allclose(simulation.positions[:3, 1:], 0.0, atol=1e-13)
    assert not np.isin(simulation.read(meter).contacts.vertices, range(3)).any()


def test_a_sliding_cloth_has_the_same_bits_on_two_threads():
    cloth = grid_cloth(np.linspace(0, 1, 21), np.linspace(0, 0.6, 13), LIMP)
    rings = attach(cloth, "rail", range(21), along=ring(1.0, 40) - [0.0, 0.0, 0.01])
    for solver in EVERY:
        found = []
        for threads in (1, 2):
            simulation = Simulation(Scene(cloth, [rings]), solver=solver, threads=threads)
            simulation.start(at((0, 0, 0)))
            for frame in range(3):
                simulation.step(at((0.01 * frame, 0.02 * frame, 0)), FRAME)
            found.append(simulation.positions)
        np.testing.assert_array_equal(*found)


@pytest.mark.parametrize(
    ("bone", "options"),
    [
        ("a", {"along": [[0.0, 0.0, 0.0]]}),
        ("a", {"along": [[0.0, 0.0], [1.0, 0.0]]}),
        ("a", {"along": [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]}),
        ("a", {"along": [[0.0, 0.0, np.nan], [1.0, 0.0, 0.0]]}),
        (("a", "b"), {"along": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]}),
        ("a", {"along": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], "stiffness": 1.0}),
        ("a", {"along": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], "points": np.zeros((3, 3))}),
    ],
)
def test_what_makes_no_sense_is_told(bone: object, options: dict):
    with pytest.raises(ValueRangeError, match="attach"):
        attach(plate(), bone, range(3), **options)  # pyright: ignore[reportArgumentType]
