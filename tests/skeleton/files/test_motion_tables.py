"""A robot's motion as people save it: names, orders, units, arrays, and files that are damaged or made to do harm."""

import io
import os
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from motions.arrays import KINDS, read_arrays
from motions.errors import FileError, ValueRangeError
from motions.limits import LARGEST_ARRAYS, LARGEST_NUMBER
from skeleton import Skeleton, column_names, load_configurations
from skeleton.robot.columns import order_of


@pytest.fixture(scope="module")
def g1() -> Skeleton:
    return Skeleton.from_urdf("g1")


def walker(turn: float = 0.3) -> np.ndarray:
    """Configurations of the G1 that turns about the vertical, in single steps of its joints, shape (4, 36)."""
    q = np.zeros((4, 36))
    q[:, 2], q[:, 5], q[:, 6] = 0.8, np.sin(turn / 2), np.cos(turn / 2)
    q[:, 7:] = 0.01 * np.arange(4)[:, None] * np.sin(np.arange(29))
    return q


def w_first(rows: np.ndarray) -> np.ndarray:
    return rows[:, [0, 1, 2, 6, 3, 4, 5, *range(7, rows.shape[1])]]


def write(path, rows: np.ndarray, header: list[str] | None = None):
    lines = [",".join(header)] if header else []
    path.write_text("\n".join(lines + [",".join(map(repr, row)) for row in rows.tolist()]))
    return path


@given(
    prefix=st.sampled_from(["", "dof_", "joint_pos/", "robot."]),
    suffix=st.sampled_from(["", "_pos", " [rad]", "_joint"]),
    root=st.sampled_from(["{}", "root_{}", "base_{}", "p{}"]),
    random=st.randoms(use_true_random=False),
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_columns_are_matched_by_name_whatever_all_names_share(tmp_path, g1, prefix, suffix, root, random):
    names = list(column_names(g1))
    places = [root.format(name) for name in names[:3]]
    turns = ["quat_" + name[1:] for name in names[3:7]]
    joints = [prefix + name.removesuffix("_joint").upper() + suffix for name in names[7:]]
    header, order = [*places, *turns, *joints], list(range(36))
    random.shuffle(order)
    path = write(tmp_path / "shuffled.csv", walker()[:, order], [header[k] for k in order])
    motion = load_configurations(path, g1)
    np.testing.assert_allclose(motion.configurations, walker(), atol=1e-12)
    assert ("columns put into the robot's order by their names" in motion.decisions) == (order != sorted(order))


def test_a_row_of_names_that_does_not_fit_is_refused_and_numbers_are_no_names(tmp_path, g1):
    names = list(column_names(g1))
    swapped = [*names[:35], "tail_joint"]
    with pytest.raises(FileError, match=r"line 1: the row of names .* lacks 'right_wrist_yaw_joint', and has 'tail_j"):
        load_configurations(write(tmp_path / "a.csv", walker(), swapped), g1)
    with pytest.raises(FileError, match="does not fit the robot"):
        load_configurations(write(tmp_path / "b.csv", walker(), [*names[:35], names[34]]), g1)
    for first in (0, 1):
        numbered = [f"q{k}" for k in range(first, first + 36)]
        motion = load_configurations(write(tmp_path / "c.csv", walker(), numbered), g1)
        np.testing.assert_allclose(motion.configurations, walker(), atol=1e-12)


def test_of_a_row_of_names_with_one_too_many_it_alone_is_told(tmp_path, g1):
    """It lacks what the names of all joints share, which does not keep these from being matched."""
    wide = np.c_[walker(), np.ones(len(walker()))]
    with pytest.raises(FileError, match="fit the robot: it has 'battery'; leave"):
        load_configurations(write(tmp_path / "a.csv", wide, [*column_names(g1), "battery"]), g1)


@pytest.mark.parametrize("name", ["Frame", "frame_idx", "", '"index"'])
@pytest.mark.parametrize("first", [0, 17])
def test_a_column_that_counts_frames_is_left_out_and_told(tmp_path, g1, name, first):
    names, rows = list(column_names(g1)), walker()
    counted = np.c_[first + np.arange(len(rows)), rows]
    motion = load_configurations(write(tmp_path / "a.csv", counted, [name, *names]), g1)
    np.testing.assert_allclose(motion.configurations, rows, atol=1e-12)
    assert any("it counts the frames" in decision for decision in motion.decisions)
    counted[-1, 0] = counted[-2, 0]
    with pytest.raises(FileError, match="does not fit the robot"):
        load_configurations(write(tmp_path / "b.csv", counted, [name, *names]), g1)


@pytest.mark.parametrize(("name", "unit"), [("time", 1.0), ("Time [s]", 1.0), ("t_ms", 1e-3), ("timestamp (us)", 1e-6)])
def test_times_are_in_the_unit_that_their_name_ends_in(tmp_path, g1, name, unit):
    rows = walker()
    times = np.arange(len(rows)) / 50.0
    path = write(tmp_path / "a.csv", np.c_[times / unit, rows], [name, *column_names(g1)])
    np.testing.assert_allclose(load_configurations(path, g1).times, times, atol=1e-9)


@pytest.mark.parametrize(("scale", "doubted"), [(1.0, False), (1000.0, True)])
def test_a_body_that_never_comes_near_the_floor_is_told(tmp_path, g1, scale, doubted):
    rows = walker()
    rows[:, :3] = np.array([0.0, 0.0, 0.8]) * scale
    motion = load_configurations(write(tmp_path / "a.csv", rows), g1)
    told = [decision for decision in motion.decisions if "places are taken to be in metres" in decision]
    assert bool(told) == doubted


def test_degrees_are_noticed_by_name_and_by_size(tmp_path, g1):
    names, rows = list(column_names(g1)), walker()
    rows[:, 7:] *= 20.0
    turned = rows.copy()
    turned[:, 7:] = np.rad2deg(rows[:, 7:])
    header = [*names[:7], *(f"{name} (deg)" for name in names[7:])]
    motion = load_configurations(write(tmp_path / "named.csv", turned, header), g1)
    np.testing.assert_allclose(motion.configurations, rows, atol=1e-12)
    assert "29 columns are in degrees by their names: turned into radians" in motion.decisions
    motion = load_configurations(write(tmp_path / "bare.csv", turned), g1)
    np.testing.assert_allclose(motion.configurations, rows, atol=1e-12)
    assert any("taken to be in degrees" in decision for decision in motion.decisions)
    assert not any(
        "degrees" in decision for decision in load_configurations(write(tmp_path / "r.csv", rows), g1).decisions
    )


@pytest.mark.parametrize("turn", [0.0, 0.3, -2.0, -2.5])
def test_the_order_of_a_quaternion_is_found_from_the_motion(tmp_path, g1, turn):
    for rows, told in ((walker(turn), False), (w_first(walker(turn)), True)):
        motion = load_configurations(write(tmp_path / "walk.csv", rows), g1)
        np.testing.assert_allclose(motion.configurations, walker(turn), atol=1e-12)
        assert any("w is taken to come first" in decision for decision in motion.decisions) == told


def test_arrays_by_the_names_that_simulators_give_them(tmp_path, g1):
    rows, names = walker(), list(column_names(g1))
    backwards, bodies = np.arange(29)[::-1], rows[:, None].repeat(4, axis=1)
    for arrays, fps in (
        ({"qpos": w_first(rows), "fps": 50}, 50),
        ({"root_pos": rows[:, :3], "root_rot": rows[:, 3:7], "dof_pos": rows[:, 7:], "framerate": np.array([30])}, 30),
        ({"root_pos": rows[:, :3], "root_rot": w_first(rows)[:, 3:7], "dof_pos": rows[:, 7:]}, 60),
        (
            {
                "root_pos": rows[:, :3], "root_quat": rows[:, 3:7], "joint_pos": rows[:, 7:][:, backwards],
                "joint_names": np.array(names[7:])[backwards],
            },
            60,
        ),
        # Isaac Lab's, of all bodies, w first, joints in an order of their own; ASAP's; rows of any name.
        (
            {
                "body_pos_w": bodies[..., :3], "body_quat_w": w_first(rows)[:, None, 3:7].repeat(4, axis=1),
                "fps": np.array([50]),
                "joint_pos": rows[:, 7:][:, backwards], "joint_names": np.array(names[7:])[backwards],
            },
            50,
        ),
        (
            {
                "body_positions": bodies[..., :3], "body_rotations": w_first(rows)[:, None, 3:7].repeat(4, axis=1),
                "dof_positions": rows[:, 7:][:, backwards], "dof_names": np.array(names[7:])[backwards],
            },
            60,
        ),
        ({"root_trans_offset": rows[:, :3], "root_rot": rows[:, 3:7], "dof": rows[:, 7:, None], "fps": 30}, 30),
        ({"motion": rows, "betas": np.zeros(10)}, 60),
    ):  # fmt: skip
        np.savez(tmp_path / "motion.npz", allow_pickle=False, **arrays)
        motion = load_configurations(tmp_path / "motion.npz", g1)
        np.testing.assert_allclose(motion.configurations, rows, atol=1e-12)
        assert motion.fps == pytest.approx(fps)
    np.savez(tmp_path / "unnamed.npz", body_pos_w=bodies[..., :3], body_quat_w=bodies[..., 3:7], joint_pos=rows[:, 7:])
    with pytest.raises(FileError, match="in a simulator's order: add an array joint_names, in the order of joint_pos"):
        load_configurations(tmp_path / "unnamed.npz", g1)
    np.savez(tmp_path / "body.npz", poses=np.zeros((4, 156)), trans=np.zeros((4, 3)))
    with pytest.raises(FileError, match=r"a person's body \(AMASS\), not a robot's.*its arrays: poses, trans"):
        load_configurations(tmp_path / "body.npz", g1)


def archive(**members: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, data in members.items():
            packed.writestr(f"{name}.npy", data)
    return file.getvalue()


def array(values, claimed: tuple[int, ...] | None = None) -> bytes:
    """An array as numpy writes it, whose head claims another shape if one is given."""
    values, file = np.asarray(values), io.BytesIO()
    head = {
        "descr": np.lib.format.dtype_to_descr(values.dtype),
        "fortran_order": False,
        "shape": claimed or values.shape,
    }
    np.lib.format.write_array_header_1_0(file, head)
    return file.getvalue() + values.tobytes()


def test_an_array_is_not_made_before_it_is_known_to_be_sound(tmp_path):
    sound = archive(q=array(np.ones((2, 3))))
    path = tmp_path / "motion.npz"
    for data, told in (
        (archive(q=array(np.ones(3), claimed=(2**24, 2**20))), "array 'q' claims 134217728 MB, which it does not hold"),
        (archive(q=array(np.ones(3), claimed=(4, 1))), "can't be read as NPZ: EOF"),
        (archive(q=array(np.ones(3) * 1j)), "array 'q' is of complex128, not of numbers"),
        (archive(q=b"\x93NUMPY\x07\x00"), "formats? .*7"),
        (archive(q=b""), "can't be read as NPZ"),
        (sound[: len(sound) // 2], "can't be read as NPZ"),
        (archive(q=array(np.ones(3)).replace(b"NUMPY", b"NUMPZ")), "can't be read as NPZ"),
        (b"", "can't be read as NPZ"),
    ):
        path.write_bytes(data)
        with pytest.raises(FileError, match=told):
            read_arrays(path)
    path.write_bytes(sound)
    np.testing.assert_array_equal(read_arrays(path)["q"], np.ones((2, 3)))


def test_arrays_that_unpack_to_more_than_a_limit_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("motions.arrays.LARGEST_ARRAYS", 4000)
    assert LARGEST_ARRAYS > 4000
    path = tmp_path / "bomb.npz"
    path.write_bytes(archive(q=array(np.zeros(300)), r=array(np.zeros(100))))
    assert set(read_arrays(path)) == {"q", "r"}
    path.write_bytes(archive(q=array(np.zeros(300)), r=array(np.zeros(201))))
    with pytest.raises(FileError, match="array 'r' claims"):
        read_arrays(path)


@given(st.data())
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_damage_to_an_archive_brings_the_reader_down(tmp_path, data):
    sound = bytearray(archive(q=array(np.ones((2, 3))), fps=array(60)))
    for place, byte in data.draw(
        st.lists(st.tuples(st.integers(0, len(sound) - 1), st.integers(0, 255)), min_size=1, max_size=6)
    ):
        sound[place] = byte
    path = tmp_path / "damaged.npz"
    path.write_bytes(sound[: data.draw(st.integers(0, len(sound)))] if data.draw(st.booleans()) else sound)
    try:
        held = read_arrays(path)
    except FileError:
        return
    # What is read in spite of the damage has passed the archive's checksums, or has become an array of another name.
    assert all(array.dtype.kind in KINDS for array in held.values())
    if "q" in held and held["q"].shape == (2, 3):
        np.testing.assert_array_equal(held["q"], np.ones((2, 3)))


def test_numbers_too_large_to_be_meant_are_told_with_their_line(tmp_path, g1):
    rows = walker()
    rows[2, 9] = 10.0 * LARGEST_NUMBER
    for suffix in ("", " header"):
        path = write(tmp_path / "huge.csv", rows, list(column_names(g1)) if suffix else None)
        with pytest.raises(FileError, match=f"line {4 if suffix else 3}: '10000000000.0' is no number, or too large"):
            load_configurations(path, g1)
    np.savez(tmp_path / "huge.npz", q=rows)
    with pytest.raises(FileError, match="array 'q' holds a number that is not finite, or too large"):
        load_configurations(tmp_path / "huge.npz", g1)


def test_only_regular_files_are_read(tmp_path, g1):
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "zero.npz").symlink_to("/dev/zero")
    for name in ("pipe.csv", "zero.npz"):
        with pytest.raises(FileError, match="not a regular file"):
            load_configurations(tmp_path / name, g1)
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(FileError, match="is a directory"):
        load_configurations(tmp_path / "folder.csv", g1)


def test_names_of_both_sides_lose_what_they_share_alone():
    expected = ["left_a_joint", "left_b_joint", "right_a_joint"]
    assert order_of(["m_right_a", "m_left_b", "m_left_a"], expected, "f").places == [2, 1, 0]
    with pytest.raises(FileError, match="lacks 'left_b_joint', and has 'm_left_c'"):
        order_of(["m_right_a", "m_left_c", "m_left_a"], expected, "f")


def test_a_body_that_hangs_head_down_in_either_order_is_refused(tmp_path, g1):
    rows = walker()
    rows[:, 3:7] = [0.6, 0.8, 0.0, 0.0]  # half a turn about a level axis, w last; as w first, 106 degrees about x
    with pytest.raises(ValueRangeError, match="hangs head down throughout"):
        load_configurations(write(tmp_path / "a.csv", rows), g1)
