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
    "tests/commands/test_cli.py",
    "tests/commands/test_words.py",
)
"""Tests of every dependency that need no extra."""
COMMAND = """#!{python}
from cape.cli import main

main()
"""
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
    command = python.with_name("cape")
    command.write_text(COMMAND.format(python=python))
    command.chmod(0o755)
    done = subprocess.run(
        [python, "-m", "pytest", *TRIED, "-q", "-n", "2", "-p", "no:cacheprovider"],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:]
