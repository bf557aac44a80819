from dataclasses import replace

import numpy as np
import pytest

import motions
from motions.errors import UnknownNameError, ValueRangeError
from skeleton import ROBOTS, Capsule, Skeleton
from skeleton.capsules import CAPSULES
from skeleton.rest import NEXT_ROLE
from tests.support.figures import figure, matrices_of

EXACT = 1e-9


def world_ends(capsule, track):
    """Both ends of a capsule over the frames [m], two arrays of shape (F, 3)."""
    bone = track.index(capsule.bone)
    rotations = matrices_of(track.rotations_wxyz[:, bone])
    return [track.positions[:, bone] + rotations @ end for end in (capsule.start, capsule.end)]


def ends_of(clip, **options):
    """Ends of a clip's capsules at its first frame by name, each of shape (2, 3), and the radii by name."""
    body = Skeleton.from_clip(clip)
    track = body.track(clip)
    capsules = body.capsules(**options)
    ends = {capsule.name: np.array([end[0] for end in world_ends(capsule, track)]) for capsule in capsules}
    return ends, {capsule.name: capsule.radius for capsule in capsules}


def distance_to_segment(point, start, end):
    along = np.clip((point - start) @ (end - start) / ((end - start) @ (end - start)), 0, 1)
    return float(np.linalg.norm(point - start - along * (end - start)))


def test_capsules_follow_their_joints_on_real_clips(mocap):
    for path in sorted(mocap.glob("*.bvh")):
        clip = motions.load(path)
        body = Skeleton.from_clip(clip)
        track = body.track(clip)
        capsules = {capsule.name: capsule for capsule in body.capsules()}
        assert set(capsules) == set(CAPSULES), body.capsules_left_out()
        for role, following in NEXT_ROLE.items():
            start, end = world_ends(capsules[role], track)
            assert np.abs(end - track.positions[:, track.index(following)]).max() < EXACT
            if not role.endswith("shoulder"):
                assert np.abs(start - track.positions[:, track.index(role)]).max() < EXACT
        for role in ("left_hand", "right_hand", "left_foot", "right_foot"):
            assert np.abs(capsules[role].start).max() < EXACT
            assert capsules[role].bone == body.role(role)


def test_capsules_are_of_human_size_on_real_clips(mocap):
    for path in sorted(mocap.glob("*.bvh")):
        body = Skeleton.from_clip(motions.load(path))
        for capsule in body.capsules():
            # From the wrist of a child of 1.4 m to the trunk of a man of 2.1 m, half as deep as 0.32 m.
            assert 0.02 < capsule.radius < 0.16, capsule.name
            length = np.linalg.norm(capsule.end - capsule.start)
            assert 0.02 < length < 0.6, capsule.name


def test_robots_limbs_reach_from_joint_to_joint(mocap):
    body = Skeleton.from_urdf("g1")
    track = body.track(np.loadtxt(mocap / "g1_B_SpinKarate.csv", delimiter=",")[::20], fps=3)
    capsules = {capsule.name: capsule for capsule in body.capsules()}
    for side in ("left", "right"):
        for role, start, end in (
            ("upper_arm", "shoulder_roll", "elbow"),
            ("forearm", "elbow", "wrist_yaw"),
            ("thigh", "hip_roll", "knee"),
            ("shin", "knee", "ankle_roll"),
        ):
            ends = world_ends(capsules[f"{side}_{role}"], track)
            for where, joint in zip(ends, (start, end), strict=True):
                gap = np.linalg.norm(where - track.positions[:, track.index(f"{side}_{joint}_joint")], axis=-1)
                # The wrist and the ankle turn between the limb and the next role's joint, off its axis by 4 cm at most;
                # the hip's roll axis crosses its yaw axis within 5 cm.
                assert gap.max() < 0.08, (side, role, joint)
    assert body.capsules_left_out() == {
        "head": "no bone for the role 'head'",
        "neck": "no bone for the role 'neck', 'head'",
    }


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_gets_arms_legs_and_a_trunk(name):
    names = {capsule.name for capsule in Skeleton.from_urdf(name).capsules()}
    assert set(CAPSULES) - names <= {"head", "neck", "left_hand", "right_hand"}


def test_the_trunk_is_wider_than_deep_and_leaves_the_arms_outside():
    ends, radii = ends_of(figure())
    trunk = ("left_chest", "right_chest", "pelvis", "left_shoulder", "right_shoulder")
    reach = [np.abs(ends[name][:, 0]).max() + radii[name] for name in trunk]
    depth = [np.abs(ends[name][:, 1]).max() + radii[name] for name in trunk]
    # Biacromial breadth about 0.40 m; trunk depth 0.14 of the stature.
    assert 0.40 < 2 * max(reach) < 0.50
    assert 0.22 < 2 * max(depth) < 0.26
    for side in ("left", "right"):
        elbow = ends[f"{side}_upper_arm"][1]
        for name in trunk:
            assert distance_to_segment(elbow, *ends[name]) > radii[name], name


def test_the_trunk_has_no_gap_from_hips_to_neck():
    ends, radii = ends_of(figure())
    for height in np.linspace(0.95, 1.40, 46):
        spine = np.array([0, 0, height])
        assert min(distance_to_segment(spine, *ends[name]) - radii[name] for name in ends) < 0, height


def test_the_head_reaches_from_vertex_to_chin():
    ends, radii = ends_of(figure())
    height = Skeleton.from_clip(figure()).height()
    vertex = 1.0 + 0.24 + 0.25 + 0.10 + 0.17
    assert ends["head"][:, 2].max() + radii["head"] == pytest.approx(vertex)
    assert ends["head"][:, 2].min() - radii["head"] == pytest.approx(vertex - 0.130 * height)


@pytest.mark.parametrize(("share", "marks"), [(1.0, True), (0.8, True), (0.6, False), (0.3, False)])
def test_a_heads_bone_that_ends_below_the_hair_line_tells_where_it_points_alone(share: float, marks: bool):
    """As of CMU's files, whose heads would reach down to the shoulders."""
    whole = figure()
    ends = whole.end_offsets.copy()
    aside = np.array([0.0, -0.6, 0.8])
    reach = (0.85 + 0.64) / (1.0 - 0.039 - 0.10) * 0.10  # of legs of 0.85 m and a head's joint 0.64 m above hips
    ends[0] = share * reach * aside
    rest = Skeleton.from_clip(replace(whole, end_offsets=ends)).rest
    up = rest.vertex - rest.origin("head")
    direction = (matrices_of(rest.rotations_wxyz)[rest.bone("head")]) @ aside
    np.testing.assert_allclose(up / np.linalg.norm(up), direction, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(up), (share if marks else 1.0) * reach, rtol=0.02)


def test_a_foot_ends_at_its_end_site_and_a_hand_by_proportion():
    ends, radii = ends_of(figure())
    ankle = np.array([0.09, 0, 1 - 0.05 - 0.85])
    toe = ankle + np.array([0, -0.20, -0.04])
    towards = (toe - ankle) / np.linalg.norm(toe - ankle)
    assert ends["left_foot"][1] + radii["left_foot"] * towards == pytest.approx(toe)
    height = Skeleton.from_clip(figure()).height()
    wrist = np.array([0.18, 0, 1 + 0.24 + 0.22 - 0.56])
    assert ends["left_hand"][1][2] - radii["left_hand"] == pytest.approx(wrist[2] - 0.108 * height)


def test_left_and_right_mirror_each_other():
    ends, radii = ends_of(figure())
    for name in CAPSULES:
        if name.startswith("left_"):
            other = name.replace("left", "right")
            assert ends[name] * [-1, 1, 1] == pytest.approx(ends[other], abs=1e-12)
            assert radii[name] == pytest.approx(radii[other])


def test_capsules_grow_with_the_body():
    ends, radii = ends_of(figure())
    halved, half_radii = ends_of(figure(size=0.5))
    for name in CAPSULES:
        assert halved[name] == pytest.approx(0.5 * ends[name])
        assert half_radii[name] == pytest.approx(0.5 * radii[name])


def test_capsules_do_not_depend_on_where_the_body_is_or_faces():
    clip = figure()
    turned = np.array(clip.rotations_wxyz)
    turned[:, 0] = [0.5, 0.5, -0.5, 0.5]
    moved = replace(clip, root_positions=clip.root_positions + 7, rotations_wxyz=turned)
    for one, other in zip(Skeleton.from_clip(clip).capsules(), Skeleton.from_clip(moved).capsules(), strict=True):
        assert one.name == other.name
        assert one.start == pytest.approx(other.start, abs=1e-12)
        assert one.end == pytest.approx(other.end, abs=1e-12)


def test_everything_can_be_overridden():
    body = Skeleton.from_clip(figure())
    plain = {capsule.name: capsule for capsule in body.capsules()}
    changed = {
        capsule.name: capsule
        for capsule in body.capsules(radii={"head": 0.2}, only=["head", "left_thigh"], scale=1.5, friction=0.4)
    }
    assert list(changed) == ["head", "left_thigh"]
    assert changed["head"].radius == 0.2
    assert changed["left_thigh"].radius == pytest.approx(1.5 * plain["left_thigh"].radius)
    assert changed["left_thigh"].friction == 0.4
    taller = body.capsules(only=["left_shin"], height=2 * body.height())
    assert taller[0].radius == pytest.approx(2 * plain["left_shin"].radius)


LEFT_LEG = ("left_thigh", "left_shin", "left_foot")


def test_capsules_without_bones_are_left_out_and_named():
    body = Skeleton.from_clip(figure(without=("Neck", "LeftHand")))
    assert body.capsules_left_out() == {
        "head": "no bone for the role 'head'",
        "neck": "no bone for the role 'neck', 'head'",
        "left_forearm": "no bone for the role 'left_hand'",
        "left_hand": "no bone for the role 'left_hand'",
    }
    assert len(body.capsules()) == len(CAPSULES) - 4
    one_legged = Skeleton.from_clip(figure(without=("LeftUpLeg",)))
    assert set(one_legged.capsules_left_out()) == {"pelvis", "left_chest", "right_chest", "chest", *LEFT_LEG}
    armless = Skeleton.from_clip(figure(without=("LeftShoulder",)))
    assert armless.capsules() == ()
    assert set(armless.capsules_left_out()) == set(CAPSULES)


def test_a_body_without_legs_has_the_rest_of_it_where_it_would_have_been():
    """Its stature is that of its arms, 0.56 m from shoulder to wrist, of which Winter's figures make 0.332."""
    whole = {c.name: c for c in Skeleton.from_clip(figure()).capsules()}
    body = Skeleton.from_clip(figure(without=("LeftUpLeg", "RightUpLeg")))
    assert body.height() == pytest.approx(0.56 / 0.332)
    assert body.decisions == ("no legs: by its arms it is taken for one that is 1.69 m tall",)
    capsules = {c.name: c for c in body.capsules()}
    assert set(whole) - set(capsules) == {*LEFT_LEG, *(name.replace("left", "right") for name in LEFT_LEG)}
    for name, capsule in capsules.items():
        assert np.linalg.norm(capsule.start - whole[name].start) < 0.06, name


def test_a_segment_of_no_length_has_no_capsule():
    clip = figure()
    offsets = np.array(clip.offsets)
    offsets[clip.joints.index("LeftHand")] = 0
    body = Skeleton.from_clip(replace(clip, offsets=offsets))
    assert body.capsules_left_out() == {"left_forearm": "its segment has no length"}


def test_wrong_options_are_named():
    body = Skeleton.from_clip(figure())
    with pytest.raises(UnknownNameError, match="no capsule named 'tail'; available: head, neck, left_chest"):
        body.capsules(only=["tail"])
    with pytest.raises(UnknownNameError, match="no capsule named 'torso'"):
        body.capsules(radii={"torso": 0.2})
    with pytest.raises(ValueRangeError, match="scale of the capsules must be positive, got 0"):
        body.capsules(scale=0)
    with pytest.raises(ValueRangeError, match="height of the capsules must be positive, got -1"):
        body.capsules(height=-1)
    with pytest.raises(ValueRangeError, match=r"capsule 'head': the radius must be positive, not -0\.1"):
        body.capsules(radii={"head": -0.1})
    with pytest.raises(ValueRangeError, match="capsule 'bar': end must be 3 finite numbers"):
        Capsule("bar", None, np.zeros(3), np.array([0, 0, np.nan]), 0.1)
