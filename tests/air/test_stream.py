"""A wind that differs from place to place and time to time, against closed forms, in steps and meshes of any size."""

import numpy as np
import pytest

import cape
from cape import Cloth, Fabric, Ledger, Pose, Scene, Simulation, Solver, SymplecticEuler, UserError, Wind, WindRecord
from cape.solvers import TRBDF2, XPBD, BackwardEuler
from tests.support.scenes import grid_cloth, mesh_cloth

FABRIC = Fabric(density=0.2, stretch=500.0, shear=50.0)
NOWHERE = Pose(np.zeros((0, 3)), np.zeros((0, 4)))
FRAME = 1.0 / 60.0
SOLVERS = [
    SymplecticEuler(precision="double", substeps=20),
    XPBD(precision="double", substeps=20),
    BackwardEuler(tolerance=1e-11, substeps=20),
    TRBDF2(tolerance=1e-11, substeps=20),
]
each_solver = pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)


def sheet(wind: Wind, *, made=grid_cloth, cells: int = 4) -> Scene:
    """Half a square metre that floats, its normal along Z."""
    across, down = np.linspace(0, 1.0, cells + 1), np.linspace(0, 0.5, cells)
    return Scene(made(across, down, FABRIC, right=(1, 0, 0), down=(0, -1, 0)), gravity=(0, 0, 0), wind=wind)


def blown(scene: Scene, solver: Solver, frames: int, *, threads: int = 1) -> Simulation:
    simulation = Simulation(scene, solver=solver, threads=threads)
    simulation.start(NOWHERE, settle=0.0)
    for _ in range(frames):
        simulation.step(NOWHERE, FRAME)
    return simulation


@each_solver
@pytest.mark.parametrize("made", [grid_cloth, mesh_cloth])
def test_a_wind_that_grows_takes_a_sheet_along_as_a_closed_form_says(solver: Solver, made):
    # Without plates' drag v' = r (a t - v) from rest, so v = a (t - (1 - exp(-r t)) / r).
    ramp = WindRecord(np.array([0.0, 10.0]), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 20.0]]))
    wind = Wind(drag=0.0, lift=0.0, viscous=0.5, record=ramp)
    simulation = blown(sheet(wind, made=made), solver, 30)
    rate, time, gain = 0.5 / FABRIC.density, 30 * FRAME, 2.0
    expected = gain * (time - (1.0 - np.exp(-rate * time)) / rate)
    # Of first order: at most h r times the velocity, an implicit solver's tolerance beside it.
    np.testing.assert_allclose(simulation.velocities[:, 2], expected, rtol=1.2 * rate * FRAME / 20)
    np.testing.assert_allclose(simulation.velocities[:, :2], 0.0, atol=1e-9)


@each_solver
def test_a_field_that_is_everywhere_alike_is_a_wind(solver: Solver):
    velocity = (1.0, -0.5, 3.0)
    uniform = blown(sheet(Wind(velocity=velocity)), solver, 10)
    field = blown(sheet(Wind(field=lambda time, places: np.broadcast_to(velocity, places.shape))), solver, 10)
    # The same sums in another order: rounding alone, but for how far an implicit solver solves.
    np.testing.assert_allclose(field.positions, uniform.positions, atol=1e-6)
    assert np.abs(uniform.positions - uniform.scene.cloth.positions).max() > 0.01


@pytest.mark.parametrize("made", [grid_cloth, mesh_cloth])
@pytest.mark.parametrize("cells", [4, 9])
def test_the_push_of_a_wind_that_differs_is_its_integral_on_any_mesh(made, cells: int):
    # Viscous air exerts mu u on each square metre. For u = (0, 0, 1 + 2 x + t) that is mu (1 + 1 + t) / 2 m2 in all,
    # whatever the mesh, as vertices share out areas so that what is linear adds up exactly.
    wind = Wind(
        drag=0.0, lift=0.0, viscous=0.3, field=lambda t, p: np.stack([0 * p[:, 0], 0 * p[:, 0], 1 + 2 * p[:, 0] + t], 1)
    )
    scene = sheet(wind, made=made, cells=cells)
    simulation = Simulation(scene, solver=SymplecticEuler(precision="double", substeps=1))
    simulation.start(NOWHERE, settle=0.0)
    simulation.step(NOWHERE, 1e-6)
    masses = scene.cloth.masses()
    pushed = masses @ simulation.velocities / 1e-6
    np.testing.assert_allclose(pushed, [0.0, 0.0, 0.3 * 0.5 * 2.0], rtol=1e-5, atol=1e-9)


def test_the_drag_of_plates_is_taken_at_each_of_them():
    # A flat sheet square to the stream, at rest: rho/2 Cd u |u| on each triangle at the mean of its corners' winds.
    def field(time, places):
        return np.stack([0 * places[:, 0], 0 * places[:, 0], 3.0 + np.sin(5.0 * places[:, 0])], axis=1)

    scene = sheet(Wind(lift=0.0, viscous=0.0, drag=1.1, field=field))
    cloth = scene.cloth
    simulation = Simulation(scene, solver=SymplecticEuler(precision="double", substeps=1))
    simulation.start(NOWHERE, settle=0.0)
    simulation.step(NOWHERE, 1e-7)
    expected = np.zeros(cloth.vertices)
    winds = field(0.0, cloth.positions)[:, 2]
    for corners in cloth.triangles:
        edges = cloth.positions[corners[1:]] - cloth.positions[corners[0]]
        area = 0.5 * np.linalg.norm(np.cross(*edges))
        expected[corners] += 0.5 * 1.2 * 1.1 * area * winds[corners].mean() ** 2 / 3.0
    np.testing.assert_allclose(cloth.masses() * simulation.velocities[:, 2] / 1e-7, expected, rtol=1e-5)


@pytest.mark.parametrize("made", [grid_cloth, mesh_cloth])
def test_steps_and_threads_change_nothing_about_the_wind(made):
    wind = Wind(velocity=(2.0, 0.0, 1.0), gusts=0.4, turbulence=0.8, seed=1)
    ends = {
        substeps: blown(sheet(wind, made=made), SymplecticEuler(precision="double", substeps=substeps), 12).positions
        for substeps in (20, 40, 80)
    }
    # Of first order: each doubling halves what is left, and the last one's share is a bound for it.
    first, second = (np.abs(ends[2 * n] - ends[n]).max() for n in (20, 40))
    assert 0.3 < second / first < 0.7
    together = blown(sheet(wind, made=made), SymplecticEuler(precision="double", substeps=20), 12, threads=2)
    np.testing.assert_array_equal(together.positions, ends[20])


def test_a_run_that_goes_on_from_a_snapshot_meets_the_same_wind():
    wind = Wind(velocity=(2.0, 0.0, 1.0), gusts=0.4, turbulence=0.8)
    scene, solver = sheet(wind), SymplecticEuler(precision="double", substeps=20)
    whole = blown(scene, solver, 10)
    half = blown(scene, solver, 5)
    other = Simulation(scene, solver=solver, threads=1)
    other.start_from(half.snapshot())
    for _ in range(5):
        other.step(NOWHERE, FRAME)
    np.testing.assert_array_equal(other.positions, whole.positions)


def test_energy_is_accounted_for_in_gusts():
    ledger = Ledger()
    scene = sheet(Wind(velocity=(2.0, 0.0, 3.0), gusts=0.5, turbulence=1.0))
    simulation = Simulation(scene, solver=SymplecticEuler(precision="double", substeps=100), threads=1, ledger=ledger)
    simulation.start(NOWHERE, settle=0.0)
    for _ in range(20):
        simulation.step(NOWHERE, FRAME)
    balance = ledger.balance
    assert abs(balance.air[-1]) > 0.1
    # What is of second order in the step counts as numerical; air in the middle of a step instead of at its ends is.
    assert abs(balance.numerical[-1]) < 0.01 * abs(balance.air[-1])
    assert balance.gap < 1e-9


def test_a_body_keeps_the_wind_off_its_cape():
    cloth = Cloth.rectangle(
        width=0.3, height=0.3, spacing=0.05, origin=(0.3, 0.15, 0.15), right=(0, -1, 0), down=(0, 0, -1)
    )
    body = cape.Capsule(name="trunk", bone=None, start=np.array([0, 0, -0.5]), end=np.array([0, 0, 0.5]), radius=0.25)

    def pushed(shelter: bool, speed: float) -> float:
        wind = Wind(velocity=(speed, 0.0, 0.0), shelter=shelter)
        scene = Scene(cloth, colliders=[body], gravity=(0, 0, 0), wind=wind)
        simulation = blown(scene, SymplecticEuler(precision="double"), 2)
        return float(scene.cloth.masses() @ simulation.velocities[:, 0])

    assert pushed(True, 4.0) < 0.3 * pushed(False, 4.0)
    assert pushed(True, -4.0) == pytest.approx(pushed(False, -4.0), rel=1e-6)


@pytest.mark.parametrize("given", [np.zeros((2, 3)), np.full((20, 3), np.nan)])
def test_a_field_that_gives_no_wind_is_refused(given: np.ndarray):
    scene = sheet(Wind(field=lambda time, places: given))
    with pytest.raises(UserError, match="field"):
        blown(scene, SymplecticEuler(), 1)
