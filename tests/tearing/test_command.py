"""What the command line tells of a cape that tears."""

import json

import pytest

import cape
from cape.cli.commands.replay import Cut
from cape.cli.figures.tearing import tearing_rows
from cape.cli.reading import Reading
from cape.cli.staging import staged
from cape.scenes.registry import named_scene
from tests.support.processes import mistake_told


def test_the_command_tells_how_much_has_torn(tmp_path, forks):
    done = forks(
        "replay", "spin", "--end", "0.5", "--garment", "back_cape", "--spacing", "0.05", "--tear-force", "4",
        "-o", "take.rrd", "--json", folder=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)
    assert facts["tears"] > 0
    before, after = facts["mass_kg"]
    assert before == after > 0.0
    assert "edges have parted" in tearing_rows(facts)[0][1]
    assert tearing_rows({**facts, "tears": 0}) == []
    assert forks("replay", "spin", "--tear", "0", folder=tmp_path).returncode == 2


def test_what_may_tear_is_kept_short_where_that_is_asked_for(tmp_path, forks):
    coarse = ("--spacing", "0.08", "--no-self-contact", "--json", "-o", "out.npz")
    spin = ("replay", "spin", "--start", "0.8", "--end", "1.2", *coarse)
    (tmp_path / "spin.toml").write_text("tear = 0.5\nstrain-limit = true\n")
    found = []
    for more in (("--tear", "0.5"), ("--tear", "0.5", "--strain-limit"), ("--scene", "spin.toml")):
        done = forks(*spin, *more, folder=tmp_path)
        assert done.returncode == 0, done.stderr
        found.append(json.loads(done.stdout)["stretch_max"])
    free, limited, by_file = found
    assert limited == by_file < 0.06 < 0.1 < free


@pytest.mark.parametrize(
    ("more", "why"),
    [
        (("--loop",), "what has torn is never again as it was, so that no round repeats: leave out the loop"),
        (("--check",), "no cloth tears twice alike, so that no second run tells its error: leave out the check"),
        (
            ("--tolerance", "1"),
            "what has torn can't be taken back to try another solver, or other steps: name a solver",
        ),
        (("--budget", "4"), "what has torn can't be taken back to try another solver, or other steps: name a solver"),
    ],
)
def test_what_tears_is_not_asked_to_come_back(tmp_path, forks, more, why):
    _, told = mistake_told(forks("replay", "walk", "--tear", "0.1", *more, folder=tmp_path))
    assert told == f"cape: {why}"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["torn", "sheet"])
def test_a_scene_that_tears_is_kept_short_where_that_is_asked_for(name: str):
    asked = (None, True, False)
    scenes = [staged(Reading(None), Cut(tear=0.5, strain_limit=each), scene=named_scene(name)).scene for each in asked]
    assert [scene.strain_limit for scene in scenes] == [False, True, False]
    assert all(scene.tearing == cape.Tearing(strain=0.5) for scene in scenes)


def test_a_mesh_without_threads_is_no_cloth_to_be_kept_short(tmp_path, forks):
    (tmp_path / "sheet.obj").write_text(
        "v -0.4 1.4 -0.2\nv 0.4 1.4 -0.2\nv 0.4 0.8 -0.3\nv -0.4 0.8 -0.3\nf 1 2 3\nf 1 3 4\n"
    )
    worn = ("--cloth", "sheet.obj", "--remesh", "0.1", "--hold", "0.4=chest")
    done = forks("replay", "idle", *worn, "--strain-limit", folder=tmp_path)
    _, told = mistake_told(done)
    assert told == "cape: only threads have a strain limit: this cloth is a mesh that does not tell its own"
