"""Every example in the README, and every script that it names, runs as it stands there."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import motions

README = Path(__file__).parents[1] / "README.md"
EXAMPLES = re.findall(r"^```python\n(.*?)^```$", README.read_text(), flags=re.DOTALL | re.MULTILINE)
SCRIPTS = sorted((README.parent / "tests" / "examples").glob("[!_]*.py"))


def outcome(example: str, folder: Path) -> tuple[int, bool, bool]:
    """The status of an example, and if it printed anything and made a recording; its errors are printed."""
    shutil.copy(motions.clip_path("walk"), folder / "walk.bvh")
    done = subprocess.run([sys.executable, "-c", example], cwd=folder, capture_output=True, text=True)
    print(done.stderr)
    return done.returncode, bool(done.stdout.strip()), (folder / "walk.rrd").exists()


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_example_runs(number, tmp_path):
    assert outcome(EXAMPLES[number], tmp_path) == (0, True, "walk.rrd" in EXAMPLES[number])


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_script_runs_and_is_named(script: Path, tmp_path: Path):
    example = script.read_text()
    assert outcome(example, tmp_path) == (0, True, "walk.rrd" in example)
    assert f"(tests/examples/{script.name})" in README.read_text()


def test_commands_in_the_readme_exist():
    text = README.read_text()
    commands = set(re.findall(r"^\$ cape (\w+)", text, flags=re.MULTILINE))
    known = subprocess.run(
        [Path(sys.executable).with_name("cape"), "--help"], capture_output=True, text=True, check=True
    ).stdout
    assert commands
    assert all(re.search(rf"\b{command}\b", known) for command in commands)
