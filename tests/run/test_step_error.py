"""The error of a time step, as it is told while a simulation runs, against what it truly is."""

import numpy as np
import pytest

import cape
from cape import Cuts, Pose, Simulation
from cape.run.step_error import (
    FREE_WINDOW,
    PARTS,
    Schedule,
    ScheduledWatch,
    Watch,
    distance,
    limit_of,
    schedule,
)
from cape.scene.poses import poses_of
from cape.scene.standard_scenes import StandardScene, draped, swing
from skeleton.shapes import Sphere
from tests.support.exact import ExactModel

FRAME = 1.0 / 60.0
TOLD = (0.8, 2.0)  # times the true error, that a run's may be


@pytest.mark.parametrize("order", [1.0, 1.5, 2.0])
def test_the_limit_of_clean_convergence_is_exact(order: float):
    limit, error = np.array([[1.0, 2.0, 3.0]]), np.array([[0.3, -0.1, 0.2]])
    ends = [limit + error * n**-order for n in (1.0, 3.0, 9.0)]
    found = limit_of(ends, 3.0)
    np.testing.assert_allclose(found.positions, limit, atol=1e-12)
    assert found.order == pytest.approx(order)
    # What is left of the error in nine times as many steps is what was extrapolated; both are told, at right angles.
    size = float(np.linalg.norm(error))
    assert found.unsure == pytest.approx(size * 9.0**-order)
    assert found.error(limit + error) == pytest.approx(size * np.hypot(1.0, 9.0**-order))


def test_where_differences_shrink_slowly_or_not_first_order_is_assumed():
    # x_n + (x_n - x_(n/2)) / (2 - 1), by hand.
    for before, last in ((1.0, 0.9), (1.0, 2.0), (0.0, 1.0)):
        ends = [np.full((1, 3), value) for value in (0.0, before, before + last)]
        found = limit_of(ends)
        np.testing.assert_allclose(found.positions, before + 2.0 * last)
        assert found.order < 1.0
        assert found.unsure == pytest.approx(np.sqrt(3.0) * last)
    still = np.ones((2, 3))
    assert limit_of([still, still, still]).order == np.inf


def parts_of(given: StandardScene, seconds: float, starts: tuple[int, ...], solver: cape.Solver):
    """Run a scene with a watch; its errors, and for each part where the run begins and ends it."""
    poses = poses_of(given.track, given.scene.bones)
    run = Simulation(given.scene, solver=solver)
    run.start(poses[0])
    length = round(seconds / FRAME)
    watch, snapshots, ends = ScheduledWatch(run, Schedule(seconds, starts)), {}, {}
    for frame in range(1, starts[-1] + length + 1):
        if frame - 1 in starts:
            snapshots[frame - 1] = run.snapshot()
        run.step(poses[frame], FRAME)
        watch.note(poses[frame], FRAME)
        if frame - length in starts:
            ends[frame - length] = run.positions
    assert len(watch.errors) == len(starts)
    assert [error.time for error in watch.errors] == pytest.approx([(start + length) * FRAME for start in starts])
    return run, watch.errors, snapshots, ends


def rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize(
    "solver",
    [
        cape.SymplecticEuler(), cape.XPBD(substeps=20), cape.XPBD(substeps=80), cape.BackwardEuler(substeps=8),
        cape.TRBDF2(substeps=4),
    ],
    ids=lambda solver: f"{solver.name} {solver.substeps or ''}",
)  # fmt: skip
def test_what_is_told_of_free_cloth_is_the_distance_from_the_exact_motion(solver: cape.Solver):
    # Three parts that overlap, of a sheet of 30 vertices, against an integrator of order 8 with force code of its own.
    given, starts = swing(spacing=0.2, seconds=0.7), (0, 11, 22)
    run, errors, snapshots, ends = parts_of(given, 0.3, starts, solver)
    model, poses, true = ExactModel(run.assembly), poses_of(given.track, run.bones), []
    for start in starts:
        place = snapshots[start].place
        rod = [pose.positions[0] for pose in poses[start : start + 19]]
        exact = model.motion(place.state[:, :3] + place.origin, place.state[:, 3:], rod, FRAME)[-1]
        true.append(distance(ends[start], exact))
    told = [error.rms for error in errors]
    assert TOLD[0] < rms(told) / rms(true) < TOLD[1]
    assert np.all(np.array(told) < 4.0 * np.array(true))
    assert np.all(np.array(told) > 0.3 * np.array(true))


@pytest.mark.parametrize("solver", [cape.SymplecticEuler(), cape.XPBD(substeps=10), cape.BackwardEuler(substeps=4)])
def test_what_is_told_in_contact_is_the_distance_from_the_solvers_own_limit(solver: cape.Solver):
    given = draped("sphere", Sphere(center=np.zeros(3), radius=0.3), spacing=0.1, seconds=1.0)
    starts = (12, 24, 36, 48)
    run, errors, snapshots, ends = parts_of(given, 0.1, starts, solver)
    twin, poses, true, unsure = Simulation(given.scene, solver=solver), poses_of(given.track, run.bones), [], []
    twin.start(poses[0])
    for start in starts:
        finer = []
        for times in (64, 128):
            twin.change_solver(solver.in_steps(times * run.substeps, FRAME))
            twin.start_from(snapshots[start])
            for frame in range(start + 1, start + 7):
                twin.step(poses[frame], FRAME)
            finer.append(twin.positions)
        true.append(distance(ends[start], finer[1]))
        unsure.append(distance(*finer))
    assert rms(unsure) < 0.1 * rms(true)
    assert TOLD[0] < rms([error.rms for error in errors]) / rms(true) < TOLD[1]


def test_parts_are_ten_at_least_and_spread_evenly_over_the_motion():
    free, touched = swing(seconds=3.0), draped("sphere", Sphere(center=np.zeros(3), radius=0.3), seconds=12.0)
    planned = schedule(free.scene, free.track.times)
    assert planned.seconds == FREE_WINDOW
    assert (planned.starts[0], planned.starts[-1], len(planned.starts)) == (0, 120, PARTS)
    assert np.ptp(np.diff(planned.starts)) <= 1
    planned = schedule(touched.scene, touched.track.times)
    assert (planned.seconds, planned.starts[-1], len(planned.starts)) == (0.1, 714, 24)
    short = swing(seconds=0.5)
    assert schedule(short.scene, short.track.times).seconds == 0.25


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
        assert watch.full
        errors.append(watch.end())
    assert errors[0] == errors[1]
    assert (errors[0].solver, errors[0].substeps, errors[0].seconds) == ("xpbd", 40, pytest.approx(0.25))


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


def test_a_take_tells_one_number_and_is_the_same_as_without():
    given = swing(spacing=0.12, seconds=1.2)
    checked = cape.simulate(given.scene, given.track, solver=cape.XPBD(substeps=10), check_steps=True)
    plain = cape.simulate(given.scene, given.track, solver=cape.XPBD(substeps=10))
    assert len(checked.step_errors) == PARTS
    assert checked.step_error == pytest.approx(rms([error.rms for error in checked.step_errors]))
    assert plain.step_errors == ()
    assert np.isnan(plain.step_error)
    np.testing.assert_array_equal(checked.positions, plain.positions)
