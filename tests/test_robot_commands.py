"""Robots at the command line: their motions, clips that they follow, their hitboxes, and how they look."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from skeleton import Skeleton, column_names

CAPE = Path(sys.executable).parent / "cape"


def cape(folder: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [CAPE, *map(str, arguments)]
    return subprocess.run(command, cwd=folder, env=os.environ, capture_output=True, text=True, timeout=300)


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
    names = column_names(Skeleton.from_urdf("g1"))
    bend = 0.2 * np.sin(np.linspace(0.0, np.pi, 31))
    columns = {name: np.zeros(31) for name in names} | {"qw": np.ones(31), "z": 0.79 - 0.3 * bend**2}
    for side in ("left", "right"):
        columns |= {
            f"{side}_knee_joint": 2 * bend,
            f"{side}_hip_pitch_joint": -bend,
            f"{side}_ankle_pitch_joint": -bend,
        }
    rows = np.stack([columns[name] for name in names], axis=1)
    np.savetxt(folder / "squat.csv", rows, delimiter=",", header=",".join(names), comments="")
    return folder


@pytest.fixture(scope="module")
def squat(folder) -> Path:
    """The recording of its hitboxes, which are written to a file as well."""
    done = cape(folder, "hitboxes", "squat.csv", "--skeleton", "g1", "--bare", "-o", "squat.rrd", "--write", "g1.toml")
    assert done.returncode == 0, done.stderr
    return folder / "squat.rrd"


def test_a_robot_is_drawn_where_its_configurations_put_it(folder, squat):
    rows = np.loadtxt(folder / "squat.csv", delimiter=",", skiprows=1)
    track = Skeleton.from_urdf("g1").track(rows, fps=60)
    for bone in ("root_joint", "left_knee_joint"):
        drawn = transforms_of(squat, f"/world/robot/{bone}")
        assert np.abs(drawn - track.positions[:, track.index(bone)]).max() < 1e-6
    entities = {chunk.entity_path for chunk in rr.chunk.RrdReader(squat).stream()}
    assert "/world/robot/left_knee_joint/left_knee_link_0" in entities
    assert "/world/hitboxes" in entities


def test_hitboxes_go_to_a_file_and_come_back(folder, squat):
    written = (folder / "g1.toml").read_text()
    assert 'bone = "left_knee_joint"' in written
    done = cape(
        folder, "hitboxes", "squat.csv", "--skeleton", "g1", "--bare", "-o", "again.rrd", "--hitboxes", "g1.toml"
    )
    assert done.returncode == 0, done.stderr
    assert "left_shin" in done.stdout
    done = cape(
        folder, "hitboxes", "squat.csv", "--skeleton", "g1", "--bare", "-o", "again.rrd", "--hitboxes", "g1.toml",
        "--write", "again.toml",
    )  # fmt: skip
    tables = [(folder / name).read_text().split("[[")[1:] for name in ("g1.toml", "again.toml")]
    assert tables[0] == tables[1] != []


def test_a_clip_on_a_robot(folder):
    """From a clip and a robot's name to a cape: figures, the robot, no penetration."""
    done = cape(
        folder, "replay", "walk", "--skeleton", "g1", "--end", "0.4", "--fps", "60", "--spacing", "0.05",
        "--hitboxes", "body", "-o", "walk.rrd", "--json",
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
    "an unknown robot": (["replay", "--skeleton", "r2d2"], "available: g1, talos"),
    "hitboxes of no kind": (["replay", "--hitboxes", "feet"], "available: limbs, all, body, or a TOML file"),
    "fitted hitboxes of a clip's body": (["replay", "--hitboxes", "all"], "needs a robot"),
    "a file that is none": (["replay", "squat.csv", "--skeleton", "g1", "--hitboxes", "none.toml"], "none.toml"),
    "another robot's motion": (["replay", "squat.csv", "--skeleton", "talos"], "(frames, 39), got (31, 36)"),
    "a cut beyond the end": (["replay", "squat.csv", "--skeleton", "g1", "--end", "9"], "lasts from 0 to 0.5 s"),
    "no frame rate": (["replay", "squat.csv", "--skeleton", "g1", "--rate", "0"], "frame rate must be positive"),
}


@pytest.mark.parametrize("what", WRONG)
def test_a_mistake_is_one_line(folder, what):
    arguments, told = WRONG[what]
    done = cape(folder, *arguments)
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert told in done.stderr
