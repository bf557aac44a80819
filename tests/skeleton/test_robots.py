"""Robots: their files, the surfaces of their links, and motions as rows of configurations."""

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motions import quaternions
from motions.conventions import to_z_up
from motions.errors import FileError, UserError, ValueRangeError
from skeleton import ROBOTS, RobotMotion, Skeleton, column_names, link_surfaces, load_configurations, missing_meshes
from skeleton.robot.meshes.link_surfaces import collada_up, geometry_model
from skeleton.shapes import Box, Capsule, Sphere
from skeleton.urdf.mimics import followed

MASS = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
SOLIDS = """
<collision><origin xyz="1 2 3" rpy="0 1.5707963267948966 0"/>
  <geometry><cylinder radius="0.1" length="0.4"/></geometry></collision>
<collision><origin xyz="0 0 1"/><geometry><sphere radius="0.2"/></geometry></collision>
<collision><origin xyz="0 1 0" rpy="0 0 0.5"/><geometry><box size="0.2 0.4 0.6"/></geometry></collision>
<collision><geometry><mesh filename="package://arm/meshes/tetra.stl" scale="2 2 2"/></geometry></collision>
"""
ARM = f"""<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="rod">{MASS}{SOLIDS}</link>
  <joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="2"/></joint>
</robot>
"""
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
ROUNDING = 1e-6  # m: meshes are stored in single precision, and none is larger than a few metres


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """A robot of one link in a package of its own."""
    import trimesh

    (tmp_path / "arm" / "meshes").mkdir(parents=True)
    (tmp_path / "arm" / "urdf").mkdir()
    trimesh.Trimesh(CORNERS, FACES).export(tmp_path / "arm" / "meshes" / "tetra.stl")
    path = tmp_path / "arm" / "urdf" / "arm.urdf"
    path.write_text(ARM)
    return path


def test_a_floating_base_is_added_only_where_there_is_none(tmp_path):
    floating = '<joint name="base_joint" type="floating"><parent link="world"/><child link="base"/></joint>'
    path = tmp_path / "arm.urdf"
    path.write_text(ARM.replace(SOLIDS, ""))
    assert Skeleton.from_urdf(path).bones == ("root_joint", "hinge")
    assert Skeleton.from_urdf(path, floating_base=False).bones == ("hinge",)
    path.write_text(
        ARM.replace(SOLIDS, "").replace('<link name="base"/>', f'<link name="world"/><link name="base"/>{floating}')
    )
    assert Skeleton.from_urdf(path).model.nq == 7 + 1


def test_a_robot_is_found_in_its_package(arm, monkeypatch):
    where = arm.parents[2]
    assert Skeleton.from_urdf("package://arm/urdf/arm.urdf", package_dirs=[where]).bones == ("root_joint", "hinge")
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"/nowhere:{where}")
    assert Skeleton.from_urdf("package://arm/urdf/arm.urdf").bones == ("root_joint", "hinge")
    with pytest.raises(FileError, match=rf"no folder holds package://leg/leg\.urdf; looked in: /nowhere, {where}"):
        Skeleton.from_urdf("package://leg/leg.urdf")


def test_a_robot_whose_world_is_y_up_is_turned():
    body = Skeleton.from_urdf("human")
    assert body.decisions == ("up: y in the robot's file, turned to +Z",)
    q = np.zeros((1, body.model.nq))
    q[0, :7] = [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]
    track = body.track(q, fps=60)
    # What is up in the file, y, is up in the world, z; the file's z is the world's -y.
    assert np.abs(track.positions[0, 0] - [1.0, -3.0, 2.0]).max() < 1e-12
    left, right = (track.positions[0, track.index(f"{side}_upper_arm"), 2] for side in ("left", "right"))
    assert min(left, right) > track.positions[0, track.index("left_thigh"), 2]
    asked = Skeleton.from_urdf("human", up="z").track(q, fps=60)
    assert np.abs(asked.positions[0, 0] - [1.0, 2.0, 3.0]).max() < 1e-12


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_has_both_shoulders_a_chest_and_all_limbs(name):
    body = Skeleton.from_urdf(name)
    limbs = ("shoulder", "upper_arm", "forearm", "hand", "thigh", "shin", "foot")
    for role in ("chest", "pelvis", *(f"{side}_{limb}" for side in ("left", "right") for limb in limbs)):
        assert role in body.roles
    # On the left what is called left, limbs in their order down the body.
    for limb in limbs[1:]:
        assert body.rest.joint(f"left_{limb}") @ body.rest.left > body.rest.joint(f"right_{limb}") @ body.rest.left
    heights = [body.rest.origin(f"left_{limb}") @ body.rest.up for limb in ("thigh", "shin", "foot")]
    assert heights == sorted(heights, reverse=True)
    assert body.rest.origin("chest") @ body.rest.up > body.rest.origin("left_thigh") @ body.rest.up


@pytest.mark.parametrize("name", [name for name in ROBOTS if name != "simple_humanoid"])
@pytest.mark.few("talos")
def test_surfaces_move_as_pinocchio_moves_the_geometry(name):
    import coal  # pyright: ignore[reportMissingImports]
    import pinocchio as pin  # pyright: ignore[reportMissingImports]

    body = Skeleton.from_urdf(name)
    kind = "visual" if name == "human" else "collision"
    pin.seed(3)
    q = pin.randomConfiguration(body.model, -np.ones(body.model.nq), np.ones(body.model.nq))
    q = followed(q, body.mimics, body.model)
    track = body.track(q[None], fps=60)
    solids = geometry_model(body, kind)
    data, placements = body.model.createData(), pin.GeometryData(solids)
    pin.updateGeometryPlacements(body.model, data, solids, placements, q)
    surfaces = link_surfaces(body, kind)
    assert len(surfaces) == len(solids.geometryObjects) > 20
    assert len({surface.name for surface in surfaces}) == len(surfaces)
    for surface, solid, placed in zip(surfaces, solids.geometryObjects, placements.oMg, strict=True):
        assert surface.bone is not None
        bone = track.index(surface.bone)
        world = quaternions.rotate(track.rotations_wxyz[0, bone], surface.vertices) + track.positions[0, bone]
        local = (world - placed.translation) @ placed.rotation
        if not isinstance(solid.geometry, coal.BVHModelBase) or collada_up(solid.meshPath) != "z":
            continue
        # Some files hold vertices that no triangle uses.
        triangles = [solid.geometry.tri_indices(i) for i in range(solid.geometry.num_tris)]
        corners = solid.geometry.vertices()[np.unique([(t[0], t[1], t[2]) for t in triangles])]
        assert np.abs(local.min(axis=0) - corners.min(axis=0)).max() < ROUNDING
        assert np.abs(local.max(axis=0) - corners.max(axis=0)).max() < ROUNDING


def test_solids_of_a_file_as_meshes_and_as_colliders(arm):
    import trimesh

    cylinder, sphere, box, tetra = link_surfaces(Skeleton.from_urdf(arm), "collision")
    assert {surface.bone for surface in (cylinder, sphere, box, tetra)} == {"hinge"}
    # The cylinder's axis z is turned to x.
    assert np.abs(np.ptp(cylinder.vertices, axis=0) - [0.4, 0.2, 0.2]).max() < ROUNDING
    assert np.abs((cylinder.vertices.max(axis=0) + cylinder.vertices.min(axis=0)) / 2 - [1, 2, 3]).max() < ROUNDING
    assert cylinder.primitive is None
    assert isinstance(sphere.primitive, Sphere)
    assert (sphere.primitive.center.tolist(), sphere.primitive.radius) == ([0, 0, 1], 0.2)
    assert isinstance(box.primitive, Box)
    assert box.primitive.half_sizes.tolist() == pytest.approx([0.1, 0.2, 0.3])
    inside = quaternions.rotate(quaternions.conjugate(box.primitive.rotation_wxyz), box.vertices - box.primitive.center)
    assert np.abs(np.abs(inside) - [0.1, 0.2, 0.3]).max() < ROUNDING
    assert tetra.primitive is None
    # Twice the size is eight times the volume, and faces point outwards.
    assert trimesh.Trimesh(tetra.vertices, tetra.triangles).volume == pytest.approx(8 / 6)


def test_a_capsule_of_the_file_is_one_here():
    surfaces = link_surfaces(Skeleton.from_urdf("simple_humanoid"), "collision")
    capsule = surfaces[0].primitive
    assert isinstance(capsule, Capsule)
    length = np.linalg.norm(capsule.end - capsule.start)
    assert np.ptp(surfaces[0].vertices, axis=0).max() == pytest.approx(length + 2 * capsule.radius, rel=1e-3)


def test_missing_meshes_and_bodies_without_links_are_told(arm):
    (arm.parents[1] / "meshes" / "tetra.stl").unlink()
    pieces = re.findall(r"<collision>.*?</collision>", ARM, re.DOTALL)
    text = ARM
    for piece in pieces:
        text = text if "mesh" in piece else text.replace(piece, "")
    arm.write_text(text)
    with pytest.raises(FileError, match=r"collision meshes of .*arm\.urdf can't be read: .*tetra\.stl"):
        link_surfaces(Skeleton.from_urdf(arm), "collision")
    from tests.support.figures import figure

    with pytest.raises(ValueRangeError, match="only a robot has links"):
        link_surfaces(Skeleton.from_clip(figure()), "visual")


@pytest.mark.parametrize("collision", ['<sphere radius="0.25"/>', '<mesh filename="package://arm/none.stl"/>'])
def test_a_missing_mesh_is_stood_in_for_and_told(tmp_path, collision):
    """By the link's shape of the other kind, where it stands, or by nothing; the other links are as they are."""
    place, mesh = '<origin xyz="0 0 0.3"/>', '<mesh filename="package://arm/none.stl"/>'
    box = '<geometry><box size="0.1 0.1 0.4"/></geometry>'
    links = (
        f'<link name="base"><visual>{place}<geometry>{mesh}</geometry></visual>'
        f"<collision>{place}<geometry>{collision}</geometry></collision></link>"
        f'<link name="rod"><visual>{box}</visual><collision>{box}</collision></link>'
    )
    ends = '<parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>'
    joint = f'<joint name="hinge" type="revolute">{ends}<limit lower="-1" upper="1" effort="1" velocity="2"/></joint>'
    path = tmp_path / "arm.urdf"
    path.write_text(f'<robot name="arm">{links}{joint}</robot>')
    body = Skeleton.from_urdf(path)
    surfaces = {surface.link: surface for surface in link_surfaces(body, "visual")}
    (told,) = missing_meshes(body, "visual")
    assert told.startswith("the mesh package://arm/none.stl of base is missing: ")
    assert np.ptp(surfaces["rod"].vertices, axis=0) == pytest.approx([0.1, 0.1, 0.4])
    if "sphere" in collision:
        assert told.endswith("its collision shape stands in for it")
        assert surfaces["base"].vertices.mean(axis=0) == pytest.approx([0.0, 0.0, 0.3], abs=1e-6)
        assert np.ptp(surfaces["base"].vertices, axis=0) == pytest.approx([0.5, 0.5, 0.5], abs=1e-3)
        assert missing_meshes(body, "collision") == ()
    else:
        assert told.endswith("it is left out")
        assert set(surfaces) == {"rod"}


# ---- motions ----


def walker(frames: int = 4) -> np.ndarray:
    """Configurations of the G1 in single steps of its joints, standing still, shape (frames, 36)."""
    q = np.zeros((frames, 36))
    q[:, 2], q[:, 6] = 0.8, 1.0
    q[:, 7:] = 0.01 * np.arange(frames)[:, None] * np.sin(np.arange(29))
    return q


@pytest.fixture(scope="module")
def g1() -> Skeleton:
    return Skeleton.from_urdf("g1")


@given(
    st.sampled_from([",", ";", "\t", " ", ", "]),
    st.booleans(),
    st.booleans(),
    st.randoms(use_true_random=False),
    st.sampled_from(["\n", "\r\n"]),
)
@settings(max_examples=40, deadline=None)
def test_a_table_comes_back_however_it_is_written(tmp_path_factory, g1, between, named, timed, random, ending):
    rows, names = walker(), list(column_names(g1))
    times = 0.25 + np.arange(len(rows)) / 8
    columns = dict(zip(names, rows.T, strict=True)) | ({"Time": times} if timed and named else {})
    order = list(columns)
    if named:
        random.shuffle(order)
    lines = [between.join(repr(float(columns[name][frame])) for name in order) for frame in range(len(rows))]
    path = tmp_path_factory.mktemp("motion") / "walk.csv"
    path.write_bytes(ending.join([between.join(order)] * named + lines).encode())
    motion = load_configurations(path, g1)
    assert motion.name == "walk"
    assert np.array_equal(motion.configurations, rows)
    if timed and named:
        assert np.array_equal(motion.times, times)
    else:
        assert motion.times.tolist() == (np.arange(len(rows)) / 60.0).tolist()


@given(st.text(alphabet='0123456789.,;-+eE \t\n"xnaif', max_size=200))
@settings(max_examples=150, deadline=None)
def test_no_text_brings_the_reader_down(tmp_path_factory, g1, text):
    path = tmp_path_factory.mktemp("motion") / "noise.csv"
    path.write_text(text)
    with pytest.raises(UserError):
        load_configurations(path, g1)


def test_arrays_with_times_or_a_rate(tmp_path, g1):
    rows, times = walker(), np.array([0.0, 0.1, 0.3, 0.4])
    np.savez(tmp_path / "timed.npz", q=rows, times=times)
    assert load_configurations(tmp_path / "timed.npz", g1).times.tolist() == times.tolist()
    np.savez(tmp_path / "rated.npz", q=rows, fps=30)
    assert load_configurations(tmp_path / "rated.npz", g1).fps == pytest.approx(30)
    assert load_configurations(tmp_path / "rated.npz", g1, fps=20).fps == pytest.approx(20)
    np.savez(tmp_path / "other.npz", angles=rows[:, 7:])
    with pytest.raises(FileError, match=r"no array 'q', .* its arrays: angles"):
        load_configurations(tmp_path / "other.npz", g1)
    with pytest.raises(ValueRangeError, match="holds the times of its frames"):
        load_configurations(tmp_path / "timed.npz", g1, fps=60)
    np.savez(tmp_path / "beside.npz", q=rows, fps=30, local_body_pos=np.array(None, dtype=object))
    assert load_configurations(tmp_path / "beside.npz", g1).fps == pytest.approx(30)
    np.savez(tmp_path / "pickled.npz", q=np.array([{}], dtype=object))
    with pytest.raises(FileError, match="array 'q' is of object, not of numbers"):
        load_configurations(tmp_path / "pickled.npz", g1)


def test_rows_that_do_not_fit_are_told_with_their_line(tmp_path, g1):
    path = tmp_path / "walk.csv"
    for text, error, match in [
        ("", FileError, "is empty"),
        ("1,2,3\n1,2\n", FileError, "line 2: 2 numbers, but 3"),
        ("1,2,3\n1,two,3\n", FileError, "line 2: 'two' is no number"),
        (
            "1,2,3\n",
            ValueRangeError,
            r"shape \(frames, 36\), got \(1, 3\); their numbers: x, y, z, qx, qy, qz, qw, left",
        ),
        (",".join(["0"] * 36), ValueRangeError, "numbers 4 to 7 of a row must be the quaternion of root_joint"),
    ]:
        path.write_text(text)
        with pytest.raises(error, match=match):
            load_configurations(path, g1)
    with pytest.raises(FileError, match="No such file"):
        load_configurations(tmp_path / "none.csv", g1)


def test_what_looks_wrong_in_a_motion_is_told(tmp_path, g1):
    def told(rows: np.ndarray) -> str:
        np.savez(tmp_path / "motion.npz", q=rows, fps=60)
        return " | ".join(load_configurations(tmp_path / "motion.npz", g1).decisions)

    assert told(walker()) == "60 frames a second"
    knee, beyond = column_names(g1).index("left_knee_joint"), walker()
    beyond[:, knee] = 3.0  # the file's limit is 2.8798
    assert "beyond the joints' limits: left_knee_joint by up to 0.12 in 4 frames" in told(beyond)
    spike = walker()
    spike[2, knee] = 1.0  # 60 rad/s there and back; the file's limit is 20
    assert "faster than the joints can turn: left_knee_joint 59" in told(spike)
    long = walker()
    long[:, 3:7] *= 1.1
    assert "quaternions of root_joint are off unit length by up to 0.1: normalised" in told(long)
    assert np.abs(load_configurations(tmp_path / "motion.npz", g1).configurations - walker()).max() < 1e-12
    fallen = walker(5)
    fallen[1:, 3:7] = [1.0, 0.0, 0.0, 0.0]  # half a turn about x
    assert "the trunk hangs head down in most frames" in told(fallen)
    fallen[0] = fallen[1]
    with pytest.raises(ValueRangeError, match=r"motion\.npz: the trunk hangs head down throughout: a quaternion is"):
        told(fallen)


def test_real_motions_of_the_g1_raise_no_doubt(mocap, g1):
    for path in sorted(mocap.glob("g1_*.csv")):
        motion = load_configurations(path, g1)
        assert motion.decisions == ("60 frames a second, as the file tells none",)
        assert np.abs(motion.configurations - np.loadtxt(path, delimiter=",")).max() < 1e-6


def test_a_motion_is_cut_and_checked():
    motion = RobotMotion("walk", walker(), np.array([1.0, 1.1, 1.2, 1.3]))
    cut = motion.trim(0.1, 0.2)
    assert cut.times.tolist() == pytest.approx([0.0, 0.1])
    assert np.array_equal(cut.configurations, walker()[1:3])
    with pytest.raises(ValueRangeError, match=r"can't trim motion 'walk' to 0 s \.\. 2 s: it lasts from 0 to 0.3 s"):
        motion.trim(0.0, 2.0)
    with pytest.raises(ValueRangeError, match="times must increase, frame 2 isn't"):
        RobotMotion("walk", walker(), np.array([0.0, 0.1, 0.1, 0.2]))
    with pytest.raises(ValueRangeError, match="the configuration of frame 1 isn't finite"):
        RobotMotion("walk", np.array([[0.0], [np.nan]]), np.array([0.0, 1.0]))
    with pytest.raises(ValueRangeError, match="has a single frame"):
        _ = RobotMotion("walk", walker(1), np.zeros(1)).fps


def chained(body: Skeleton, q: np.ndarray) -> dict[str, np.ndarray]:
    """Poses bone_to_world of a robot's joints from its file alone, as 4 x 4 matrices, by name."""
    assert body.source is not None
    tree = ElementTree.parse(body.source.urdf).getroot()
    angles = dict(zip(column_names(body), q, strict=True))
    # The root's link moves as the first seven numbers tell, and the whole world may be turned.
    base = np.eye(4)
    base[:3, :3] = to_z_up("y" if body.decisions else "z")
    floating = np.eye(4)
    floating[:3, :3], floating[:3, 3] = quaternions.to_matrix(q[[6, 3, 4, 5]]), q[:3]
    joints = {attribute(joint, "child", "link"): joint for joint in tree.findall("joint")}
    poses = {"root_joint": base @ floating}

    def angle_of(joint: ElementTree.Element) -> float:
        mimic, name = joint.find("mimic"), joint.get("name", "")
        if mimic is None:
            return angles[name]
        source = next(other for other in joints.values() if other.get("name") == mimic.get("joint"))
        return float(mimic.get("multiplier", 1.0)) * angle_of(source) + float(mimic.get("offset", 0.0))

    def link_pose(link: str) -> np.ndarray:
        if link not in joints:
            return poses["root_joint"]
        joint = joints[link]
        pose = np.eye(4)
        roll, pitch, yaw = numbers(attribute(joint, "origin", "rpy"))
        pose[:3, :3] = quaternions.to_matrix(quaternions.from_euler(np.array([yaw, pitch, roll]), "zyx"))
        pose[:3, 3] = numbers(attribute(joint, "origin", "xyz"))
        pose = link_pose(attribute(joint, "parent", "link")) @ pose
        if joint.get("type") != "fixed":
            axis = numbers(attribute(joint, "axis", "xyz"))
            turn = np.eye(4)
            angle = angle_of(joint)
            turn[:3, :3] = quaternions.to_matrix(quaternions.from_rotation_vector(angle * axis / np.linalg.norm(axis)))
            pose = pose @ turn
        poses[joint.get("name", "")] = pose
        return pose

    for link in joints:
        link_pose(link)
    return poses


def attribute(joint: ElementTree.Element, tag: str, name: str) -> str:
    element = joint.find(tag)
    return "" if element is None else element.get(name, "")


def numbers(text: str) -> np.ndarray:
    """Three numbers of a file, zeros where it has none."""
    return np.array([float(part) for part in (text or "0 0 0").split()])


@pytest.mark.parametrize("name", ROBOTS)
def test_bones_are_where_the_files_origins_and_axes_take_them(name):
    body = Skeleton.from_urdf(name)
    random = np.random.default_rng(5)
    q = random.uniform(-1.0, 1.0, body.model.nq)
    q[3:7] /= np.linalg.norm(q[3:7])
    track, poses = body.track(q[None], fps=60), chained(body, q)
    for index, bone in enumerate(body.bones):
        assert np.abs(track.positions[0, index] - poses[bone][:3, 3]).max() < 1e-9
        assert np.abs(quaternions.to_matrix(track.rotations_wxyz[0, index]) - poses[bone][:3, :3]).max() < 1e-9


def test_a_mesh_that_is_too_large_is_stood_in_for_and_most_of_them_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("skeleton.robot.meshes.missing_meshes.LARGEST_MESH", 2**20)
    (tmp_path / "large.stl").write_bytes(bytes(2**20 + 1))
    visual = '<visual><geometry><mesh filename="large.stl"/></geometry></visual>'
    ball = '<collision><geometry><sphere radius="0.25"/></geometry></collision>'
    box = '<visual><geometry><box size="0.1 0.1 0.4"/></geometry></visual>'
    path = tmp_path / "one.urdf"
    path.write_text(f'<robot name="one"><link name="base">{visual}{box}{ball}</link></robot>')
    body = Skeleton.from_urdf(path)
    (told,) = missing_meshes(body, "visual")
    assert told == "the mesh large.stl of base has 1 MB, more than 1: its collision shape stands in for it"
    assert len(link_surfaces(body, "visual")) == 2
    path.write_text(f'<robot name="one"><link name="base">{visual}{ball}</link></robot>')
    with pytest.raises(FileError, match=r"large.stl of base has 1 MB, more than 1; so are others: export them with"):
        link_surfaces(Skeleton.from_urdf(path), "visual")
