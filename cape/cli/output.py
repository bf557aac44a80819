"""Where a command writes its recording, and how it opens it."""

import os
import subprocess
import sys
from pathlib import Path

from motions.errors import FileError


def output_path(asked: Path | None, name: str, ending: str = ".rrd") -> Path:
    """Where to write, by default the motion's name with that ending, checked before anything is simulated.

    Raises:
        FileError: the folder does not exist or can't be written, or the path is a folder.
    """
    path = Path(f"{name}{ending}") if asked is None else asked
    folder = path.resolve().parent
    if path.is_dir():
        raise FileError(f"can't write {path}: it is a directory")
    if not folder.is_dir():
        raise FileError(f"can't write {path}: there is no folder {folder}")
    if not os.access(folder, os.W_OK):
        raise FileError(f"can't write {path}: the folder {folder} is not writable")
    return path


def open_viewer(path: Path) -> None:
    """Open a recording in the Rerun viewer, which goes on after this command ends and listens on loopback alone."""
    subprocess.Popen(
        [sys.executable, "-m", "rerun", str(path), "--bind", "127.0.0.1"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
