"""Cloth that nothing touches: free fall, a spring, momentum, energy and the order of both solvers."""

import dataclasses

import numpy as np
import pytest

from cape import XPBD, Fabric, Scene, SymplecticEuler, attach
from cape.solvers import Solver
from tests.support.scenes import Run, both_solvers, grid_cloth, turn_about

G = 9.81  # m/s2
SOFT = Fabric(density=0.2, stretch=50.0, shear=10.0, bend=1e-4, damping_time=0.0, bend_damping_time=0.0)
FLOATING = (0.0, 0.0, 0.0)


@both_solvers
def test_free_fall(solver: Solver):
    frames, substeps = 30, 8
    h = 1 / 60 / substeps
    throw = np.array([0.3, -0.2, 1.0])
    run = Run(Scene(grid_cloth([0, 0.1, 0.2], [0, 0.1, 0.2], SOFT)), solver, velocities=throw)
    start = run.positions
    for _ in range(frames):
        run.step(1 / 60, substeps)
    t = frames / 60
    gravity = np.array([0, 0, -G])
    # 240 steps, each rounding lengths of a metre: 240 * 2^-53 m, and ten times that in XPBD, which divides by h.
    np.testing.assert_allclose(
        run.positions - start, np.tile(throw * t + gravity * t * (t + h) / 2, (9, 1)), atol=1e-12
    )
    np.testing.assert_allclose(run.velocities, np.tile(throw + gravity * t, (9, 1)), atol=1e-10)
    # Both methods are of first order: g t h / 2 = 5 mm away from the parabola, of 1.2 m.
    parabola = throw * t + gravity * t**2 / 2
    error = np.abs(run.positions - start - parabola).max()
    assert error == pytest.approx(G * t * h / 2, rel=1e-6)
    assert error < 0.005 * np.abs(gravity * t**2 / 2).max()


@both_solvers
@pytest.mark.parametrize("ratio", [0.0, 0.05, 0.3])
def test_spring_has_the_period_and_the_damping_of_kelvin_and_voigt(solver: Solver, ratio: float):
    width, height, density, stretch = 0.1, 0.2, 0.3, 120.0
    # The lower left vertex of a single cell carries a third of its mass and hangs on half a cell's width of thread.
    omega = np.sqrt(stretch * width / 2 / height / (density * width * height / 3))
    fabric = Fabric(density=density, stretch=stretch, shear=0, bend=0, damping_time=2 * ratio / omega)
    cloth = grid_cloth([0, width], [0, height], fabric)
    # Pulled down by a ten-thousandth, so that the sideways thread's tilt, of second order, is lost in rounding.
    pulled = dataclasses.replace(cloth, positions=cloth.positions * [1, 1, 1 + 1e-4])
    run = Run(Scene(pulled, [attach(pulled, "hand", [0, 1])], gravity=FLOATING), solver)
    h = 0.01 / omega
    z = []
    for _ in range(1000):
        z.append(run.positions[2, 2] + height)
        run.step(h, 1)
    # z(n+1) = a z(n) + b z(n-1) for a linear oscillator; its roots q are exp(s h), s = -zeta w +- i w sqrt(1 - zeta^2).
    a, b = np.linalg.lstsq(np.stack([z[1:-1], z[:-2]], axis=1), z[2:], rcond=None)[0]
    s = np.log(complex(a / 2, np.sqrt(-b - a * a / 4))) / h
    exact = omega * complex(-ratio, np.sqrt(1 - ratio**2))
    # XPBD on one spring is implicit Euler, whose root is -ln(1 - s h) / h = s + s^2 h / 2 + s^3 h^2 / 3. Symplectic
    # Euler's damping at the old velocity makes |q|^2 = 1 - 2 zeta w h: an error of zeta w h, and w^2 h^2 / 24 besides.
    wh = omega * h
    expected = exact + exact**2 * h / 2 if isinstance(solver, XPBD) else exact
    error = wh**2 if isinstance(solver, XPBD) else wh**2 + 2 * ratio * wh
    assert abs(s - expected) / omega < error
    # The same in the words of a spring: its period to 1 % and its damping ratio to 0.01.
    assert 2 * np.pi / abs(s.imag) == pytest.approx(2 * np.pi / exact.imag, rel=0.01)
    assert -s.real / abs(s) == pytest.approx(ratio, abs=0.01)


def crumpled(solver: Solver, fabric: Fabric = SOFT) -> Run:
    """A free cloth far from its rest shape, thrown and turning."""
    rng = np.random.default_rng(5)
    cloth = grid_cloth(np.linspace(0, 0.5, 6), np.linspace(0, 0.4, 5), fabric)
    bent = dataclasses.replace(cloth, positions=cloth.positions + 0.03 * rng.standard_normal((30, 3)))
    spin = np.array([1.0, 3.0, -2.0])
    velocities = np.array([0.5, 0.2, -0.4]) + np.cross(spin, bent.positions) + 0.1 * rng.standard_normal((30, 3))
    return Run(Scene(bent, gravity=FLOATING), solver, velocities=velocities)


@both_solvers
def test_momentum_is_conserved(solver: Solver):
    damped = dataclasses.replace(SOFT, damping_time=1e-3, bend_damping_time=2e-3)
    run = crumpled(solver, damped)
    momentum = run.momentum
    assert np.linalg.norm(momentum) > 0.01
    for _ in range(60):
        run.step(1 / 60, 40)
    # 2400 steps of roundings of some 1e-3 kg at 5 m/s, each 2^-53; XPBD divides a rounding of 1 m by h = 0.4 ms.
    np.testing.assert_allclose(run.momentum, momentum, atol=1e-11)


def test_angular_momentum_is_conserved_by_symplectic_euler():
    # Damping along a spring keeps it too. Damping of bending does not: it also slows the turning of a bent cloth.
    run = crumpled(SymplecticEuler(precision="double"), dataclasses.replace(SOFT, damping_time=1e-3))
    before = run.angular_momentum
    assert np.linalg.norm(before) > 0.001
    for _ in range(60):
        run.step(1 / 60, 40)
    np.testing.assert_allclose(run.angular_momentum, before, atol=1e-13)


def test_angular_momentum_lost_by_xpbd_is_of_first_order():
    lost = []
    for substeps in (160, 320):
        run = crumpled(XPBD(precision="double"))
        before = run.angular_momentum
        # Later on the cloth turns what was lost early into other motion, of another order.
        for _ in range(3):
            run.step(1 / 60, substeps)
        lost.append(np.linalg.norm(run.angular_momentum - before))
    assert np.log2(lost[0] / lost[1]) == pytest.approx(1.0, abs=0.2)


def stretched(solver: Solver) -> Run:
    """A free cloth, stretched by 5 % down and let go."""
    cloth = grid_cloth(np.linspace(0, 0.3, 4), np.linspace(0, 0.3, 4), SOFT)
    return Run(Scene(dataclasses.replace(cloth, positions=cloth.positions * 1.05), gravity=FLOATING), solver)


def test_energy_of_symplectic_euler_stays_bounded():
    run = stretched(SymplecticEuler(precision="double"))
    start = run.elastic_energy
    energies = []
    # The slowest mode along the threads has a period of 2 * 0.3 m / sqrt(50 / 0.2) m/s = 38 ms: some 260 periods.
    for _ in range(600):
        run.step(1 / 60, 60)
        energies.append(run.kinetic_energy + run.elastic_energy)
    # The method conserves an energy that differs from this one by w h / 2, with w h = 0.13 for the fastest mode, and
    # no trend: the last third oscillates as the first does.
    relative = np.array(energies) / start
    assert np.abs(relative - 1).max() < 0.065
    assert abs(relative[-200:].mean() - relative[:200].mean()) < 0.002


def test_energy_of_xpbd_never_grows():
    run = stretched(XPBD(precision="double"))
    last = run.elastic_energy
    for _ in range(100):
        run.step(1 / 60, 40)
        energy = run.kinetic_energy + run.elastic_energy
        assert energy <= last * (1 + 1e-9)
        last = energy


def swung(solver: Solver, substeps: int) -> np.ndarray:
    """Positions of a cloth that hangs from a bone which is swung and turned for a third of a second."""
    cloth = grid_cloth(np.linspace(0, 0.3, 4), np.linspace(0, 0.3, 4), dataclasses.replace(SOFT, damping_time=1e-3))
    run = Run(Scene(cloth, [attach(cloth, "hand", range(4))]), solver)
    for frame in range(1, 21):
        angle = 2 * np.pi * frame / 60
        pose = [[0.1 * np.sin(angle), 0.05 * np.sin(2 * angle), 0.0]], [turn_about((0, 0, 1), 0.5 * np.sin(angle))]
        run.step(1 / 60, substeps, pose)
    return run.positions


def test_both_solvers_converge_to_the_same_motion_at_first_order():
    limits, errors = [], []
    for solver in (SymplecticEuler(precision="double"), XPBD(precision="double")):
        coarse, middle, fine = (swung(solver, substeps) for substeps in (100, 200, 400))
        order = np.log2(np.linalg.norm(coarse - middle) / np.linalg.norm(middle - fine))
        assert order == pytest.approx(1.0, abs=0.2), solver.name
        limits.append(2 * fine - middle)
        errors.append(np.abs(fine - limits[-1]).max())
    # Extrapolation leaves the second order; a twentieth of the coarser solver's error, itself below 2 mm.
    assert np.abs(limits[0] - limits[1]).max() < 0.05 * max(errors)
    assert max(errors) < 0.002


@both_solvers
def test_attached_vertices_follow_their_bone_in_every_substep(solver: Solver):
    cloth = grid_cloth(np.linspace(0, 0.3, 4), np.linspace(0, 0.3, 4), SOFT)
    scene = Scene(cloth, [attach(cloth, "hand", range(4))])
    duration, substeps, angle = 1 / 60, 10, 0.4
    offset = np.array([0.02, -0.01, 0.03])

    def held_at(time: float) -> np.ndarray:
        turn = angle * time / duration
        x, z = cloth.positions[:4, 0], cloth.positions[:4, 2]
        # Turned about y.
        points = np.stack([x * np.cos(turn) + z * np.sin(turn), 0 * x, z * np.cos(turn) - x * np.sin(turn)], axis=1)
        return points + offset * time / duration

    whole, parts = Run(scene, solver), Run(scene, solver)
    whole.step(duration, substeps, ([offset], [turn_about((0, 1, 0), angle)]))
    for k in range(1, substeps + 1):
        share = k / substeps
        parts.step(duration / substeps, 1, ([share * offset], [turn_about((0, 1, 0), share * angle)]))
    h = duration / substeps
    np.testing.assert_allclose(whole.positions[:4], held_at(duration), atol=1e-15)
    # Roundings of 2^-53 of lengths of 0.4 m, divided by the step of 1.7 ms.
    last = (held_at(duration) - held_at(duration - h)) / h
    np.testing.assert_allclose(whole.velocities[:4], last, atol=1e-12)
    assert np.abs(last - (held_at(duration) - held_at(0)) / duration).max() > 0.1
    np.testing.assert_allclose(parts.positions, whole.positions, atol=1e-13)
