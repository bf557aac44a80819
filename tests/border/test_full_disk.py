"""A disk that is full, or a file that may not grow: one line, status 2, and nothing that was there is lost."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from cape.cli import _cut_short
from tests.support.command import CAPE, cape

LITTLE = 3000  # bytes

SHORT = ("idle", "--end", "0.1", "--garment", "back_cape", "--spacing", "0.1")
SOON = {
    "a scene file": ("scene", "init", "-o", "new.toml"),
    "a kept take, before it is simulated": ("replay", *SHORT, "-o", "out.npz"),
}
LATER = {
    "a recording": ("replay", *SHORT, "-o", "out.rrd"),
    "hitboxes": ("hitboxes", "walk", "--bare", "--write", "out.toml"),
    "a kept take that is exported": ("export", "take.npz", "-o", "out.glb"),
    "a layer of it": ("export", "take.npz", "-o", "out.usda"),
    "point caches": ("export", "take.npz", "-o", "out.pc2"),
    "a mesh for each frame": ("export", "take.npz", "-o", "out.ply"),
    "textures": ("fabrics", "--write", "fabrics"),
}


def refused(arguments: tuple[str, ...], folder: Path) -> str:
    """What a command says that may write no more than `LITTLE`; what is there stays, and nothing new is left."""
    (folder / "out.toml").write_text("what was there")
    before = {path: path.read_bytes() for path in folder.iterdir()}
    done = subprocess.run(
        [CAPE, *arguments],
        cwd=folder,
        # Python does not notice that its own compiled files are cut short.
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (LITTLE, LITTLE)),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2, done.stderr
    *_, told = done.stderr.splitlines()
    assert "Traceback" not in done.stderr
    assert {path: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before
    return told


@pytest.mark.parametrize("what", SOON)
def test_it_is_told_in_a_line(what: str, tmp_path: Path):
    assert refused(SOON[what], tmp_path).startswith("cape: can't write ")


@pytest.mark.extra
@pytest.mark.parametrize("what", LATER)
def test_so_it_is_of_all_else_that_is_written(what: str, tmp_path: Path):
    if "take.npz" in LATER[what]:
        assert cape("replay", *SHORT, "-o", "take.npz", folder=tmp_path).returncode == 0
    assert refused(LATER[what], tmp_path).startswith("cape: can't write ")


def test_a_file_of_python_that_a_full_disk_has_cut_short_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "cut_module.py").write_text("VALUE = [" + "1, " * 1000 + "]")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    __import__("cut_module")
    (compiled,) = (tmp_path / "__pycache__").iterdir()
    compiled.write_bytes(compiled.read_bytes()[:60])
    del sys.modules["cut_module"]
    with pytest.raises(EOFError) as caught:
        __import__("cut_module")
    assert _cut_short(caught.value) == str(compiled)
    assert _cut_short(EOFError()) is None
