"""Files that are read whole, within limits, and files that appear under their names complete or not at all."""

import os
import platform
import re
import secrets
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from motions.errors import FileError
from motions.limits import LARGEST_FILE


def read_bytes(path: Path, *, most: int | None = None) -> bytes:
    """All of a regular file, of `most` bytes or `LARGEST_FILE`: what never ends, or waits for a writer, is none.

    Raises:
        FileError: it is missing, no regular file, too large, or can't be read.
    """
    try:
        found = _regular(path)
        most = LARGEST_FILE if most is None else most
        if found.st_size > most:
            raise FileError(f"{path} has {found.st_size / 2**20:.0f} MB, more than {most / 2**20:.0f}")
        return path.read_bytes()
    except (OSError, ValueError) as error:
        if isinstance(error, FileError):
            raise
        raise FileError(_unreadable(path, error)) from None


def require_file(path: Path) -> None:
    """Check that a file is there, before what takes longer than to read it.

    Raises:
        FileError: it is missing, or no regular file.
    """
    try:
        _regular(path)
    except (OSError, ValueError) as error:
        if isinstance(error, FileError):
            raise
        raise FileError(_unreadable(path, error)) from None


def _regular(path: Path) -> os.stat_result:
    found = os.stat(path)
    if stat.S_ISDIR(found.st_mode):
        raise FileError(f"{path} is a directory, not a file")
    if not stat.S_ISREG(found.st_mode):
        raise FileError(f"{path} is not a regular file")
    return found


def _unreadable(path: Path, error: OSError | ValueError) -> str:
    return f"can't read {str(path)[:200]}: {getattr(error, 'strerror', None) or error}"


def printable(text: str) -> str:
    """A text of a file as it may stand in a terminal: what is no character to be seen is written as an escape."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def text_of(name: str) -> str:
    """A file's name as text that any file may hold: bytes of it that are no UTF-8 are replaced."""
    return re.sub("[\ud800-\udfff]", "\N{REPLACEMENT CHARACTER}", name)


def fault_of_toml(error: ValueError | RecursionError) -> str:
    """What `tomllib` found wrong with a text, in words for those who know no Python."""
    if isinstance(error, RecursionError):
        return "nested too deeply"
    if "set_int_max_str_digits" in str(error):
        return f"a number of more than {sys.get_int_max_str_digits()} digits"
    return str(error)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a hidden name beside `path`, of the same suffix, to write to; the file takes its own name as the block ends.

    One that is there is replaced; where the block fails, it stays as it is.

    Raises:
        FileError: it can't be written.
    """
    try:
        try:
            partial = begin_file(path)
        except ValueError as error:
            raise FileError(f"can't write {str(path)[:200]!r}: {error}") from None
        try:
            yield partial
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        # Who writes in C, as Pillow does, may know no more than that it failed.
        raise FileError(f"can't write {path}: {error.strerror or error}") from error


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Make a folder for files that nobody needs after the block.

    Raises:
        FileError: nowhere can one be made, as on a full disk.
    """
    try:
        made = tempfile.TemporaryDirectory(prefix="cape-")
    except OSError as error:
        raise FileError(f"can't write temporary files: {error.strerror}") from error
    with made as folder:
        yield Path(folder)


def begin_file(path: Path) -> Path:
    """Make an empty file beside `path`, of the same suffix, under a name that nobody can foresee.

    What processes of this machine that are gone have begun there is removed.

    Raises:
        OSError: it can't be made.
    """
    path = path.resolve()
    remove_left(path.parent)
    partial = path.with_name(f".{_host()}-{os.getpid()}-{secrets.token_hex(16)}.part{path.suffix}")
    partial.touch(exist_ok=False)
    return partial


def remove_left(folder: Path) -> None:
    """Remove what processes of this machine that are gone have begun to write in a folder."""
    host = _host()
    for left in folder.glob(f".{host}-*-*.part*"):
        found = re.fullmatch(rf"\.{host}-(\d+)-[0-9a-f]{{32}}\.part(\.\w+)?", left.name)
        if found and not _is_running(int(found[1])):
            with suppress(OSError):
                left.unlink()


def _host() -> str:
    return re.sub(r"\W", "_", platform.node())


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass  # somebody else's
    return True


def write_text(path: Path, text: str, *, newline: str | None = None) -> None:
    """Write a text file; one that is there is replaced at the end. `newline` is as of `open`.

    Names of files that are no text are in it as the bytes that they are.

    Raises:
        FileError: it can't be written.
    """
    with whole_file(path) as partial:
        partial.write_text(text, encoding="utf-8", errors="surrogateescape", newline=newline)
