"""Where a command writes its recording, and how it opens it."""

import os
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from cape import exports
from motions.errors import FileError, UnknownNameError
from motions.files import text_of

WANT_TEXT = ("", ".rrd", ".usd", ".usda", ".usdc", ".toml")  # suffixes of what takes no other paths


def output_path(
    asked: Path | None, name: str, ending: str = ".rrd", *, inputs: Iterable[str | Path | None] = ()
) -> Path:
    """Where to write, by default the motion's name with that ending, checked before anything is simulated.

    Raises:
        FileError: the folder does not exist or can't be written, or the path is a folder or "-", or what is written
            there, or comes beside it, is one of the `inputs`.
    """
    path, inputs = Path(f"{name}{ending}") if asked is None else asked, tuple(inputs)
    if str(path) == "-":
        raise FileError("can't write to standard output: -o takes a file, such as ./-")
    if _is_there(path) and any(given is not None and _is_same(path, Path(given)) for given in inputs):
        raise FileError(f"can't write {path}: it is what is read")
    folder = path.resolve().parent
    for given in filter(None, inputs):
        if _is_same(folder, Path(given).parent) and exports.may_write(path, Path(given).name) and os.path.exists(given):
            raise FileError(f"can't write {path}: {given}, which is read, would be written over")
    if path.suffix.lower() in WANT_TEXT and text_of(whole := str(path.absolute())) != whole:
        raise FileError(f"can't write {path}: {whole} is no text (UTF-8), as such a file wants its path: rename it")
    if path.is_dir():
        raise FileError(f"can't write {path}: it is a directory")
    if not folder.is_dir():
        raise FileError(f"can't write {path}: there is no folder {folder}")
    if not os.access(folder, os.W_OK):
        raise FileError(f"can't write {path}: the folder {folder} is not writable")
    return path


def require_suffix(path: Path, suffixes: Sequence[str], hint: str = "") -> None:
    """Check that a path ends as what will be in it does, or has no suffix: a recording named .fbx opens nowhere.

    Raises:
        UnknownNameError: it ends otherwise; the `hint` closes its text.
    """
    if path.suffix and path.suffix.lower() not in suffixes:
        raise UnknownNameError("kind of output", path.suffix, suffixes, hint)


def _is_there(path: Path) -> bool:
    """Tell whether something is there already.

    Raises:
        FileError: nothing can be, as a name is too long, or nobody may look.
    """
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except (OSError, ValueError) as error:
        raise FileError(f"can't write {path}: {getattr(error, 'strerror', None) or error}") from None
    return True


def _is_same(path: Path, other: Path) -> bool:
    try:
        return path.samefile(other)
    except (OSError, ValueError):
        return False


def open_viewer(path: Path) -> None:
    """Open a recording in the Rerun viewer, which goes on after this command ends and listens on loopback alone."""
    subprocess.Popen(
        [sys.executable, "-m", "rerun", str(path), "--bind", "127.0.0.1"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
