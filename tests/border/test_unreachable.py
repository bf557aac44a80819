"""Paths that the system won't look up, as their names are too long or nobody may look: one line, status 2."""

import errno
from pathlib import Path

import pytest

import cape
import motions
from cape.cli import _status_of
from cape.pictures.viewer import require_recording
from motions.errors import UserError
from skeleton import Skeleton
from tests.support.command import Forks
from tests.support.processes import mistake_told

LONG = "n" * 300
COMMANDS = {
    "a robot": ("replay", "walk", "--skeleton", LONG),
    "a robot's file": ("replay", "walk", "--skeleton", f"{LONG}.urdf"),
    "a robot's package": ("replay", "walk", "--skeleton", f"package://{LONG}/robot.urdf"),
    "a motion": ("replay", LONG),
    "a motion's file": ("info", f"{LONG}.csv", "--skeleton", "g1"),
    "a scene": ("replay", "--scene", LONG),
    "a kept take": ("export", f"{LONG}.npz", "-o", "out.glb"),
    "a kept motion": ("export", f"{LONG}.bvh", "-o", "out.glb"),
    "a recording that is drawn": ("render", f"{LONG}.rrd"),
    "a recording that is written": ("replay", "walk", "-o", f"{LONG}.rrd"),
    "a folder that it is written to": ("replay", "walk", "-o", f"{LONG}/out.rrd"),
    "hitboxes": ("hitboxes", "walk", "--bare", "--write", f"{LONG}.toml"),
    "a scene's file": ("scene", "init", "-o", f"{LONG}.toml"),
    "a picture": ("render", "walk", "-o", f"{LONG}.png"),
    "plots": ("bench", "--quick", "-o", LONG),
}


@pytest.mark.parametrize("what", COMMANDS)
def test_names_that_are_too_long_are_told_in_a_line(what: str, forks: Forks, tmp_path: Path):
    said, line = mistake_told(forks(*COMMANDS[what], folder=tmp_path))
    assert said == []
    assert len(line) <= 500
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", [LONG, f"{LONG}.glb", "a\0b", "a\0b.glb"])
def test_so_they_are_by_the_library(name: str):
    for call in (
        lambda: motions.load(name),
        lambda: motions.load("walk", animation=name),
        lambda: Skeleton.from_urdf(name),
        lambda: cape.Take.load(name),
        lambda: cape.read_cloth(name),
        lambda: cape.read_wind(name),
        lambda: require_recording(name),
    ):
        with pytest.raises(UserError):
            call()


def test_what_nobody_may_look_at_is_told_in_a_line(capsys: pytest.CaptureFixture[str]):
    assert _status_of(PermissionError(errno.EACCES, "Permission denied", "closed/walk.bvh")) == 2
    assert capsys.readouterr().err == "cape: can't use closed/walk.bvh: Permission denied\n"
