"""What commands tell: short, things of one kind once, in the words of the command line."""

from dataclasses import replace

import pytest

import motions
from cape.cli.words import MOST, be_verbose, gathered, shortened
from tests.support.figures import figure


@pytest.fixture(autouse=True)
def _quiet():
    yield
    be_verbose(False)


def test_a_long_message_keeps_its_beginning_and_its_end():
    text = "no bone named 'tail'; available: " + ", ".join(f"bone_{k}" for k in range(200)) + ". Roles: none"
    told = shortened(text)
    assert len(told) <= MOST
    assert told.startswith("no bone named 'tail'; available: bone_0, bone_1, ")
    assert told.endswith("bone_199. Roles: none (all of it: --verbose)")
    be_verbose(True)
    assert shortened(text) == text


def test_sentences_of_a_kind_are_counted():
    meshes = [f"the mesh {k}.stl of link {k} is missing: it is left out" for k in range(13)]
    told = gathered(["up: z", *meshes, "60 frames a second"])
    assert told == [
        "up: z",
        meshes[0],
        meshes[1] + " (and 11 more like it: --verbose)",
        "60 frames a second",
    ]
    assert gathered(meshes[:2]) == meshes[:2]
    be_verbose(True)
    assert gathered(meshes) == meshes


def test_verbose_is_an_option_of_commands(forks, tmp_path):
    clip = figure(frames=3)
    motions.save(replace(clip, joints=tuple(f"{joint}_{'long' * 10}" for joint in clip.joints)), tmp_path / "long.bvh")
    mistake = ("replay", "long.bvh", "--attach", "left_shoulder=tail")
    short, whole = forks(*mistake, folder=tmp_path), forks(*mistake, "--verbose", folder=tmp_path)
    assert short.returncode == whole.returncode == 2
    assert len(short.stderr) <= len("cape: ") + MOST + 1 < len(whole.stderr)
    assert all(done.stderr.startswith("cape: no bone named 'tail'; available: Hips_") for done in (short, whole))
