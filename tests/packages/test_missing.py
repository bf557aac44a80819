"""Without Pinocchio, robots' data and Rerun: what works all the same, and what says in one line what to install."""

import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import cape
from skeleton import known_robots
from tests.characters.builder import body, character
from tests.support.processes import ROOT

MODULES = ("pinocchio", "coal", "rerun", "rerun_cli", "pink")
PACKAGES = ("pin", "example-robot-data", "rerun-sdk")
SMALL = ("--end", "0.05", "--spacing", "0.08", "--no-self-contact")
MOST_MEGABYTES = 500


def without(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the command where the modules can't be imported."""
    code = f"import sys; sys.modules.update(dict.fromkeys({MODULES})); from cape.cli import main; main()"
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


def test_clips_and_characters_are_simulated_kept_and_exported_without(tmp_path):
    character(tmp_path / "hero.glb", body(), frames=4)
    done = without("replay", "hero.glb", *SMALL, "--hitboxes", "body", "--json", "-o", "hero.npz", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["result"] == "finished"
    assert len(cape.Take.load(tmp_path / "hero.npz").positions) == 4
    done = without("replay", "walk", *SMALL, "-o", "walk.obj", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "walk.obj").exists()


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (("replay", "walk"), "a recording needs Rerun: pip install 'rerun-sdk>=0.41,<0.42' (-o NAME.npz"),
        (("render", "walk"), "a picture needs Rerun: pip install 'rerun-sdk>=0.41,<0.42'"),
        (("replay", "walk", "--skeleton", "g1", "-o", "a.npz"), "a robot needs Pinocchio: pip install pin"),
    ],
)
def test_what_needs_them_says_what_to_install(tmp_path, asked, told):
    done = without(*asked, folder=tmp_path)
    assert done.returncode == 2
    assert told in done.stderr
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_robots_of_ones_own_do_without_the_data_of_others(monkeypatch, tmp_path):
    def absent(name: str) -> None:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(known_robots.importlib.metadata, "distribution", absent)
    with pytest.raises(known_robots.MissingPackageError, match="pip install example-robot-data"):
        known_robots.find_urdf("g1")
    own = tmp_path / "own.urdf"
    own.write_text("<robot name='own'/>")
    assert known_robots.find_urdf(own) == own
    assert str(tmp_path.resolve()) in known_robots.package_folders(own)


def test_platforms_without_their_wheels_are_marked():
    text = (ROOT / "pyproject.toml").read_text()
    for package in ("pin", "example-robot-data", "pin-pink"):
        assert re.search(rf"\"{package}>=[\d.]+; platform_system != 'Windows'\"", text), package


def installed(folder: Path) -> Path:
    """An environment with all that the project needs but the three; gives its command."""
    every = [line for line in importlib.metadata.requires("cape") or [] if "extra ==" not in line]
    needed = [line.split(";")[0] for line in every if not re.match(r"(pin|example-robot-data|rerun-sdk)\b(?!-)", line)]
    assert len(needed) == len(every) - 3
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    pip = [str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet", "--no-compile"]
    copy = folder / "source"
    shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".git", ".venv", "tests", "__pycache__", "*.egg-info"))
    subprocess.run([*pip, *needed], check=True)
    subprocess.run([*pip, "--no-deps", str(copy)], check=True)
    shutil.rmtree(copy)
    return folder / "bin" / "cape"


@pytest.mark.extra
def test_an_environment_without_them_is_small_and_works(tmp_path):
    command = installed(tmp_path / "lean")
    found = subprocess.run([tmp_path / "lean/bin/pip", "list"], capture_output=True, text=True, check=True).stdout
    assert not re.search(rf"^({'|'.join(PACKAGES)}) ", found, re.MULTILINE)
    size = sum(p.stat().st_size for p in (tmp_path / "lean").rglob("*") if p.is_file() and not p.is_symlink())
    assert size < 1e6 * MOST_MEGABYTES
    print(f"{size / 1e6:.0f} MB")
    character(tmp_path / "hero.glb", body(), frames=4)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([command, *arguments], cwd=tmp_path, env=environment, capture_output=True, text=True)

    for name in ("hero.glb", "walk"):
        done = run("replay", name, *SMALL, "-o", f"{Path(name).stem}.npz")
        assert done.returncode == 0, done.stderr
        done = run("export", f"{Path(name).stem}.npz", "-o", f"{Path(name).stem}.ply")
        assert done.returncode == 0, done.stderr
    for asked, told in (
        (("replay", "walk"), "pip install 'rerun-sdk"),
        (("info", "g1"), "pip install pin"),
    ):
        done = run(*asked)
        assert done.returncode == 2
        assert told in done.stderr
    doctor = run("doctor")
    assert doctor.returncode == 1
    for package in PACKAGES:
        assert f"lacks {package}" in doctor.stdout
