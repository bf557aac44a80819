"""A robot's file: links that are fixed are bones, joints that follow others do, and files that are no URDF say so."""

import re

import numpy as np
import pytest

import cape
from motions import quaternions
from motions.errors import FileError, UnknownNameError
from skeleton import Hitboxes, Skeleton, column_names, link_surfaces, load_configurations, load_hitboxes
from skeleton.robot.collision_geometry import add_to_geometry_model
from skeleton.shapes import Sphere
from tests.skeleton.robots import person_urdf

ARMS = [f"{side}_{joint}" for side in ("left", "right") for joint in ("shoulder_pitch", "elbow", "wrist_pitch")]
FIXED = ["waist_yaw", "neck_pitch", *ARMS]
FOLLOWING = {
    "left_shoulder_pitch": 'joint="right_shoulder_pitch" multiplier="-0.5" offset="0.1"',
    "left_elbow": 'joint="left_shoulder_pitch" multiplier="2"',
    "neck_pitch": 'joint="waist_yaw"',
}


def turned(body: Skeleton, angles: dict[str, float], frames: int = 2) -> np.ndarray:
    """The same configuration in all frames, the root where it begins, joints at angles [rad]."""
    q = np.zeros((frames, body.model.nq))
    q[:, 6] = 1.0
    for joint, angle in angles.items():
        q[:, column_names(body).index(joint)] = angle
    return q


def test_what_is_fixed_is_a_bone_with_a_role(tmp_path):
    body = Skeleton.from_urdf(person_urdf(tmp_path, fixed=FIXED))
    assert body.model.nq == 7 + 6
    assert set(body.bones) == {"root_joint", *FIXED, *(f"{s}_{j}" for s in ("left", "right") for j in
                                                       ("hip_pitch", "knee", "ankle_pitch"))}  # fmt: skip
    assert (body.roles["chest"], body.roles["left_upper_arm"]) == ("waist_yaw", "left_shoulder_pitch")
    assert {f"{side}_{limb}" for side in ("left", "right") for limb in ("upper_arm", "forearm", "hand")} < set(
        body.roles
    )
    # Parents are those of the file, and every bone follows its own.
    parent = {bone: body.bones[body.parents[body.bones.index(bone)]] for bone in body.bones[1:]}
    assert parent["left_wrist_pitch"] == "left_elbow"
    assert parent["left_shoulder_pitch"] == "waist_yaw"
    assert parent["waist_yaw"] == "root_joint"
    assert all(above < bone for bone, above in enumerate(body.parents))


def test_a_fixed_bone_is_where_its_joint_takes_it(tmp_path):
    """Below a joint that turns by a about y, at rest p from it, a bone is at R(a) p and turned by a."""
    body = Skeleton.from_urdf(person_urdf(tmp_path, fixed=[joint for joint in FIXED if joint != "waist_yaw"]))
    track = body.track(turned(body, {"waist_yaw": 0.7}), fps=60)
    at_rest = np.array([0.0, 0.2, 0.3 - 0.3 - 0.25])
    turn = np.array([np.cos(0.35), 0.0, np.sin(0.35), 0.0])
    hand = track.index("left_wrist_pitch")
    expected = np.array([0.0, 0.0, 0.15]) + quaternions.rotate(turn, at_rest)
    assert np.abs(track.positions[0, hand] - expected).max() < 1e-12
    assert np.abs(track.rotations_wxyz[0, hand] - turn).max() < 1e-12


def test_a_fixed_bone_holds_cloth_and_carries_solids(tmp_path):
    body = Skeleton.from_urdf(person_urdf(tmp_path, fixed=FIXED))
    track = body.track(turned(body, {}, frames=3), fps=60)
    scene = cape.dress(body, track, spacing=0.06)
    take = cape.simulate(scene, track)
    assert take.result == "finished"
    # Named by the fixed joint, or by the link below it; Pinocchio has it on the joint that carries both.
    for name in ("left_elbow", "left_forearm"):
        path = tmp_path / "solids.toml"
        Hitboxes("person", (Sphere(name="ball", bone=name, center=np.array([0.0, 0.0, -0.1]), radius=0.04),)).save(path)
        (ball,) = load_hitboxes(path, body).solids
        assert ball.bone == "left_elbow"
        geometry = add_to_geometry_model([ball], body).geometryObjects[0]
        assert geometry.parentJoint == 1
        assert np.abs(geometry.placement.translation - [0.0, 0.2, 0.15 + 0.3 - 0.3 - 0.1]).max() < 1e-12


def test_what_is_fixed_gives_way_to_a_joint_of_its_name(tmp_path):
    """As the root does that is added."""
    path = person_urdf(tmp_path, fixed=FIXED)
    path.write_text(path.read_text().replace('name="waist_yaw"', 'name="root_joint"'))
    body = Skeleton.from_urdf(path)
    assert body.bones[0] == "root_joint"
    assert "root_joint_fixed" in body.bones
    assert body.links["chest"] == body.roles["chest"] == "root_joint_fixed"


def test_roles_are_given_by_the_names_of_fixed_joints_and_of_links(tmp_path):
    path = person_urdf(tmp_path, fixed=FIXED)
    roles = {"left_shoulder": "left_elbow", "right_shoulder": "right_forearm"}
    body = Skeleton.from_urdf(path, roles=roles)
    assert (body.role("left_shoulder"), body.role("right_shoulder")) == ("left_elbow", "right_elbow")
    with pytest.raises(UnknownNameError, match="no bone named 'wing'; available: root_joint, "):
        Skeleton.from_urdf(path, roles={"left_shoulder": "wing"})
    with pytest.raises(UnknownNameError, match="no role named 'wing'"):
        Skeleton.from_urdf(path, roles={"wing": "left_elbow"})


def test_joints_follow_those_that_they_mimic(tmp_path):
    """By their multiples, plus offsets, also along a chain: the left elbow is at 2 (-0.5 a + 0.1)."""
    body = Skeleton.from_urdf(person_urdf(tmp_path, mimics=FOLLOWING))
    a = 0.6
    track = body.track(turned(body, {"right_shoulder_pitch": a, "left_elbow": 9.0, "waist_yaw": 0.2}), fps=60)
    at = {"left_shoulder_pitch": -0.5 * a + 0.1, "left_elbow": 2.0 * (-0.5 * a + 0.1), "neck_pitch": 0.2}
    for joint, angle in at.items():
        bone = track.index(joint)
        above = track.rotations_wxyz[0, body.parents[bone]]
        own = quaternions.multiply(quaternions.conjugate(above), track.rotations_wxyz[0, bone])
        assert own == pytest.approx([np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0], abs=1e-12)
    # The neutral pose is one of the robot's, too.
    neutral = body.rest.rotations_wxyz[body.bones.index("left_shoulder_pitch")]
    assert neutral == pytest.approx([np.cos(0.05), 0.0, np.sin(0.05), 0.0], abs=1e-12)


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("whole", [False, True])
def test_a_motion_may_leave_out_the_joints_that_follow(tmp_path, named, whole):
    body = Skeleton.from_urdf(person_urdf(tmp_path, mimics=FOLLOWING))
    q, names = turned(body, {"right_shoulder_pitch": 0.6, "right_knee": 1.0}), column_names(body)
    kept = [k for k, name in enumerate(names) if whole or name not in FOLLOWING]
    rows = [",".join(names[k] for k in kept)] if named else []
    rows += [",".join(repr(float(row[k])) for k in kept) for row in q]
    (tmp_path / "walk.csv").write_text("\n".join(rows))
    motion = load_configurations(tmp_path / "walk.csv", body)
    q[:, [names.index(joint) for joint in FOLLOWING]] = [-0.2, -0.4, 0.0]
    assert np.abs(motion.configurations - q).max() < 1e-12


def test_joints_that_can_not_follow_are_told(tmp_path):
    lost = Skeleton.from_urdf(person_urdf(tmp_path, mimics={"neck_pitch": 'joint="tail"'}))
    assert lost.decisions == ("the joint neck_pitch mimics 'tail', which is none: it moves by itself",)
    circle = {"left_elbow": 'joint="left_wrist_pitch"', "left_wrist_pitch": 'joint="left_elbow"'}
    with pytest.raises(FileError, match="the joint left_elbow mimics itself, by way of others"):
        Skeleton.from_urdf(person_urdf(tmp_path, mimics=circle))
    with pytest.raises(FileError, match=r"can't be read as URDF: multiplier value \(half\) is not a valid float"):
        Skeleton.from_urdf(person_urdf(tmp_path, mimics={"neck_pitch": 'joint="waist_yaw" multiplier="half"'}))


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("walker.urdf.xacro", '<robot name="w"><link name="a"/></robot>', "xacro .* -o walker_made.urdf"),
        ("walker.urdf", '<robot name="w"><xacro:include filename="x"/></robot>', "is a xacro file"),
        (
            "walker.urdf",
            '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="w"><xacro:property name="r" value="1"/></robot>',
            "is a xacro file",
        ),
        ("walker.xml", '<mujoco model="w"><worldbody/></mujoco>', "is an MJCF file of MuJoCo, not URDF"),
        ("walker.sdf", '<sdf version="1.6"><model name="w"/></sdf>', "is an SDF file of Gazebo, not URDF"),
        ("walker.urdf", "solid walker", "can't be read as URDF: "),
    ],
)  # fmt: skip
def test_what_is_no_urdf_is_answered_in_a_line(tmp_path, name, text, told):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(FileError, match=told):
        Skeleton.from_urdf(path)


@pytest.mark.parametrize(
    ("written", "instead"),
    [(' effort="9"', ""), (' velocity="9"', ""), ("<inertial>.*?</inertial>", "<inertial/>")],
)
def test_what_exporters_leave_out_is_not_missed(tmp_path, capfd, written, instead):
    """Neither the model nor the shapes of links need it, and the parser says nothing of it."""
    path = person_urdf(tmp_path)
    whole, text = Skeleton.from_urdf(path), path.read_text()
    (tmp_path / "less.urdf").write_text(re.sub(written, instead, text))
    assert (tmp_path / "less.urdf").read_text() != text
    body = Skeleton.from_urdf(tmp_path / "less.urdf")
    assert (body.bones, body.roles) == (whole.bones, whole.roles)
    assert len(link_surfaces(body, "visual")) == len(link_surfaces(whole, "visual"))
    assert capfd.readouterr().err == ""
