"""Files that are read whole, within limits, and files that appear under their names complete or not at all."""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from motions.errors import FileError
from motions.limits import LARGEST_FILE


def read_bytes(path: Path) -> bytes:
    """All of a regular file: what never ends, or waits for a writer, is none.

    Raises:
        FileError: it is missing, no regular file, too large, or can't be read.
    """
    try:
        found = os.stat(path)
        if stat.S_ISDIR(found.st_mode):
            raise FileError(f"{path} is a directory, not a file")
        if not stat.S_ISREG(found.st_mode):
            raise FileError(f"{path} is not a regular file")
        if found.st_size > LARGEST_FILE:
            raise FileError(f"{path} has {found.st_size / 2**20:.0f} MB, more than {LARGEST_FILE / 2**20:.0f}")
        return path.read_bytes()
    except (OSError, ValueError) as error:
        if isinstance(error, FileError):
            raise
        raise FileError(f"can't read {str(path)[:200]}: {getattr(error, 'strerror', None) or error}") from None


def printable(text: str) -> str:
    """A text of a file as it may stand in a terminal: what is no character to be seen is written as an escape."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a hidden name beside `path`, of the same suffix, to write to; the file takes its own name as the block ends.

    One that is there is replaced; where the block fails, it stays as it is.

    Raises:
        FileError: it can't be written.
    """
    partial = path.with_name(f".{os.getpid()}.part{path.suffix}")
    try:
        try:
            yield partial
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        raise FileError(f"can't write {path}: {error.strerror}") from error


def write_text(path: Path, text: str) -> None:
    """Write a text file; one that is there is replaced at the end.

    Raises:
        FileError: it can't be written.
    """
    with whole_file(path) as partial:
        partial.write_text(text, encoding="utf-8")
