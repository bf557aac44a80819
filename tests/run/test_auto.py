"""Solver and steps from a tolerance or a budget, and the measured error of a time step."""

from dataclasses import replace

import numpy as np
import pytest

import cape
from cape import Auto, AutoSimulation, Cuts, Pose, Simulation
from cape.cloth.fabric import Fabric
from cape.run.step_error import Watch, other_steps
from cape.scene.poses import poses_of
from cape.scene.standard_scenes import StandardScene, standard_scene, swing

STIFF = Fabric(stretch=1e6, shear=1e5)
EXACT = cape.SymplecticEuler(precision="double")
TOLERANCES = (0.01, 0.003, 0.001, 0.0003)  # m


def run(simulation: Simulation, given: StandardScene) -> np.ndarray:
    """Positions of each frame but the first [m], shape (F - 1, V, 3)."""
    poses, steps = poses_of(given.track, simulation.bones), np.diff(given.track.times)
    simulation.start(poses[0])
    taken = []
    for pose, dt in zip(poses[1:], steps, strict=True):
        simulation.step(pose, float(dt))
        taken.append(simulation.positions)
    return np.array(taken)


def apart(first: np.ndarray, second: np.ndarray) -> float:
    """Root mean square distance [m]."""
    return float(np.sqrt(np.mean(np.sum((first - second) ** 2, axis=-1))))


@pytest.fixture(scope="module", params=["swing", "stiff"])
def smooth(request: pytest.FixtureRequest) -> tuple[StandardScene, np.ndarray]:
    """A smooth scene, and where it goes in steps so short that less than 0.02 mm is left of their error."""
    given = standard_scene(request.param)
    return given, run(Simulation(given.scene, solver=EXACT), given)


@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_errors_of_whole_runs_are_at_most_twice_the_tolerance(
    smooth: tuple[StandardScene, np.ndarray], tolerance: float
):
    given, exact = smooth
    simulation = AutoSimulation(given.scene, Auto(tolerance=tolerance))
    assert apart(run(simulation, given), exact) < 2.0 * tolerance
    assert simulation.errors


def test_usual_fabrics_get_euler_and_stiff_ones_as_many_steps_of_xpbd_as_they_need():
    usual = AutoSimulation(swing().scene, Auto(tolerance=0.001))
    stiff = [AutoSimulation(swing(fabric=STIFF).scene, Auto(tolerance=mm * 1e-3)) for mm in (10.0, 1.0)]
    for simulation in (usual, *stiff):
        simulation.start({"rod": (np.zeros(3), [1.0, 0.0, 0.0, 0.0])})
    assert usual.solver == cape.SymplecticEuler()
    coarse, fine = (simulation.solver.substeps or 0 for simulation in stiff)
    assert [simulation.solver.name for simulation in stiff] == ["xpbd", "xpbd"]
    assert 8 <= coarse < 40 < fine < 200


def test_steps_become_shorter_as_the_motion_gets_harder_and_frames_of_any_length_get_as_many():
    given = swing(fabric=STIFF, seconds=1.0)
    simulation = AutoSimulation(given.scene, Auto(tolerance=0.003))
    run(simulation, given)
    gentle = simulation.solver.substeps or 0
    for frame in range(1, 181):
        turn = 2.0 * np.pi * frame / 60.0
        simulation.step(
            {"rod": (np.array([0.1 * np.sin(turn), 0.05 * (1.0 - np.cos(2.0 * turn)), 0.0]), [1, 0, 0, 0])}, 1 / 60
        )
    hard = simulation.solver.substeps or 0
    assert hard > 1.2 * gentle
    assert any(error.rms > simulation.allowed for error in simulation.errors)
    where = {"rod": (np.zeros(3), [1.0, 0.0, 0.0, 0.0])}
    simulation.step(where, 1 / 30)
    twice = simulation.solver.substeps or 0
    simulation.step(where, 1 / 60)
    assert abs(twice - 2 * (simulation.solver.substeps or 0)) <= 2


@pytest.mark.parametrize(
    "solver",
    [cape.XPBD(substeps=40), cape.XPBD(substeps=160), cape.BackwardEuler(substeps=8), cape.SymplecticEuler()],
    ids=["xpbd", "xpbd in short steps", "backward_euler", "euler"],
)
def test_the_measured_error_is_the_true_one_within_a_factor_of_three(solver: cape.Solver):
    # An order between 1 and 2 where 1.8 is taken for XPBD: 2^1.8 - 1 is 2.5 times 2^1 - 1, and 0.8 times 2^2 - 1.
    given = swing(spacing=0.06, seconds=1.5)
    poses = poses_of(given.track, given.scene.bones)
    simulation, reference = Simulation(given.scene, solver=solver), Simulation(given.scene, solver=EXACT)
    simulation.start(poses[0])
    watch = Watch(simulation)
    for frame in range(1, 31):
        simulation.step(poses[frame], 1 / 60)
        watch.note(poses[frame], 1 / 60)
    assert not watch.watching
    watch.begin()
    reference.start_from(simulation.snapshot())
    reference.change_solver(replace(EXACT, substeps=1000))
    for frame in range(31, 91):
        assert not watch.full
        for each in (simulation, reference):
            each.step(poses[frame], 1 / 60)
        watch.note(poses[frame], 1 / 60)
    assert watch.full
    error, true = watch.end(), apart(simulation.positions, reference.positions)
    assert error.time == pytest.approx(1.5)
    assert (error.solver, error.substeps) == (solver.name, simulation.substeps)
    assert true / 3.0 < error.rms < 3.0 * true


def test_the_second_run_takes_half_the_steps_or_twice_as_many():
    assert other_steps(cape.XPBD(), 40).substeps == 20
    assert other_steps(cape.XPBD(), 1).substeps == 2
    assert other_steps(cape.SymplecticEuler(), 66).substeps == 132
    assert other_steps(cape.TRBDF2(tolerance=1e-6), 8) == cape.TRBDF2(tolerance=1e-6, substeps=4)


def test_a_part_is_taken_again_as_it_was_though_arrays_are_used_again():
    given = swing(spacing=0.06, seconds=0.5)
    errors = []
    for shared in (False, True):
        simulation = Simulation(given.scene, solver=cape.XPBD())
        place = np.zeros(3)
        simulation.start({"rod": (place, [1.0, 0.0, 0.0, 0.0])})
        watch = Watch(simulation)
        watch.begin(0.25)
        for frame in range(1, 16):
            place = place if shared else np.zeros(3)
            place[0] = 0.01 * frame
            simulation.step({"rod": (place, [1.0, 0.0, 0.0, 0.0])}, 1 / 60)
            watch.note({"rod": (place, [1.0, 0.0, 0.0, 0.0])}, 1 / 60)
        errors.append(watch.end())
    assert errors[0] == errors[1]


def test_a_part_in_which_bones_jump_is_left_out():
    given = swing(spacing=0.06, seconds=0.5)
    simulation = Simulation(given.scene, cuts=Cuts(speed=5.0))
    poses = poses_of(given.track, simulation.bones)
    simulation.start(poses[0])
    watch = Watch(simulation)
    watch.begin()
    far = Pose(poses[0].positions + 10.0, poses[0].rotations_wxyz)
    for pose in (poses[1], far):
        simulation.step(pose, 1 / 60)
        watch.note(pose, 1 / 60)
    assert simulation.jumps == 1
    assert not watch.watching
    with pytest.raises(cape.UserError, match="no part"):
        watch.end()


@pytest.mark.parametrize("second", [cape.XPBD(), cape.TRBDF2(), cape.SymplecticEuler(precision="double")])
def test_a_solver_is_changed_where_the_cloth_is(second: cape.Solver):
    given = swing(spacing=0.06, seconds=0.5)
    poses = poses_of(given.track, given.scene.bones)
    changed, plain = Simulation(given.scene), Simulation(given.scene)
    for simulation in (changed, plain):
        simulation.start(poses[0])
        for pose in poses[1:16]:
            simulation.step(pose, 1 / 60)
    before = changed.positions, changed.velocities
    changed.change_solver(second)
    np.testing.assert_array_equal(changed.positions, before[0])
    np.testing.assert_array_equal(changed.velocities, before[1])
    changed.step(poses[16], 1 / 60)
    plain.step(poses[16], 1 / 60)
    assert changed.solver is second
    assert 0.0 < apart(changed.positions, plain.positions) < 1e-3
    changed.change_solver(cape.SymplecticEuler())
    changed.step(poses[17], 1 / 60)


class Clock:
    """Each frame takes as long as it is told, however many steps it has."""

    def __init__(self) -> None:
        self.now, self.seconds, self.asked = 0.0, 0.0, 0

    def __call__(self) -> float:
        self.asked += 1
        if self.asked % 2 == 0:
            self.now += self.seconds
        return self.now


def test_steps_follow_the_time_that_frames_take():
    given = swing(spacing=0.06)
    clock = Clock()
    simulation = AutoSimulation(given.scene, Auto(budget=10.0), clock=clock)
    still = {"rod": (np.zeros(3), [1.0, 0.0, 0.0, 0.0])}
    simulation.start(still)
    # Ten seconds for a frame are enough for the shortest steps worth taking.
    usual = cape.SymplecticEuler().margin
    assert isinstance(simulation.solver, cape.SymplecticEuler)
    assert simulation.solver.margin == pytest.approx(usual / 8.0)

    def frames(seconds: float) -> None:
        clock.seconds = seconds
        for _ in range(30):
            simulation.step(still, 1 / 60)

    frames(16.0)  # twice as long as is planned for
    assert simulation.solver.margin == pytest.approx(usual / 4.0)
    frames(80.0)
    assert simulation.solver == cape.SymplecticEuler()
    frames(16.0)
    assert isinstance(simulation.solver, cape.XPBD)
    simulation.step(still, 1 / 60)
    before = simulation.substeps
    frames(16.0)
    assert simulation.substeps == pytest.approx(before / 2.0, abs=1.0)
    assert simulation.errors == []


@pytest.mark.parametrize(
    "asked", [{"tolerance": 0.0}, {"budget": -1.0}, {"tolerance": np.inf}, {"tolerance": 1e-3, "budget": 4e-3}]
)
def test_what_cannot_be_asked_for_is_refused(asked: dict[str, float]):
    with pytest.raises(cape.UserError):
        Auto(**asked)


def test_a_ledger_keeps_the_accounts_of_one_solver():
    given = swing(spacing=0.06, seconds=0.1)
    with pytest.raises(cape.UserError, match="one solver"):
        cape.simulate(given.scene, given.track, solver=Auto(tolerance=0.001), ledger=cape.Ledger())
    simulation = Simulation(given.scene, ledger=cape.Ledger())
    simulation.start(poses_of(given.track, simulation.bones)[0])
    with pytest.raises(cape.UserError, match="one solver"):
        simulation.change_solver(cape.XPBD())


def test_a_take_tells_of_errors_as_they_were_measured():
    given = swing(spacing=0.06, seconds=2.2)
    chosen = cape.simulate(given.scene, given.track, solver=Auto(tolerance=0.01))
    checked = cape.simulate(given.scene, given.track, solver=cape.XPBD(), check_steps=True)
    plain = cape.simulate(given.scene, given.track, solver=cape.XPBD())
    assert chosen.step_errors
    assert [round(error.time, 2) for error in checked.step_errors] == [1.0, 2.0]
    assert plain.step_errors == ()
    np.testing.assert_array_equal(checked.positions, plain.positions)
