"""Orders of the implicit solvers at their defaults, measured against an integrator with force code of its own."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from cape.cloth.cloth import Cloth
from cape.cloth.fabric import Fabric
from cape.scene.holding.attachments import attach
from cape.scene.scene import Scene
from cape.solvers import TRBDF2, BackwardEuler, Solver
from tests.support.exact import ExactModel
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


@cache
def exact() -> FloatArray:
    """Positions at the end of each frame [m], by an explicit method of order 8 with an error of 1e-10 a step."""
    model, start = ExactModel(Run(SCENE, TRBDF2()).assembly), SHEET.positions
    places = [rod(frame) for frame in range(FRAMES + 1)]
    return model.motion(start, np.zeros_like(start), places, FRAME, relative=1e-10, absolute=1e-11)


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
