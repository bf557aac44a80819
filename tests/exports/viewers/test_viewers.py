"""Exports opened and drawn by Blender, and by three.js in Chromium: vertices are where the take has them."""

import json
import os
import re
import shutil
import subprocess
import threading
from dataclasses import replace
from functools import partial
from html import unescape
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from PIL import Image

import motions
from cape.exports.moving_mesh import moving_mesh
from cape.exports.skinned import glb
from cape.results.take import Take
from tests.characters.builder import character
from tests.exports.a_figure import placed
from tests.exports.a_take import FPS, FRAMES
from tests.exports.test_figure import take_of
from tests.exports.test_skinned import waving

pytestmark = pytest.mark.extra

HERE = Path(__file__).parent
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
BLENDER = Path(os.environ.get("CAPE_BLENDER", CACHE / "cape-blender" / "bin" / "python"))
THREE = Path(os.environ.get("CAPE_THREE", CACHE / "cape-viewer" / "node_modules" / "three"))
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
FLAGS = ("--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--dump-dom",
         "--virtual-time-budget=60000")  # fmt: skip
WITHIN = 1e-5  # m
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # from Y up
JOINTS = 6


class Export(NamedTuple):
    """A file, the name of a mesh in it, frames per second, and where its vertices are to be, Z up [m] (F, V, 3)."""

    path: Path
    mesh: str
    fps: float
    expected: np.ndarray


@pytest.fixture(
    scope="module", params=["morph.glb", "joints.glb", "a.usd", "a.pc2", "a.mdd", "figure.glb", "figure.usd"]
)
def export(request: pytest.FixtureRequest, tmp_path_factory) -> Export:
    take, path = waving(), tmp_path_factory.mktemp("export") / request.param
    if request.param == "joints.glb":
        skin = glb.write(moving_mesh(take), path, joints=JOINTS, held=take.held)
        return Export(path, "cape", FPS, skin.positions())
    if path.stem == "figure":
        figure(path.with_name("hero.glb")).keep(path.with_name("take.npz"))
        take = Take.load(path.with_name("take.npz"))
        take.export(path)
        assert take.bones.skin is not None
        return Export(path, "Body", take.bones.fps, placed(take.bones, take.bones.skin.pieces[0]))
    take.export(path)
    return Export(path, "cape", FPS, take.positions)


def figure(path: Path) -> Take:
    """A take of a small cloth, and of a walking character whose mesh swells and leans by two morph targets."""
    clip = motions.load(character(path, frames=FRAMES))
    assert clip.skin is not None
    (piece,) = clip.skin.pieces
    assert piece.normals is not None
    swells, leans = 0.04 * piece.normals, 0.3 * piece.vertices[:, [1]] * [0.0, 0.0, 1.0]
    piece = replace(piece, targets=np.stack([swells, leans]), target_morphs=np.array([1, 0]))
    times = np.arange(clip.frames) / (clip.frames - 1.0)
    morphs = np.stack([1.0 - times**2, np.sin(3.0 * times)], axis=1)
    return take_of(replace(clip, skin=replace(clip.skin, pieces=(piece,)), morphs=morphs))


def test_blender(export: Export, tmp_path: Path):
    path, mesh, fps, expected = export
    if not BLENDER.is_file():
        pytest.skip(f"needs Blender: python3.11 -m venv {BLENDER.parents[1]} && {BLENDER} -m pip install bpy")
    command = [BLENDER, HERE / "in_blender.py", path, mesh, str(fps), str(FRAMES), tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert (tmp_path / "told.json").is_file(), done.stdout[-2000:] + done.stderr[-2000:]
    assert np.abs(np.array(json.loads((tmp_path / "told.json").read_text())) - expected).max() < WITHIN
    opaque = np.asarray(Image.open(tmp_path / "drawn.png"))[..., 3] > 128
    assert 0.05 < opaque.mean() < 0.95


class Served(SimpleHTTPRequestHandler):
    """The page, three.js and one file."""

    def __init__(self, file: Path, *arguments):
        self.file = file
        super().__init__(*arguments)

    def translate_path(self, path: str) -> str:
        path = path.partition("?")[0]
        if path.startswith("/three/"):
            return str(THREE / path.removeprefix("/three/"))
        return str(self.file if path == "/file.glb" else HERE / "page.html")

    def log_message(self, format: str, *arguments: object) -> None:
        pass


def test_three_in_chromium(export: Export):
    path, mesh, fps, expected = export
    if path.suffix != ".glb":
        pytest.skip("three.js reads GLB")
    if CHROMIUM is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    if not THREE.is_dir():
        pytest.skip(f"needs three.js: npm install --prefix {THREE.parents[1]} three")
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Served, path)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        times = ",".join(f"{frame / fps:.9f}" for frame in range(FRAMES))
        address = f"http://127.0.0.1:{server.server_address[1]}/?mesh={mesh}&times={times}"
        done = subprocess.run([CHROMIUM, *FLAGS, address], capture_output=True, text=True, timeout=300)
        server.shutdown()
    found = re.search(r'<pre id="told">(.+?)</pre>', done.stdout, re.DOTALL)
    assert found is not None, done.stderr[-2000:]
    told = json.loads(unescape(found[1]))
    assert np.abs(np.array(told["frames"]) @ Z_UP.T - expected).max() < WITHIN
    assert 0.05 < told["drawn"] < 0.95
