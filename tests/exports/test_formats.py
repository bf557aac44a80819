"""Exports, read back by readers that know nothing of how they were written: places, times, textures, orientation."""

# trimesh.load gives whatever a file holds.
# pyright: reportAttributeAccessIssue=false

import json
import os
import struct
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from cape.cloth.drawn.textures import Textures
from cape.cloth.normals import vertex_normals
from cape.exports import FORMATS, moving_mesh
from cape.results.take import Take
from motions.errors import FileError, UnknownNameError, UserError, ValueRangeError
from tests.exports.a_take import FPS, FRAMES, make_take

CLOSE = 1e-5  # m
Z_UP_TO_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


@pytest.fixture(scope="module")
def take() -> Take:
    return make_take()


def turned(take: Take) -> np.ndarray:
    """Its positions with Y up, (F, V, 3)."""
    return take.positions.astype(float) @ Z_UP_TO_Y_UP.T


def same(a: object, b: object) -> None:
    np.testing.assert_allclose(np.asarray(a, float), np.asarray(b, float), rtol=0.0, atol=CLOSE)


def test_what_faced_z_in_a_y_up_file_faces_z_again():
    """A BVH file's +Z comes in as -Y (`motions.conventions`), and must go out as +Z; its Y comes in as Z."""
    found = moving_mesh.y_up(np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], np.float32))
    assert found.tolist() == [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]


def test_obj_with_its_caches_and_material(take: Take, tmp_path: Path):
    files = take.export(tmp_path / "walk.obj")
    assert [f.name for f in files] == ["walk.obj", "walk.mtl", "walk_albedo.png", "walk.pc2", "walk.mdd"]
    read = trimesh.load(tmp_path / "walk.obj", process=False, maintain_order=True)
    same(read.vertices, turned(take)[0])
    assert np.array_equal(read.faces, take.triangles)
    same(read.visual.uv, take.texcoords * [1, -1] + [0, 1])
    assert read.visual.material.image.size == Image.open(tmp_path / "walk_albedo.png").size

    data = (tmp_path / "walk.pc2").read_bytes()
    magic, version, vertices, start, step, frames = struct.unpack("<12siiffi", data[:32])
    assert (magic, version, start, step) == (b"POINTCACHE2\0", 1, 0.0, 1.0)
    same(np.frombuffer(data[32:], "<f4").reshape(frames, vertices, 3), turned(take))

    data = (tmp_path / "walk.mdd").read_bytes()
    frames, vertices = struct.unpack(">ii", data[:8])
    same(np.frombuffer(data[8 : 8 + 4 * frames], ">f4"), np.arange(FRAMES) / FPS)
    same(np.frombuffer(data[8 + 4 * frames :], ">f4").reshape(frames, vertices, 3), turned(take))


def test_an_image_of_ones_own_is_exported(take: Take):
    assert take.cloth is not None
    image = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
    worn = replace(take, cloth=replace(take.cloth, textures=Textures(image)))
    assert np.array_equal(moving_mesh.moving_mesh(worn).texture, image)
    assert not np.array_equal(moving_mesh.moving_mesh(take).texture, image)


@pytest.mark.parametrize("suffix", ["pc2", "mdd"])
def test_a_cache_comes_with_its_mesh(take: Take, suffix: str, tmp_path: Path):
    names = [file.name for file in take.export(tmp_path / f"walk.{suffix}")]
    assert names == [f"walk.{suffix}", "walk.obj", "walk.mtl", "walk_albedo.png"]
    assert sorted(names) == sorted(file.name for file in tmp_path.iterdir())


def test_ply_frame_by_frame(take: Take, tmp_path: Path):
    files = take.export(tmp_path / "walk.ply")
    assert [f.name for f in files] == [f"walk_{frame:04}.ply" for frame in range(FRAMES)]
    for frame, file in enumerate(files):
        read = trimesh.load(file, process=False)
        same(read.vertices, take.positions[frame])
        assert np.array_equal(read.faces, take.triangles)
    assert f"frame 3 of {FRAMES}, at {3 / FPS:.6f} s".encode() in files[3].read_bytes()


def test_frames_of_another_export_are_told(take: Take, tmp_path: Path):
    take.export(tmp_path / "walk.ply")
    (tmp_path / "walk_a.ply").touch()
    with pytest.warns(UserWarning, match=r"4 more files .* walk_0003.ply to walk_0006.ply"):
        files = take.part(0, 3).export(tmp_path / "walk.ply")
    assert [file.name for file in files] == ["walk_0000.ply", "walk_0001.ply", "walk_0002.ply"]
    # They are told of, not taken away.
    names = sorted(file.name for file in tmp_path.glob("walk_0*.ply"))
    assert names == [f"walk_{frame:04}.ply" for frame in range(FRAMES)]


def test_a_rate_is_told_without_the_digits_that_rounding_leaves():
    """Times of 60 frames a second make 59.99999999999999 of it, which whoever keeps whole numbers takes for 59."""
    whole = make_take(280)
    for rate, start in ((60.0, 0.0), (60.0, 100.0), (29.97, 0.0), (24.0, 7.3), (30000 / 1001, 0.0), (59.99999, 0.0)):
        times = start + np.arange(280) / rate
        told = moving_mesh.moving_mesh(replace(whole, bones=replace(whole.bones, times=times))).fps
        assert told == (rate if rate != 30000 / 1001 else pytest.approx(rate, rel=1e-13))


class GLB:
    """A binary glTF as its specification lays it out."""

    def __init__(self, path: Path):
        data = path.read_bytes()
        magic, version, length, text_length, text = struct.unpack("<4sIII4s", data[:20])
        assert (magic, version, length, text) == (b"glTF", 2, len(data), b"JSON")
        self.content = json.loads(data[20 : 20 + text_length])
        start = 20 + text_length
        size, kind = struct.unpack("<I4s", data[start : start + 8])
        assert kind == b"BIN\0"
        self.binary = data[start + 8 : start + 8 + size]

    def view(self, index: int) -> bytes:
        view = self.content["bufferViews"][index]
        return self.binary[view["byteOffset"] :][: view["byteLength"]]

    def array(self, index: int) -> np.ndarray:
        accessor = self.content["accessors"][index]
        columns = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[accessor["type"]]
        array = np.frombuffer(self.view(accessor["bufferView"]), {5126: "<f4", 5125: "<u4"}[accessor["componentType"]])
        assert len(array) == columns * accessor["count"]
        array = array.reshape(-1, columns) if columns > 1 else array
        for bound in ("min", "max"):
            if bound in accessor:
                same(getattr(array, bound)(axis=0), accessor[bound] if columns > 1 else accessor[bound][0])
        return array


def test_glb_shows_each_frame_at_its_time(take: Take, tmp_path: Path):
    assert take.export(tmp_path / "walk.glb") == (tmp_path / "walk.glb",)
    glb = GLB(tmp_path / "walk.glb")
    [mesh], [animation] = glb.content["meshes"], glb.content["animations"]
    [primitive], [sampler], [channel] = mesh["primitives"], animation["samplers"], animation["channels"]
    assert channel["target"] == {"node": 0, "path": "weights"}
    assert sampler.get("interpolation", "LINEAR") == "LINEAR"
    same(glb.array(sampler["input"]), np.arange(FRAMES) / FPS)
    weights = glb.array(sampler["output"]).reshape(FRAMES, len(primitive["targets"]))
    for name, expected in {
        "POSITION": turned(take),
        "NORMAL": vertex_normals(take.positions, take.triangles) @ Z_UP_TO_Y_UP.T,
    }.items():
        targets = np.stack([glb.array(target[name]) for target in primitive["targets"]])
        same(glb.array(primitive["attributes"][name]) + np.tensordot(weights, targets, axes=1), expected)
    assert all("min" in glb.content["accessors"][target["POSITION"]] for target in primitive["targets"])
    assert np.array_equal(glb.array(primitive["indices"]).reshape(-1, 3), take.triangles)
    same(glb.array(primitive["attributes"]["TEXCOORD_0"]), take.texcoords)
    [image] = glb.content["images"]
    (tmp_path / "albedo.png").write_bytes(glb.view(image["bufferView"]))
    drawn = np.asarray(Image.open(tmp_path / "albedo.png"))
    assert np.array_equal(drawn, moving_mesh.moving_mesh(take).texture)


def test_glb_as_trimesh_reads_it(take: Take, tmp_path: Path):
    take.export(tmp_path / "walk.glb")
    [read] = trimesh.load(tmp_path / "walk.glb", process=False).geometry.values()
    same(read.vertices, turned(take)[0])
    assert np.array_equal(read.faces, take.triangles)
    assert read.visual.material.doubleSided
    assert read.visual.material.metallicFactor == 0.0


@pytest.mark.parametrize("suffix", list(FORMATS))
def test_a_single_frame_of_unknown_cloth(suffix: str, tmp_path: Path):
    take = make_take(1)
    for file in replace(take, cloth=None).export(tmp_path / f"still{suffix}"):
        assert file.stat().st_size > 0


def test_an_export_ends_before_what_is_not_finite(take: Take, tmp_path: Path):
    positions = take.positions.copy()
    positions[4:] = np.nan
    with pytest.warns(UserWarning, match="ends at frame 3 of 6: positions aren't finite from frame 4"):
        assert len(replace(take, positions=positions).export(tmp_path / "a.ply")) == 4
    with pytest.raises(ValueRangeError, match="nothing to export: the first frame of 'a take' isn't finite"):
        replace(take, positions=np.full_like(positions, np.inf)).export(tmp_path / "b.ply")
    with pytest.raises(ValueRangeError, match="has no triangle"):
        replace(take, triangles=take.triangles[:0]).export(tmp_path / "b.ply")


def test_formats_and_packages_that_are_not_there(take: Take, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(UnknownNameError, match=r"no format of exports named '\.fbx'; available: \.usd, .*\.ply"):
        take.export(tmp_path / "walk.fbx")
    with pytest.raises(UnknownNameError, match=r"take\.save write recordings"):
        take.export(tmp_path / "walk.rrd")
    with pytest.raises(FileError, match="can't write"):
        take.export(tmp_path / "nowhere" / "walk.obj")
    monkeypatch.setattr(sys, "path", [])
    for module, suffix, package in (("pxr", "usd", "usd-core"), ("pygltflib", "glb", "pygltflib")):
        monkeypatch.delitem(sys.modules, module, raising=False)
        with pytest.raises(UserError, match=f"pip install {package} "):
            take.export(tmp_path / f"walk.{suffix}")
    assert not list(tmp_path.iterdir())


def test_a_glb_has_its_largest_size(take: Take, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("cape.exports.glb.LARGEST", 1000)
    with pytest.raises(ValueRangeError, match="7 frames are too many for a GLB"):
        take.export(tmp_path / "walk.glb")


LIMITED = """
import resource, signal, sys
from tests.exports.a_take import make_take
take = make_take(150)
take.export("before.usd")  # what is imported and compiled in is there
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, resource.RLIM_INFINITY))
try:
    take.export("after.usd")
except ValueError as error:
    print(type(error).__name__, error)
"""


def test_a_file_that_cannot_be_written_in_full_ends_in_a_line(tmp_path: Path):
    done = subprocess.run(
        [sys.executable, "-c", LIMITED],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "FileError can't write after.usd: Error occurred writing file: File too large\n"
    assert sorted(f.name for f in tmp_path.iterdir()) == ["after_albedo.png", "before.usd", "before_albedo.png"]
