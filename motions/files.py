"""Text files that appear under their names complete, or not at all."""

import os
from pathlib import Path

from motions.errors import FileError


def write_text(path: Path, text: str) -> None:
    """Write a file; one that is there is replaced at the end.

    Raises:
        FileError: it can't be written.
    """
    partial = path.with_name(f".{os.getpid()}.part")
    try:
        try:
            partial.write_text(text, encoding="utf-8")
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        raise FileError(f"can't write {path}: {error.strerror}") from error
