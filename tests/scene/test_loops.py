"""Where a motion begins again: how far it takes its bones in a round, and whether it loops at all."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import motions
from cape.scene.loops import BESIDE, Travel, round_of
from cape.scene.poses import Pose
from motions import quaternions
from skeleton import Skeleton
from skeleton.track import BoneTrack
from tests.support.scenes import turn_about

FRAME = 1 / 60
UP = (0.0, 0.0, 1.0)


def strolling(frames: int, *, speed: float = 1.2, turn: float = 0.0, stride: int = 60) -> BoneTrack:
    """Two bones on a circle, turning at a rate [rad/s]; the second swings about the first once in `stride` frames."""
    times = FRAME * np.arange(frames, dtype=float)
    angles = turn * times
    # np.sinc(x) is sin(pi x) / (pi x): a circle of radius speed / turn, or a straight line.
    chord = speed * times * np.sinc(angles / (2.0 * np.pi))
    path = np.stack([chord * np.cos(angles / 2.0), chord * np.sin(angles / 2.0), np.ones(frames)], axis=1)
    swing = 0.3 * np.sin(2.0 * np.pi * np.arange(frames) / stride)
    body = np.array([turn_about(UP, angle) for angle in angles])
    arm = quaternions.multiply(body, np.array([turn_about((0.0, 1.0, 0.0), angle) for angle in swing]))
    hand = path + quaternions.rotate(arm, np.broadcast_to([0.0, 0.2, -0.5], path.shape))
    return BoneTrack(("hip", "hand"), times, np.stack([path, hand], axis=1), np.stack([body, arm], axis=1))


# What meeting half way leaves out is a change of velocity within a step: of a point that swings as 0.3 rad sin(2 pi t),
# 0.6 m from its axis, it is 0.3 * 0.6 m * (2 pi)^2 * FRAME^2 / 4 at most on each side; of a circle speed * turn.
SWING = 0.3 * (0.54 + BESIDE) * (2.0 * np.pi) ** 2 * FRAME**2 / 2.0


@given(rounds=st.integers(1, 3), speed=st.floats(0.0, 5.0), turn=st.one_of(st.just(0.0), st.floats(0.05, 2.0)))
def test_a_round_goes_as_far_as_its_motion(rounds: int, speed: float, turn: float):
    frames = 60 * rounds
    track, travel = round_of(strolling(frames, speed=speed, turn=turn))
    assert track.frames == frames
    assert travel.loops
    following = strolling(frames + 1, speed=speed, turn=turn)
    curved = (speed * turn + (0.54 + BESIDE) * turn**2) * FRAME**2 / 2.0
    assert travel.yaw == pytest.approx(math.remainder(turn * rounds, 2.0 * np.pi), abs=(SWING + curved) / BESIDE)
    here = travel.onwards(Pose(track.positions[0], track.rotations_wxyz[0]))
    np.testing.assert_allclose(here.positions, following.positions[-1], atol=2.0 * (SWING + curved))
    assert travel.gap < SWING + curved + 1e-12


def test_a_last_frame_that_is_the_first_once_more_is_left_out():
    whole = strolling(61)
    track, travel = round_of(whole)
    assert track.frames == 60
    np.testing.assert_array_equal(track.positions, whole.positions[:60])
    assert travel.shift == pytest.approx([1.2, 0.0, 0.0], abs=SWING)


def test_a_motion_that_ends_elsewhere_does_not_loop():
    half = strolling(45)  # the hand is where it is farthest behind
    _, travel = round_of(half)
    assert not travel.loops
    assert travel.bone == "hand"
    # It swings by 0.3 rad, 0.5 m below its axis, and comes from 0; the level motion takes up a part of that.
    assert 0.5 * math.sin(0.3) / 2.0 < travel.gap < (0.54 + BESIDE) * 0.35


def test_a_round_that_climbs_does_not_loop():
    flat = strolling(60)
    climbing = flat.positions + np.linspace(0.0, 0.3, 60)[:, None, None] * [0.0, 0.0, 1.0]
    _, travel = round_of(BoneTrack(flat.names, flat.times, climbing, flat.rotations_wxyz))
    assert travel.gap == pytest.approx(0.3, abs=0.01)


@given(
    yaw=st.floats(-3.0, 3.0),
    shift=st.tuples(*[st.floats(-9.0, 9.0)] * 2),
    point=st.tuples(*[st.floats(-9.0, 9.0)] * 3),
)
def test_forth_and_back_are_each_others_inverse(yaw: float, shift: tuple, point: tuple):
    travel = Travel(yaw, np.array([*shift, 0.0]), 0.0, "hip")
    turn = np.array([[math.cos(yaw), -math.sin(yaw), 0.0], [math.sin(yaw), math.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(travel.forth(np.array(point)), turn @ point + [*shift, 0.0], atol=1e-12)
    np.testing.assert_allclose(travel.back(travel.forth(np.array(point))), point, atol=1e-12)
    away, turned = travel.way_back
    np.testing.assert_allclose(away + quaternions.rotate(turned, travel.forth(np.array(point))), point, atol=1e-12)


@pytest.mark.parametrize(("name", "most"), [("walk", 0.001), ("run", 0.004), ("idle", 0.0001)])
def test_shipped_loops_go_on_as_they_begin(name: str, most: float):
    clip = motions.load(name)
    track, travel = round_of(Skeleton.from_clip(clip).track(clip))
    assert track.frames == clip.frames
    assert travel.gap < most
