"""The shipped clips, read as a user's file would be: contact with the ground, smoothness, loops, physics, likeness."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import motions
from motions import quaternions
from motions.making import gait, gait_data
from motions.making.body import BALL, HEEL, center_of_mass
from motions.making.make import MAKERS, make

FloatArray = NDArray[np.float64]

NAMES = tuple(MAKERS)
CYCLES = ("idle", "walk", "run")
SIDES = ("Left", "Right")
FLOOR = 0.003  # a point of the foot this near to the floor stands on it [m]

# Bounds on the angular speed [rad/s] and acceleration [rad/s2] of any joint against its parent. Nearest to them come
# the kick's knee with 19 rad/s and the knees that take off with 860 rad/s2; one frame 16 degrees off would be 1000.
FASTEST, JERKIEST = 25.0, 1000.0


@pytest.fixture(scope="module")
def clips() -> dict[str, motions.Clip]:
    return {name: motions.load(motions.clip_path(name)) for name in NAMES}


def point_of_foot(clip: motions.Clip, side: str, point: FloatArray) -> FloatArray:
    positions, rotations = clip.world_poses()
    foot = clip.index(f"{side}Foot")
    return positions[:, foot] + quaternions.rotate(rotations[:, foot], point)


def end_of(clip: motions.Clip, joint: str) -> FloatArray:
    return clip.end_positions()[:, list(clip.end_parents).index(clip.index(joint))]


def joint(clip: motions.Clip, name: str) -> FloatArray:
    return clip.world_positions()[:, clip.index(name)]


def contacts(clip: motions.Clip, side: str) -> list[FloatArray]:
    """Places of the heel and of the ball of one foot, one array for each time that it stands, shape (frames, 3)."""
    stays = []
    for point, height in ((HEEL, 0.0), (BALL, BALL[2] - HEEL[2])):
        places = point_of_foot(clip, side, point)
        down = places[:, 2] < height + FLOOR
        edges = np.flatnonzero(np.diff(np.concatenate([[False], down, [False]]).astype(int)))
        stays += [places[start:end] for start, end in edges.reshape(-1, 2)]
    return stays


def angular_velocity(clip: motions.Clip) -> FloatArray:
    """Of each joint against its parent between the frames [rad/s], in the joint's own frame, shape (F - 1, J, 3)."""
    q = clip.rotations_wxyz
    turn = quaternions.multiply(quaternions.conjugate(q[:-1]), q[1:])
    turn = np.where(turn[..., :1] < 0, -turn, turn)
    sine = np.linalg.norm(turn[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, turn[..., :1])
    return turn[..., 1:] / np.where(sine > 0, sine, 1.0) * angle * clip.fps


def in_chest(clip: motions.Clip, points: FloatArray) -> FloatArray:
    positions, rotations = clip.world_poses()
    chest = clip.index("Spine2")
    return quaternions.rotate(quaternions.conjugate(rotations[:, chest]), points - positions[:, chest])


def test_there_are_six_and_each_lasts_a_few_seconds(clips: dict[str, motions.Clip]) -> None:
    assert set(motions.clip_names()) == set(NAMES)
    for name, clip in clips.items():
        assert 3.0 < clip.duration < 6.1, name
        assert motions.clip_path(name).stat().st_size < 500_000


def test_making_them_again_gives_the_same_files(tmp_path: Path) -> None:
    for path in make(tmp_path):
        assert path.read_bytes() == motions.clip_path(path.stem).read_bytes(), path.stem


@pytest.mark.parametrize("name", NAMES)
def test_first_pose_faces_x_with_arms_hanging(clips: dict[str, motions.Clip], name: str) -> None:
    clip = clips[name]
    across = joint(clip, "LeftArm")[0] - joint(clip, "RightArm")[0]
    assert across[1] > 0.4
    for side, sign in zip(SIDES, (1, -1), strict=True):
        hand = in_chest(clip, joint(clip, f"{side}Hand"))[0]
        assert 0.18 < sign * hand[1] < 0.32
        assert joint(clip, f"{side}ForeArm")[0, 2] < joint(clip, f"{side}Arm")[0, 2] - 0.2


@pytest.mark.parametrize("name", NAMES)
def test_no_foot_slides(clips: dict[str, motions.Clip], name: str) -> None:
    stood = 0
    for side in SIDES:
        for places in contacts(clips[name], side):
            stood += len(places)
            assert np.linalg.norm(np.ptp(places[:, :2], axis=0)) < 0.01
    assert stood > 0.4 * clips[name].frames


@pytest.mark.parametrize("name", NAMES)
def test_no_foot_is_under_the_floor(clips: dict[str, motions.Clip], name: str) -> None:
    clip = clips[name]
    for side in SIDES:
        lowest = [point_of_foot(clip, side, HEEL), joint(clip, f"{side}ToeBase"), end_of(clip, f"{side}ToeBase")]
        assert min(points[:, 2].min() for points in lowest) > -0.01


@pytest.mark.parametrize("name", NAMES)
def test_joints_turn_smoothly(clips: dict[str, motions.Clip], name: str) -> None:
    speed = angular_velocity(clips[name])
    assert np.linalg.norm(speed, axis=-1).max() < FASTEST
    acceleration = np.diff(speed, axis=0) * clips[name].fps
    assert np.linalg.norm(acceleration, axis=-1).max() < JERKIEST


@pytest.mark.parametrize("name", CYCLES)
def test_loops_have_no_seam(clips: dict[str, motions.Clip], name: str) -> None:
    """Played twice in a row, travel apart, no joint nor the root accelerates more at the seam than elsewhere."""
    clip = clips[name]
    cycle = {"walk": gait.WALK, "run": gait.RUN}.get(name)
    travel = cycle.strides * (clip.root_positions[cycle.frames] - clip.root_positions[0]) if cycle else np.zeros(3)
    twice = replace(
        clip,
        root_positions=np.concatenate([clip.root_positions, clip.root_positions + travel]),
        rotations_wxyz=quaternions.make_continuous(np.concatenate([clip.rotations_wxyz] * 2)),
    )
    seam = slice(clip.frames - 3, clip.frames + 1)
    turning = np.linalg.norm(np.diff(angular_velocity(twice), axis=0) * clip.fps, axis=-1)
    once = np.linalg.norm(np.diff(angular_velocity(clip), axis=0) * clip.fps, axis=-1)
    assert np.all(turning[seam].max(axis=0) < 1.02 * once.max(axis=0) + 0.2)
    moving = np.abs(np.diff(twice.root_positions, 2, axis=0)) * clip.fps**2
    assert np.all(moving[seam].max(axis=0) < 1.2 * moving[: clip.frames - 4].max(axis=0) + 0.2)


@pytest.mark.parametrize(("name", "slowest", "fastest"), [("walk", 1.1, 1.6), ("run", 2.5, 4.5)])
def test_speeds(clips: dict[str, motions.Clip], name: str, slowest: float, fastest: float) -> None:
    root = clips[name].root_positions
    velocity = (root[-1] - root[0]) / clips[name].duration
    assert slowest < velocity[0] < fastest
    assert abs(velocity[1]) < 0.02


def test_the_run_is_nearly_as_fast_as_the_measured_one(clips: dict[str, motions.Clip]) -> None:
    """Speed follows from the measured angles and cadence, on this body's legs, which aren't the subject's."""
    root = clips["run"].root_positions[:, 0]
    assert (root[-1] - root[0]) / clips["run"].duration == pytest.approx(gait_data.RUN_SPEED, rel=0.1)


def test_the_walk_covers_the_measured_stride(clips: dict[str, motions.Clip]) -> None:
    """Stride length follows from the measured angles and this body's legs; the subject's own was measured apart."""
    root = clips["walk"].root_positions[:, 0]
    stride = (root[gait.WALK.frames] - root[0]).item()
    assert stride == pytest.approx(gait_data.WALK_STRIDE, rel=0.02)


# RMS deviation in degrees. Knee and ankle give way most: the soles are levelled, and no leg is quite straight.
@pytest.mark.parametrize(
    ("cycle", "hip", "knee", "ankle"), [(gait.WALK, 2.5, 4.5, 4.2), (gait.RUN, 0.8, 1.6, 5.5)], ids=["walk", "run"]
)
def test_gait_stays_near_the_measured_angles(cycle: gait.Gait, hip: float, knee: float, ankle: float) -> None:
    name = "walk" if cycle is gait.WALK else "run"
    clip = motions.load(motions.clip_path(name))
    frames = np.arange(cycle.frames)
    phase = (frames + round(cycle.start * cycle.frames)) / cycle.frames
    at_rest = np.mean(cycle.angles["tilt"]) - cycle.lean[0]
    for part, angle, sign, zero, bound in (
        ("UpLeg", "hip", -1, at_rest, hip),
        ("Leg", "knee", 1, 0.0, knee),
        ("Foot", "ankle", -1, 0.0, ankle),
    ):
        samples = cycle.angles[angle]
        measured = np.interp(phase % 1, np.arange(len(samples) + 1) / len(samples), [*samples, samples[0]])
        for side, later in zip(SIDES, (0, cycle.frames // 2), strict=True):
            local = clip.rotations_wxyz[frames + later, clip.index(f"{side}{part}")]
            flexion = sign * np.degrees(quaternions.to_euler(local, "yxz")[:, 0]) + zero
            assert np.sqrt(np.mean((flexion - measured) ** 2)) < bound, (side, angle)


def test_the_jump_flies_freely(clips: dict[str, motions.Clip]) -> None:
    """In flight the centre of mass falls with g = 9.81 m/s2 and keeps its horizontal velocity."""
    clip = clips["jump"]
    lowest = np.min(
        [[point_of_foot(clip, side, HEEL)[:, 2], joint(clip, f"{side}ToeBase")[:, 2] - 0.015] for side in SIDES],
        axis=(0, 1),
    )
    flight = np.flatnonzero(lowest > 0.02)[1:-1]
    assert np.all(np.diff(flight) == 1)
    assert len(flight) / clip.fps > 0.4
    mass = center_of_mass(clip.world_positions())[flight]
    time = clip.times[flight]
    fall = np.polyfit(time, mass[:, 2], 2)
    assert 2 * fall[0] == pytest.approx(-9.81, abs=0.02)
    assert np.abs(np.polyval(fall, time) - mass[:, 2]).max() < 1e-4
    assert np.abs(np.polyval(np.polyfit(time, mass[:, 0], 1), time) - mass[:, 0]).max() < 1e-4
    assert lowest.max() > 0.3


def test_the_kick_is_fast_and_high(clips: dict[str, motions.Clip]) -> None:
    clip = clips["kick"]
    foot = joint(clip, "RightFoot")
    speed = np.linalg.norm(np.diff(foot, axis=0), axis=1) * clip.fps
    assert 8.0 < speed.max() < 12.0
    assert joint(clip, "RightToeBase")[:, 2].max() > 1.2


def test_the_spin_turns_twice_on_one_spot(clips: dict[str, motions.Clip]) -> None:
    clip = clips["spin"]
    _, rotations = clip.world_poses()
    forwards = quaternions.rotate(rotations[:, clip.index("Hips")], np.array([1.0, 0.0, 0.0]))
    heading = np.unwrap(np.arctan2(forwards[:, 1], forwards[:, 0]))
    assert heading[-1] - heading[0] == pytest.approx(-4 * np.pi, abs=0.02)
    turning = np.abs(heading - heading[0]) > 0.5
    ball = joint(clip, "LeftToeBase")[turning]
    assert np.ptp(ball, axis=0).max() < 0.005
    for side in SIDES:
        from_axis = np.linalg.norm((joint(clip, f"{side}Hand") - joint(clip, "Spine2"))[:, :2], axis=1)
        whirling = (heading - heading[0] < -np.pi) & (heading - heading[0] > -3 * np.pi)
        assert from_axis[whirling].max() < 0.6 * from_axis.max()


def test_idle_breathes_and_shifts_its_weight(clips: dict[str, motions.Clip]) -> None:
    mass = center_of_mass(clips["idle"].world_positions())
    assert 0.03 < np.ptp(mass[:, 1]) < 0.10
    assert np.ptp(in_chest(clips["idle"], joint(clips["idle"], "Hips")), axis=0).max() > 0.005


@pytest.mark.parametrize("name", NAMES)
def test_arms_keep_out_of_trunk_and_legs(clips: dict[str, motions.Clip], name: str) -> None:
    """Forearms and hands stay outside of an elliptic trunk, 34 cm wide and 24 cm deep, and 10 cm off the thighs."""
    clip = clips[name]
    for side in SIDES:
        elbow, wrist, fingers = joint(clip, f"{side}ForeArm"), joint(clip, f"{side}Hand"), end_of(clip, f"{side}Hand")
        arm = [elbow + (wrist - elbow) * s for s in np.linspace(0, 1, 6)]
        arm += [wrist + (fingers - wrist) * s for s in np.linspace(0, 1, 4)]
        for point in arm:
            inside = in_chest(clip, point)
            beside = (inside[:, 2] > -0.36) & (inside[:, 2] < 0.13)
            assert np.hypot(inside[beside, 0] / 0.12, inside[beside, 1] / 0.17).min(initial=9.0) > 1.0
            for leg in SIDES:
                hip, knee = joint(clip, f"{leg}UpLeg"), joint(clip, f"{leg}Leg")
                thigh = [hip + (knee - hip) * s for s in np.linspace(0, 1, 9)]
                assert min(np.linalg.norm(point - part, axis=1).min() for part in thigh) > 0.10


def broken(clip: motions.Clip, change: Callable[[FloatArray], None]) -> motions.Clip:
    root = np.array(clip.root_positions)
    change(root)
    return replace(clip, root_positions=root)


def test_a_sliding_foot_would_be_seen(clips: dict[str, motions.Clip]) -> None:
    def faster(root: FloatArray) -> None:
        root[:, 0] *= 1.05

    slid = [np.ptp(places[:, 0]) for places in contacts(broken(clips["walk"], faster), "Left")]
    assert max(slid) > 0.02
