"""Every example in the README runs as it stands there."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import motions

README = Path(__file__).parents[1] / "README.md"
EXAMPLES = re.findall(r"^```python\n(.*?)^```$", README.read_text(), flags=re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_example_runs(number, tmp_path):
    shutil.copy(motions.clip_path("walk"), tmp_path / "walk.bvh")
    done = subprocess.run([sys.executable, "-c", EXAMPLES[number]], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    assert (tmp_path / "walk.rrd").exists() == ("walk.rrd" in EXAMPLES[number])


def test_commands_in_the_readme_exist():
    text = README.read_text()
    commands = set(re.findall(r"^\$ cape (\w+)", text, flags=re.MULTILINE))
    known = subprocess.run(
        [Path(sys.executable).with_name("cape"), "--help"], capture_output=True, text=True, check=True
    ).stdout
    assert commands
    assert all(re.search(rf"\b{command}\b", known) for command in commands)
