"""Ctrl-C ends the installed command soon, wherever it is, and loses nothing that was done."""

import os
import re
import signal
import subprocess
from pathlib import Path

import pytest

from tests.support.command import CAPE

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
