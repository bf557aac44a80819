"""Vertices that springs hold at where bones carry them: sag, period, decay, work, each against a closed form."""

import dataclasses

import numpy as np
import pytest

from cape import TRBDF2, XPBD, BackwardEuler, Fabric, Ledger, Pose, Scene, Simulation, Solver, SymplecticEuler, attach
from tests.support.scenes import grid_cloth, mesh_cloth

G = 9.81  # m/s2
FRAME = 1 / 60  # s
EVERY = (
    SymplecticEuler(precision="double"),
    XPBD(precision="double"),
    BackwardEuler(tolerance=1e-11, forcing=1e-6),
    TRBDF2(tolerance=1e-11, forcing=1e-6),
)
every_solver = pytest.mark.parametrize("solver", EVERY, ids=lambda s: s.name)
UNTURNED = np.array([[1.0, 0.0, 0.0, 0.0]])
LIMP = Fabric(density=0.2, stretch=50.0, shear=10.0, bend=1e-4, damping_time=0.0, bend_damping_time=0.0)


def at(height: float) -> Pose:
    return Pose(np.array([[0.0, 0.0, height]]), UNTURNED)


def plate(make=grid_cloth, fabric: Fabric = LIMP):
    """3 x 3 vertices of 0.2 m; 8 g in all."""
    return make(np.linspace(0, 0.2, 3), np.linspace(0, 0.2, 3), fabric)


def on_springs(solver: Solver, omega: float, damping: float, *, gravity: float = 0.0, make=grid_cloth) -> Simulation:
    """A plate of which each vertex hangs on a spring of m omega^2, so that it moves as a whole, without strain.

    `damping` is c over m [1/s].
    """
    cloth = plate(make)
    mass = cloth.masses()
    hold = attach(cloth, "hand", range(9), stiffness=mass * omega**2, damping=mass * damping)
    return Simulation(Scene(cloth, [hold], gravity=(0.0, 0.0, -gravity)), solver=solver, cuts=None, ledger=Ledger())


@every_solver
@pytest.mark.parametrize("make", [grid_cloth, mesh_cloth], ids=["grid", "mesh"])
@pytest.mark.few("grid-euler", "mesh-xpbd", "grid-tr_bdf2", "mesh-backward_euler")
def test_a_mass_on_a_spring_sags_by_its_weight_over_the_stiffness(solver: Solver, make):
    omega = 30.0  # rad/s, of which critical damping leaves exp(-30) in a second
    simulation = on_springs(dataclasses.replace(solver, substeps=20), omega, 2 * omega, gravity=G, make=make)
    simulation.start(at(0.0))
    for _ in range(120):
        simulation.step(at(0.0), FRAME)
    sag = plate(make).positions - simulation.positions
    # At rest no method has an error; implicit stages leave 1e-11 m, whose velocity is some 1e-8 m/s.
    np.testing.assert_allclose(sag, np.tile([0.0, 0.0, G / omega**2], (9, 1)), atol=1e-8)


@every_solver
def test_a_sheet_that_hangs_on_springs_sags_by_all_of_its_weight(solver: Solver):
    cloth = plate()
    stiffness = 6.0  # N/m at each of three vertices
    scene = Scene(cloth, [attach(cloth, "hand", range(3), stiffness=stiffness)])
    simulation = Simulation(scene, solver=dataclasses.replace(solver, substeps=40))
    simulation.start(at(0.0), settle=3.0)
    for _ in range(60):
        simulation.step(at(0.0), FRAME)
    sag = (cloth.positions - simulation.positions)[:3, 2].mean()
    # Of XPBD each sweep passes on a share of the load alone: h^2 N^2 g more, see `Chain.sag`, here 4 rows.
    late = (FRAME / 40) ** 2 * 16 * G if isinstance(solver, XPBD) else 0.0
    assert sag == pytest.approx(0.2 * 0.04 * G / (3 * stiffness), rel=1e-3, abs=late)


def period_error(solver: Solver, steps: int) -> float:
    """Distance after one period of the undamped oscillator from where it was let go, as a share of its amplitude."""
    omega, pulled = 2 * np.pi, 0.01
    simulation = on_springs(dataclasses.replace(solver, substeps=steps), omega, 0.0)
    simulation.start(at(0.0))
    simulation.disturb(np.tile([0.0, pulled, 0.0], (9, 1)))
    simulation.step(at(0.0), 1.0)
    return float(np.hypot(simulation.positions[4, 1] - pulled, simulation.velocities[4, 1] / omega) / pulled)


@every_solver
def test_an_oscillation_has_its_period_to_the_order_of_the_method(solver: Solver):
    coarse, fine = period_error(solver, 400), period_error(solver, 800)
    # Backward Euler damps by omega h / 2, and so does XPBD: exp(-pi omega h) after a period.
    assert fine < 1.01 * np.pi * 2 * np.pi / 800
    # Symplectic Euler is first order in between, but conjugate to a method of second order, as a period shows.
    order = 2 if isinstance(solver, TRBDF2 | SymplecticEuler) else 1
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.2)


def decay_error(solver: Solver, steps: int) -> float:
    omega, pulled = 6.0, 0.01
    simulation = on_springs(dataclasses.replace(solver, substeps=steps), omega, 2 * omega)
    simulation.start(at(0.0))
    simulation.disturb(np.tile([0.0, 0.0, pulled], (9, 1)))
    simulation.step(at(0.0), 0.5)
    exact = pulled * (1 + omega * 0.5) * np.exp(-omega * 0.5)
    height = float((simulation.positions - plate().positions)[4, 2])
    return abs(height - exact) / pulled


@every_solver
def test_critical_damping_lets_a_vertex_creep_back_without_a_swing(solver: Solver):
    coarse, fine = decay_error(solver, 100), decay_error(solver, 200)
    assert fine < 0.01
    assert np.log2(coarse / fine) == pytest.approx(2 if isinstance(solver, TRBDF2) else 1, abs=0.25)


def test_without_a_damping_that_of_a_vertex_alone_is_critical():
    cloth = plate()
    simulation = Simulation(Scene(cloth, [attach(cloth, "hand", range(3), stiffness=6.0)]))
    simulation.start(at(0.0))
    pull = simulation.assembly.pull
    assert pull is not None
    np.testing.assert_allclose(pull.damping, 2 * np.sqrt(6.0 * cloth.masses()[:3]))


@every_solver
def test_a_hand_that_moves_gives_its_work_to_spring_height_and_damper(solver: Solver):
    omega, speed, frames = 30.0, 0.5, 90
    simulation = on_springs(dataclasses.replace(solver, substeps=40), omega, 2 * omega, gravity=G)
    assert simulation.ledger is not None
    simulation.start(at(0.0))
    for _ in range(60):
        simulation.step(at(0.0), FRAME)
    for frame in range(1, frames + 1):
        simulation.step(at(speed * FRAME * frame), FRAME)
    balance, mass = simulation.ledger.balance, 0.2 * 0.04
    lifted = balance.attachments[-1] - balance.attachments[60]
    # The jerk at the start gives m v^2 to a critically damped mass: half of it to the damper, half to its motion.
    assert lifted == pytest.approx(mass * G * speed * frames * FRAME + mass * speed**2, rel=2e-3)
    assert balance.damping[-1] - balance.damping[60] == pytest.approx(0.5 * mass * speed**2, rel=0.05)
    assert balance.elastic[-1] == pytest.approx(0.5 * mass * (G / omega) ** 2, rel=1e-3)
    assert abs(balance.numerical[-1] - balance.numerical[60]) < 0.02 * lifted
    # Of the work in steps, none is of higher than second order in the positions.
    assert balance.gap < 1e-9


@every_solver
def test_a_spring_that_is_far_stiffer_than_the_cloth_gains_no_energy(solver: Solver):
    cloth = plate()
    hold = attach(cloth, "hand", range(3), stiffness=2e4, damping=0.0)
    ledger = Ledger()
    simulation = Simulation(Scene(cloth, [hold]), solver=solver, ledger=ledger)
    simulation.start(at(0.0))
    for _ in range(60):
        simulation.step(at(0.0), FRAME)
    balance = ledger.balance
    # Against weight times size, of which the share that a first-order method carries to and fro is h omega at most.
    assert (balance.total - balance.total[0]).max() < 0.01 * 0.2 * 0.04 * G * 0.2
    assert np.abs(simulation.positions[:3] - cloth.positions[:3]).max() < 1e-3


def test_what_springs_hold_has_the_same_bits_on_two_threads():
    cloth = grid_cloth(np.linspace(0, 1, 21), np.linspace(0, 0.6, 13), LIMP)
    scene = Scene(cloth, [attach(cloth, "hand", range(21), stiffness=3.0)])
    for solver in EVERY:
        found = []
        for threads in (1, 2):
            simulation = Simulation(scene, solver=dataclasses.replace(solver, substeps=None), threads=threads)
            simulation.start(at(0.0))
            for frame in range(3):
                simulation.step(at(0.02 * frame), FRAME)
            found.append(simulation.positions)
        np.testing.assert_array_equal(*found)
