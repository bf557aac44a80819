"""What commands that measure for minutes share: a bar for each section, and a look at the folder beforehand."""

import os
import sys
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from cape.cli.compiling_told import telling
from motions.errors import FileError


def require_folder(folder: Path) -> None:
    """Check where to write before anything is measured.

    Raises:
        FileError: there is no such folder, or it can't be written.
    """
    if not os.path.isdir(folder):
        raise FileError(f"can't write to {folder}: there is no such folder")
    if not os.access(folder, os.W_OK):
        raise FileError(f"can't write to {folder}: it is not writable")


TENTHS = 10


@contextmanager
def sections():
    """Show the section and a bar on a terminal; elsewhere a line for each section, and for each tenth of it."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not sys.stderr.isatty()) as progress:
        task = progress.add_task("", total=None)
        known = ""

        def told(section: str, steps: int) -> Callable[[], None]:
            nonlocal known
            known = section
            progress.reset(task, description=section, total=steps)
            if not progress.disable:
                return lambda: progress.advance(task)
            print(f"{section}: {steps} steps", file=sys.stderr, flush=True)
            done = 0

            def advance() -> None:
                nonlocal done
                done += 1
                if done * TENTHS // steps > (done - 1) * TENTHS // steps:
                    print(f"{section}: {done} of {steps}", file=sys.stderr, flush=True)

            return advance

        with telling.within(lambda text: progress.update(task, description=text or known)):
            yield told
