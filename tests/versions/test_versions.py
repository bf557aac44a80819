"""The lowest and the newest versions of the dependencies that `pyproject.toml` allows do what the suite's own do."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.support.processes import ROOT

pytestmark = pytest.mark.extra

TRIED = (
    "tests/border",
    "tests/motions/test_bvh.py",
    "tests/skeleton/test_capsules.py",
    "tests/skeleton/test_track.py",
    "tests/record/test_record.py",
    "tests/outfits",
)
"""Tests of every dependency that need neither an extra nor the installed command."""
LEFT_OUT = ("--ignore=tests/border/test_full_disk.py",)
TESTING = ("pytest", "pytest-xdist", "hypothesis")


def allowed() -> list[str]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]


def lowest(requirement: str) -> str:
    """Of "name>=1.2,<2; marker" the releases of 1.2, where the marker holds: "name==1.2.*; marker"."""
    found = re.fullmatch(r"([\w-]+)>=([\d.]+)(?:,[^;]*)?(;.*)?", requirement)
    assert found is not None, f"{requirement} tells no lowest version"
    return f"{found[1]}=={found[2]}.*{found[3] or ''}"


@pytest.mark.parametrize("which", ["lowest", "newest"])
def test_the_tests_pass_with_the_versions_that_are_allowed(which: str, tmp_path: Path):
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "venv"], check=True)
    python = tmp_path / "venv" / "bin" / "python"
    wanted = [lowest(each) for each in allowed()] if which == "lowest" else allowed()
    installed = subprocess.run(
        [python, "-m", "pip", "install", "-q", *wanted, *TESTING], capture_output=True, text=True, check=False
    )
    if re.search("ConnectionError|NewConnectionError|Temporary failure", installed.stderr):
        pytest.skip("there is no package index to be reached")
    assert installed.returncode == 0, installed.stderr[-2000:]
    done = subprocess.run(
        [python, "-m", "pytest", *TRIED, *LEFT_OUT, "-q", "-n", "2", "-p", "no:cacheprovider"],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:]
