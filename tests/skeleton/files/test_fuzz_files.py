"""Damaged files of all five formats are read, or end in a `UserError`, within a gigabyte."""

import io
import resource
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import motions
from motions.errors import UserError
from skeleton import Skeleton, column_names, load_configurations, missing_meshes
from skeleton.robot.solid_files import read_solids
from tests.skeleton.files.fuzzing import fuzz

BVH = b"""HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Spine
  {
    OFFSET 0 40 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT Head
    {
      OFFSET 0 45 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET 0 20 0
      }
    }
  }
}
MOTION
Frames: 3
Frame Time: .0083333
0 90 0 1 2 3 4 5 6 7 8 9
0 90 1 1 2 3 4 5 6 7 8 9
0 90 2 1 2 3 4 5 6 7 8 9
"""
URDF = b"""<?xml version="1.0"?>
<robot name="arm">
 <link name="base"><visual><geometry><mesh filename="package://arm/none.stl" scale="1 1 1"/></geometry></visual>
  <collision><geometry><sphere radius="0.25"/></geometry></collision>
  <inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
 <link name="rod"><visual><origin xyz="0 0 0.3" rpy="0 0 1"/>
  <geometry><box size="0.1 0.1 0.4"/></geometry></visual></link>
 <link name="tip"/>
 <joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
  <limit lower="-1" upper="1" effort="1" velocity="2"/></joint>
 <joint name="slide" type="prismatic"><origin xyz="0 0 1" rpy="0 0 0"/><parent link="rod"/><child link="tip"/>
  <axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="2"/><mimic joint="hinge" multiplier="2"/></joint>
</robot>
"""
TOML = b"""robot = "arm"
[[solid]]
name = "a"
kind = "capsule"
bone = "hinge"
start = [0.0, 0.0, 0.0]
end = [0.1, 0.0, 0.0]
radius = 0.1
[[solid]]
name = "b"
kind = "box"
center = [0.0, 0.0, 0.0]
half_sizes = [1, 1, 1]
rotation_wxyz = [1, 0, 0, 0]
friction = 0.2
[[solid]]
name = "c"
kind = "plane"
point = [0.0, 0.0, 0.0]
normal = [0.0, 0.0, 1.0]
thickness = 0.01
"""

IN_SUITE, IN_EXTRA = 500, 20_000
ROOM = 2**20  # kB


@pytest.fixture(scope="module")
def arm(tmp_path_factory) -> Skeleton:
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_bytes(URDF)
    return Skeleton.from_urdf(path)


def configurations(arm: Skeleton) -> np.ndarray:
    rows = np.zeros((4, len(column_names(arm))))
    rows[:, 2], rows[:, 6], rows[:, 7] = 0.8, 1.0, 0.1 * np.arange(4)
    return rows


def archive(arrays: dict[str, np.ndarray]) -> bytes:
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **arrays)  # pyright: ignore[reportArgumentType]
    return file.getvalue()


def packed(*members: bytes) -> bytes:
    """An archive whose checksums are right, whatever its arrays are."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as packed:
        for name, data in zip(("q", "times", "fps"), members, strict=False):
            packed.writestr(f"{name}.npy", data)
    return file.getvalue()


def member(values) -> bytes:
    file = io.BytesIO()
    np.save(file, np.asarray(values), allow_pickle=False)
    return file.getvalue()


def readers(arm: Skeleton, folder: Path) -> dict[str, tuple[Callable[[bytes], object], list[bytes]]]:
    def on_disk(name: str, read: Callable[[Path], object]) -> Callable[[bytes], object]:
        path = folder / name

        def given(data: bytes) -> object:
            path.write_bytes(data)
            return read(path)

        return given

    rows, names = configurations(arm), column_names(arm)
    text = "\n".join(",".join(map(repr, row)) for row in rows.tolist())
    arrays = [
        {"q": rows, "fps": np.array(30)},
        {"qpos": rows, "times": np.arange(4) / 30},
        {"root_pos": rows[:, :3], "root_rot": rows[:, 3:7], "dof_pos": rows[:, 7:], "joint_names": np.array(names[7:])},
    ]
    npz = on_disk("motion.npz", lambda path: load_configurations(path, arm))
    return {
        "bvh": (on_disk("clip.bvh", motions.load), [BVH]),
        "urdf": (on_disk("arm.urdf", lambda path: missing_meshes(Skeleton.from_urdf(path), "visual")), [URDF]),
        "csv": (
            on_disk("motion.csv", lambda path: load_configurations(path, arm)),
            [text.encode(), f"{','.join(names)}\n{text}".encode(), f"time {' '.join(names)}".encode()],
        ),
        "npz": (npz, [archive(each) for each in arrays]),
        "array": (lambda data: npz(packed(data)), [member(rows), member(rows.astype(np.float32).T)]),
        "toml": (on_disk("solids.toml", lambda path: read_solids(path, arm.bones)), [TOML]),
    }


FORMATS = ("bvh", "urdf", "csv", "npz", "array", "toml")


def places_reached(arm: Skeleton, folder: Path, kind: str, cases: int) -> tuple[int, int]:
    """How many places in the readers so many damaged files reach, and what they take of memory [KiB].

    Anything but a `UserError` comes out.
    """
    read, seeds = readers(arm, folder)[kind]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        reached = fuzz(read, seeds, cases=cases, expected=UserError)
    return reached, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before


@pytest.mark.parametrize("kind", FORMATS)
def test_damaged_files_are_read_or_refused(arm, tmp_path, kind):
    reached, taken = places_reached(arm, tmp_path, kind, IN_SUITE)
    assert reached > 30
    assert taken < ROOM


@pytest.mark.extra
@pytest.mark.parametrize("kind", FORMATS)
def test_many_damaged_files_are_read_or_refused(arm, tmp_path, kind):
    reached, taken = places_reached(arm, tmp_path, kind, IN_EXTRA)
    assert reached > 30
    assert taken < ROOM
