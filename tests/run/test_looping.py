"""Going round until the cloth repeats: its limit, the way it is carried, and that no seam is left."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import cape
from cape import Cloth, Cuts, Fabric, Pose, Scene, Simulation, SymplecticEuler, Wind, attach
from cape.run import looping
from cape.scene.loops import Travel, round_of
from cape.scene.poses import poses_of
from motions import quaternions
from motions.errors import ValueRangeError
from skeleton.track import BoneTrack
from tests.support.scenes import turn_about

FRAME = 1 / 60
ROUND = 60  # frames
SOFT = Fabric(density=0.2, stretch=100.0, shear=20.0, bend=1e-4, damping_time=1e-3)
DOUBLE = SymplecticEuler(precision="double")


def sheet() -> Scene:
    """A sheet that hangs by its upper edge in still air, which stops it swinging in a second or two."""
    cloth = Cloth.rectangle(width=0.3, height=0.4, spacing=0.1, fabric=SOFT)
    return Scene(cloth, [attach(cloth, "rod", "top")], wind=Wind())


def swing(frames: int = ROUND, *, speed: float = 0.0, turn: float = 0.0) -> BoneTrack:
    """A rod that swings to and fro once in `ROUND` frames, walks along +X [m/s] and turns [rad/s]."""
    times = FRAME * np.arange(frames, dtype=float)
    angle = 2.0 * np.pi * np.arange(frames) / ROUND
    heading = turn * times
    radius = speed / turn if turn else 0.0
    path = np.stack(
        [radius * np.sin(heading) if turn else speed * times, radius * (1.0 - np.cos(heading)), np.zeros(frames)],
        axis=1,
    )
    turns = np.array([turn_about((0.0, 0.0, 1.0), each) for each in heading])
    swung = quaternions.rotate(turns, np.stack([0.05 * np.sin(angle), np.zeros(frames), np.zeros(frames)], axis=1))
    return BoneTrack(("rod",), times, (path + swung)[:, None], turns[:, None])


def rounds_carried_on(track: BoneTrack, travel: Travel, count: int) -> list[np.ndarray]:
    """Each of so many rounds of the sheet [m], (F, V, 3), each in its own place: none is brought back."""
    scene, rounds = sheet(), []
    simulation = Simulation(scene, solver=DOUBLE)
    poses = poses_of(track, simulation.bones)
    turned = quaternions.multiply(track.rotations_wxyz[1, 0], quaternions.conjugate(track.rotations_wxyz[0, 0]))
    velocity = (track.positions[1, 0] - track.positions[0, 0]) / FRAME
    simulation.start(poses[0], settle=1.0, velocity=velocity, spin=quaternions.to_rotation_vector(turned) / FRAME)
    for number in range(count):
        if number:
            poses = [travel.onwards(pose) for pose in poses]
        places = []
        for frame, pose in enumerate(poses):
            if number or frame:
                simulation.step(pose, FRAME)
            places.append(simulation.positions)
        rounds.append(np.array(places))
    return rounds


def brought_back(round_: np.ndarray, travel: Travel, number: int) -> np.ndarray:
    for _ in range(number):
        round_ = travel.back(round_)
    return round_


@pytest.fixture(scope="module")
def still() -> list[np.ndarray]:
    """Many rounds of a sheet that swings in place."""
    return rounds_carried_on(*round_of(swing()), 16)


def farthest(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.linalg.norm(first - second, axis=-1).max())


def test_a_driven_sheet_comes_to_its_own_limit(still: list[np.ndarray]):
    take = cape.simulate(sheet(), swing(), solver=DOUBLE, settle=1.0, loop=True)
    assert take.loop is not None
    assert take.loop.repeats
    limit, gaps = still[-1], [farthest(a, b) for a, b in pairwise(still)]
    # Rounds come nearer to each other by at least this factor each, so that the rest of the way is a geometric series.
    factor = max(b / a for a, b in pairwise(gaps[:8]))
    assert factor < 0.9
    assert gaps[-1] < 1e-4
    before = gaps[take.loop.rounds - 2]
    assert farthest(take.positions, limit) < before / (1.0 - factor)
    assert farthest(take.positions, limit) < 0.2 * farthest(still[0], limit)


@pytest.mark.parametrize(("speed", "turn"), [(1.0, 0.0), (1.0, 0.7)], ids=["straight", "in a circle"])
def test_rounds_go_on_from_each_other_where_they_are_brought_back(speed: float, turn: float):
    track, travel = round_of(swing(speed=speed, turn=turn))
    take = cape.simulate(sheet(), track, solver=DOUBLE, settle=1.0, loop=True)
    assert take.loop is not None
    carried = rounds_carried_on(track, travel, take.loop.rounds)
    last = brought_back(carried[-1], travel, take.loop.rounds - 1)
    before = brought_back(carried[-2], travel, take.loop.rounds - 2)
    first, end = take.loop.blended
    # A take is kept in single precision.
    np.testing.assert_allclose(take.positions[: first + 1], last[: first + 1], atol=1e-6)
    np.testing.assert_allclose(take.positions[end:], before[end:], atol=1e-6)
    assert take.loop.gap == pytest.approx(farthest(last[first : end + 1], before[first : end + 1]), abs=2e-6)


def is_smooth(places: np.ndarray, travel: Travel) -> bool:
    """Tell whether at the seam of a round [m], (F, V, 3), nothing moves as it does nowhere else."""
    over = np.concatenate([travel.back(places[-2:]), places, travel.forth(places[:2])])
    bends = np.linalg.norm(np.diff(over, n=2, axis=0), axis=2).max(axis=1)
    steps = np.linalg.norm(np.diff(over, axis=0), axis=2).max(axis=1)
    bent = max(bends[:2].max(), bends[-2:].max()) < bends[2:-2].max()
    return bool(bent and max(steps[1], steps[-2]) < 1.1 * steps[2:-2].max())


@pytest.mark.parametrize("rounds", [2, looping.MOST_ROUNDS])
def test_no_jolt_is_left_at_the_seam(monkeypatch: pytest.MonkeyPatch, rounds: int):
    monkeypatch.setattr(looping, "MOST_ROUNDS", rounds)
    track, travel = round_of(swing(speed=1.0, turn=0.7))
    take = cape.simulate(sheet(), track, settle=0.0, loop=True)
    assert is_smooth(take.positions.astype(float), travel)


def test_cloth_that_does_not_repeat_is_led_to_where_it_was(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(looping, "REPEATED", 1e-12)
    monkeypatch.setattr(looping, "MOST_ROUNDS", 3)
    track, travel = round_of(swing(speed=1.0, turn=0.7))
    take = cape.simulate(sheet(), track, solver=DOUBLE, settle=1.0, loop=True)
    assert take.loop is not None
    assert (take.loop.drawn, take.loop.rounds) == (True, 3)
    first, end = take.loop.blended
    assert end == ROUND - 1
    second, third = (brought_back(r, travel, n) for n, r in enumerate(rounds_carried_on(track, travel, 3)) if n)
    # Up to there it is the third round, and at the end the second, which the third goes on from.
    np.testing.assert_allclose(take.positions[: first + 1], third[: first + 1], atol=1e-6)
    np.testing.assert_allclose(take.positions[end], second[end], atol=1e-6)
    assert take.loop.gap == pytest.approx(farthest(third[first:], second[first:]), abs=2e-6)
    assert farthest(take.positions, third) > 0.5 * farthest(second[first:], third[first:])
    assert is_smooth(take.positions.astype(float), travel)


def test_what_is_blended_is_measured(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(looping, "MOST_ROUNDS", 2)
    scene = replace(sheet(), colliders=[cape.Plane(point=np.array([0.0, 0.0, -0.41]))])
    take = cape.simulate(scene, swing(), settle=0.0, loop=True)
    assert take.loop is not None
    assert not take.loop.repeats
    assert any("doesn't repeat within 5 mm by itself in 2 rounds" in note for note in take.warnings)
    cloth = scene.cloth
    edges = np.array([(a, b) for a in range(cloth.vertices) for b in (a + 1, a + 4) if b < cloth.vertices])
    rest = np.linalg.norm(cloth.pattern[edges[:, 0]] - cloth.pattern[edges[:, 1]], axis=1)
    threads = rest < 0.11
    lengths = np.linalg.norm(take.positions[:, edges[:, 0]] - take.positions[:, edges[:, 1]], axis=2)
    strains = (lengths / rest - 1.0)[:, threads].max(axis=1)
    np.testing.assert_allclose(take.stretch_max, strains, atol=1e-5)
    depths = np.maximum(-0.41 - take.positions[:, 4:, 2], 0.0).max(axis=1)
    np.testing.assert_allclose(take.penetration, depths, atol=1e-6)


def test_a_clip_that_does_not_loop_says_so_and_throws_nothing():
    away = swing(45, speed=1.0)  # ends 10 cm from where it would begin again, and tilted
    tilted = np.array([turn_about((1.0, 0.0, 0.0), 0.02 * frame) for frame in range(45)])
    track = replace(away, rotations_wxyz=tilted[:, None])
    take = cape.simulate(sheet(), track, settle=1.0, loop=True)
    assert take.loop is not None
    assert not take.loop.travel.loops
    told = [note for note in take.warnings if "the clip doesn't loop: at its end rod is" in note]
    assert len(told) == 1
    # The same seam as a motion: it tears.
    places, turns = (np.concatenate([each, each]) for each in (track.positions, track.rotations_wxyz))
    twice = BoneTrack(track.names, FRAME * np.arange(90.0), places, turns)
    thrown = cape.simulate(sheet(), twice, settle=1.0, cuts=None)
    assert take.stretch_max.max() < 0.25 * thrown.stretch_max.max()
    assert take.kinetic_energy.max() < 0.25 * thrown.kinetic_energy.max()


def broken_off(rounds: float) -> cape.Take:
    """A loop that the user interrupts after so many rounds."""

    def stop(done: int, of: int) -> None:
        if done > rounds * ROUND:
            raise KeyboardInterrupt

    take = cape.simulate(sheet(), swing(), settle=0.0, loop=True, progress=stop)
    assert take.result == f"stopped at frame {ROUND}"
    return take


def test_the_first_round_is_kept_where_the_next_is_broken_off():
    take = broken_off(1.5)
    assert take.loop is None
    np.testing.assert_array_equal(take.positions, cape.simulate(sheet(), swing(), settle=0.0).positions)


def test_the_last_whole_round_leads_into_itself_where_a_later_one_is_broken_off():
    take = broken_off(3.5)
    assert take.loop is not None
    assert (take.loop.rounds, take.loop.drawn) == (3, False)
    whole = cape.simulate(sheet(), swing(), settle=0.0)
    steps = np.linalg.norm(np.diff(whole.positions, axis=0), axis=2).max()
    seam = np.linalg.norm(take.positions[-1] - take.positions[0], axis=1).max()
    assert seam < 1.5 * steps  # as far as a frame's motion gets, which the first round's seam does not keep to
    assert np.linalg.norm(whole.positions[-1] - whole.positions[0], axis=1).max() > 1.5 * steps


def test_a_tolerance_holds_in_every_round():
    chosen = cape.simulate(sheet(), swing(speed=0.5), solver=cape.Auto(tolerance=0.001), settle=1.0, loop=True)
    fixed = cape.simulate(sheet(), swing(speed=0.5), solver=DOUBLE, settle=1.0, loop=True)
    assert chosen.loop is not None
    assert chosen.loop.repeats
    assert np.sqrt(np.mean(np.sum((chosen.positions - fixed.positions) ** 2, axis=2))) < 0.005


def test_a_loop_keeps_no_accounts():
    with pytest.raises(ValueRangeError, match="a ledger keeps the accounts of one run"):
        cape.simulate(sheet(), swing(), ledger=cape.Ledger(), loop=True)


# -- what rounds are made of --


def test_a_cloth_that_is_moved_goes_on_as_it_was():
    angle, shift = 2.0, np.array([5.0, -3.0, 0.0])
    turn = turn_about((0.0, 0.0, 1.0), angle)
    here, there = (Simulation(sheet(), solver=DOUBLE) for _ in range(2))
    poses = poses_of(swing(), here.bones)
    for pose in poses[:20]:
        here.step(pose, FRAME)
        there.step(pose, FRAME)
    there.move(shift, turn)
    for pose in poses[20:]:
        here.step(pose, FRAME)
        there.step(pose.turned(turn).moved(shift), FRAME)
    np.testing.assert_allclose(there.positions, shift + quaternions.rotate(turn, here.positions), atol=1e-9)
    np.testing.assert_allclose(there.velocities, quaternions.rotate(turn, here.velocities), atol=1e-7)
    assert there.jumps == 0


@pytest.mark.parametrize("cuts", [Cuts(), None])
def test_a_step_may_be_told_to_be_a_jump(cuts: Cuts | None):
    simulation = Simulation(sheet(), cuts=cuts)
    simulation.start(Pose(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]])), settle=2.0)
    before = simulation.positions
    simulation.step({"rod": ([0.1, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])}, FRAME, jumped=True)
    assert simulation.jumps == 1
    np.testing.assert_allclose(simulation.positions, before + np.array([0.1, 0.0, 0.0]), atol=1e-3)


def test_what_is_free_is_drawn_a_share_of_the_way():
    simulation = Simulation(sheet(), solver=DOUBLE)
    simulation.step(poses_of(swing(), simulation.bones)[0], FRAME)
    places, speeds = simulation.positions, simulation.velocities
    simulation.draw(places + np.array([0.0, 0.1, 0.0]), speeds + np.array([0.0, 0.0, 2.0]), 0.25)
    held, free = np.arange(4), np.arange(4, len(places))
    np.testing.assert_array_equal(simulation.positions[held], places[held])
    np.testing.assert_allclose((simulation.positions - places)[free], [[0.0, 0.025, 0.0]] * len(free), atol=1e-12)
    np.testing.assert_allclose((simulation.velocities - speeds)[free], [[0.0, 0.0, 0.5]] * len(free), atol=1e-12)
    with pytest.raises(ValueRangeError, match="positions and velocities must be finite and of shape"):
        simulation.draw(places[1:], speeds, 0.5)


def test_a_simulation_that_goes_back_goes_on_as_it_did():
    scene = replace(sheet(), self_contact=cape.SelfContact(), colliders=[cape.Sphere(bone="rod", radius=0.1)])
    simulation = Simulation(scene)
    poses = poses_of(swing(), simulation.bones)
    for pose in poses[:20]:
        simulation.step(pose, FRAME)
    mark, ends = simulation.mark(), []
    for _ in range(2):
        simulation.go_back(mark)
        for pose in poses[20:25]:
            simulation.step(pose, FRAME)
        ends.append(simulation.positions)
    np.testing.assert_array_equal(*ends)


def test_the_passage_is_where_two_rounds_are_most_alike():
    apart = np.array([9.0, 8.0, 3.0, 1.0, 2.0, 1.5, 7.0, 0.0, 8.0])
    assert looping.closest(apart, 2) == (3, 2.0)
    shares = looping.passage(9, 3, 5)
    np.testing.assert_array_equal(shares, [0.0, 0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 1.0])
