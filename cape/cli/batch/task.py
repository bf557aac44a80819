"""One task of a batch: `cape replay` in a process of its own, begun again where that was killed, and what it leaves."""

import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from cape.cli.batch.plan import Task
from motions.errors import UserError
from motions.files import write_text

DONE, FAILED, STOPPED = "done", "failed", "stopped"
ATTEMPTS = 3  # at a task whose process is killed, as by a system that is short of memory
LOOK = 0.2  # [s] between looks whether to stop
LONGEST = 500  # characters of an error that are kept
SUMMARY, LOG = "summary.json", "log.txt"


@dataclass(frozen=True)
class Outcome:
    """How a task ended.

    Attributes:
        name: of the task.
        status: "done", "failed" or "stopped".
        error: why it failed, in a line.
        facts: what `cape replay --json` tells.
        seconds: that its processes took.
        attempts: that were made; 0 where it stood complete already.
    """

    name: str
    status: str
    error: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)
    seconds: float = 0.0
    attempts: int = 0

    @property
    def unwritten(self) -> bool:
        """Whether there was no place to write to, as on a full disk."""
        return self.status == FAILED and self.error.startswith("can't write ")


def complete(task: Task) -> Outcome | None:
    """What stands in the task's folder, where that is of the same options, inputs and version, and all there."""
    try:
        kept = json.loads((task.own_folder / SUMMARY).read_text())
        if kept["task"] != _identity(task) or kept["bytes"] != task.output.stat().st_size:
            return None
        return replace(Outcome(**kept["outcome"]), attempts=0)
    except (OSError, ValueError, TypeError, KeyError):
        return None


def do(task: Task, stopped: Callable[[], bool]) -> Outcome:
    """Do a task; whatever goes wrong is in the outcome.

    Args:
        task: what to do.
        stopped: tells whether nobody waits for it any more; looked at a few times a second.
    """
    began = time.monotonic()
    try:
        task.own_folder.mkdir(parents=True, exist_ok=True)
        (task.own_folder / SUMMARY).unlink(missing_ok=True)
        outcome = _attempted(task, stopped)
        outcome = replace(outcome, seconds=round(time.monotonic() - began, 2))
        if outcome.status == DONE:
            text = {"task": _identity(task), "bytes": task.output.stat().st_size, "outcome": asdict(outcome)}
            write_text(task.own_folder / SUMMARY, json.dumps(text))
        return outcome
    except (OSError, UserError) as error:
        return replace(failed(task, why(error)), seconds=round(time.monotonic() - began, 2))


def why(error: OSError | UserError) -> str:
    """What went wrong, in a line."""
    if isinstance(error, UserError):
        return str(error)
    return f"can't write {error.filename or 'temporary files'}: {error.strerror}"


def failed(task: Task, error: str) -> Outcome:
    """The outcome of a task that was tried, and could not be done."""
    return Outcome(task.name, FAILED, error[:LONGEST], attempts=1)


def run_cape(
    arguments: Sequence[str], *, place: str | Path, said: Path, stopped: Callable[[], bool]
) -> tuple[int | None, str]:
    """Run a command of `cape` in a process, whose standard error goes to a file; it ends at once where it is stopped.

    Args:
        arguments: of the command.
        place: its folder.
        said: the file.
        stopped: tells whether to end it.

    Returns:
        Its status, negative for a signal's number, None where it was stopped; and what it printed.
    """
    with said.open("wb") as errors, tempfile.TemporaryFile() as printed:
        process = subprocess.Popen(
            # Nothing of the user's folder is imported, whatever its files are called.
            [sys.executable, "-P", "-m", "cape.cli", *arguments],
            cwd=place,
            stdin=subprocess.DEVNULL,
            stdout=printed,
            stderr=errors,
            start_new_session=True,  # Ctrl-C is for the batch, which ends them all
        )
        ended, killed = threading.Event(), threading.Event()

        def watch() -> None:
            while not (stopping := stopped()) and not ended.wait(LOOK):
                pass
            if stopping and process.poll() is None:
                killed.set()
                process.kill()

        watcher = threading.Thread(target=watch, name="cape-watch")
        watcher.start()
        try:
            # Without a time limit, since Python waits with one by looking ever so often.
            status = process.wait()
        finally:
            ended.set()
            watcher.join()
            if process.returncode is None:
                process.kill()
                process.wait()
        printed.seek(0)
        return None if killed.is_set() else status, printed.read().decode(errors="replace")


def last_line(said: Path) -> str:
    """The last thing that a command said, which is what went wrong."""
    lines = said.read_text(errors="replace").split("\n")
    told = next((line for line in reversed(lines) if line.strip()), "it says nothing")
    return told.strip().removeprefix("cape: ")[:LONGEST]


def _attempted(task: Task, stopped: Callable[[], bool]) -> Outcome:
    said = task.own_folder / LOG
    # What takes as long as a fifth of the simulation is for those who ask for it.
    brief = () if "--check" in task.arguments else ("--no-crossings",)
    command = ["replay", *brief, *task.arguments, "-o", str(task.output), "--json", "--", task.clip]
    status, attempt = -1, 0
    while status is not None and status < 0 and attempt < ATTEMPTS and not stopped():
        attempt += 1
        status, printed = run_cape(command, place=task.place, said=said, stopped=stopped)
        if status == 0:
            facts = json.loads(printed.splitlines()[-1])
            whole = facts["result"].startswith("finished")
            return Outcome(task.name, DONE if whole else FAILED, "" if whole else facts["result"], facts, 0.0, attempt)
    if status is None or stopped():
        return Outcome(task.name, STOPPED, "stopped before it was done", attempts=attempt)
    told = f"its process was killed {attempt} times, by signal {-status}" if status < 0 else last_line(said)
    return Outcome(task.name, FAILED, told, attempts=attempt)


def _identity(task: Task) -> dict[str, Any]:
    """What must be the same for a result to stand."""
    return {
        "clip": task.clip,
        "arguments": list(task.arguments),
        "output": task.output.name,
        "inputs": dict(task.inputs),
        "version": task.version,
    }
