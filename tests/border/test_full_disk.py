"""A disk that is full, or a file that may not grow: one line, status 2, and nothing that was there is lost."""

import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cape.cli import _cut_short, _status_of
from cape.pictures import films, stills
from cape.pictures.viewer import require_viewer
from motions.errors import FileError, UserError
from motions.files import scratch_folder
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
DRAWN = {
    "a picture": ("render", "out.rrd", "-o", "out.png"),
    "a small picture": ("render", "out.rrd", "-o", "out.jpg"),
    "a film": ("render", "out.rrd", "--film-fps", "10", "-o", "out.gif"),
    "a film that is encoded": ("render", "out.rrd", "--film-fps", "10", "-o", "out.mp4"),
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


@pytest.fixture
def little(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """No file of this process may get larger than `LITTLE`."""
    Image.init()  # what is imported later would be kept cut short
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (LITTLE, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("name", ["out.png", "out.jpg", "out.gif", "out.mp4"])
def test_pictures_and_films_are_whole_or_not_there(name: str, little: None, tmp_path: Path):
    if name.endswith(".mp4"):
        pytest.importorskip("imageio_ffmpeg", reason="pip install 'cape[film]'")
    noise = np.random.default_rng(0).integers(0, 255, (3, 64, 64, 3), dtype=np.uint8)
    pictures = map(Image.fromarray, noise)
    path = tmp_path / name
    path.write_text("what was there")
    with pytest.raises(FileError, match=rf"^can't write .*{name}: File too large$"):
        films.save(pictures, path) if path.suffix in films.SUFFIXES else stills.save(next(pictures), path)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert path.read_text() == "what was there"


def test_no_room_for_temporary_files_is_told(monkeypatch: pytest.MonkeyPatch):
    def full(prefix: str) -> str:
        raise FileNotFoundError(2, "No usable temporary directory found in ['/tmp']")

    monkeypatch.setattr("tempfile.TemporaryDirectory", full)
    with (
        pytest.raises(FileError, match=r"^can't write temporary files: No usable temp"),
        scratch_folder(),
    ):
        pass


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A recording; skips where nothing can be drawn."""
    try:
        require_viewer()
    except UserError as error:
        pytest.skip(str(error))
    folder = tmp_path_factory.mktemp("recorded")
    assert cape("replay", *SHORT, "-o", "out.rrd", folder=folder).returncode == 0
    return (folder / "out.rrd").read_bytes()


@pytest.mark.extra
@pytest.mark.parametrize("what", DRAWN)
def test_so_it_is_of_what_is_drawn(what: str, recorded: bytes, tmp_path: Path):
    (tmp_path / "out.rrd").write_bytes(recorded)
    assert refused(DRAWN[what], tmp_path).startswith("cape: can't write out.")


@pytest.mark.extra
def test_so_it_is_of_a_gallery(recorded: bytes, tmp_path: Path):
    asked = ("gallery", "-o", "pages", "--garment", "half_cape", "--clip", "idle")
    assert refused(asked, tmp_path).startswith("cape: can't write ")
    assert not list((tmp_path / "pages").iterdir())


def test_a_full_disk_that_nobody_expected_is_told_in_a_line(capsys: pytest.CaptureFixture[str]):
    assert _status_of(OSError(28, "No space left on device", "some.log")) == 2
    assert capsys.readouterr().err == "cape: can't write some.log: No space left on device\n"
    with pytest.raises(OSError, match="Not a directory"):
        _status_of(OSError(20, "Not a directory", "some.log"))


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
