"""Every example in the README and the manual, and every script that they name, runs as it stands there."""

import re
import shutil
from pathlib import Path

import pytest

import motions
from cape import manual
from tests.support.command import Forks

ROOT = Path(__file__).parents[1]
TEXTS = {path: path.read_text() for path in (ROOT / "README.md", *sorted(manual.FOLDER.glob("*.md")))}
ALL = "\n".join(TEXTS.values())
EXAMPLES = re.findall(r"^```python\n(.*?)^```$", ALL, flags=re.DOTALL | re.MULTILINE)
SCRIPTS = sorted((ROOT / "tests" / "examples").glob("[!_]*.py"))


def outcome(forks: Forks, example: str, folder: Path) -> tuple[int, bool, bool]:
    """The status of an example, and if it printed anything and made a recording; its errors are printed."""
    shutil.copy(motions.clip_path("walk"), folder / "walk.bvh")
    done = forks.script(example, folder=folder)
    print(done.stderr)
    return done.returncode, bool(done.stdout.strip()), (folder / "walk.rrd").exists()


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_example_runs(number, tmp_path, forks):
    assert outcome(forks, EXAMPLES[number], tmp_path) == (0, True, "walk.rrd" in EXAMPLES[number])


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_script_runs_and_is_named(script: Path, tmp_path: Path, forks: Forks):
    example = script.read_text()
    assert outcome(forks, example, tmp_path) == (0, True, "walk.rrd" in example)
    assert f"tests/examples/{script.name})" in ALL


def test_commands_that_are_told_exist(tmp_path: Path, forks: Forks):
    commands = set(re.findall(r"^\$ cape (\w+)", ALL, flags=re.MULTILINE))
    known = forks("--help", folder=tmp_path).stdout
    assert commands
    assert all(re.search(rf"\b{command}\b", known) for command in commands)


def test_what_is_linked_is_there():
    for path, text in TEXTS.items():
        for link in re.findall(r"\]\((?!https?:)([^)#]+)\)", text):
            assert (path.parent / link).exists(), f"{path.name}: {link}"


def test_the_manual_s_chapters_are_listed_and_printed(tmp_path: Path, forks: Forks):
    assert sorted(manual.NAMES) == [path.stem for path in TEXTS if path.parent == manual.FOLDER]
    listed = re.findall(r"^\| \[(\w+)\]\(cape/manual/\1\.md\)", TEXTS[ROOT / "README.md"], flags=re.MULTILINE)
    assert tuple(listed) == manual.NAMES
    told = forks("manual", folder=tmp_path).stdout
    assert all(name in told and manual.title(name) in told for name in manual.NAMES)
    assert forks("manual", "live", folder=tmp_path).stdout == manual.chapter("live")
    done = forks("manual", "lives", folder=tmp_path)
    assert done.returncode == 2
    assert "did you mean 'live'" in done.stderr
