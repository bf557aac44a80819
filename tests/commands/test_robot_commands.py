"""Robots at the command line: their motions, clips that they follow, their hitboxes, and how they look."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from skeleton import Skeleton, column_names


def transforms_of(recording: Path, entity: str) -> np.ndarray:
    """Translations of an entity over the frames [m], shape (F, 3)."""
    rows = []
    for chunk in rr.chunk.RrdReader(recording).stream():
        if chunk.entity_path == entity:
            batch = chunk.to_record_batch()
            column = next(name for name in batch.schema.names if name.endswith("Transform3D:translation"))
            rows += batch.column(column).to_pylist()
    return np.array(rows)[:, 0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A folder with a robot's motion: it squats, half a second at 60 frames a second."""
    folder = tmp_path_factory.mktemp("robots")
    names = column_names(Skeleton.from_urdf("romeo"))
    bend = 0.2 * np.sin(np.linspace(0.0, np.pi, 31))
    columns = {name: np.zeros(31) for name in names} | {"qw": np.ones(31), "z": 0.84 - 0.3 * bend**2}
    for side in ("L", "R"):
        columns[f"{side}KneePitch"] = 2 * bend
        columns[f"{side}HipPitch"] = columns[f"{side}AnklePitch"] = -bend
    rows = np.stack([columns[name] for name in names], axis=1)
    np.savetxt(folder / "squat.csv", rows, delimiter=",", header=",".join(names), comments="")
    return folder


SQUAT = ("hitboxes", "squat.csv", "--skeleton", "romeo", "--bare")


@pytest.fixture(scope="module")
def squat(folder, forks) -> Path:
    """The recording of its hitboxes, which are written to a file as well."""
    done = forks(*SQUAT, "-o", "squat.rrd", "--write", "romeo.toml", folder=folder)
    assert done.returncode == 0, done.stderr
    assert "LKneePitchLink: " in done.stdout
    return folder / "squat.rrd"


def test_a_robot_is_drawn_where_its_configurations_put_it(folder, squat):
    rows = np.loadtxt(folder / "squat.csv", delimiter=",", skiprows=1)
    track = Skeleton.from_urdf("romeo").track(rows, fps=60)
    for bone in ("root_joint", "LKneePitch"):
        drawn = transforms_of(squat, f"/world/robot/{bone}")
        assert np.abs(drawn - track.positions[:, track.index(bone)]).max() < 1e-6
    entities = {chunk.entity_path for chunk in rr.chunk.RrdReader(squat).stream()}
    assert "/world/robot/LKneePitch/LKneePitchLink_0" in entities
    assert "/world/hitboxes" in entities


def test_hitboxes_go_to_a_file_and_come_back(folder, squat, forks):
    done = forks(*SQUAT, "-o", "again.rrd", "--hitboxes", "romeo.toml", "--write", "again.toml", folder=folder)
    assert done.returncode == 0, done.stderr
    assert "left_shin" in done.stdout
    first, second = (tomllib.loads((folder / f"{name}.toml").read_text())["solid"] for name in ("romeo", "again"))
    assert first == second
    assert {solid["bone"] for solid in first} >= {"LKneePitch", "TrunkYaw"}


def test_a_clip_on_a_robot(folder, forks):
    """From a clip and a robot's name to a cape: figures, the robot, no penetration."""
    done = forks(
        "replay", "walk", "--skeleton", "romeo", "--end", "0.4", "--fps", "60", "--spacing", "0.05",
        "--hitboxes", "body", "-o", "walk.rrd", "--json",
        folder=folder,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)
    assert facts["frames"] == 25
    assert facts["penetration_max_mm"] <= 2.0
    for role in ("left_hand", "right_hand", "left_foot", "right_foot"):
        assert facts["retarget"]["errors_cm"][role]["max"] <= 5.0
    assert 0.5 < facts["retarget"]["scale"] < 1.0
    assert "walk: scale: the robot's legs are" in done.stderr
    assert len(transforms_of(folder / "walk.rrd", "/world/robot/root_joint")) == 25


WRONG = {
    "a robot's motion without a robot": (["replay", "squat.csv"], "name the robot, such as --skeleton g1"),
    "a motion that is not there, before the robot is": (
        ["replay", "none.csv", "--skeleton", "none.urdf"],
        "can't read none.csv: No such file",
    ),
    "a clip that is not there, before the robot is": (["replay", "none", "--skeleton", "none.urdf"], "no file 'none'"),
    "an unknown robot": (["replay", "--skeleton", "r2d2"], "available: g1, talos"),
    "hitboxes of no kind": (["replay", "--hitboxes", "feet"], "available: limbs, all, body, or a TOML file"),
    "fitted hitboxes of a clip's body": (["replay", "--hitboxes", "all"], "needs a robot"),
    "a file that is none": (["replay", "squat.csv", "--skeleton", "romeo", "--hitboxes", "none.toml"], "none.toml"),
    "another robot's motion": (
        ["replay", "squat.csv", "--skeleton", "talos"],
        "does not fit the robot: it lacks 'leg_left_1",
    ),
    "a cut beyond the end": (["replay", "squat.csv", "--skeleton", "romeo", "--start", "9"], "lasts from 0 to 0.5 s"),
    "no frame rate": (["replay", "squat.csv", "--skeleton", "romeo", "--rate", "0"], "frame rate must be positive"),
}


@pytest.mark.parametrize("what", WRONG)
def test_a_mistake_is_one_line(folder, what, forks):
    arguments, told = WRONG[what]
    done = forks(*arguments, folder=folder)
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert told in done.stderr
