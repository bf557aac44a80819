"""`cape` with a GLB in place of a clip: what is told, what is recorded, and what is refused in one line."""

import json
from pathlib import Path

import numpy as np
import pygltflib as gl
import pytest
import rerun as rr

import motions
from tests.characters.builder import body, character
from tests.characters.test_reading import drawn

BODY = body()


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("heroes")
    red = gl.PbrMetallicRoughness(baseColorFactor=[1.0, 0.0, 0.0, 1.0])
    material = gl.Material(pbrMetallicRoughness=red)
    character(folder / "hero.glb", BODY, frames=6, clips=("Idle", "Walk"), material=material)
    (folder / "hero.fbx").write_bytes(b"Kaydara FBX Binary")
    (folder / "hero.c3d").write_bytes(b"\x02P")
    return folder


def test_a_character_wears_a_cape_over_its_own_mesh(folder, forks):
    asked = ("--animation", "Walk", "--spacing", "0.08", "--hitboxes", "body", "--no-self-contact", "--fps", "48")
    done = forks("replay", "hero.glb", *asked, "--json", folder=folder)
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)
    assert (facts["result"], facts["frames"], facts["output"]) == ("finished", 6, "hero.rrd")
    found: dict[str, list] = {}
    for chunk in rr.chunk.RrdReader(folder / "hero.rrd").stream().filter(content="/world/body/Body"):
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if name.startswith("Mesh3D:"):
                found.setdefault(name[7:], []).extend(row.as_py() for row in batch.column(name))
    expected = drawn(motions.load(folder / "hero.glb", animation="Walk"))
    assert np.abs(np.array(found["vertex_positions"]) - expected).max() < 1e-5
    assert len(found["triangle_indices"]) == 1
    assert np.array(found["triangle_indices"][0]).shape == BODY.triangles.shape
    assert np.allclose(np.linalg.norm(np.array(found["vertex_normals"]), axis=-1), 1.0, atol=1e-5)
    assert found["albedo_factor"][0] == [0xFF0000FF]
    paths = {chunk.entity_path for chunk in rr.chunk.RrdReader(folder / "hero.rrd").stream()}
    assert {path for path in paths if path.startswith("/world/body")} == {"/world/body/Body"}


def test_what_a_file_holds_is_told(folder, forks):
    done = forks("info", "hero.glb", "--hitboxes", "body", folder=folder)
    assert done.returncode == 0, done.stderr
    text = " ".join(done.stdout.split())
    assert f"{len(BODY.vertices)} vertices, {len(BODY.triangles)} triangles on 22 joints: Body" in text
    assert "animation: Idle, the first of Idle, Walk" in text
    assert "role left_hand: mixamorig:LeftHand" in text


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (("hero.glb", "--animation", "Jump"), "no animation named 'Jump'; available: Idle, Walk"),
        (("walk", "--animation", "Jump"), "leave out the animation 'Jump'"),
        (("hero.fbx",), "hero.fbx is an FBX file: convert it to GLB, in Blender or by its command: blender -b"),
        (("hero.c3d",), "hero.c3d is a take of markers, which are no joints"),
    ],
)  # fmt: skip
def test_mistakes_are_told_in_one_line(folder, forks, asked, told):
    done = forks("replay", *asked, folder=folder)
    assert done.returncode == 2
    assert told in done.stderr
    assert len(done.stderr) < 500
    assert done.stderr.count("\n") == 1


@pytest.mark.extra
def test_hitboxes_are_fitted_to_the_mesh(folder, forks):
    done = forks("hitboxes", "hero.glb", "--bare", "--write", "hero.toml", "-o", "boxes.rrd", folder=folder)
    assert done.returncode == 0, done.stderr
    text = (folder / "hero.toml").read_text()
    assert 'name = "left_forearm"' in text
    assert 'bone = "mixamorig:LeftForeArm"' in text
    paths = {chunk.entity_path for chunk in rr.chunk.RrdReader(folder / "boxes.rrd").stream()}
    assert "/world/body/Body" in paths
