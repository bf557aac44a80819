"""Solver and steps from a tolerance or a budget."""

from dataclasses import replace

import numpy as np
import pytest

import cape
from cape import Auto, AutoSimulation, Pose, Simulation
from cape.cloth.fabric import Fabric
from cape.run.auto.ahead import Coming
from cape.run.auto.choice import FRAME, Choice
from cape.run.auto.drift import RATIOS, Drift, Orders
from cape.run.auto.part import End, Part
from cape.run.auto.prediction import APART, SURE, UNKNOWN, Prediction
from cape.run.auto.sagging import USUAL_SPEED, USUAL_TIME, Sagging
from cape.run.step_error import PARTS, Schedule, ScheduledWatch
from cape.scene.poses import poses_of
from cape.scene.standard_scenes import StandardScene, draped, flag, swing
from skeleton.shapes import Sphere
from tests.support.error_scenes import TOUCHED, gentle

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


@pytest.mark.parametrize("tolerance", [0.001, 0.0001])
def test_a_short_motion_of_stiff_cloth_is_neither_missed_nor_taken_in_steps_for_nothing(tolerance: float):
    given = gentle("stiff", 2, 1.2, stretch=1e6, spacing=0.1)
    exact = run(Simulation(given.scene, solver=replace(EXACT, margin=0.5)), given)
    simulation = AutoSimulation(given.scene, Auto(tolerance=tolerance))
    simulation.expect(poses_of(given.track, simulation.bones)[1:], np.diff(given.track.times))
    error = apart(run(simulation, given), exact)
    assert simulation.solver.name == "xpbd"
    assert 0.5 * tolerance < error < 1.1 * tolerance
    (told,) = simulation.errors
    assert 0.5 * error < told.rms < 2.0 * error


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
    counts = set()
    for pose, dt in zip(poses[1:], steps, strict=True):
        chosen.step(pose, float(dt))
        counts.add(chosen.substeps)
        plain.change_solver(cape.SymplecticEuler(substeps=chosen.substeps))
        plain.step(pose, float(dt))
        np.testing.assert_array_equal(chosen.positions, plain.positions)
        np.testing.assert_array_equal(chosen.velocities, plain.velocities)
    assert len(counts) > 1


def test_another_pose_than_was_expected_ends_what_was_taken_ahead():
    given = flag(spacing=0.1, seconds=0.5)
    chosen, plain = AutoSimulation(given.scene, Auto(tolerance=0.003)), Simulation(given.scene)
    poses = poses_of(given.track, chosen.bones)
    moved = Pose(poses[3].positions + 0.01, poses[3].rotations_wxyz)
    for simulation in (chosen, plain):
        simulation.start(poses[0])
    steps = np.diff(given.track.times)
    chosen.expect(poses[1:], steps)
    ahead = []
    for pose, dt in zip((*poses[1:3], moved, *poses[4:9]), steps, strict=False):
        # A loop of its own reckons the length of a frame otherwise.
        chosen.step(pose, float(np.nextafter(dt, 1.0)) if pose is not moved else float(dt))
        ahead.append(bool(chosen._ahead.taken))
        plain.change_solver(cape.SymplecticEuler(substeps=chosen.substeps))
        plain.step(pose, float(dt))
        if pose is moved:
            np.testing.assert_array_equal(chosen.positions, plain.positions)
    assert ahead == [True, True, *6 * [False]]
    with pytest.raises(cape.UserError, match="as many steps"):
        chosen.expect(poses, [0.1])


def test_the_step_of_xpbd_is_that_of_its_error():
    exact = Sagging(300.0, 2.0)
    assert exact.error(exact.step(0.002)) == pytest.approx(0.002)
    # It lags in proportion to how fast it is moved, and sags as far.
    assert exact.at(2.0 * USUAL_SPEED) == pytest.approx((300.0, 4.0))
    # It falls behind all the time; of long motions no more is expected before they tell of themselves.
    assert exact.at(USUAL_SPEED, 0.25 * USUAL_TIME) == pytest.approx((300.0, 0.5))
    assert exact.at(USUAL_SPEED, 3.0 * USUAL_TIME) == pytest.approx((300.0, 2.0))


@pytest.mark.parametrize("ratio", [2.0, 4.0, 0.5])
def test_a_drift_is_found_from_a_run_in_other_steps(ratio: float):
    # Errors of a run in steps of 1, and of its companion, which point the same way: a h^2 + b h t.
    times, (start, growth) = np.linspace(0.1, 2.0, 20), (0.4, 0.3)
    apart = np.abs(start * (ratio**2 - 1.0) + growth * (ratio - 1.0) * times)
    found = Drift.between(times, apart, ratio, Orders(2.0, 1.0))
    assert found[:2] == pytest.approx((start, growth))
    # What was not seen goes on as is likely; its mean is as far off as what was seen.
    found = Drift.between(times, apart, ratio, Orders(2.0, 1.0), likely=0.1, seen=0.25)
    assert found.growth == pytest.approx(0.25 * growth + 0.75 * 0.1)
    # What grows faster than errors may is out of place at once, as by so much on the average.
    found = Drift.between(times, apart, ratio, Orders(2.0, 1.0), most=0.1)
    out = np.mean(apart - 0.1 * abs(ratio - 1.0) * times) / abs(ratio**2 - 1.0)
    assert found[:2] == pytest.approx((out, 0.1))
    still = Drift.between(times, np.full(20, 0.3), 2.0, Orders(2.0, None))
    assert still[:2] == pytest.approx((0.1, 0.0))


def test_a_drift_tells_the_error_of_the_whole_and_which_steps_keep_it():
    drift = Drift(0.4, 0.3, Orders(2.0, 1.0))
    times = np.linspace(0.0, 5.0, 100_001)
    assert drift.rms(5.0, 5.0) == pytest.approx(apart_over(0.4 + 0.3 * times), rel=1e-4)
    # Half the step from 1 s on: a quarter of the start, half of the growth, and what had grown by then.
    halved = np.where(times < 1.0, 0.4 + 0.3 * times, 0.1 + 0.3 + 0.15 * (times - 1.0))
    assert drift.rms(1.0, 5.0, 0.5) == pytest.approx(apart_over(halved), rel=1e-4)
    ratio = drift.ratio(0.8, 1.0, 5.0)
    assert drift.rms(1.0, 5.0, ratio) <= 0.8 < drift.rms(1.0, 5.0, 1.1 * ratio)
    assert drift.ratio(1e-6, 1.0, 5.0) == RATIOS[-1]


def apart_over(values: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def test_few_parts_that_are_not_measured_miss_what_is_allowed():
    # Parts whose errors scatter by a factor of 2.1, each like the one before it, as those of a cape in contact do.
    rng, beyond, missed, measured = np.random.default_rng(5), 0, 0, 0
    for _ in range(60):
        known, value = Prediction(), rng.normal()
        for _part in range(100):
            if known.empty or known.bound() > 8.0:
                known.note(float(np.exp(0.75 * value)))
                measured += 1
            else:
                missed += 0.75 * value > np.log(8.0)
                beyond += 0.75 * value > np.log(known.bound())
                known.pass_over()
            value = 0.7 * value + np.sqrt(1.0 - 0.7**2) * rng.normal()
    # Errors beyond eight times the usual are one in 360, whether measured or not. The bound itself is exceeded by one
    # in a hundred where all is known, and by a few where it rests on as few parts as are measured.
    assert missed / 6000 < 1 / 360
    assert beyond / (6000 - measured) < 0.05
    assert measured < 0.3 * 6000


def test_a_bound_widens_as_parts_pass_until_one_is_measured():
    known = Prediction()
    assert known.empty
    known.note(1.0)
    # One error is known, and nothing of how they change from part to part.
    assert known.bound() == pytest.approx(np.exp(SURE * UNKNOWN))
    for _ in range(9):
        known.note(1.0)
    # Variances of nine changes and of ten parts, all none, and of one that is not known.
    assert known.bound() == pytest.approx(np.exp(SURE * UNKNOWN * np.sqrt(1.0 / 10.0)))
    near = known.bound()
    known.pass_over()
    assert known.bound() > near
    # Those of all parts tell ever less of what is long after them.
    for passed in (1, 2):
        for _ in range(APART):
            known.pass_over()
        spread = UNKNOWN * np.hypot(np.sqrt(1.0 / 11.0) * np.sqrt(2.0), np.sqrt(passed))
        assert known.bound() == pytest.approx(np.exp(SURE * spread))
    assert known.likely == 1.0


def test_what_a_calm_part_tells_is_told_of_one_that_is_shaken_as_much_more():
    known = Prediction()
    known.note(2.0, jolt=0.1)
    calm = known.bound()
    assert known.bound(10.0) == pytest.approx(100.0 * calm)
    known.pass_over(0.2)
    assert known.likely == pytest.approx(4.0)
    known.note(1.0, jolt=0.1)
    # Jolts have doubled and halved: the next one is likely to be twice as strong, where it is stronger.
    assert known.rise == pytest.approx(2.0)


def test_a_jolt_is_the_change_of_velocities_in_a_frame():
    rng = np.random.default_rng(3)
    start, *ends = (rng.normal(size=(3, 7)) for _ in range(3))
    given = swing(spacing=0.2, seconds=0.1)
    run_ = Simulation(given.scene)
    run_.start(poses_of(given.track, given.scene.bones)[0])
    mark = run_.mark()
    moment = mark.frame.moment._replace(state=(*np.zeros((3, 7)), *start))
    part = Part(mark._replace(frame=mark.frame._replace(moment=moment)))
    coming = Coming(poses_of(given.track, given.scene.bones)[1], FRAME)
    for end in ends:
        part.note(coming, 20, list(end))
    changes = np.diff([start, *ends], axis=0)
    assert part.jolt == pytest.approx(np.sqrt(np.mean(np.sum(changes**2, axis=1))))


def test_an_error_that_does_not_shrink_with_the_step_is_told_larger_by_as_much():
    given = flag(spacing=0.2, seconds=0.1)
    simulation, poses = AutoSimulation(given.scene, Auto(tolerance=0.001)), poses_of(given.track, given.scene.bones)
    simulation.start(poses[0])
    part = Part(simulation.mark())
    simulation._take(Coming(poses[1], FRAME))
    part.note(Coming(poses[1], FRAME), simulation.substeps, simulation._started.state[3:])
    here, length, way = simulation.positions, simulation._choice.length, np.array([1e-3, 0.0, 0.0])

    def told(*ends: tuple[float, float]) -> float:
        return simulation._compare(part, [End("euler", n * length, here + mm * way) for n, mm in ends]).rms

    # Twice the step makes twice the error, 2 mm, and four times the step four times that.
    assert told((2.0, 1.0)) == pytest.approx(0.001)
    assert told((4.0, 3.0), (2.0, 1.0)) == pytest.approx(0.001)
    # Half as much would have been left, had the error shrunk from 2 mm as the step.
    assert told((4.0, 2.0), (2.0, 1.0)) == pytest.approx(0.002)
    # Steps that are nearly as long tell nothing: others are taken.
    assert told((1.1, 1.0)) != pytest.approx(0.01, rel=0.1)


def test_steps_of_another_length_need_no_other_programs():
    given = swing(spacing=0.1, seconds=0.1)
    simulation = Simulation(given.scene)
    simulation.start(poses_of(given.track, given.scene.bones)[0])
    running, usual = simulation._started.running, cape.SymplecticEuler()
    for solver in (replace(usual, margin=0.3), replace(usual, substeps=50)):
        simulation.change_solver(solver)
        assert simulation._started.running is running
    assert simulation._started.choose_substeps(FRAME) == 50
    # Unless they are too short for single precision.
    simulation.change_solver(replace(usual, margin=1e-4))
    assert simulation._started.running.state.x.dtype == np.float64
    simulation.change_solver(usual)
    assert simulation._started.running.state.x.dtype == np.float32


def test_a_part_in_which_the_cloth_is_struck_keeps_to_what_was_asked_for_after_calm_ones():
    tolerance, given = 0.0005, TOUCHED["pushed"](1, 0.6)
    simulation = AutoSimulation(given.scene, Auto(tolerance=tolerance))
    poses, steps = poses_of(given.track, simulation.bones), np.diff(given.track.times)
    simulation.start(poses[0])
    simulation.expect(poses[1:], steps)
    watch = ScheduledWatch(simulation, Schedule(0.1, tuple(range(0, 36, 6))))
    for pose, dt in zip(poses[1:], steps, strict=True):
        simulation.step(pose, float(dt))
        watch.note(pose, float(dt))
    errors = np.array([error.rms for error in watch.errors])
    assert errors.max() < 1.1 * tolerance
    assert errors[0] < 0.1 * tolerance < errors.max()


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


def test_steps_become_shorter_where_errors_are_to_be_smaller_and_longer_where_larger():
    # Of first order in contact.
    touched = Choice(stable=1e-6, sagging=Sagging(300.0, 5.0))
    touched.aim_at(0.01)
    before = touched.step
    assert touched.solver == cape.XPBD()
    assert touched.scale(0.4)
    assert touched.step == pytest.approx(0.4 * before)
    touched.scale(1.5)
    assert touched.step == pytest.approx(0.6 * before)
    # In free motion by the errors of a cloth that sags and lags.
    free = Choice(stable=1e-6, sagging=Sagging(300.0, 5.0), free=True)
    free.aim_at(0.01)
    error = free.sagging.error(free.step)
    free.scale(0.4)
    assert free.sagging.error(free.step) == pytest.approx(0.4 * error)
    euler = Choice(stable=1e-3, sagging=Sagging(300.0, 5.0))
    euler.aim_at(0.001)
    assert euler.explodes_at_double
    assert euler.scale(0.4)
    assert euler.finer == pytest.approx(2.5)
    assert not euler.explodes_at_double
    usual = cape.SymplecticEuler().margin
    assert euler.for_frame(FRAME, times=2.0) == cape.SymplecticEuler(margin=usual * 2.0 / 2.5)
    assert not euler.scale(1.0)
    euler.take(100.0)
    assert euler.for_frame(FRAME) == cape.SymplecticEuler()
    # Free cloth so stiff that thousands of steps of the others would be needed.
    stiff = Choice(stable=1e-8, sagging=Sagging(3e5, 5.0), free=True)
    stiff.aim_at(1e-5)
    assert stiff.for_frame(1 / 30) == cape.TRBDF2(substeps=16)
    assert stiff.for_frame(1 / 30, times=2.0) == cape.TRBDF2(substeps=8)


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
