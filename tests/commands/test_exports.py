"""`cape export`, and what `cape replay` writes besides recordings."""

import json
import os
from contextlib import nullcontext
from pathlib import Path

import pygltflib
import pytest
import trimesh
from PIL import Image

import cape
import motions
from cape.cli.exports.writing import begun, write
from cape.cli.staging import Staged
from cape.exports import FORMATS, glb, may_write
from cape.results import take_file
from cape.results.take import Take
from motions.errors import FileError, UserError, ValueRangeError
from tests.characters.builder import character
from tests.exports.a_figure import make_figure
from tests.exports.a_take import FPS, FRAMES, make_take
from tests.support.command import Forks


def test_export_by_command(forks: Forks, tmp_path: Path):
    make_take().keep(tmp_path / "walk.npz")
    (tmp_path / "walk.bvh").touch()
    done = forks("export", "walk.npz", "-o", "out.obj", "--json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert (told["frames"], told["fps"], told["vertices"], told["format"]) == (FRAMES, FPS, 30, "OBJ, PC2 and MDD")
    assert told["files"] == ["out.obj", "out.mtl", "out_albedo.png", "out.pc2", "out.mdd"]
    assert all((tmp_path / name).is_file() for name in told["files"])
    done = forks("export", "walk.npz", "-o", "out.ply", folder=tmp_path)
    assert f"to, {FRAMES} in all" in done.stdout
    assert f"out_{FRAMES - 1:04}.ply" in done.stdout
    done = forks("export", "walk.npz", "-o", "out.rrd", "--json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["format"] == "recording"
    assert (tmp_path / "out.rrd").read_bytes().startswith(b"RRF2")
    for arguments, text in {
        ("walk.npz", "-o", "out.abc"): "no format of exports named '.abc'",
        ("walk.rrd", "-o", "out.obj"): "is a recording",
        ("walk.bvh", "-o", "out.obj"): "is a motion, not a kept take: cape replay walk.bvh -o walk.npz",
        ("walk", "-o", "out.obj"): "is a motion, not a kept take: cape replay walk -o out.obj",
        ("gone.bvh", "-o", "out.obj"): "No such file",
        ("walk.npz", "-o", "no/out.obj"): "there is no folder",
        ("walk.npz", "-o", "out.rrd", "--joints", "4"): "joints are for binary glTF (.glb), not for recordings",
    }.items():
        done = forks("export", *arguments, folder=tmp_path)
        assert done.returncode == 2
        assert text in done.stderr
        assert done.stderr.count("\n") == 1


def test_replay_keeps_and_exports_as_the_suffix_tells(forks: Forks, tmp_path: Path):
    few = ("--end", "0.05", "--spacing", "0.08", "--json")
    done = forks("replay", "walk", *few, "-o", "walk.npz", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    facts, kept = json.loads(done.stdout), cape.Take.load(tmp_path / "walk.npz")
    assert facts["output"] == "walk.npz"
    assert (facts["frames"], facts["vertices"]) == kept.positions.shape[:2]
    assert (kept.result, kept.substeps, kept.name) == (facts["result"], facts["substeps"], "walk")
    done = forks("replay", "walk", "-o", "walk.npz", "--layers", "cape", "--spawn", folder=tmp_path)
    assert done.returncode == 2
    assert "--layers and --spawn is for recordings (.rrd), not for walk.npz" in done.stderr


def test_what_is_written_goes_by_the_suffix(tmp_path: Path):
    take, as_it_is = make_take(2), {"layers": ["cape"], "surfaces": ()}
    for name, kind in {"a.npz": "take", "a.OBJ": "export", "a.rrd": "recording", "a": "recording"}.items():
        assert write(take, tmp_path / name, **as_it_is) == kind
        assert (tmp_path / name).stat().st_size > 0


def test_what_comes_beside_an_export_is_not_written_over_what_is_read(forks: Forks, tmp_path: Path):
    sheet = trimesh.creation.box((0.6, 0.01, 0.8))
    sheet.export(tmp_path / "coat.obj")
    character(tmp_path / "hero.glb")
    Image.new("RGB", (2, 2)).save(tmp_path / "hero_albedo.png")
    read = pygltflib.GLTF2().load(str(tmp_path / "hero.glb"))
    assert read is not None
    read.convert_buffers(pygltflib.BufferFormat.DATAURI)
    read.images = [pygltflib.Image(uri="hero_albedo.png")]
    read.save(str(tmp_path / "hero.gltf"))
    for name in ("skin_0012.ply", "cut.mtl"):
        (tmp_path / name).touch()
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    for arguments, file in {
        ("walk", "--cloth", "coat.obj", "-o", "coat.pc2"): "coat.obj",
        ("walk", "--cloth", "coat.obj", "-o", "Coat.mdd"): "coat.obj",
        ("walk", "--cloth-visual", "skin_0012.ply", "--cloth", "coat.obj", "-o", "skin.ply"): "skin_0012.ply",
        ("walk", "--texture", "hero_albedo.png", "-o", "hero.obj"): "hero_albedo.png",
        ("hero.gltf", "-o", "hero.usd"): "hero_albedo.png",
        ("hero.glb", "--animation", "hero.gltf", "-o", "hero.usdc"): "hero_albedo.png",
    }.items():
        done = forks("replay", *arguments, folder=tmp_path)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
        assert f"{file}, which is read, would be written over" in done.stderr
    done = forks("replay", "--script", "hero.glb 1s, walk", "-o", "hero.glb", folder=tmp_path)
    assert "it is what is read" in done.stderr
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_files_that_do_not_collide_are_no_hindrance():
    for path, names in {
        "walk.usd": ("walk.png", "walk_albedo.bmp", "walks_albedo.png", "walk.obj"),
        "walk.obj": ("walk_Body.png", "walk.glb"),
        "walk.pc2": ("walk.mdd",),
        "walk.glb": ("walk_albedo.png", "walk.bvh"),
        "walk.ply": ("walk_12.ply", "walk_0012.obj"),
        "walk.rrd": ("walk_albedo.png",),
    }.items():
        assert not any(may_write(path, name) for name in names)


def test_every_file_of_an_export_is_among_those_that_it_may_write(tmp_path: Path):
    for number, suffix in enumerate(FORMATS):
        path = tmp_path / str(number) / f"a b{suffix}"
        path.parent.mkdir()
        made = make_figure(2).export(path)
        assert sorted(made) == sorted(path.parent.iterdir())
        assert all(may_write(path, file.name) for file in made)


@pytest.fixture
def who() -> Staged:
    take = make_take()
    assert take.cloth is not None
    scene = cape.Scene(take.cloth, attachments=[cape.attach(take.cloth, "hip", [0])])
    return Staged("walk", take.bones, scene, (), None, None, ())


@pytest.mark.parametrize("name", ["long.npz", "long.glb"])
def test_what_no_file_can_hold_is_told_before_it_is_simulated(
    name: str, who: Staged, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    frames, vertices = who.track.frames, who.scene.cloth.vertices
    for spare in (0, -1):
        monkeypatch.setattr(take_file, "LARGEST_FILE", take_file.ROOM + 12 * frames * vertices + spare)
        monkeypatch.setattr(glb, "LARGEST", frames * (24 * vertices + 4 * frames) + spare)
        refused = pytest.raises(ValueRangeError) if spare else nullcontext()
        with refused, begun(tmp_path / name, who, loop=False, layers=None):
            pass
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("name", "error"), [("full.npz", ValueRangeError), ("full.usd", FileError)])
def test_a_run_whose_end_finds_no_room_keeps_what_fits(
    name: str, error: type[UserError], who: Staged, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    """A disk that others have filled meanwhile, or what a take holds besides its positions."""
    of = "keep" if name.endswith("npz") else "export"
    whole = getattr(Take, of)

    def crowded(take: Take, path: Path) -> None:
        if len(take.positions) > 3:
            raise error("no room")
        whole(take, path)

    monkeypatch.setattr(Take, of, crowded)
    with begun(tmp_path / name, who, loop=False, layers=None) as output:
        output.finish(make_take())
    assert output.full() == f"the first 3 of {FRAMES} frames are written, more did not fit"
    if of == "keep":
        assert len(Take.load(tmp_path / name).positions) == 3
    with begun(tmp_path / name, who, loop=False, layers=None) as output:
        output.finish(make_take(3))
    assert output.full() is None


def test_files_whose_names_are_no_text_are_read_and_written(forks: Forks, tmp_path: Path):
    """As archives of other systems leave them: in Latin-1, whose bytes Python has as characters that no file holds."""
    name = os.fsdecode(b"w\xe4lk")
    motions.save(motions.load("walk").trim(0.0, 0.05), tmp_path / f"{name}.bvh")
    few = (f"{name}.bvh", "--garment", "back_cape", "--spacing", "0.1")
    for output in ("a.rrd", "a.npz", "a.usd", "a.glb", f"{name}.obj", f"{name}.npz"):
        done = forks("replay", *few, "-o", output, folder=tmp_path)
        assert done.returncode == 0, done.stderr
        assert (tmp_path / output).is_file()
    assert cape.Take.load(tmp_path / "a.npz").name == "w\ufffdlk"
    assert b"mtllib w\xe4lk.mtl\n" in (tmp_path / f"{name}.obj").read_bytes()
    done = forks("batch", *few, "--format", "npz", "-o", name, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    for output in (f"{name}.usd", f"{name}.rrd"):
        done = forks("replay", *few, "-o", output, folder=tmp_path)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert "is no text (UTF-8)" in done.stderr
