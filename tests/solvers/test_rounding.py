"""Solvers with a state in double precision share what is compiled of contact, and lose nothing where nothing acts."""

from dataclasses import replace

import numpy as np
import pytest

import cape
from cape import Fabric, Scene, SelfContact
from cape.kernels.solve.rounding import Rounded, add_changes, round_state
from cape.kernels.state import State
from cape.kernels.team import Team
from cape.solvers import Solver
from tests.support.code import compiled_only, name_of, requests_of
from tests.support.scenes import Run, grid_cloth

IMPLICIT = (cape.BackwardEuler(), cape.TRBDF2())
both = pytest.mark.parametrize("solver", IMPLICIT, ids=lambda s: s.name)
SHARED = {
    "find_nearby", "wake_faces", "watch_tiles", "keep_out", "keep_faces_out", "keep_apart", "look_ahead",
    "search_pairs", "begin_drawing", "end_drawing", "limit_down", "limit_across",
}  # fmt: skip


def touching(height: float) -> Scene:
    """A cloth, `height` [m] above a sphere so small that it pokes between vertices, that contact and limits act on."""
    side = np.linspace(0.0, 0.2, 9)
    cloth = grid_cloth(side, side, Fabric(), down=(0.0, -1.0, 0.0), origin=(0.4, 0.6, height))
    ball = cape.Sphere(center=np.array([0.5, 0.5, 0.0]), radius=0.03)
    return Scene(cloth, colliders=[ball], self_contact=SelfContact(), strain_limit=True)


@compiled_only
@both
def test_contact_and_limits_are_compiled_as_for_euler(solver: Solver):
    scene = touching(0.1)
    euler, found = (set(requests_of(scene, each)) for each in (cape.SymplecticEuler(), solver))
    assert {name_of(request) for request in euler} >= SHARED
    assert {name_of(request) for request in euler & found} >= SHARED


@both
def test_in_single_precision_nothing_is_copied(solver: Solver):
    running = Run(touching(0.1), replace(solver, precision="single")).running
    assert running.corrected is running.state


def test_what_the_copy_is_changed_by_is_added_and_all_else_keeps_its_bits():
    rng = np.random.default_rng(0)
    state = State(*rng.uniform(-2.0, 2.0, (6, 50)))
    copy = State(*np.zeros((6, 50), np.float32))
    group, team = Rounded(state, copy), Team(0, 1, 10, 40, np.zeros(16, np.int64))
    before = np.array(state)
    round_state(group, team, 0, 1, 0.1)
    assert (np.array(copy)[:, 10:40] == before[:, 10:40].astype(np.float32)).all()
    assert (np.array(copy)[:, :10] == 0.0).all()
    changed = np.zeros((6, 50))
    changed[:, 20] = 0.1
    for component, by in zip(copy, changed, strict=True):
        component += by.astype(np.float32)
    add_changes(group, team, 0, 1, 0.1)
    after = np.array(state)
    untouched = np.arange(50) != 20
    assert (after[:, untouched] == before[:, untouched]).all()
    # The change, and its sum with numbers below 4, are rounded to single precision, whose last digit is 2^-22 there.
    assert np.abs(after - before - changed).max() <= 2.0**-22
    assert np.abs(after - before - changed)[:, 20].max() > 0.0


@both
def test_what_falls_onto_a_sphere_ends_where_it_does_in_double_precision(
    solver: Solver, monkeypatch: pytest.MonkeyPatch
):
    ends = []
    for rounds in (True, False):
        monkeypatch.setattr(type(solver), "rounds", rounds)
        run = Run(touching(0.06), replace(solver, tolerance=1e-11, forcing=1e-6), velocities=(0.0, 0.0, -3.0))
        assert (run.running.corrected is run.running.state) != rounds
        for _ in range(2):
            run.step(1 / 60, 8)
        ends.append(run.positions)
    fallen = 0.06 - 3.0 * 2 / 60 - 0.5 * 9.81 * (2 / 60) ** 2
    assert ends[1][:, 2].max() > fallen + 0.05  # the sphere has held it up
    # Each of 16 steps is corrected twice at most, with coordinates below 1 m that are rounded by 2^-25 m.
    assert 0.0 < np.abs(ends[0] - ends[1]).max() < 16 * 2 * 2.0**-25
