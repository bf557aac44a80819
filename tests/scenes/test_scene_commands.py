"""Scenes by file and by name, through the installed command."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cape.cli.scenes.file import read_scene
from cape.scene.standard_scenes import STANDARD_SCENES
from cape.scenes.registry import SCENES
from tests.record.test_record import Recording
from tests.support.command import Forks
from tests.support.processes import mistake_told

SHORT = ("--end", "0.2", "--spacing", "0.1")


def replayed(forks: Forks, folder: Path, *arguments: str) -> dict[str, Any]:
    done = forks("replay", *arguments, "--json", folder=folder)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


DRAWN = {
    "sheet": {"/world/colliders/floor"},
    "moved": {"/world/colliders/left_cube", "/world/colliders/right_cube", "/world/colliders/hem_cube"},
    "sphere": {"/world/colliders/sphere", "/world/contacts/points"},
    "cube": {"/world/colliders/cube", "/world/contacts/points"},
    "look": {"/world/colliders/floor"},
    "torn": {"/world/colliders/ball"},
    "caught": {"/world/cape"},
    "cape": {"/world/hitboxes", "/world/skeleton"},
    "hitboxes": {"/world/hitboxes", "/world/shells", "/world/contacts/points"},
}


LEFT = ("sheet", "sphere", "look", "cape")  # which go the way of others, and are run when there is time


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.extra] if n in LEFT else []) for n in SCENES])
@pytest.mark.few("moved", "torn")
def test_a_scene_by_name_runs_and_draws_what_it_shows(name, forks, tmp_path):
    facts = replayed(forks, tmp_path, "--scene", name, *SHORT)
    assert facts["output"] == f"{name}.rrd"
    assert facts["frames"] == 13
    assert facts["result"] == "finished"
    assert facts["stretch_max"] <= 0.05
    assert facts["penetration_max_mm"] <= 0.1
    recording = Recording(tmp_path / f"{name}.rrd")
    assert DRAWN[name] <= recording.entities
    vertices = recording.array("/world/cape", "Mesh3D:vertex_positions")
    assert vertices.shape == (13, facts["vertices"], 3)
    assert np.abs(vertices[-1] - vertices[0]).max() > 0.005


def test_scenes_are_listed(forks, tmp_path):
    done = forks("scenes", folder=tmp_path)
    assert done.returncode == 0
    assert all(scene.title in done.stdout for scene in SCENES.values())
    listed = json.loads(forks("scenes", "--json", folder=tmp_path).stdout)
    assert list(listed) == [*SCENES, *(name for name in STANDARD_SCENES if name not in SCENES)]


@pytest.fixture(scope="module")
def folder(forks, tmp_path_factory) -> Path:
    """A folder with scene files: one as it is written, and one of many keys and tables."""
    place = tmp_path_factory.mktemp("scenes")
    done = forks("scene", "init", "-o", "hero.toml", folder=place)
    assert done.returncode == 0, done.stderr
    (place / "mast.csv").write_text("0,-6,0,0\n9,-6,0,0\n")
    (place / "own.toml").write_text(
        """\
clip = "idle"
end = 0.2
spacing = 0.1
garment = "back_cape"
fabric = "velvet"
wind-file = "mast.csv"
solver = "xpbd"
substeps = 12
layers = "cape,hitboxes"
output = "own_output.rrd"
self-contact = false

[fabrics.velvet]
density = 0.5

[[attachment]]
bone = "chest"
within = 0.3
stiffness = 30.0

[[collider]]
name = "post"
kind = "sphere"
center = [-0.6, 0.0, 1.0]
radius = 0.1
"""
    )
    return place


def test_a_scene_file_as_it_is_written_runs(folder, forks):
    facts = replayed(forks, folder, "--scene", "hero.toml", *SHORT)
    assert facts["output"] == "hero.rrd"
    assert facts["result"] == "finished"


def test_a_file_that_is_there_is_not_written_over(folder, forks):
    before = (folder / "hero.toml").read_text()
    _, line = mistake_told(forks("scene", "init", "kick", "-o", "hero.toml", folder=folder))
    assert "there already" in line
    assert (folder / "hero.toml").read_text() == before


def test_what_init_is_asked_for_is_in_the_file(folder, forks):
    asked = ("kick", "--wind", "1", "0", "0", "--no-self-contact", "--attach", "left_shoulder=LeftShoulder")
    done = forks("scene", "init", *asked, "-o", "asked.toml", folder=folder)
    assert done.returncode == 0, done.stderr
    assert read_scene(folder / "asked.toml").options == {
        "clip": "kick",
        "wind": [1.0, 0.0, 0.0],
        "self-contact": False,
        "attach": ["left_shoulder=LeftShoulder"],
    }


def test_what_a_file_says_holds_and_options_override_it(folder, forks):
    facts = replayed(forks, folder, "--scene", "own.toml")
    assert (facts["frames"], facts["solver"], facts["substeps"]) == (13, "xpbd", 12)
    assert facts["output"] == "own_output.rrd"
    assert facts["self_contact_mm"] is None
    entities = Recording(folder / "own_output.rrd").entities
    assert "/world/colliders/post" in entities
    assert not any(entity.startswith("/plots") for entity in entities)
    # A script in place of the file's clip, and a tolerance in place of its solver.
    again = replayed(
        forks, folder, "--scene", "own.toml", "--script", "walk 1s", "--end", "0.1", "--tolerance", "20",
        "--self-contact", "-o", "again.rrd", "--layers", "plots",
    )  # fmt: skip
    assert (again["frames"], again["output"]) == (7, "again.rrd")
    assert again["step_error"] is not None
    assert again["self_contact_mm"] is not None
    assert Recording(folder / "again.rrd").entities >= {"/plots/stretch"}


def test_a_scene_file_is_checked_without_a_run(folder, forks):
    done = forks("scene", "check", "own.toml", folder=folder)
    assert done.returncode == 0, done.stderr
    for word in ("idle, 13 frames", "back_cape of velvet", "post", "moving", "xpbd", "own_output.rrd"):
        assert word in done.stdout
    assert not (folder / "checked.rrd").exists()


MISTAKES = {
    "a key": (["replay", "--scene", "bad.toml"], "gutss = 1", "bad.toml, line 2: no key named 'gutss'"),
    "a value": (["replay", "--scene", "bad.toml"], "spacing = -1", "bad.toml, line 2: spacing must be positive"),
    "a clip": (["scene", "check", "bad.toml"], 'clip = "no.bvh"', "bad.toml, line 2: no file 'no.bvh'"),
    "a bone": (["scene", "check", "bad.toml"], '[[attachment]]\nbone = "tail"\nwithin = 1', "line 2: no bone named"),
    "what is too far away": (
        ["replay", "--scene", "bad.toml", "--garment", "back_cape", *SHORT],
        '[[attachment]]\nbone = "chest"\nwithin = 0.01',
        "bad.toml, line 2: no vertex is within",
    ),
    "a value given by hand": (["replay", "--scene", "bad.toml", "--spacing", "-2"], "spacing = 0.1", "cape: spacing"),
    "a name": (["replay", "--scene", "shet"], "", "available: sheet"),
    "a missing file": (["replay", "--scene", "none.toml"], "", "none.toml"),
    "a clip for a sheet": (["replay", "walk", "--scene", "sheet"], "", "leave out clip"),
    "a garment for a sheet": (["replay", "--scene", "cube", "--garment", "skirt"], "", "leave out garment"),
    "hitboxes for a sheet": (["replay", "--scene", "cube", "--hitboxes", "body"], "", "leave out hitboxes"),
    "a spacing that is no other": (["replay", "--scene", "walk", "--spacing", "0.1"], "", "leave out --spacing"),
    "an unknown tab": (["replay", "--tab", "plots"], "", "available: cape, hitboxes"),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_a_mistake_is_one_line(case, forks, tmp_path):
    arguments, text, told = MISTAKES[case]
    (tmp_path / "bad.toml").write_text(f"# what is wrong\n{text}\n")
    _, line = mistake_told(forks(*arguments, folder=tmp_path))
    assert told in line
    assert [path.name for path in tmp_path.iterdir()] == ["bad.toml"]
