import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import motions
from motions.clip import Clip
from motions.errors import FileError, UnknownNameError, ValueRangeError
from skeleton import ROBOTS, Skeleton
from tests.support.figures import figure, matrices_of, world_matrices

EXACT = 1e-9
"""What the poses are good for [m]: a chain of 60 joints loses some 60 roundings of 1e-15 m, far less."""

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
HINGE = '<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/>'
PENDULUM = f"""<?xml version="1.0"?>
<robot name="pendulum">
  <link name="base"/>
  <link name="upper">{INERTIAL}</link>
  <link name="lower">{INERTIAL}</link>
  <joint name="hinge" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 2"/>{HINGE}</joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.5"/>{HINGE}</joint>
</robot>
"""


@st.composite
def trees(draw: st.DrawFn) -> Clip:
    """Clips of random trees: 1 to 12 joints, some of them changing their place, a few frames, any rotations."""
    joints, frames = draw(st.integers(1, 12)), draw(st.integers(1, 4))
    parents = [-1, *(draw(st.integers(0, joint - 1)) for joint in range(1, joints))]
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    rotations = random.normal(size=(frames, joints, 4))
    offsets = random.normal(size=(joints, 3))
    offsets[0] = 0
    local_positions = None
    if draw(st.booleans()):
        local_positions = np.repeat(offsets[None], frames, axis=0)
        moving = draw(st.sets(st.integers(0, joints - 1)))
        local_positions[:, list(moving)] += random.normal(size=(frames, len(moving), 3))
    return Clip(
        name="tree",
        joints=tuple(f"j{joint}" for joint in range(joints)),
        parents=np.array(parents),
        offsets=offsets,
        end_parents=np.array([joints - 1]),
        end_offsets=random.normal(size=(1, 3)),
        fps=30.0,
        root_positions=random.normal(size=(frames, 3)),
        rotations_wxyz=rotations / np.linalg.norm(rotations, axis=-1, keepdims=True),
        local_positions=local_positions,
    )


def assert_poses(track, expected, tolerance=EXACT):
    assert np.abs(track.positions - expected[..., :3, 3]).max() < tolerance
    assert np.abs(matrices_of(track.rotations_wxyz) - expected[..., :3, :3]).max() < tolerance


@given(trees())
@settings(max_examples=60, deadline=None)
def test_poses_equal_chained_matrices_on_any_tree(clip):
    assert_poses(Skeleton.from_clip(clip).track(clip), world_matrices(clip))


def test_poses_equal_chained_matrices_on_real_clips(mocap):
    for path in sorted(mocap.glob("*.bvh")):
        clip = motions.load(path)
        assert_poses(Skeleton.from_clip(clip).track(clip), world_matrices(clip))


@given(trees())
@settings(max_examples=50, deadline=None)
def test_poses_are_those_that_pinocchio_gives_its_model_of_the_clip(clip):
    import pinocchio as pin  # pyright: ignore[reportMissingImports]

    body = Skeleton.from_clip(clip)
    track, data = body.track(clip), body.model.createData()
    local = np.repeat(clip.offsets[None], clip.frames, axis=0) if clip.local_positions is None else clip.local_positions
    sizes = zip(body.model.idx_qs.tolist()[1:], body.model.nqs.tolist()[1:], strict=True)
    q = np.zeros((clip.frames, body.model.nq))
    for joint, (start, size) in enumerate(sizes):
        if size == 7:
            q[:, start : start + 3] = clip.root_positions if joint == 0 else local[:, joint]
        q[:, start + size - 4 : start + size] = clip.rotations_wxyz[:, joint][:, [1, 2, 3, 0]]
    for frame in range(clip.frames):
        pin.forwardKinematics(body.model, data, q[frame])
        placed = np.array([placement.translation for placement in data.oMi.tolist()[1:]])
        assert np.abs(track.positions[frame] - placed).max() < 1e-12 * max(1.0, np.abs(placed).max())


def test_a_body_of_two_thousand_joints_needs_little_memory():
    """A chain of a thousand joints and a thousand fingers; what Pinocchio would allocate for it is some 100 GB."""
    joints, random = 2000, np.random.default_rng(1)
    parents = np.concatenate([[-1], np.arange(999), np.zeros(1000, int)])
    offsets = 0.01 * random.normal(size=(joints, 3))
    offsets[0] = 0.0
    rotations = random.normal(size=(2, joints, 4))
    clip = Clip(
        name="centipede", joints=tuple(f"j{k}" for k in range(joints)), parents=parents, offsets=offsets,
        end_parents=np.zeros(0, int), end_offsets=np.zeros((0, 3)), fps=30.0, root_positions=np.zeros((2, 3)),
        rotations_wxyz=rotations / np.linalg.norm(rotations, axis=-1, keepdims=True),
    )  # fmt: skip
    track = Skeleton.from_clip(clip).track(clip)
    assert np.abs(track.positions - clip.world_positions()).max() < EXACT


def test_end_sites_are_frames_of_the_model():
    import pinocchio as pin  # pyright: ignore[reportMissingImports]

    clip = figure()
    body = Skeleton.from_clip(clip)
    data = body.model.createData()
    configuration = pin.neutral(body.model)
    configuration[:3] = clip.root_positions[0]
    pin.framesForwardKinematics(body.model, data, configuration)
    crown = data.oMf[body.model.getFrameId("Head end 0")].translation
    assert np.abs(crown - [0, 0, 1.0 + 0.24 + 0.25 + 0.10 + 0.17]).max() < EXACT


@pytest.mark.parametrize("name", ["g1_B_SpinKarate", "g1_J_ShortDance16_JazzWalk"])
def test_robot_follows_its_recorded_configurations(mocap, name):
    configurations = np.loadtxt(mocap / f"{name}.csv", delimiter=",")
    track = Skeleton.from_urdf("g1").track(configurations, fps=60)
    assert track.frames == len(configurations)
    root = track.index("root_joint")
    assert np.abs(track.positions[:, root] - configurations[:, :3]).max() < EXACT
    # The waist's first joint sits at the root's origin and turns about its z axis by the first waist angle.
    waist = np.swapaxes(matrices_of(track.rotations_wxyz[:, root]), -1, -2) @ matrices_of(
        track.rotations_wxyz[:, track.index("waist_yaw_joint")]
    )
    yaw = np.arctan2(waist[:, 1, 0], waist[:, 0, 0])
    assert np.abs(yaw - configurations[:, 7 + 12]).max() < 1e-6
    # The ankle's two joints are 17.6 mm apart, whatever the pose.
    feet = track.positions[:, [track.index("left_ankle_pitch_joint"), track.index("left_ankle_roll_joint")]]
    apart = np.linalg.norm(feet[:, 1] - feet[:, 0], axis=-1)
    assert np.ptp(apart) < EXACT
    assert apart[0] == pytest.approx(0.017558, abs=1e-6)


def test_fixed_robot_is_a_double_pendulum(tmp_path):
    path = tmp_path / "pendulum.urdf"
    path.write_text(PENDULUM)
    angles = np.array([[0.0, 0.0], [0.3, -0.9], [-1.2, 0.4]])
    track = Skeleton.from_urdf(path, floating_base=False).track(angles, fps=10)
    elbow = np.stack([-0.5 * np.sin(angles[:, 0]), np.zeros(3), 2 - 0.5 * np.cos(angles[:, 0])], axis=-1)
    assert np.abs(track.positions[:, track.index("elbow")] - elbow).max() < EXACT
    total = angles.sum(axis=1)
    turn = np.stack([np.cos(total / 2), np.zeros(3), np.sin(total / 2), np.zeros(3)], axis=-1)
    assert np.abs(track.rotations_wxyz[:, track.index("elbow")] - turn).max() < EXACT
    assert track.fps == pytest.approx(10)


def test_only_the_asked_bones_are_read_out():
    clip = figure(frames=3)
    body = Skeleton.from_clip(clip)
    everything, some = body.track(clip), body.track(clip, ["left_hand", "LeftHand", "chest", "Hips"])
    assert some.names == ("LeftHand", "Chest", "Hips")
    assert some.parents is not None
    assert some.parents.tolist() == [1, 2, -1]
    assert some.roles["left_hand"] == "LeftHand"
    assert "head" not in some.roles
    for name in some.names:
        assert np.array_equal(some.positions[:, some.index(name)], everything.positions[:, everything.index(name)])


def test_a_clip_with_its_joints_in_another_order_gives_the_same_poses():
    clip = figure(frames=2)
    body = Skeleton.from_clip(clip)
    # Parents first is the reader's promise; only the arrays' order matters here, so siblings are swapped.
    left, right = clip.joints.index("LeftShoulder"), clip.joints.index("RightShoulder")
    order = list(range(len(clip.joints)))
    order[left], order[right] = right, left
    place = np.argsort(order)
    shuffled = replace(
        clip,
        joints=tuple(clip.joints[i] for i in order),
        parents=np.array([-1 if clip.parents[i] < 0 else place[clip.parents[i]] for i in order]),
        offsets=clip.offsets[order],
        end_parents=place[clip.end_parents],
        rotations_wxyz=clip.rotations_wxyz[:, order],
    )
    track = body.track(shuffled)
    assert track.names == clip.joints
    assert np.abs(track.positions - body.track(clip).positions).max() < EXACT


def test_times_come_from_the_clip():
    clip = figure(frames=4)
    body = Skeleton.from_clip(clip)
    assert body.track(clip).times.tolist() == [0, 1 / 60, 2 / 60, 3 / 60]
    with pytest.raises(ValueRangeError, match="a clip has its own"):
        body.track(clip, fps=30)


def test_roles_are_found_and_overridable():
    clip = figure()
    body = Skeleton.from_clip(clip, roles={"chest": "Neck"})
    assert body.role("left_upper_arm") == "LeftArm"
    assert body.role("chest") == "Neck"
    assert body.bone("left_upper_arm") == body.bone("LeftArm")


def test_roles_that_names_do_not_tell_are_guessed_from_the_shape_and_told():
    clip = motions.load("idle")
    named = Skeleton.from_clip(clip)
    nameless = replace(clip, joints=tuple(f"joint_{k}" for k in range(len(clip.joints))))
    body = Skeleton.from_clip(nameless)
    assert {role: clip.joints[nameless.index(joint)] for role, joint in body.roles.items()} == dict(named.roles)
    assert named.decisions == ()
    (told,) = body.decisions
    assert told.startswith("roles guessed from the shape of the body: ")
    assert f"left_upper_arm={body.role('left_upper_arm')}" in told
    assert "--attach ROLE=BONE" in told
    by_hand = Skeleton.from_clip(nameless, roles={"head": "joint_0"})
    assert by_hand.role("head") == "joint_0"


def test_a_hand_whose_name_tells_nothing_is_guessed_where_the_arm_is_that_of_its_names():
    clip = motions.load("idle")
    strange = replace(clip, joints=tuple(joint.replace("Hand", "Pako") for joint in clip.joints))
    body = Skeleton.from_clip(strange)
    assert (body.role("left_hand"), body.role("right_hand")) == ("LeftPako", "RightPako")
    assert "left_hand=LeftPako, right_hand=RightPako;" in body.decisions[0]
    other = Skeleton.from_clip(strange, roles={"left_upper_arm": "LeftShoulder", "left_forearm": "LeftArm"})
    assert "left_hand" not in other.roles
    assert other.role("right_hand") == "RightPako"


def test_unknown_roles_and_bones_list_what_there_is():
    clip = figure(without=("Neck",))
    body = Skeleton.from_clip(clip)
    with pytest.raises(UnknownNameError, match=r"'head'.*roles=.*Hips, Chest, "):
        body.role("head")
    with pytest.raises(UnknownNameError, match=r"no bone named 'tail'; available: Hips.*Roles: pelvis"):
        body.track(clip, ["tail"])
    with pytest.raises(UnknownNameError, match="no bone named 'Nose'"):
        Skeleton.from_clip(clip, roles={"head": "Nose"})


def test_motions_that_do_not_fit_are_refused():
    clip = figure(frames=2)
    body = Skeleton.from_clip(clip)
    with pytest.raises(ValueRangeError, match="lacks Neck, Head"):
        body.track(figure(without=("Neck",)))
    sliding = np.repeat(clip.offsets[None], 2, axis=0)
    sliding[1, 1] += 0.1
    with pytest.raises(ValueRangeError, match=r"change their place.*: Chest"):
        body.track(replace(clip, local_positions=sliding))
    robot = Skeleton.from_urdf("g1")
    still = np.zeros((2, 36))
    still[:, 6] = 1
    with pytest.raises(ValueRangeError, match="got the clip 'figure'"):
        robot.track(clip)
    with pytest.raises(ValueRangeError, match=r"\(frames, 36\), got \(2, 35\)"):
        robot.track(still[:, 1:], fps=60)
    with pytest.raises(ValueRangeError, match="either fps or times, got none"):
        robot.track(still)
    with pytest.raises(ValueRangeError, match="either fps or times, got both"):
        robot.track(still, fps=60, times=[0, 1])
    with pytest.raises(ValueRangeError, match="frame rate must be positive, got -1"):
        robot.track(still, fps=-1)
    with pytest.raises(ValueRangeError, match=r"times must have the shape \(2,\).*got \(3,\)"):
        robot.track(still, times=[0, 1, 2])
    still[1, 9] = np.nan
    with pytest.raises(ValueRangeError, match="frame 1 holds NaN"):
        robot.track(still, fps=60)


def test_robots_that_can_not_be_found_or_read(tmp_path):
    with pytest.raises(UnknownNameError, match="no robot named 'r2d2'; available: g1, talos"):
        Skeleton.from_urdf("r2d2")
    with pytest.raises(FileError, match=r"no file .*missing\.urdf; robots known by name: g1"):
        Skeleton.from_urdf(tmp_path / "missing.urdf")
    with pytest.raises(FileError, match="is a directory"):
        Skeleton.from_urdf(tmp_path)
    text = tmp_path / "text.urdf"
    text.write_text("no XML")
    with pytest.raises(FileError, match="can't be read as URDF"):
        Skeleton.from_urdf(text)


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_has_arms_and_legs(name):
    body = Skeleton.from_urdf(name)
    assert 0.8 < body.height() < 2.0
    assert 0.1 * body.height() < body.shoulder_width() < 0.4 * body.height()


@pytest.mark.parametrize("size", [1.0, 0.5])
def test_height_and_shoulder_width_of_a_known_figure(size):
    body = Skeleton.from_clip(figure(size=size))
    assert body.shoulder_width() == pytest.approx(2 * (0.02 + 0.16) * size)
    # Legs of 0.85 m, 0.81 m from the hip joints to the end site of the head; the ankles are 3.9 % of the whole high.
    assert body.height() == pytest.approx((0.85 + 0.05 + 0.24 + 0.25 + 0.10 + 0.17) / (1 - 0.039) * size)


def test_height_by_proportion_where_the_head_has_no_end_or_is_missing():
    clip = figure()
    headed = Skeleton.from_clip(replace(clip, end_parents=clip.end_parents[1:], end_offsets=clip.end_offsets[1:]))
    assert headed.height() == pytest.approx((0.85 + 0.64) / (1 - 0.039 - 0.10))
    headless = Skeleton.from_clip(figure(without=("Neck",)))
    assert headless.height() == pytest.approx((0.85 + 0.05 + 0.24 + 0.22) / (0.818 - 0.039))


def test_importing_loads_no_heavy_package():
    heavy = "{'pinocchio', 'rerun', 'trimesh', 'matplotlib', 'coal', 'numba'}"
    code = f"import sys, skeleton; print(sorted({heavy} & set(sys.modules)))"
    root = Path(__file__).parents[2]
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root)
    assert result.stdout.strip() == "[]"


def test_links_tell_who_is_who_where_joints_do_not(tmp_path):
    joints = [("bky", "pelvis", "utorso", "0 0 0.4"), ("nky", "utorso", "head", "0 0 0.2")]
    for side, y in (("l", 0.2), ("r", -0.2)):
        for first, chain in (("utorso", ("uarm", "farm", "hand")), ("pelvis", ("uleg", "lleg", "foot"))):
            above, place = first, f"0 {y} 0"
            for number, part in enumerate(chain):
                joints.append((f"{side}{first[0]}{number}", above, f"{side}_{part}", place))
                above, place = f"{side}_{part}", "0 0 -0.3"
    links = ("pelvis", *(child for _, _, child, _ in joints))
    text = "".join(f'<link name="{link}">{INERTIAL}</link>' for link in links)
    for name, parent, child, place in joints:
        ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{place}"/>'
        text += f'<joint name="{name}" type="revolute">{ends}{HINGE}</joint>'
    (tmp_path / "terse.urdf").write_text(f'<robot name="terse">{text}</robot>')
    body = Skeleton.from_urdf(tmp_path / "terse.urdf")
    for number, (arm, leg) in enumerate((("upper_arm", "thigh"), ("forearm", "shin"), ("hand", "foot"))):
        for side in ("left", "right"):
            assert body.role(f"{side}_{arm}") == f"{side[0]}u{number}"
            assert body.role(f"{side}_{leg}") == f"{side[0]}p{number}"
    assert body.role("chest") == "bky"
