"""A mesh named on the command line, and textures written by it."""

import json

import numpy as np
import pytest
from PIL import Image

from cape.cli.commands import fabrics
from cape.cloth.fabrics import FABRICS
from tests.meshes.mesh_files import glb, obj, sheet
from tests.meshes.test_wearing import cone


def test_a_glb_is_worn_and_what_was_done_to_it_is_told(tmp_path, forks):
    points, faces = cone()
    y_up = points[:, [1, 2, 0]]
    pin = (np.arange(len(points)) < 32).astype(np.float32)
    doubled = np.concatenate([faces, faces[:3]])
    own = {"TEXCOORD_0": points[:, :2], "_PIN": pin}
    (tmp_path / "poncho.glb").write_bytes(glb(180.0 / 1.75 * y_up, doubled, own))
    Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(tmp_path / "image.png")
    asked = (
        "--end",
        "0.1",
        "--cloth",
        "poncho.glb",
        "--hold",
        "PIN=chest",
        "--scale-to-body",
        "180",
        "--remesh",
        "0.08",
    )
    done = forks("replay", "walk", *asked, "--texture", "image.png", "-o", "a.rrd", "--json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "poncho.glb: 3 triangles that were there twice dropped" in done.stderr
    facts = json.loads(done.stdout)
    assert facts["result"] == "finished"
    assert 200 < facts["vertices"] < 600
    assert (tmp_path / "a.rrd").exists()


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (("--cloth", "none.obj"), "cape: can't read none.obj"),
        (("--cloth", "fin.obj"), "cape: fin.obj: 1 edges of the mesh belong to more than two triangles: 3 at ("),
        (("--remesh", "0.03"), "cape: --remesh belongs to a mesh: name it by --cloth"),
        (("--cloth", "fin.obj", "--spacing", "0.1"), "--spacing and --length are of garments"),
        (("--texture", "fin.obj"), "cape: fin.obj is no image that can be read: it is of no format that Pillow knows"),
    ],
)
def test_what_is_wrong_is_one_line(asked, told, tmp_path, forks):
    points, faces = sheet(3, 3)
    fin = np.concatenate([faces, [[*faces[1, 1:], len(points)]]])
    (tmp_path / "fin.obj").write_text(obj(np.concatenate([points, [[0.5, 0.1, -0.1]]]), fin))
    done = forks("replay", "walk", "--end", "0.1", *asked, folder=tmp_path)
    assert done.returncode == 2
    lines = [line for line in done.stderr.splitlines() if not line.startswith("walk: ")]
    assert len(lines) == 1
    assert told in lines[0]


def test_textures_of_fabrics_are_written_as_gltf_takes_them(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(fabrics, "FABRICS", {"denim": FABRICS["denim"]})  # each takes a fifth of a second
    assert fabrics.run(json=True, write=tmp_path / "maps") == 0
    files = json.loads(capsys.readouterr().out)
    kinds = ("albedo", "normal", "metal_roughness")
    assert files == {"denim": [str(tmp_path / "maps" / f"denim_{kind}.png") for kind in kinds]}
    normal, metal = (
        np.array(Image.open(tmp_path / "maps" / f"denim_{kind}.png")) for kind in ("normal", "metal_roughness")
    )
    # Unit normals out of the cloth, to a rounding of 1/255 in each component.
    assert np.linalg.norm(normal / 127.5 - 1.0, axis=2) == pytest.approx(1.0, abs=0.02)
    assert (normal[..., 2] > 127).all()
    assert not metal[..., 2].any()
    assert metal[..., 1].min() > 127
