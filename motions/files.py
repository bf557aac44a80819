"""Files that appear under their names complete, or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from motions.errors import FileError


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
