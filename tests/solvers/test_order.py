"""Orders of the implicit solvers at their defaults, measured against an integrator with force code of its own."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from cape.assembly.springs import Springs
from cape.cloth.cloth import Cloth
from cape.cloth.fabric import Fabric
from cape.scene.attachments import attach
from cape.scene.scene import Scene
from cape.solvers import TRBDF2, BackwardEuler, Solver
from tests.support.scenes import Run

FRAME, FRAMES = 1.0 / 60.0, 20
COUNTS = (4, 8, 16, 32, 64, 128)
FloatArray = NDArray[np.float64]
SHEET = Cloth.rectangle(
    width=0.3, height=0.6, spacing=0.06, fabric=Fabric(density=0.22, stretch=2026.0, shear=105.0, bend=1.6e-4)
)
SCENE = Scene(SHEET, [attach(SHEET, "rod", "top")])


def rod(frame: int) -> FloatArray:
    """Where the rod is at the end of a frame, between which it moves evenly: out of rest, without any kick."""
    time = frame * FRAME
    return np.array([0.15 * np.sin(4.0 * time) ** 3, 0.0, 0.0])


def accelerations(x: FloatArray, v: FloatArray, springs: Springs, inverse_mass: FloatArray) -> FloatArray:
    """[m/s2] of vertices at x with velocities v, of which those without inverse mass are held."""
    fabric, force = SHEET.fabric, np.zeros_like(x)
    apart, speed = x[springs.second] - x[springs.first], v[springs.second] - v[springs.first]
    length = np.linalg.norm(apart, axis=1)
    along = apart / length[:, None]
    rate = np.einsum("ek,ek->e", speed, along)
    pull = (springs.stiffness * (length - springs.rest + fabric.damping_time * rate))[:, None] * along
    np.add.at(force, springs.first, pull)
    np.add.at(force, springs.second, -pull)
    bent = np.einsum("ka,kac->kc", springs.bend_coefficients, (x + fabric.bend_damping_time * v)[springs.bend_vertices])
    push = springs.bend_stiffness[:, None, None] * springs.bend_coefficients[:, :, None] * bent[:, None, :]
    np.add.at(force, springs.bend_vertices, -push)
    return inverse_mass[:, None] * force + [0.0, 0.0, -9.81] * (inverse_mass > 0.0)[:, None]


@cache
def exact() -> FloatArray:
    """Positions at the end of each frame [m], by an explicit method of order 8 with an error of 1e-10 a step."""
    run = Run(SCENE, TRBDF2())
    springs, weights = run.assembly.springs, run.assembly.inverse_mass
    held, start = weights == 0.0, SHEET.positions
    x, v = start.copy(), np.zeros_like(start)
    taken = []
    for frame in range(1, FRAMES + 1):
        v[held] = (rod(frame) - rod(frame - 1)) / FRAME

        def rates(_: float, y: FloatArray) -> FloatArray:
            places, speeds = y.reshape(2, -1, 3)
            return np.stack([speeds, accelerations(places, speeds, springs, weights)]).ravel()

        found = solve_ivp(rates, (0.0, FRAME), np.stack([x, v]).ravel(), method="DOP853", rtol=1e-10, atol=1e-11)
        x, v = found.y[:, -1].reshape(2, -1, 3)
        taken.append(x)
    return np.array(taken)


def error(solver: Solver, substeps: int, *, apart: bool = False) -> float:
    """Root mean square distance from the exact motion [m]; `apart` makes a frame of each step."""
    run, taken = Run(SCENE, solver), []
    for frame in range(1, FRAMES + 1):
        for part in range(1, substeps + 1) if apart else (substeps,):
            share = part / substeps
            place = (1.0 - share) * rod(frame - 1) + share * rod(frame)
            steps, duration = (1, FRAME / substeps) if apart else (substeps, FRAME)
            assert run.step(duration, steps, ([place], [[1.0, 0.0, 0.0, 0.0]])) == 0
        taken.append(run.positions)
    return float(np.sqrt(np.mean((np.array(taken) - exact()) ** 2)))


def orders(solver: Solver, counts: tuple[int, ...] = COUNTS, *, apart: bool = False) -> FloatArray:
    """Powers of the step by which errors shrink from each number of steps to the next."""
    return -np.diff(np.log2([error(solver, count, apart=apart) for count in counts]))


@pytest.mark.parametrize("kind", [BackwardEuler, TRBDF2], ids=lambda kind: kind.name)
def test_at_their_defaults_solvers_keep_the_order_of_equations_solved_exactly(kind: type[BackwardEuler | TRBDF2]):
    usual, tight = orders(kind()), orders(kind(tolerance=1e-11, forcing=1e-4))
    np.testing.assert_allclose(usual, tight, atol=0.1)
    if kind is TRBDF2:
        assert usual[COUNTS.index(32) :].min() > 1.9


def test_tr_bdf2_keeps_its_order_in_frames_of_a_single_step():
    counts = COUNTS[COUNTS.index(32) :]
    usual, tight = (orders(solver, counts, apart=True) for solver in (TRBDF2(), TRBDF2(tolerance=1e-11, forcing=1e-4)))
    np.testing.assert_allclose(usual, tight, atol=0.1)
    assert usual.min() > 1.8
