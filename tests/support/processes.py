"""Python scripts in processes of their own, which can import the packages and the tests."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]


def python(script: str, *arguments: str, **environment: str) -> str:
    """What a fresh process prints; it must end well, within five minutes."""
    return python_within(300.0, script, *arguments, **environment)


def python_within(seconds: float, script: str, *arguments: str, **environment: str) -> str:
    """What a fresh process prints; it must end well, in time."""
    done = subprocess.run(
        [sys.executable, "-c", script, *arguments],
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True,
        text=True,
        timeout=seconds,
        cwd=ROOT,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def mistake_told(done: Any) -> tuple[list[str], str]:
    """What a command says before, and the line by which it tells a mistake of the user's; it ends with status 2."""
    assert done.returncode == 2
    assert done.stdout == ""
    *said, line = done.stderr.splitlines()
    assert line.startswith("cape: ")
    return said, line
