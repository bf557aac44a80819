"""The installed command, as a user calls it: in a process of its own, or forked from one that has imported much."""

import atexit
import gc
import json
import os
import runpy
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import NamedTuple, Self

CAPE = Path(sys.executable).with_name("cape")

# What commands import, and foreign packages that are slow to import and start no threads, as rerun does: a fork that
# talked to a viewer would have the threads of the process that it comes from break down.
IMPORTED = (
    "cape.cli.app", "cape.cli.commands.replay", "cape.cli.figures.checking", "cape.record.growing", "cape.scenes",
    "attr", "numpy.fft", "numpy.ma", "numpy.random", "PIL.ExifTags", "PIL.Image", "pinocchio", "psutil", "pydoc",
    "pydantic.fields", "pydantic.type_adapter", "pydantic.types", "rich.progress", "rich.table", "typer._adapters",
)  # fmt: skip
OURS = ("cape", "skeleton", "motions")


def cape(
    *arguments: str | Path, folder: Path, timeout: float = 300.0, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run the command in a folder."""
    return subprocess.run(
        [CAPE, *map(str, arguments)],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=timeout,
    )


class Done(NamedTuple):
    """How a command ended, and what it printed."""

    returncode: int
    stdout: str
    stderr: str


class Forks:
    """Runs the installed script, or others, in forks of a process that has imported much: for runs that are many."""

    def __init__(self, folder: Path):
        """Printed text goes through files in the folder."""
        self._printed, self._script = (folder / "stdout", folder / "stderr"), folder / "script.py"
        self._process = subprocess.Popen(
            [sys.executable, "-P", __file__],
            # A fork has but the thread that forked.
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

    def __call__(self, *arguments: str | Path, folder: Path, **environment: str) -> Done:
        """Run the command in a folder."""
        return self._run(CAPE, *arguments, folder=folder, **environment)

    def script(self, code: str, *arguments: str | Path, folder: Path, **environment: str) -> Done:
        """Run a Python script in a folder; it finds foreign packages imported, and none of ours."""
        self._script.write_text(code)
        return self._run(self._script, *arguments, folder=folder, **environment)

    def _run(self, path: Path, *arguments: str | Path, folder: Path, **environment: str) -> Done:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        asked = [str(each) for each in (folder, *self._printed, path, *arguments)]
        print(json.dumps([environment, *asked]), file=self._process.stdin, flush=True)
        status = self._process.stdout.readline()
        assert status, f"the process that is to fork for {arguments} has broken down"
        return Done(int(status), *(path.read_text() for path in self._printed))


def _fork_for_each() -> None:
    """Read lines of JSON, what `_run` is given; answer with the status of each."""
    for module in IMPORTED:
        with suppress(ModuleNotFoundError):  # typer of another version may need others
            import_module(module)
    _build_once()
    gc.freeze()  # else each fork, as it ends, looks through all that was imported
    for line in sys.stdin:
        fork = os.fork()
        if not fork:
            _run(*json.loads(line))
            return
        print(os.waitstatus_to_exitcode(os.waitpid(fork, 0)[1]), flush=True)


def _build_once() -> None:
    """Have the command and its options ready, which take most of the time of a run that is refused."""
    import typer.main

    from cape.cli.app import app

    typer.main.get_command = cache(typer.main.get_command)
    typer.main.get_command(app)


def _run(environment: dict[str, str], folder: str, stdout: str, stderr: str, *command: str) -> None:
    """Run a script in this process, which ends as the script does."""
    os.environ.update(environment)
    if command[0] != str(CAPE):
        for name in [name for name in sys.modules if name.partition(".")[0] in OURS]:
            del sys.modules[name]
    signal.alarm(300)
    os.chdir(folder)
    for stream, path in enumerate((os.devnull, stdout, stderr)):
        file = os.open(path, os.O_RDONLY if stream == 0 else os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(file, stream)
        os.close(file)
    sys.argv = list(command)
    status = None
    try:
        runpy.run_path(command[0], run_name="__main__")
    except SystemExit as end:
        if isinstance(end.code, str):
            raise
        status = end.code
    # All that is done where a process ends, but for taking apart what was imported, which takes a tenth of a second.
    threading._shutdown()  # pyright: ignore[reportAttributeAccessIssue]
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status or 0)


if __name__ == "__main__":
    _fork_for_each()
