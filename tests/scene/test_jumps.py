"""Jumps of the bones: what counts as one, and that the cloth comes along or is put on anew without a tear."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cape
import motions
from cape import Cloth, Scene, Simulation, attach
from cape.scene.jumps import Cuts, rigid_motion, seam
from cape.scene.poses import Pose
from motions import quaternions
from motions.errors import UnknownNameError, ValueRangeError
from skeleton import Skeleton
from skeleton.track import BoneTrack
from tests.support.scenes import turn_about

FRAME = 1 / 60
UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])

angles = st.floats(-np.pi, np.pi)
axes = st.sampled_from([(0.0, 0.0, 1.0), (0.6, 0.8, 0.0), (0.36, 0.48, 0.8)])


@given(axes, angles, st.integers(0, 2**32 - 1))
def test_a_rigid_motion_is_found_from_its_points(axis, angle, seed):
    rng = np.random.default_rng(seed)
    before, turn, shift = rng.normal(size=(6, 3)), quaternions.to_matrix(turn_about(axis, angle)), rng.normal(size=3)
    rotation, found = rigid_motion(before, before @ turn.T + shift)
    np.testing.assert_allclose(rotation, turn, atol=1e-9)
    np.testing.assert_allclose(found, shift, atol=1e-9)


def test_what_only_a_mirror_could_match_is_still_a_rotation():
    before = np.random.default_rng(3).normal(size=(8, 3))
    rotation, _ = rigid_motion(before, before * [1.0, 1.0, -1.0])
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_points_on_a_line_are_brought_onto_each_other():
    before = np.linspace(0.0, 1.0, 5)[:, None] * [1.0, 0.0, 0.0]
    after = np.linspace(0.0, 1.0, 5)[:, None] * [0.0, 0.6, 0.8] + 1.0
    rotation, shift = rigid_motion(before, after)
    np.testing.assert_allclose(before @ rotation.T + shift, after, atol=1e-12)


def two_bones(shift: float = 0.0, angle: float = 0.0) -> Pose:
    turned = np.stack([turn_about((0.0, 0.0, 1.0), angle), UNTURNED])
    return Pose(np.array([[shift, 0.0, 0.0], [0.0, 1.0, 0.0]]), turned)


@pytest.mark.parametrize(
    ("pose", "is_jump"),
    [
        (two_bones(shift=50.0 * FRAME * 0.99), False),
        (two_bones(shift=50.0 * FRAME * 1.01), True),
        (two_bones(angle=60.0 * FRAME * 0.99), False),
        (two_bones(angle=60.0 * FRAME * 1.01), True),
        (two_bones(angle=2 * np.pi), False),
    ],
    ids=["fast", "faster", "turning", "turning faster", "full turn"],
)
def test_a_jump_begins_at_the_limits(pose: Pose, is_jump: bool):
    assert Cuts().between(two_bones(), pose, FRAME, np.array([0])) is is_jump


def test_bones_that_hold_nothing_may_spin():
    assert not Cuts().between(two_bones(), two_bones(angle=3.0), FRAME, np.array([1]))


def test_settings_out_of_range_are_refused():
    with pytest.raises(ValueRangeError, match="the speed of a cut must be positive, not 0"):
        Cuts(speed=0)
    with pytest.raises(UnknownNameError, match="carry, reset"):
        Cuts(then="tear")  # pyright: ignore[reportArgumentType]


def hung(cuts: Cuts | None) -> Simulation:
    """A sheet that hangs from two bones, one at each end of its upper edge, and has come to hang still."""
    cloth = Cloth.rectangle(width=0.4, height=0.4, spacing=0.1, origin=(0.0, 0.2, 0.0))
    top = cloth.region("top")
    scene = Scene(cloth, [attach(cloth, "left", top[:3]), attach(cloth, "right", top[3:])])
    simulation = Simulation(scene, cuts=cuts)
    simulation.start(pose_of(0.0), settle=2.0)
    return simulation


def pose_of(x: float, angle: float = 0.0, apart: float = 0.0) -> dict:
    """Both bones turned about Z at a distance along X, the left one moved away from the right one along Y [m]."""
    turn = turn_about((0.0, 0.0, 1.0), angle)
    return {"left": (np.array([x, apart, 0.0]), turn), "right": (np.array([x, 0.0, 0.0]), turn)}


def stretch(simulation: Simulation) -> float:
    return simulation.read(simulation.meter()).stretch


@pytest.mark.parametrize("then", ["carry", "reset"])
@pytest.mark.parametrize(("shift", "angle"), [(1000.0, 0.0), (0.0, np.pi), (10.0, 2.0)])
def test_the_cloth_comes_along_without_a_tear(then, shift: float, angle: float):
    simulation = hung(Cuts(then=then))
    simulation.step(pose_of(0.0), FRAME)
    before, taut = simulation.positions, stretch(simulation)
    turn = quaternions.to_matrix(turn_about((0.0, 0.0, 1.0), angle))
    worst = 0.0
    for _ in range(30):
        simulation.step(pose_of(shift, angle), FRAME)
        worst = max(worst, stretch(simulation))
    assert simulation.jumps == 1
    # It hangs as it hung: nothing but the roundings of single precision set it in motion.
    np.testing.assert_allclose(simulation.positions, before @ turn.T + [shift, 0.0, 0.0], atol=2e-4)
    assert worst < taut + 1e-3


def test_a_jump_taken_for_a_motion_tears():
    simulation = hung(None)
    simulation.step(pose_of(0.0, np.pi), FRAME)
    assert simulation.jumps == 0
    assert stretch(simulation) > 0.1


def test_speeds_turn_with_the_bones():
    simulation = hung(Cuts())
    for frame in range(1, 20):
        simulation.step(pose_of(0.02 * frame), FRAME)
    before = simulation.velocities
    simulation.step(pose_of(0.38 + 20.0, np.pi / 2), FRAME)
    # They move on for a frame, in which gravity and the threads change some of 1.2 m/s: g for a frame is 0.16 m/s.
    after = simulation.velocities @ quaternions.to_matrix(turn_about((0.0, 0.0, 1.0), np.pi / 2))
    free = np.arange(len(before)) >= 5
    assert np.abs(before[free, 0]).min() > 0.8
    assert np.linalg.norm((after - before)[free], axis=1).mean() < 0.4


def test_bones_that_close_up_in_a_jump_take_their_places_slowly():
    simulation = hung(Cuts())
    start = simulation.positions[:5, 1]
    simulation.step(pose_of(100.0, apart=-0.1), FRAME)
    # The best rigid motion shares the 0.1 m between both sides; from there it is 3 m/s at most.
    assert np.abs(simulation.velocities[:5]).max() < 3.0 + 1e-3
    for _ in range(20):
        simulation.step(pose_of(100.0, apart=-0.1), FRAME)
    np.testing.assert_allclose(simulation.positions[:5, 1] - start, [-0.1, -0.1, -0.1, 0.0, 0.0], atol=1e-6)


def jumping(frames: int = 12) -> BoneTrack:
    """Both bones at rest, but for a jump of 10 m to frame 5, and back by half a turn to frame 9."""
    poses = [pose_of(10.0 * (frame >= 5), np.pi * (frame >= 9)) for frame in range(frames)]
    places, turns = (np.array([[pose[bone][k] for bone in ("left", "right")] for pose in poses]) for k in (0, 1))
    return BoneTrack(("left", "right"), FRAME * np.arange(frames, dtype=float), places, turns)


def test_frames_of_a_track_in_which_bones_jump():
    track = jumping()
    assert Cuts().frames(track, ["left"]) == [5, 9]
    # What holds nothing may spin.
    assert Cuts().frames(track, []) == [5]
    assert Cuts().frames(seam(track), ["left"]) == [1]
    assert Cuts().frames(seam(jumping(5)), ["left"]) == []


@pytest.mark.parametrize(
    ("cuts", "jumps", "told"),
    [(Cuts(), (5, 9), "carried along as a whole"), (Cuts(then="reset"), (5, 9), "put on anew"), (None, (), None)],
    ids=["carry", "reset", "off"],
)
def test_a_run_tells_when_the_bones_jumped(cuts: Cuts | None, jumps: tuple[int, ...], told: str | None):
    take = cape.simulate(hung(None).scene, jumping(), cuts=cuts, settle=0.5)
    assert take.jumps == jumps
    notes = [note for note in take.warnings if "jump" in note]
    if told is None:
        assert notes == []
    else:
        assert notes == [f"the bones jump at frame 5 (10.00 m), 9 (0.00 m): the cape was {told}"]


def worn(*, to: int = 3) -> tuple[Scene, BoneTrack]:
    """A cape on a body that stands still but for a jump of 10 m to some frame."""
    body = Skeleton.from_clip(motions.load("idle"))
    still = body.track(motions.load("idle")).first(1)
    positions, rotations = (np.repeat(each, 6, axis=0) for each in (still.positions, still.rotations_wxyz))
    positions[to:] += [10.0, 0.0, 0.0]
    track = replace(still, times=FRAME * np.arange(6.0), positions=positions, rotations_wxyz=rotations)
    return cape.dress(body, track, garment="back_cape"), track


def test_a_garment_that_would_lie_in_a_limb_is_put_on_anew():
    scene, track = worn()
    plain = cape.simulate(scene, track, settle=1.0)
    assert (plain.jumps, plain.renewed) == ((3,), ())
    assert any("carried along" in note for note in plain.warnings)
    positions = track.positions.copy()
    middle = plain.positions[-1][np.argsort(plain.positions[-1][:, 2])[plain.positions.shape[1] // 2]]
    positions[3:, track.index("left_forearm")] = middle
    take = cape.simulate(scene, replace(track, positions=positions), settle=1.0)
    assert (take.jumps, take.renewed) == ((3,), (3,))
    assert any("put on anew" in note for note in take.warnings)
    assert take.stretch_max.max() < 0.05


def test_a_garment_whose_wearer_holds_it_otherwise_is_put_on_anew():
    scene, track = worn()
    scene = replace(scene, colliders=())  # no limb can be in the way
    left, right = (track.index(attachment.bone) for attachment in scene.attachments)
    apart = track.positions[0, left] - track.positions[0, right]
    positions = track.positions.copy()
    positions[3:, left] += 0.1 * apart / np.linalg.norm(apart)
    assert cape.simulate(scene, replace(track, positions=positions), settle=1.0).renewed == (3,)


def test_a_jump_away_from_the_first_frame_sets_nothing_in_motion():
    scene, track = worn(to=1)
    take = cape.simulate(scene, track, settle=1.0)
    arrived = replace(track, positions=track.positions[1:].repeat([2, 1, 1, 1, 1], axis=0))
    still = cape.simulate(scene, arrived, settle=1.0)
    assert take.jumps == (1,)
    # It settles elsewhere, where single precision rounds otherwise; at the jump's speed it would have 30 kJ.
    np.testing.assert_allclose(take.kinetic_energy, still.kinetic_energy, rtol=0.1)
