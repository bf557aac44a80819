"""Exports opened and drawn by Blender, and by three.js in Chromium: vertices are where the take has them."""

import json
import os
import re
import shutil
import subprocess
import threading
from functools import partial
from html import unescape
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cape.exports.moving_mesh import moving_mesh
from cape.exports.skinned import glb
from tests.exports.a_take import FPS, FRAMES
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


@pytest.fixture(scope="module", params=["morph.glb", "joints.glb", "a.usd", "a.pc2", "a.mdd"])
def export(request: pytest.FixtureRequest, tmp_path_factory) -> tuple[Path, np.ndarray]:
    """A file, and where its vertices are to be, Z up [m], shape (F, V, 3)."""
    take, path = waving(), tmp_path_factory.mktemp("export") / request.param
    if request.param == "joints.glb":
        return path, glb.write(moving_mesh(take), path, joints=JOINTS, held=take.held).positions()
    take.export(path)
    return path, take.positions


def test_blender(export: tuple[Path, np.ndarray], tmp_path: Path):
    path, expected = export
    if not BLENDER.is_file():
        pytest.skip(f"needs Blender: python3.11 -m venv {BLENDER.parents[1]} && {BLENDER} -m pip install bpy")
    command = [BLENDER, HERE / "in_blender.py", path, str(FPS), str(FRAMES), tmp_path]
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


def test_three_in_chromium(export: tuple[Path, np.ndarray]):
    path, expected = export
    if path.suffix != ".glb":
        pytest.skip("three.js reads GLB")
    if CHROMIUM is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    if not THREE.is_dir():
        pytest.skip(f"needs three.js: npm install --prefix {THREE.parents[1]} three")
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Served, path)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        times = ",".join(f"{frame / FPS:.9f}" for frame in range(FRAMES))
        address = f"http://127.0.0.1:{server.server_address[1]}/?times={times}"
        done = subprocess.run([CHROMIUM, *FLAGS, address], capture_output=True, text=True, timeout=300)
        server.shutdown()
    found = re.search(r'<pre id="told">(.+?)</pre>', done.stdout, re.DOTALL)
    assert found is not None, done.stderr[-2000:]
    told = json.loads(unescape(found[1]))
    assert np.abs(np.array(told["frames"]) @ Z_UP.T - expected).max() < WITHIN
    assert 0.05 < told["drawn"] < 0.95
