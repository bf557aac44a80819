"""Files that are damaged, compressed or too large: one error tells what is wrong, before memory is taken."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import motions
from motions import limits
from motions.errors import FileError, UserError
from tests.characters.builder import body, character
from tests.characters.test_reading import two_bones
from tests.skeleton.files.fuzzing import fuzz

BODY = body()


def changed(path: Path, **changes: Any) -> Path:
    """The file with other values in its description, by their places there: `accessors__0__count=5`."""
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    top = json.loads(data[20 : 20 + length])
    for place, value in changes.items():
        at, keys = top, [int(key) if key.isdigit() else key for key in place.split("__")]
        for key in keys[:-1]:
            at = at[key]
        at[keys[-1]] = value
    text = json.dumps(top).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest)) + struct.pack("<II", len(text), 0x4E4F534A)
    path.write_bytes(head + text + rest)
    return path


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "is compressed by Draco .*Compression off"),
        ({"extensionsRequired": ["EXT_meshopt_compression"]}, "is compressed by meshopt"),
        ({"accessors__0__count": 10**9}, "more memory than any character needs"),
        ({"accessors__0__count": 10**6}, "accessor 0 reaches beyond"),
        ({"accessors__0__count": -1}, "accessor 0 has -1 elements"),
        ({"nodes__1__children": [0]}, "hang at each other in a circle"),
        ({"nodes__0__children": [1, 1]}, "node 1 hangs at two others"),
        ({"nodes__0__translation": [1e30, 0, 0]}, "nodes hold a number that isn't finite, or beyond 1e.09"),
        ({"skins__0__joints": [0]}, "hangs at joints that its skin does not have"),
        ({"buffers__0__uri": "../hero.bin"}, r"names '../hero.bin', which is no file in its folder"),
        ({"buffers__0__uri": "/etc/passwd"}, r"names '/etc/passwd', which is no file in its folder"),
        ({"buffers__0__uri": "https://x.org/a.bin"}, "names 'https://x.org/a.bin', which is no file in its folder"),
        ({"buffers__0__uri": "none.bin"}, "No such file"),
        ({"buffers__0__uri": "data:;base64,=A"}, "no base64"),
        ({"skins__0__joints": ["a", "b"]}, "is no glTF that can be read"),
        (
            {"animations__0__samplers__0__interpolation": "EASE"},
            "keyframes of node 0 have 2 times for 2 values of EASE",
        ),
    ],
)
def test_what_is_wrong_is_told(tmp_path, changes, told):
    with pytest.raises(FileError, match=told) as caught:
        motions.load(changed(two_bones(tmp_path / "hero.glb"), **changes))
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("data", "told"), [(b"", "is empty"), (b"glTF", "no glTF that can be"), (b"hello", "no glTF that")]
)
def test_what_is_no_gltf_is_told(tmp_path, data, told):
    (tmp_path / "a.glb").write_bytes(data)
    with pytest.raises(FileError, match=told):
        motions.load(tmp_path / "a.glb")


def test_a_link_to_a_file_elsewhere_is_not_followed(tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "secret.bin").write_bytes(b"\0" * 1000)
    (tmp_path / "other" / "a.bin").symlink_to(tmp_path / "secret.bin")
    path = changed(two_bones(tmp_path / "other" / "hero.glb"), buffers__0__uri="a.bin")
    with pytest.raises(FileError, match="no file in its folder"):
        motions.load(path)


def test_sparse_elements_that_are_not_there_are_refused(tmp_path):
    path = two_bones(tmp_path / "a.glb", sparse=True)
    with pytest.raises(FileError, match="replaces elements that it does not have"):
        motions.load(changed(path, accessors__0__count=2))


def test_a_mesh_without_skeleton_is_no_character(tmp_path):
    path = changed(two_bones(tmp_path / "a.glb"), skins=[], animations=[])
    path = changed(path, nodes__2={"mesh": 0}, nodes__3={"mesh": 1})
    with pytest.raises(FileError, match=r"no skin and no animation, .*--cloth"):
        motions.load(path)


def test_what_is_too_large_is_refused_before_it_is_made(tmp_path, monkeypatch):
    path = character(tmp_path / "hero.glb", BODY)
    monkeypatch.setattr("motions.gltf.meshes.MOST_MESH_TRIANGLES", 100)
    with pytest.raises(FileError, match="more than 100 triangles"):
        motions.load(path)
    monkeypatch.setattr("motions.gltf.document.LARGEST_DESCRIPTION", 1000)
    with pytest.raises(FileError, match="its description has"):
        motions.load(path)
    assert limits.LARGEST_DESCRIPTION > 1000
    monkeypatch.undo()
    monkeypatch.setattr("motions.gltf.poses.LONGEST", 10)
    with pytest.raises(FileError, match="too long a motion"):
        motions.load(path, rate=1000.0)


def test_nothing_but_told_mistakes_comes_of_damage(tmp_path):
    seeds = [two_bones(tmp_path / "a.glb", sparse=sparse).read_bytes() for sparse in (False, True)]

    def read(data: bytes) -> None:
        path = tmp_path / "damaged.glb"
        path.write_bytes(data)
        with np.errstate(all="raise"):
            clip = motions.load(path)
        assert np.isfinite(clip.world_positions()).all()

    assert fuzz(read, seeds, cases=150, expected=UserError) > 100
