"""What Blender makes of a character and writes again, also by way of FBX, is the same character."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import motions
from motions.errors import FileError
from tests.characters.builder import body, character
from tests.characters.test_reading import drawn

AGAIN = """
import bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath="hero.glb")
bpy.ops.export_scene.gltf(filepath="again.glb")
bpy.ops.export_scene.fbx(filepath="hero.fbx", bake_anim=True)
"""


def blender(code: str, folder: Path) -> None:
    """Run code in Blender, the program or the package."""
    if (program := shutil.which("blender")) is not None:
        command = [program, "-b", "--python-expr", code]
    elif subprocess.run([sys.executable, "-c", "import bpy"], capture_output=True).returncode == 0:
        command = [sys.executable, "-c", code]
    else:
        pytest.skip("Blender is missing: pip install bpy")
    subprocess.run(command, cwd=folder, check=True, capture_output=True)


@pytest.mark.extra
def test_blender_gives_the_same_back(tmp_path):
    hero = character(tmp_path / "hero.glb", body(), frames=61)
    blender(AGAIN, tmp_path)
    with pytest.raises(FileError) as told:
        motions.load(tmp_path / "hero.fbx")
    code = re.search(r'--python-expr "(.*)"', str(told.value))
    assert code is not None
    blender(code[1].replace("IN.fbx", "hero.fbx").replace("OUT.glb", "by_fbx.glb"), tmp_path)
    first = drawn(motions.load(hero))[0]
    for name in ("again.glb", "by_fbx.glb"):
        other = drawn(motions.load(tmp_path / name))[0]
        # Blender sorts vertices by its own lights.
        apart = np.linalg.norm(first[:, None] - other[None], axis=2)
        assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1e-5
