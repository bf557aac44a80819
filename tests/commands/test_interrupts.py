"""Ctrl-C ends the installed command soon, wherever it is, and loses nothing that was done."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from cape.importing import is_command
from tests.support.command import CAPE
from tests.support.processes import ROOT

HOPELESS = 60.0  # s: what is not ended by then was not going to end


def begin(*arguments: str | Path, folder: Path, **environment: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [CAPE, *map(str, arguments)],
        cwd=folder,
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell that starts tests in the background has it ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


def interrupted(process: "subprocess.Popen[str]", told: str) -> tuple[str, str]:
    """Interrupt it when it has written some words on standard error; gives what it printed."""
    assert process.stderr is not None
    lines = []
    for line in process.stderr:
        lines.append(line)
        if re.search(told, line):
            break
    else:
        pytest.fail("".join(lines))
    process.send_signal(signal.SIGINT)
    out, rest = process.communicate(timeout=HOPELESS)
    assert process.returncode == 130, "".join(lines) + rest
    assert "Traceback" not in rest
    assert rest.endswith("cape: interrupted\n")
    return out, "".join(lines)


def test_many_steps_are_warned_of_and_can_be_interrupted_while_the_cloth_is_put_on(tmp_path):
    """Putting it on takes 192 frames of a million steps each, which would be an hour or more."""
    process = begin("replay", "walk", "--garment", "back_cape", "--substeps", "1000000", folder=tmp_path)
    out, _ = interrupted(process, r"euler takes 1000000 steps a frame here, about \d+ (minutes|hours) for .*putting")
    assert out == ""
    assert list(tmp_path.iterdir()) == []


def test_compiling_can_be_interrupted(tmp_path):
    process = begin("replay", "walk", folder=tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    interrupted(process, "compiling .* pieces of code")
    assert not list(tmp_path.glob("*.rrd"))


INTERRUPTING = """
import os, signal, sys

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == os.environ["INTERRUPTED_AT"]:
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Finder())
"""


def interrupted_at(module: str, command: list[str], folder: Path) -> "subprocess.CompletedProcess[str]":
    """A process that is interrupted when it first looks for a module."""
    (folder / "sitecustomize.py").write_text(INTERRUPTING)
    return subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, "INTERRUPTED_AT": module, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])},
        capture_output=True,
        text=True,
        timeout=HOPELESS,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


@pytest.mark.parametrize("command", [[CAPE], [sys.executable, "-m", "cape"]], ids=["script", "module"])
def test_modules_that_are_being_imported_can_be_interrupted(command, tmp_path):
    for module, status, told in (
        ("cape.air", -signal.SIGINT, ""),  # the first that is imported, and one that has begun itself
        ("skeleton.shapes", -signal.SIGINT, ""),
        ("cape.cli.app", 130, "cape: interrupted\n"),
    ):
        done = interrupted_at(module, [*command, "clips"], tmp_path)
        assert (done.returncode, done.stdout, done.stderr) == (status, "", told), module


def test_the_library_leaves_interrupts_to_who_imports_it(tmp_path):
    script = "try:\n    import cape\nexcept KeyboardInterrupt:\n    print('heard')"
    done = interrupted_at("cape.air", [sys.executable, "-c", script], tmp_path)
    assert (done.returncode, done.stdout) == (0, "heard\n"), done.stderr


@pytest.mark.parametrize(
    ("started", "words", "is_one"),
    [
        ("/opt/bin/cape", ["python", "/opt/bin/cape", "replay"], True),
        ("cape.exe", ["python.exe", "cape.exe"], True),
        ("-m", ["python", "-X", "utf8", "-m", "cape", "replay", "-m"], True),
        ("-m", ["python", "-mcape.cli"], True),
        ("-m", ["python", "-m", "pytest", "-m", "cape"], False),
        ("/opt/bin/cape", ["python", "-c", "spawn", "--multiprocessing-fork"], False),
        ("/home/me/my_cape.py", ["python", "/home/me/my_cape.py", "cape"], False),
        ("", ["python"], False),
    ],
)
def test_what_is_the_command(started: str, words: list[str], is_one: bool):
    assert is_command(started, words) == is_one
