"""Tethers: no vertex farther from what is held than the cloth between is long, and no energy gained by them."""

import dataclasses

import numpy as np
import pytest

from cape import Fabric, Ledger, Pose, Scene, Simulation, Solver, Sphere, Tethers, UserError, attach
from cape.assembly.geodesics import geodesic_distances
from motions.errors import ValueRangeError
from tests.support.scenes import EVERY, grid_cloth, mesh_cloth

G = 9.81  # m/s2
FRAME = 1 / 60  # s
UNTURNED = np.array([[1.0, 0.0, 0.0, 0.0]])
LIMP = Fabric(density=0.2, stretch=4.0, shear=1.0, bend=1e-5, damping_time=0.0, bend_damping_time=0.0)
FEW = tuple(dataclasses.replace(solver, substeps=40) for solver in EVERY)
every_solver = pytest.mark.parametrize("solver", FEW, ids=lambda s: s.name)


def at(height: float) -> Pose:
    return Pose(np.array([[0.0, 0.0, height]]), UNTURNED)


def sheet(make=grid_cloth, down=(0.0, 0.0, -1.0)):
    return make(np.linspace(0, 0.3, 4), np.linspace(0, 0.6, 7), LIMP, down=down)


def farthest(simulation: Simulation) -> float:
    """The largest distance from the nearest held vertex, as a share of the way along the cloth."""
    cloth, held = simulation.scene.cloth, np.arange(4)
    ways, nearest = geodesic_distances(cloth, held)
    places = simulation.positions
    away = np.linalg.norm(places - places[nearest], axis=1)
    return float((away[ways > 0] / ways[ways > 0]).max())


@every_solver
@pytest.mark.parametrize("make", [grid_cloth, mesh_cloth], ids=["grid", "mesh"])
@pytest.mark.few("grid-euler", "mesh-xpbd", "grid-backward_euler")
def test_no_vertex_gets_farther_than_its_tether_is_long(solver: Solver, make):
    cloth = sheet(make)
    hold = attach(cloth, "hand", range(4))
    shares = []
    for tethers in (None, Tethers(slack=0.05)):
        simulation = Simulation(Scene(cloth, [hold], tethers=tethers), solver=solver)
        simulation.start(at(0.0))
        share = 0.0
        for frame in range(40):
            simulation.step(at(0.2 * np.sin(0.3 * frame)), FRAME)
            share = max(share, farthest(simulation))
        shares.append(share)
    assert shares[0] > 1.3  # 0.2 kg/m2 g 0.6 m over 4 N/m are 29 % in the upper threads alone
    # Positions in double precision.
    assert shares[1] <= 1.05 * (1 + 1e-9)


@every_solver
def test_a_sheet_that_falls_into_its_tethers_gains_no_energy(solver: Solver):
    cloth = sheet(down=(0.0, 1.0, 0.0))
    ledger = Ledger()
    scene = Scene(cloth, [attach(cloth, "hand", range(4))], tethers=Tethers(slack=0.0))
    simulation = Simulation(scene, solver=solver, ledger=ledger)
    simulation.start(at(0.0))
    for _ in range(120):
        simulation.step(at(0.0), FRAME)
    balance = ledger.balance
    size = 0.2 * 0.18 * G * 0.6  # weight times length
    # What first-order methods carry to and fro, h omega of it, apart.
    assert (balance.total - balance.total[0]).max() < 0.01 * size
    # Tethers take energy, as a rope does that is drawn taut, and never give any.
    assert np.diff(balance.contacts).max() < 1e-3 * size
    assert balance.contacts[-1] < 0.0
    assert farthest(simulation) <= 1 + 1e-9


def test_colliders_have_the_last_word():
    cloth = sheet()
    ball = Sphere(center=np.array([0.15, 0.02, -0.3]), radius=0.1, thickness=0.005)
    scene = Scene(cloth, [attach(cloth, "hand", range(4))], [ball], tethers=Tethers(slack=0.0))
    simulation = Simulation(scene)
    simulation.start(at(0.0))
    for _ in range(30):
        simulation.step(at(0.0), FRAME)
    assert np.linalg.norm(simulation.positions - ball.center, axis=1).min() > 0.1


def test_tethers_have_the_same_bits_on_two_threads():
    cloth = grid_cloth(np.linspace(0, 1, 21), np.linspace(0, 0.6, 13), LIMP)
    scene = Scene(cloth, [attach(cloth, "hand", range(21))], tethers=Tethers())
    for solver in FEW:
        found = []
        for threads in (1, 2):
            simulation = Simulation(scene, solver=solver, threads=threads)
            simulation.start(at(0.0))
            for frame in range(3):
                simulation.step(at(0.05 * frame), FRAME)
            found.append(simulation.positions)
        np.testing.assert_array_equal(*found)


def test_what_makes_no_sense_is_told():
    cloth = sheet()
    with pytest.raises(ValueRangeError, match="slack"):
        Tethers(slack=-0.1)
    with pytest.raises(UserError, match="held hard"):
        Scene(cloth, [attach(cloth, "hand", range(4), stiffness=1.0)], tethers=Tethers())
