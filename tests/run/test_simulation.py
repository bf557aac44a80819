"""The loop around the solvers: poses, failure, settling, precision, and the same bits every time."""

import itertools
import math
import os
import subprocess
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from cape import XPBD, Capsule, Cloth, Diverged, Fabric, Pose, Scene, Simulation, Solver, SymplecticEuler, attach
from cape import simulate as simulate_take
from cape.kernels.bones import Motion
from cape.run.hanging import Hanging
from motions.errors import UnknownNameError, ValueRangeError
from skeleton.track import BoneTrack
from tests.support.scenes import both_by_default, turn_about

SOFT = Fabric(density=0.2, stretch=100.0, shear=20.0, bend=1e-4, damping_time=1e-3)
UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])


def hanging(
    fabric: Fabric = SOFT, *, spacing: float = 0.05, origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Scene:
    """A rectangle that hangs from a bone."""
    cloth = Cloth.rectangle(width=0.3, height=0.4, spacing=spacing, fabric=fabric, origin=origin)
    return Scene(cloth, [attach(cloth, "hand", "top")])


def swing(time: float, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Pose:
    """Pose of the only bone at a time [s]: swung and turned once a second."""
    angle = 2 * np.pi * time
    place = np.array([0.1 * np.sin(angle), 0.05 * np.sin(2 * angle), 0.0]) + offset
    return Pose(place[None], turn_about((0, 0, 1), 0.5 * np.sin(angle))[None])


def swing_track(frames: int = 31) -> BoneTrack:
    times = np.arange(frames) / 60
    poses = [swing(t) for t in times]
    return BoneTrack(
        ("hand",), times, np.stack([p.positions for p in poses]), np.stack([p.rotations_wxyz for p in poses])
    )


def swung(solver: Solver, *, frames: int = 30, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Positions of the hanging cloth after a while, relative to `offset` [m]."""
    simulation = Simulation(hanging(origin=offset), solver=solver)
    simulation.start(swing(0.0, offset))
    for frame in range(1, frames + 1):
        simulation.step(swing(frame / 60, offset), 1 / 60)
    return simulation.positions - offset


# -- poses --


@both_by_default
def test_a_mapping_and_a_pose_give_the_same_bits(solver: Solver):
    cloth = Cloth.rectangle(width=0.3, height=0.4, spacing=0.05, fabric=SOFT)
    scene = Scene(cloth, [attach(cloth, "left", "top_left"), attach(cloth, "right", "top_right")])
    by_pose, by_name = Simulation(scene, solver=solver), Simulation(scene, solver=solver)
    assert by_pose.bones == ("left", "right")
    for frame in range(5):
        left, right = swing(frame / 60), swing(frame / 120)
        by_pose.step(Pose(*(np.concatenate(both) for both in zip(left, right, strict=True))), 1 / 60)
        named = {
            "right": (right.positions[0].tolist(), right.rotations_wxyz[0]),
            "foot": ((9, 9, 9), UNTURNED),
            "left": (left.positions[0], left.rotations_wxyz[0].tolist()),
        }
        by_name.step(named, 1 / 60)
    np.testing.assert_array_equal(by_name.positions, by_pose.positions)
    np.testing.assert_array_equal(by_name.velocities, by_pose.velocities)


def test_a_step_without_a_start_starts():
    stepped, started = Simulation(hanging()), Simulation(hanging())
    stepped.step(swing(0.0), 1 / 60)
    started.start(swing(0.0))
    started.step(swing(0.0), 1 / 60)
    np.testing.assert_array_equal(stepped.positions, started.positions)
    assert np.abs(stepped.velocities).max() > 0.01


def test_nothing_can_be_asked_before_the_start():
    simulation = Simulation(hanging())
    for ask in (lambda: simulation.positions, lambda: simulation.velocities, simulation.meter):
        with pytest.raises(ValueRangeError, match="has not been started"):
            ask()


BAD_POSES = {
    "NaN": ({"hand": ([math.nan, 0, 0], UNTURNED)}, ValueRangeError, "the pose of the bones is not finite"),
    "infinite turn": ({"hand": ([0, 0, 0], [math.inf, 0, 0, 0])}, ValueRangeError, "not finite"),
    "no turn at all": ({"hand": ([0, 0, 0], [0.0, 0, 0, 0])}, ValueRangeError, "a quaternion of zeros"),
    "missing": ({"foot": ([0, 0, 0], UNTURNED)}, UnknownNameError, "no bone named 'hand'; available: foot"),
    "two bones": (Pose(np.zeros((2, 3)), np.tile(UNTURNED, (2, 1))), ValueRangeError, "a pose of 1 bones is needed"),
}


@pytest.mark.parametrize("case", BAD_POSES)
def test_a_bad_pose_is_refused_and_changes_nothing(case: str):
    pose, error, text = BAD_POSES[case]
    simulation = Simulation(hanging())
    with pytest.raises(error, match=text):
        simulation.start(pose)
    simulation.step(swing(0.0), 1 / 60)
    before = simulation.positions, simulation.velocities
    with pytest.raises(error, match=text):
        simulation.step(pose, 1 / 60)
    np.testing.assert_array_equal((simulation.positions, simulation.velocities), before)


@pytest.mark.parametrize("dt", [0.0, -1 / 60, math.nan, math.inf])
def test_a_bad_time_step_is_refused(dt: float):
    with pytest.raises(ValueRangeError, match="time step must be positive and finite"):
        Simulation(hanging()).step(swing(0.0), dt)


# -- failure --


@dataclass(frozen=True, kw_only=True)
class ExplodesAfter(SymplecticEuler):
    """Turns one vertex into NaN from some frame on, however small the step."""

    frame: int = 3
    stepped: list[int] = field(default_factory=list)

    def step(self, running, motion, *, duration, substeps, threads=1, journal=None) -> int:
        super().step(running, motion, duration=duration, substeps=substeps, threads=threads)
        self.stepped.append(substeps)
        if len(self.stepped) >= self.frame:
            running.state.z[-1] = np.nan
        return 0


@pytest.mark.parametrize("share", [0.15, 0.5])
def test_too_large_a_step_is_taken_back_and_done_again(share: float):
    scene = hanging(SOFT, spacing=0.02)
    trial = Simulation(scene)
    trial.step(swing(0.0), 1 / 60)
    enough = trial.substeps
    # At half of what is stable a rounding error grows by a factor of ten a step, to 1e30 in a frame.
    simulation = Simulation(scene, solver=SymplecticEuler(substeps=round(share * enough)))
    fine = Simulation(scene, solver=SymplecticEuler(substeps=2 * enough))
    for run in (simulation, fine):
        run.start(swing(0.0))
        for frame in range(1, 31):
            run.step(swing(frame / 60), 1 / 60)
    assert simulation.retried == 30
    # Half a step of first order, at 10 m/s2 over half a second: g t h / 2 = 0.6 mm, and twice that where it folds.
    assert np.abs(simulation.positions - fine.positions).max() < 0.0012


def test_a_cloth_strained_far_takes_the_shorter_steps_that_it_needs():
    # Held by both edges and drawn to three times its length, its springs resist across their direction, too.
    fabric = Fabric(density=0.2, stretch=100.0, shear=20.0, bend=1e-4)
    cloth = Cloth.rectangle(width=0.3, height=0.4, spacing=0.02, fabric=fabric)
    simulation = Simulation(Scene(cloth, [attach(cloth, "hand", "top"), attach(cloth, "foot", "bottom")]))
    taken = []
    for frame in range(121):
        places = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -min(0.02 * frame, 0.8)]])
        simulation.step(Pose(places, np.tile(UNTURNED, (2, 1))), 1 / 60)
        taken.append(simulation.substeps)
    assert set(taken) == {taken[0], taken[-1]}
    assert taken[-1] > 1.2 * taken[0]
    # The frame that strained them was taken again; of those after it none explodes.
    assert (simulation.refined, simulation.retried) == (1, 0)


def test_what_explodes_at_any_step_is_reported_and_the_state_is_as_before():
    solver = ExplodesAfter(substeps=20, frame=3)
    simulation = Simulation(hanging(), solver=solver)
    simulation.start(swing(0.0))
    simulation.step(swing(1 / 60), 1 / 60)
    simulation.step(swing(2 / 60), 1 / 60)
    before = simulation.positions, simulation.velocities
    with pytest.raises(Diverged, match=r"explodes even at \d+ substeps.*softer or heavier fabric.*xpbd"):
        simulation.step(swing(3 / 60), 1 / 60)
    np.testing.assert_array_equal((simulation.positions, simulation.velocities), before)
    retried = solver.stepped[3:]
    assert len(retried) == 4
    assert all(after >= 2 * previous for previous, after in itertools.pairwise([20, *retried]))


def test_what_exploded_and_then_does_not_converge_is_kept(monkeypatch: pytest.MonkeyPatch):
    simulation = Simulation(hanging())
    simulation.start(swing(0.0))
    tries: list[int] = []
    cloth = simulation._started
    advance = cloth.advance

    def unsettled(motion, duration: float, substeps: int) -> int:
        advance(motion, duration, substeps)
        tries.append(substeps)
        if len(tries) == 3:
            cloth.state.z[-1] = np.nan
        return 1

    monkeypatch.setattr(cloth, "advance", unsettled)
    simulation.step(swing(1 / 60), 1 / 60)
    assert len(tries) == 4
    assert np.isfinite(simulation.positions).all()
    assert (simulation.retried, simulation.refined, simulation.unconverged) == (1, 0, 1)
    monkeypatch.undo()
    simulation.start(swing(0.0))
    assert (simulation.retried, simulation.refined, simulation.unconverged) == (0, 0, 0)


def test_a_frame_of_settling_that_explodes_is_taken_in_shorter_steps(monkeypatch: pytest.MonkeyPatch):
    """As where limbs pinch the cloth on their way to the first pose."""
    scene, bone = hanging(), swing(0.0)
    usual, refused = Simulation(scene), Simulation(scene)
    usual.start(bone, settle=0.5)
    advance, asked = Hanging.advance, []

    def explosive(self: Hanging, motion: Motion, duration: float, substeps: int) -> int:
        asked.append(substeps)
        unconverged = advance(self, motion, duration, substeps)
        if substeps == asked[0]:
            self.state.vx[3] = 1e9
        return unconverged

    monkeypatch.setattr(Hanging, "advance", explosive)
    refused.start(bone, settle=0.5)
    assert set(asked[1::2]) == {2 * asked[0]}
    np.testing.assert_allclose(refused.positions, usual.positions, atol=1e-3)


def test_a_cloth_settles_at_a_stable_step_whatever_is_asked_for():
    simulation = Simulation(hanging(), solver=SymplecticEuler(substeps=1))
    simulation.start(swing(0.0), settle=0.5)
    assert np.isfinite(simulation.positions).all()
    simulation.step(swing(1 / 60), 1 / 60)
    assert np.isfinite(simulation.positions).all()


def test_an_explosion_while_settling_is_reported():
    simulation = Simulation(hanging(), solver=ExplodesAfter(frame=2))
    with pytest.raises(Diverged, match=r"explodes even at \d+ substeps"):
        simulation.start(swing(0.0), settle=0.5)
    with pytest.raises(ValueRangeError, match="has not been started"):
        _ = simulation.positions


@pytest.mark.parametrize("given", [{"velocity": (math.nan, 0, 0)}, {"spin": (0, math.inf, 0)}, {"spin": (0, 0)}])
def test_a_bad_velocity_or_spin_at_the_start_is_refused(given: dict):
    with pytest.raises(ValueRangeError, match="at the start must be three finite numbers"):
        Simulation(hanging()).start(swing(0.0), **given)


def test_a_take_ends_before_the_frame_that_diverges():
    # The first two steps tell how long it will take.
    take = simulate_take(hanging(), swing_track(), solver=ExplodesAfter(frame=8), settle=0.0)
    assert take.result == "diverged at frame 6"
    assert any("softer or heavier fabric" in w for w in take.warnings)
    assert len(take.positions) == take.bones.frames == 6
    for series in (take.stretch_max, take.penetration, take.penetrated, take.kinetic_energy):
        assert len(series) == 6
    assert np.isfinite(take.positions).all()


def test_an_interrupt_keeps_the_frames_that_are_done():
    def stop(done: int, frames: int) -> None:
        assert frames == 31
        if done == 7:
            raise KeyboardInterrupt

    whole = simulate_take(hanging(), swing_track())
    take = simulate_take(hanging(), swing_track(), progress=stop)
    assert take.result == "stopped at frame 7"
    np.testing.assert_array_equal(take.positions, whole.positions[:7])
    np.testing.assert_array_equal(take.kinetic_energy, whole.kinetic_energy[:7])
    assert whole.result == "finished"
    assert len(whole.positions) == 31


def test_a_track_of_one_frame_is_refused():
    with pytest.raises(ValueRangeError, match="a motion of one frame can't be simulated"):
        simulate_take(hanging(), swing_track(1))


def test_a_bone_that_the_track_lacks_is_named():
    cloth = Cloth.rectangle(width=0.2, height=0.2, spacing=0.1)
    with pytest.raises(UnknownNameError, match="no bone named 'wing'; available: hand"):
        simulate_take(Scene(cloth, [attach(cloth, "wing", "top")]), swing_track())


# -- settling --


@pytest.fixture(scope="module")
def standing():
    """A cape on somebody who stands still for a second: shoulders 0.36 m apart, a trunk of three capsules."""
    names = ("left_upper_arm", "right_upper_arm", "pelvis")
    places = np.array([[0, 0.18, 1.41], [0, -0.18, 1.41], [0, 0, 1.0]])
    cloth = Cloth.cape(length=0.9, spacing=0.04)
    trunk = [
        Capsule("chest", "pelvis", np.array([0, 0, 0.0]), np.array([0, 0, 0.3]), 0.12),
        Capsule("shoulders", "pelvis", np.array([0, 0.13, 0.38]), np.array([0, -0.13, 0.38]), 0.07),
    ]
    scene = Scene(
        cloth,
        [attach(cloth, "left_upper_arm", "top_left"), attach(cloth, "right_upper_arm", "top_right")],
        trunk,
    )
    frames = 61
    track = BoneTrack(names, np.arange(frames) / 60, np.tile(places, (frames, 1, 1)), np.tile(UNTURNED, (frames, 3, 1)))
    return simulate_take(scene, track)


def test_the_first_frame_is_settled(standing):
    cape_mass = Cloth.cape(length=0.9, spacing=0.04).masses().sum()
    # Root mean square, weighed by mass: less than a finger's breadth in a second.
    assert np.sqrt(2 * standing.kinetic_energy[0] / cape_mass) < 0.03
    drift = np.linalg.norm(standing.positions - standing.positions[0], axis=2)
    assert np.sqrt((drift**2).mean(axis=1)).max() < 0.02
    assert standing.result == "finished"


def test_a_settled_cape_hangs_behind_the_back(standing):
    hem = standing.positions[0, -20:]
    # The trunk reaches from 0.12 m before the pelvis to 0.12 m behind it.
    assert hem[:, 0].mean() < 0
    assert hem[:, 0].max() < 0.06
    assert (hem[:, 2] < 0.9).all()
    assert standing.penetration.max() < 1e-5
    assert standing.stretch_max.max() < 0.1


# -- precision --


def test_single_and_double_precision_agree():
    single = swung(SymplecticEuler(substeps=40))
    double = swung(SymplecticEuler(substeps=40, precision="double"))
    difference = np.abs(single - double).max()
    # Each of 1200 steps rounds a position below 0.5 m by 2^-26 m at most, and the springs hold what rounds apart
    # together: 18 um if all roundings went the same way.
    assert 0 < difference < 1200 * 2**-26


@both_by_default
def test_far_from_the_origin_nothing_changes(solver: Solver):
    solver = replace(solver, substeps=40)
    near = swung(solver)
    # A kilometre off. Powers of two, so that the poses themselves lose 2^-43 m at most.
    far = swung(solver, offset=(1024.0, -512.0, 128.0))
    assert np.abs(far - near).max() < (1200 * 2**-26 if solver.precision == "single" else 1e-9)


@both_by_default
def test_a_cloth_does_not_notice_that_its_world_moves_on(solver: Solver):
    # Galileo: at 6 m/s, and five metres on, it swings as one that was hung up at rest.
    speed, frames = np.array([5.0, -3.0, 1.0]), 50
    still, carried = (Simulation(hanging(), solver=replace(solver, substeps=40)) for _ in range(2))
    still.start(swing(0.0))
    carried.start(swing(0.0), velocity=speed)
    for frame in range(1, frames + 1):
        still.step(swing(frame / 60), 1 / 60)
        carried.step(swing(frame / 60, tuple(speed * frame / 60)), 1 / 60)
    assert np.abs(still.velocities).max() > 0.5
    moved = carried.positions - still.positions - speed * frames / 60
    # Roundings of positions below 2 m, and of speeds below 8 m/s, which reach positions only through one step each.
    assert np.abs(moved).max() < (2000 * (2**-24 + 2**-22 / 2400) if solver.precision == "single" else 1e-9)
    np.testing.assert_allclose(carried.velocities - speed, still.velocities, atol=2e-2)


# -- the same bits --

SCRIPT = """
import sys
sys.path.insert(0, {root!r})
import hashlib, numpy as np
from tests.run.test_simulation import hanging, swing_track
from cape import XPBD, SymplecticEuler, simulate
for solver in (SymplecticEuler(), XPBD()):
    take = simulate(hanging(), swing_track(), solver=solver)
    print(hashlib.sha256(take.positions.tobytes() + take.kinetic_energy.tobytes()).hexdigest())
"""


def test_the_same_bits_in_any_process_with_any_number_of_threads():
    script = SCRIPT.format(root=str(Path(__file__).parents[2]))
    seen = []
    for threads in ("1", "2"):
        environment = {**os.environ, "NUMBA_NUM_THREADS": threads}
        done = subprocess.run(
            [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
        )
        seen.append(done.stdout.split())
    assert seen[0] == seen[1]
    assert len(seen[0]) == 2


@both_by_default
def test_the_same_bits_twice(solver: Solver):
    first, second = (simulate_take(hanging(), swing_track(), solver=solver) for _ in range(2))
    np.testing.assert_array_equal(first.positions, second.positions)
    np.testing.assert_array_equal(first.kinetic_energy, second.kinetic_energy)
    assert first.stretch_p99 == second.stretch_p99


def test_a_simulation_starts_anew():
    simulation = Simulation(hanging())
    results = []
    for _ in range(2):
        simulation.start(swing(0.0))
        for frame in range(1, 6):
            simulation.step(swing(frame / 60), 1 / 60)
        results.append(simulation.positions)
    np.testing.assert_array_equal(*results)


COMPILER_OFF = """
import sys
sys.path.insert(0, {root!r})
import numpy as np
from tests.run.test_simulation import swung
from cape import XPBD, SymplecticEuler
np.save(sys.argv[1], [swung(s(substeps=40, precision="double"), frames=2) for s in (SymplecticEuler, XPBD)])
"""


def test_the_compiler_changes_nothing_but_rounding(tmp_path: Path):
    script, output = COMPILER_OFF.format(root=str(Path(__file__).parents[2])), tmp_path / "positions.npy"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    subprocess.run([sys.executable, "-c", script, str(output)], env=environment, check=True)
    compiled = [swung(solver(substeps=40, precision="double"), frames=2) for solver in (SymplecticEuler, XPBD)]
    np.testing.assert_allclose(np.load(output), compiled, atol=1e-13)
