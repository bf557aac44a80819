"""The add-on, handed out by the installed command, in a real Blender without a window."""

import ast
import json
import os
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import motions
from cape.addon.install import ADDON
from skeleton import Skeleton
from tests.support.command import CAPE, Forks, cape
from tests.support.processes import mistake_told

BLENDER = Path(os.environ.get("CAPE_BLENDER", Path.home() / ".cache" / "cape-blender" / "bin" / "python"))
GET = f"python3.11 -m venv {BLENDER.parents[1]} && {BLENDER} -m pip install bpy"
OLD_GET = "apt-get install blender"
HERE = Path(__file__).parent
WITHIN = 1e-5  # m


def test_the_add_on_is_handed_out_with_the_command_that_it_is_to_call(forks: Forks, tmp_path: Path):
    done = forks("addon", "-o", "hang.py", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "hang.py").read_text()
    assert f"\nCOMMAND = {str(CAPE)!r}\n" in text
    names = {node.id for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Name)}
    assert {"bl_info", "bpy", "COMMAND"} <= names
    assert "SPDX-License-Identifier: MIT" in text
    assert text.replace(repr(str(CAPE)), '"cape"') == ADDON.read_text()
    assert "hang.py" in done.stdout
    assert "named *.py" in mistake_told(forks("addon", "-o", "hang.zip", folder=tmp_path))[1]


@pytest.fixture(scope="module", params=["package", "program"])
def blender(request: pytest.FixtureRequest, tmp_path_factory) -> tuple[Path, dict]:
    """The folder of what was made in Blender, and what it told: the newest there is, and the system's, often old."""
    begin: list[str | Path] = [BLENDER, HERE / "in_blender.py"]
    if request.param == "program":
        begin = ["blender", "--background", "--factory-startup", "--python", HERE / "in_blender.py", "--"]
        if shutil.which("blender") is None:
            pytest.skip(f"needs Blender: {OLD_GET}")
    elif not BLENDER.is_file():
        pytest.skip(f"needs Blender as a package: {GET}")
    folder = tmp_path_factory.mktemp("blender")
    assert cape("addon", folder=folder).returncode == 0
    done = subprocess.run(
        [*begin, folder / "cape_blender.py", motions.clip_path("walk"), folder],
        cwd=folder,
        env={**os.environ, "BLENDER_USER_RESOURCES": str(folder / "user")},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert (folder / "told.json").is_file(), done.stdout[-2000:] + done.stderr[-2000:]
    return folder, json.loads((folder / "told.json").read_text())


def cached(path: Path) -> np.ndarray:
    """The vertices that a PC2 holds, turned to Z up [m], shape (F, V, 3)."""
    data = path.read_bytes()
    _, _, vertices, _, _, frames = struct.unpack("<12siiffi", data[:32])
    places = np.frombuffer(data[32:], "<f4").reshape(frames, vertices, 3)
    return np.stack([places[..., 0], -places[..., 2], places[..., 1]], axis=-1)


@pytest.mark.extra
@pytest.mark.parametrize("name", ["turned", "fbx"])
def test_bones_and_cloth_are_in_blender_where_they_were_simulated(name: str, blender: tuple[Path, dict]):
    """From a BVH in centimetres, of an armature that is scaled, turned and moved; and through an FBX."""
    folder, told = blender
    found = told[name]
    assert found["first"] == 3.0
    assert found["images"][0] > 100
    [clip], [cache] = (list((folder / name).glob(f"*.{suffix}")) for suffix in ("bvh", "pc2"))
    motion = motions.load(clip, unit="m", up="z")
    track, cloth = Skeleton.from_clip(motion).track(motion), cached(cache)
    assert motion.frames == len(cloth) == 12
    for frame, seen in found["places"].items():
        at = int(frame) - 3
        for bone, head in seen["heads"].items():
            assert np.abs(track.positions[at, track.index(bone)] - head).max() < WITHIN
        assert np.abs(cloth[at] - seen["vertices"]).max() < WITHIN
        neck = np.array(next(head for bone, head in seen["heads"].items() if bone.endswith("Neck")))
        assert np.linalg.norm(cloth[at] - neck, axis=1).min() < 0.2
    assert np.ptp(cloth, axis=0).max() > 0.05


@pytest.mark.extra
def test_what_blender_draws_has_the_cape_in_it(blender: tuple[Path, dict]):
    picture = np.asarray(Image.open(blender[0] / "drawn.png").convert("RGB")).astype(int)
    red = (picture[..., 0] > 2 * picture[..., 1]) & (picture[..., 0] > 60)
    assert red.mean() > 0.02


@pytest.mark.extra
def test_what_cape_refuses_is_told(blender: tuple[Path, dict]):
    assert "no garment named 'toga'" in blender[1]["unknown"]["error"]


@pytest.mark.extra
def test_the_preview_comes_before_the_action(blender: tuple[Path, dict]):
    told = blender[1]
    assert told["range"] == list(range(3, 15))
    assert told["ranges"] == [280, 5]


@pytest.mark.extra
def test_bones_without_parents_get_one_and_what_moves_is_moved(blender: tuple[Path, dict]):
    clip = motions.load(blender[0] / "pair.bvh", unit="m", up="z", keep_first_frame=True)
    track = Skeleton.from_clip(clip).track(clip)
    assert clip.joints == ("armature", "a_-1", "a_+1")
    left, right = (track.positions[:, track.index(name)] for name in clip.joints[1:])
    assert np.abs(left - (-1.0, 0.0, 1.0)).max() < WITHIN
    assert np.abs(right[0] - (1.0, 0.0, 1.0)).max() < WITHIN
    assert np.abs(right[-1] - (1.0, 0.2, 1.0)).max() < WITHIN
