"""What a check of a motion finds, and that it finds nothing where there is nothing."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import cape
import motions
from cape.start import check_start
from motions import quaternions
from motions.errors import UnknownNameError
from skeleton import BoneTrack, Capsule, Finding, Skeleton, check_motion
from skeleton.checks.crossings import crossings, segment_distance
from skeleton.checks.speeds import FASTEST_LIMB, FASTEST_PELVIS, FASTEST_TURNS, glitches, too_fast
from skeleton.checks.standing import feet, scale_doubts
from skeleton.placed_solids import ends_in_world, floor_level, lowest_points

FPS = 60.0
NAMES = ("Hips", "Spine", "Arm", "ForeArm", "Hand", "Thigh", "Shin", "Foot")
PARENTS = np.array([-1, 0, 1, 2, 3, 0, 5, 6])
ROLES = {
    "pelvis": "Hips",
    "chest": "Spine",
    "left_upper_arm": "Arm",
    "left_forearm": "ForeArm",
    "left_hand": "Hand",
    "left_thigh": "Thigh",
    "left_shin": "Shin",
    "left_foot": "Foot",
}
# Half a person: pelvis at 1 m, the arm stretched to the left, the leg hanging, the ankle 0.1 m above the ground.
PLACES = np.array(
    [[0, 0, 1], [0, 0, 1.3], [0, 0.2, 1.5], [0, 0.5, 1.5], [0, 0.8, 1.5], [0, 0.1, 1], [0, 0.1, 0.55], [0, 0.1, 0.1]]
)  # fmt: skip


def person(frames: int = 60, *, shift: np.ndarray | None = None, turns: dict[str, np.ndarray] | None = None):
    """A track of half a person that stands still but for a `shift` (F, 3) [m] and angles about x by bone (F,) [deg]."""
    positions = np.tile(PLACES, (frames, 1, 1)) + (0.0 if shift is None else shift[:, None])
    rotations = np.zeros((frames, len(NAMES), 4))
    rotations[..., 0] = 1.0
    for bone, angles in (turns or {}).items():
        rotations[:, NAMES.index(bone)] = quaternions.from_euler(np.radians(angles)[:, None], "x")
    return BoneTrack(NAMES, np.arange(frames) / FPS, positions, rotations, PARENTS, ROLES)


def foot(radius: float = 0.04) -> Capsule:
    """From the ankle forward and 0.06 m down: with a radius of 0.04 m it touches the ground."""
    return Capsule("left_foot", "Foot", np.zeros(3), np.array([0.15, 0.0, -0.06]), radius)


def kinds(findings) -> list[str]:
    return [finding.kind for finding in findings]


def ball(name: str, bone: str | None, radius: float, at=(0.0, 0.0, 0.0)) -> Capsule:
    return Capsule(name, bone, np.array(at, float), np.array(at, float), radius)


# Distances of segments


coordinates = st.floats(-2.0, 2.0, width=32)
segments = arrays(np.float64, (2, 2, 3), elements=coordinates)


def nearest_by_search(a, b) -> float:
    """By golden ratios along one segment of the convex distance from the other, which a point has in closed form."""

    def from_b(s: float) -> np.floating:
        point, axis = a[0] + s * (a[1] - a[0]), b[1] - b[0]
        square = axis @ axis
        t = np.clip((point - b[0]) @ axis / square, 0.0, 1.0) if square > 0.0 else 0.0
        return np.linalg.norm(point - b[0] - t * axis)

    low, high = 0.0, 1.0
    for _ in range(100):
        first, second = (2 * low + high) / 3, (low + 2 * high) / 3
        low, high = (first, high) if from_b(first) > from_b(second) else (low, second)
    return float(min(from_b(low), from_b(0.0), from_b(1.0)))


@given(segments)
def test_the_distance_of_segments_is_the_least_of_all_their_points(ends):
    found = segment_distance(*ends[0], *ends[1])
    # In nearly parallel segments rounding (1e-16 of squares of 16 m2) is over the least squared sine told apart, 1e-12.
    assert found == pytest.approx(nearest_by_search(*ends), abs=1e-3 if nearly_parallel(ends) else 1e-7)


def nearly_parallel(ends) -> bool:
    a, b = ends[:, 1] - ends[:, 0]
    return bool(np.linalg.norm(np.cross(a, b)) < 1e-4 * np.linalg.norm(a) * np.linalg.norm(b))


@pytest.mark.parametrize(
    ("a", "b", "distance"),
    [
        ([[0, 0, 0], [1, 0, 0]], [[0.5, -1, 2], [0.5, 1, 2]], 2.0),  # skew lines, both inside
        ([[0, 0, 0], [1, 0, 0]], [[2, 0, 0], [3, 0, 0]], 1.0),  # on a line
        ([[0, 0, 0], [1, 0, 0]], [[0.5, 1, 0], [3, 1, 0]], 1.0),  # parallel, side by side
        ([[0, 0, 0], [1, 0, 0]], [[4, 4, 0], [4, 9, 0]], 5.0),  # from end to end
        ([[0, 0, 0], [0, 0, 0]], [[0, 1, -1], [0, 1, 1]], 1.0),  # a point
        ([[0, 0, 0], [0, 0, 0]], [[0, 3, 4], [0, 3, 4]], 5.0),  # two points
    ],
)
def test_segments_whose_distance_is_plain(a, b, distance):
    a, b = np.array(a, float), np.array(b, float)
    assert segment_distance(a[0], a[1], b[0], b[1]) == pytest.approx(distance, abs=1e-12)
    assert segment_distance(b[1], b[0], a[0], a[1]) == pytest.approx(distance, abs=1e-12)


# Where capsules are


def test_capsules_go_where_their_bones_take_them():
    # A quarter turn about x takes -Z to +Y.
    track = person(2, turns={"Arm": np.array([0.0, 90.0])})
    hanging = Capsule("arm", "Arm", np.zeros(3), np.array([0.0, 0.0, -0.3]), 0.05)
    still = ball("post", None, 0.1, (1.0, 2.0, 3.0))
    ends = ends_in_world([hanging, still], track)
    np.testing.assert_allclose(ends[:, 0, 1], [[0.0, 0.2, 1.2], [0.0, 0.5, 1.5]], atol=1e-12)
    np.testing.assert_allclose(ends[:, 1], [[[1.0, 2.0, 3.0]] * 2] * 2)
    np.testing.assert_allclose(lowest_points([hanging, still], track), [[1.15, 2.9], [1.45, 2.9]], atol=1e-12)
    assert floor_level([still], track) is None


# Speeds


def test_a_joint_beyond_its_limit_is_named_with_its_frames():
    limit = FASTEST_TURNS["shin"]
    rate = np.zeros(60)
    rate[20:31] = 1.1 * limit / FPS
    fast = check_motion(person(turns={"Shin": np.cumsum(rate), "Foot": np.cumsum(rate)}))
    (finding,) = fast
    assert (finding.kind, finding.parts, finding.frames) == ("speed", ("Shin",), (20, 30))
    assert finding.figure == pytest.approx(1.1 * limit, rel=1e-9)
    assert "left_shin" in finding.text
    assert "3000" in finding.text
    slow = 0.9 * np.cumsum(rate)
    assert check_motion(person(turns={"Shin": slow, "Foot": slow})) == ()


def test_speeds_of_joints_are_against_the_bone_above():
    turning = np.cumsum(np.full(60, 1500.0 / FPS))
    whole = {name: turning for name in NAMES}
    assert check_motion(person(turns=whole)) == ()  # 1,500 deg/s as a whole, which a skater reaches
    against = too_fast(person(turns={**whole, "Foot": -turning}), [])
    assert [f.parts for f in against] == [("Foot",)]
    assert against[0].figure == pytest.approx(3000.0, rel=1e-9)


def test_a_frame_out_of_line_is_no_fast_motion():
    once = np.zeros(60)
    once[30] = 90.0  # there and back in two steps, 5,400 deg/s
    (finding,) = check_motion(person(turns={"ForeArm": once, "Hand": once}))
    assert (finding.kind, finding.parts, finding.frames) == ("glitch", ("ForeArm",), (30, 31))
    assert finding.figure == pytest.approx(90.0 * FPS, rel=1e-9)


def test_a_fast_motion_is_no_glitch():
    # A stroke of a fifth of a second, 2,500 deg/s in its middle.
    stroke = np.cumsum(
        np.where(np.abs(np.arange(60) - 30) <= 6, 2500.0 / FPS * np.cos((np.arange(60) - 30) / 4.5) ** 2, 0.0)
    )
    assert glitches(person(turns={"ForeArm": stroke, "Hand": stroke}), []) == []


def test_limbs_and_pelvis_that_fly_are_named():
    away = np.zeros((60, 3))
    away[30:, 0] = 1.1 * FASTEST_PELVIS / FPS
    (finding,) = check_motion(person(shift=away))
    assert (finding.kind, finding.parts, finding.frames) == ("speed", ("Hips",), (30, 30))
    assert finding.figure == pytest.approx(1.1 * FASTEST_PELVIS)
    track = person()
    positions = track.positions.copy()
    positions[30:, NAMES.index("Hand"), 0] += 1.1 * FASTEST_LIMB / FPS
    thrown = BoneTrack(NAMES, track.times, positions, track.rotations_wxyz, PARENTS, ROLES)
    assert [(f.kind, f.parts) for f in check_motion(thrown)] == [("speed", ("Hand",))]
    # Against the pelvis: a runner's own speed is not his hand's.
    running = np.arange(60)[:, None, None] * [0.9 * FASTEST_PELVIS / FPS, 0.0, 0.0]
    positions[30:, NAMES.index("Hand"), 0] -= 0.2 * FASTEST_LIMB / FPS
    assert check_motion(BoneTrack(NAMES, track.times, positions + running, track.rotations_wxyz, PARENTS, ROLES)) == ()


def test_without_parents_and_roles_nothing_is_found():
    spin = np.cumsum(np.full(60, 150.0))
    track = person(turns={"Arm": spin})
    assert check_motion(BoneTrack(NAMES, track.times, track.positions, track.rotations_wxyz)) == ()


# Crossings


def test_crossed_limbs_are_named_with_depth_and_frames():
    # The forearm's ball moves along Z through the shin's: 3 cm deep in the frames 20 to 24.
    track = person()
    apart = np.full(60, 0.3)
    apart[20:25] = 0.10 + 0.05 - 0.03
    apart[40] = 0.10 + 0.05 - 0.026
    positions = track.positions.copy()
    positions[:, NAMES.index("ForeArm")] = positions[:, NAMES.index("Shin")] + apart[:, None] * [0.0, 0.0, 1.0]
    moved = BoneTrack(NAMES, track.times, positions, track.rotations_wxyz, PARENTS, ROLES)
    capsules = [ball("left_shin", "Shin", 0.10), ball("left_forearm", "ForeArm", 0.05)]
    (finding,) = crossings(moved, capsules)
    assert finding.text == "left_forearm in left_shin by 30 mm in frames 20 to 24, and 1 more time"
    assert (finding.figure, finding.frames) == (pytest.approx(0.03), (20, 24))
    # Half of the thinner radius is what flesh gives way by.
    assert crossings(moved, [ball("left_shin", "Shin", 0.10 - 0.01), capsules[1]]) == []


def test_neighbours_and_trunks_overlap_by_construction():
    big = [ball(name, name, 0.5) for name in ("Hips", "Spine", "Arm", "Thigh")]
    assert crossings(person(), big) == []
    # A joint that folds for a while: forearm and upper arm meet there, and the hand is near the upper arm.
    folded = person()
    positions = folded.positions.copy()
    positions[20:30, NAMES.index("ForeArm")] = positions[20:30, NAMES.index("Arm")]
    joint = [ball("left_upper_arm", "Arm", 0.1), ball("left_forearm", "ForeArm", 0.1)]
    assert crossings(BoneTrack(NAMES, folded.times, positions, folded.rotations_wxyz, PARENTS, ROLES), joint) == []
    # Hand and hips are five bones apart with capsules: that those overlap all the time is no one's build.
    capsules = [ball(name, name, 0.1) for name in ("Spine", "Arm", "ForeArm", "Thigh")]
    stuck = [ball("left_hand", "Hand", 0.1, (0.0, -0.7, -0.5)), ball("pelvis", "Hips", 0.2), *capsules]
    assert ("left_hand", "pelvis") in [f.parts for f in crossings(person(), stuck)]


# Floor and scale


def test_a_foot_under_the_floor_is_named():
    down = np.zeros((100, 3))
    down[50] = [0.0, 0.0, -0.07]  # rarer than the 2 % of frames that may be below the floor
    (finding,) = feet(person(100, shift=down), [foot(0.04)])
    assert (finding.kind, finding.frames, finding.parts) == ("floor", (50, 50), ("left_foot",))
    assert finding.figure == pytest.approx(0.07, abs=1e-9)
    assert feet(person(100, shift=0.5 * down), [foot(0.04)]) == []


def test_a_foot_that_never_touches_the_floor_is_named():
    low = ball("left_shin", "Shin", 0.05, (0.0, 0.0, -0.6))  # reaches 0.1 m under the ground
    (finding,) = feet(person(), [foot(0.04), low])
    assert finding.text == "left_foot never comes nearer to the floor than 100 mm"
    assert feet(person(), [foot(0.04)]) == []


def leap(gravity: float) -> np.ndarray:
    """Stands, leaps 0.4 m high, stands [m], shape (120, 3)."""
    times = np.arange(120) / FPS
    return np.stack([0 * times, 0 * times, np.maximum(0.0, 0.4 - gravity / 2 * (times - 1.0) ** 2)], axis=1)


@pytest.mark.parametrize(("gravity", "doubted"), [(9.81, False), (9.81 * 2.54, True), (9.81 / 2.54, True)])
def test_a_flight_tells_of_gravity(gravity, doubted):
    found = scale_doubts(person(120, shift=leap(gravity)), [foot()])
    assert bool(found) == doubted
    if found:
        assert found[0].figure == pytest.approx(gravity, rel=1e-9)


def test_a_giant_is_doubted():
    assert kinds(scale_doubts(person(), [], height=17.5)) == ["unit"]
    assert scale_doubts(person(), [], height=1.75) == []


# The start


IDENTITY = [1.0, 0.0, 0.0, 0.0]


def rod(height: float = 0.0) -> BoneTrack:
    return BoneTrack(("rod",), np.arange(2) / FPS, np.full((2, 1, 3), [0.0, 0.0, height]), np.full((2, 1, 4), IDENTITY))


def test_what_starts_in_a_collider_is_told():
    sheet = cape.Cloth.rectangle(width=0.4, height=0.4, spacing=0.1, origin=(0.0, 0.2, 0.2), down=(0.0, 0.0, -1.0))
    held = cape.attach(sheet, "rod", "top")
    free = cape.Scene(sheet, [held], [cape.Sphere(name="far", center=np.array([2.0, 0.0, 0.0]), radius=0.5)])
    assert check_start(free, rod()) == ()
    # The middle of the sheet, a vertex, is the sphere's; its neighbours are 0.1 m off.
    (inside,) = check_start(cape.Scene(sheet, [held], [cape.Sphere(name="ball", bone="rod", radius=0.05)]), rod())
    assert inside.text == "the cloth starts in ball: 1 of 20 vertices, up to 50 mm deep"
    assert (inside.figure, inside.parts) == (pytest.approx(0.05), ("ball",))
    high = cape.Sphere(name="ball", bone="rod", center=np.array([0.0, 0.2, 0.2]), radius=0.05)
    (holding,) = check_start(cape.Scene(sheet, [held], [high]), rod())
    assert holding.text == "rod holds the cloth in ball: 1 of 5 vertices, up to 50 mm deep"
    # Held elsewhere than where the sheet starts, at points given in the bone's frame.
    lower = cape.attach(sheet, "rod", "top", points=np.tile([0.0, 0.0, -0.5], (5, 1)))
    (given,) = check_start(
        cape.Scene(sheet, [lower], [cape.Sphere(name="ball", center=np.array([0, 0, 0.5]), radius=0.05)]), rod(1.0)
    )
    assert given.text.startswith("rod holds the cloth in ball: 5 of 5 vertices")


def test_a_capsule_that_starts_in_the_floor_is_told():
    sheet = cape.Cloth.rectangle(width=0.4, height=0.4, spacing=0.2, origin=(0.0, 0.2, 2.0))
    scene = cape.Scene(sheet, [], [ball("left_foot", "rod", 0.05), cape.Plane(name="floor")])
    assert [f.text for f in check_start(scene, rod(0.02))] == ["left_foot starts in floor by 30 mm"]
    assert check_start(scene, rod(0.04)) == ()


def test_a_track_without_the_bone_is_refused_by_name():
    with pytest.raises(UnknownNameError, match=r"Tail.*Hips"):
        check_motion(person(), [ball("tail", "Tail", 0.1)])


# Whole motions


@pytest.mark.parametrize("name", motions.clip_names())
def test_shipped_clips_raise_no_alarm(name):
    clip = motions.load(name)
    body = Skeleton.from_clip(clip)
    track = body.track(clip)
    assert check_motion(track, body.capsules(), height=body.height()) == ()
    assert check_start(cape.dress(body, track), track) == ()


def parts_of(findings: tuple[Finding, ...], kind: str) -> set[tuple[str, ...]]:
    return {finding.parts for finding in findings if finding.kind == kind}


def check_of(path: Path) -> tuple[Finding, ...]:
    clip = motions.load(str(path))
    body = Skeleton.from_clip(clip)
    return check_motion(body.track(clip), body.capsules(), height=body.height())


def test_real_mocap_has_the_faults_that_its_pictures_show(mocap):
    pirouette = check_of(mocap / "cmu_05_11_pirouette_daz.bvh")
    assert ("right_shin", "left_thigh") in parts_of(pirouette, "crossing")
    assert all(f.frames == (2, 2) for f in pirouette if f.kind == "glitch")
    # 17 m/s2: as if the dancer were 1 m tall, or filmed at 90 frames a second.
    assert kinds(check_of(mocap / "ad_fair1_jumping_zup.bvh")) == ["unit"]
    assert check_of(mocap / "cmu_12_01_walk.bvh") == ()


def test_a_robots_motion_is_checked_too(mocap):
    robot = Skeleton.from_urdf("g1")
    track = robot.track(np.loadtxt(mocap / "g1_B_SpinKarate.csv", delimiter=","), fps=60)
    assert ("right_hand", "right_thigh") in parts_of(check_motion(track, robot.capsules()), "crossing")


def test_info_tells_the_worst_of_each_kind_and_all_as_json(tmp_path, forks):
    clip = motions.load("walk")
    rotations = clip.rotations_wxyz.copy()
    for frame, joint in enumerate(("LeftArm", "RightArm", "LeftForeArm", "RightForeArm", "Head"), start=100):
        turned = quaternions.from_euler(np.radians([60.0]), "z")
        j = clip.joints.index(joint)
        rotations[frame, j] = quaternions.multiply(rotations[frame, j], turned)
    motions.save(replace(clip, rotations_wxyz=rotations), tmp_path / "torn.bvh")
    text = " ".join(forks("info", "torn.bvh", folder=tmp_path).stdout.split())
    assert text.count("check glitch:") == 4
    assert "glitch: 2 more, see --json" in text
    facts = json.loads(forks("info", "torn.bvh", "--json", folder=tmp_path).stdout)
    assert ["clip", "torn"] in facts["rows"]
    assert len([f for f in facts["findings"] if f["kind"] == "glitch"]) == 5
