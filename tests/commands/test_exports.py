"""`cape export`, and what `cape replay` writes besides recordings."""

import json
from pathlib import Path

import cape
from cape.cli.exports.writing import write
from tests.exports.a_take import FPS, FRAMES, make_take
from tests.support.command import Forks


def test_export_by_command(forks: Forks, tmp_path: Path):
    make_take().keep(tmp_path / "walk.npz")
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
