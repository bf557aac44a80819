"""Solver and steps from a tolerance or a budget."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

import cape
from cape import Auto, AutoSimulation, Pose, Simulation
from cape.cloth.fabric import Fabric
from cape.run.choice import Choice
from cape.run.sagging import Sagging
from cape.run.step_error import PARTS, Schedule, ScheduledWatch
from cape.scene.poses import poses_of
from cape.scene.standard_scenes import StandardScene, draped, swing
from skeleton.shapes import Sphere
from tests.support.error_scenes import gentle

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


@pytest.fixture(scope="module", params=[2e3, 2e5], ids=["soft", "stiff"])
def smooth(request: pytest.FixtureRequest) -> tuple[StandardScene, np.ndarray]:
    """A smooth scene, and where it goes in steps so short that less than 0.02 mm is left of their error."""
    given = gentle("stiff", 1, 1.5, stretch=request.param, spacing=0.1)
    return given, run(Simulation(given.scene, solver=replace(EXACT, margin=0.2)), given)


@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_errors_of_whole_runs_are_what_was_asked_for_where_the_motion_is_known(
    smooth: tuple[StandardScene, np.ndarray], tolerance: float
):
    given, exact = smooth
    simulation = AutoSimulation(given.scene, Auto(tolerance=tolerance))
    simulation.expect(poses_of(given.track, simulation.bones)[1:], np.diff(given.track.times))
    assert apart(run(simulation, given), exact) < 1.1 * tolerance
    assert simulation.errors
    assert all(error.rms <= tolerance for error in simulation.errors)


@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_errors_of_whole_runs_are_twice_as_much_at_most_where_it_is_not(
    smooth: tuple[StandardScene, np.ndarray], tolerance: float
):
    given, exact = smooth
    simulation = AutoSimulation(given.scene, Auto(tolerance=tolerance))
    assert apart(run(simulation, given), exact) < 2.0 * tolerance


@pytest.mark.parametrize("tolerance", [0.003, 0.0003])
def test_in_contact_parts_keep_to_what_was_asked_for_by_an_error_measured_apart(tolerance: float):
    given = draped("sphere", Sphere(center=np.zeros(3), radius=0.3), spacing=0.1, seconds=0.4)
    steps = np.diff(given.track.times)
    simulation = AutoSimulation(given.scene, Auto(tolerance=tolerance))
    poses = poses_of(given.track, simulation.bones)
    simulation.start(poses[0])
    simulation.expect(poses[1:], steps)
    watch = ScheduledWatch(simulation, Schedule(0.1, (0, 6, 12, 18)))
    for pose, dt in zip(poses[1:], steps, strict=True):
        simulation.step(pose, float(dt))
        watch.note(pose, float(dt))
    errors = np.array([error.rms for error in watch.errors])
    assert len(errors) == 4
    assert errors.max() < 1.1 * tolerance
    # Nor are they far smaller where the cloth touches, which would be steps for nothing.
    assert tolerance > 0.001 or errors.max() > 0.2 * tolerance


def test_frames_taken_ahead_are_those_of_a_run_that_takes_the_same_steps():
    given = draped("sphere", Sphere(center=np.zeros(3), radius=0.3), spacing=0.1, seconds=0.5)
    chosen, plain = AutoSimulation(given.scene, Auto(tolerance=0.003)), Simulation(given.scene)
    poses, steps = poses_of(given.track, chosen.bones), np.diff(given.track.times)
    for simulation in (chosen, plain):
        simulation.start(poses[0])
    chosen.expect(poses[1:], steps)
    for pose, dt in zip(poses[1:], steps, strict=True):
        for simulation in (chosen, plain):
            simulation.step(pose, float(dt))
        np.testing.assert_array_equal(chosen.positions, plain.positions)
        np.testing.assert_array_equal(chosen.velocities, plain.velocities)
    assert chosen.solver == plain.solver


def test_another_pose_than_was_expected_ends_what_was_taken_ahead():
    given = draped("sphere", Sphere(center=np.zeros(3), radius=0.3), spacing=0.1, seconds=0.5)
    chosen, plain = AutoSimulation(given.scene, Auto(tolerance=0.003)), Simulation(given.scene)
    poses = poses_of(given.track, chosen.bones)
    moved = Pose(poses[3].positions + 0.01, poses[3].rotations_wxyz)
    for simulation in (chosen, plain):
        simulation.start(poses[0])
    chosen.expect(poses[1:], np.diff(given.track.times))
    for pose in (*poses[1:3], moved, *poses[4:9]):
        for simulation in (chosen, plain):
            simulation.step(pose, 1.0 / 60.0)
    np.testing.assert_array_equal(chosen.positions, plain.positions)
    with pytest.raises(cape.UserError, match="as many steps"):
        chosen.expect(poses, [0.1])


def test_the_error_of_xpbd_is_fitted_by_its_two_parts():
    exact = Sagging(300.0, 2.0)
    steps = (1e-3, 4e-4, 1e-4)
    ways = [exact.error(first) - exact.error(second) for first, second in itertools.pairwise(steps)]
    assert Sagging.measured(steps, (ways[0], ways[1])) == pytest.approx(exact)
    assert exact.error(exact.step(0.002)) == pytest.approx(0.002)
    # Where they shrink more slowly than by the first order, it is taken; where faster than by the second, that.
    assert Sagging.measured((4.0, 2.0, 1.0), (1.0, 1.0)) == pytest.approx((0.0, 1.0))
    assert Sagging.measured((4.0, 2.0, 1.0), (30.0, 3.0)) == pytest.approx((1.0, 0.0))


def test_usual_fabrics_get_euler_and_stiff_ones_as_many_steps_of_xpbd_as_they_need():
    usual = AutoSimulation(swing().scene, Auto(tolerance=0.001))
    stiff = [AutoSimulation(swing(fabric=STIFF).scene, Auto(tolerance=mm * 1e-3)) for mm in (10.0, 1.0)]
    for simulation in (usual, *stiff):
        simulation.start({"rod": (np.zeros(3), [1.0, 0.0, 0.0, 0.0])})
    assert usual.solver == cape.SymplecticEuler()
    coarse, fine = (simulation.solver.substeps or 0 for simulation in stiff)
    assert [simulation.solver.name for simulation in stiff] == ["xpbd", "xpbd"]
    assert 8 <= coarse < 40 < fine < 200


def test_frames_of_any_length_get_as_many_steps():
    given = swing(spacing=0.2, fabric=STIFF, seconds=0.5)
    simulation = AutoSimulation(given.scene, Auto(tolerance=0.01))
    where = {"rod": (np.zeros(3), [1.0, 0.0, 0.0, 0.0])}
    counts = []
    for dt in (1 / 60, 1 / 30, 1 / 60):
        simulation.step(where, dt)
        counts.append(simulation.substeps)
    assert simulation.solver.name == "xpbd"
    assert abs(counts[1] - 2 * counts[0]) <= 1
    assert counts[2] == counts[0]


def test_steps_become_shorter_where_errors_are_larger_than_allowed_and_longer_where_far_smaller():
    # Of first order in contact: twice the error allowed, aimed at 0.8 of it, is 0.4 of the step.
    touched = Choice(stable=1e-6, sagging=Sagging(300.0, 5.0))
    touched.aim_at(0.01)
    before = touched.step
    assert touched.solver == cape.XPBD()
    touched.shorten(2.0)
    assert touched.step == pytest.approx(0.4 * before)
    touched.lengthen(0.1)
    assert touched.step == pytest.approx(0.6 * before)
    # In free motion by the errors of a cloth that sags and lags.
    free = Choice(stable=1e-6, sagging=Sagging(300.0, 5.0), free=True)
    free.aim_at(0.01)
    error = free.sagging.error(free.step)
    free.shorten(2.0)
    assert free.sagging.error(free.step) == pytest.approx(0.4 * error)
    assert free.growth == pytest.approx(free.sagging.error(2.0 * free.step) / free.sagging.error(free.step))
    euler = Choice(stable=1e-3, sagging=Sagging(300.0, 5.0))
    euler.aim_at(0.001)
    assert euler.explodes_at_half
    assert euler.shorten(2.0)
    assert euler.finer == pytest.approx(2.5)
    assert not euler.explodes_at_half
    euler.lengthen(0.01)
    euler.lengthen(0.01)
    assert euler.finer == pytest.approx(2.5 / 1.5 / 1.5)
    # Free cloth so stiff that thousands of steps of the others would be needed.
    stiff = Choice(stable=1e-8, sagging=Sagging(3e5, 5.0), free=True)
    stiff.aim_at(1e-5)
    assert stiff.for_frame(1 / 30) == cape.TRBDF2(substeps=16)


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


def test_a_take_tells_of_the_errors_of_a_chosen_solver_and_measures_them_where_asked_to():
    given = swing(spacing=0.12, seconds=1.2)
    chosen = cape.simulate(given.scene, given.track, solver=Auto(tolerance=0.01))
    checked = cape.simulate(given.scene, given.track, solver=Auto(tolerance=0.01), check_steps=True)
    assert chosen.step_errors
    assert len(checked.step_errors) == PARTS
    np.testing.assert_array_equal(checked.positions, chosen.positions)
