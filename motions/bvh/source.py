"""The bytes of a text file, and errors that name their line."""

import codecs
from dataclasses import dataclass
from pathlib import Path

from motions.errors import FileError
from motions.files import read_bytes


@dataclass(frozen=True)
class Source:
    """A text file in memory.

    Attributes:
        path: where it came from, for messages.
        data: its bytes without byte order mark, lines ended by a line feed alone.
    """

    path: Path
    data: bytes

    @classmethod
    def read(cls, path: Path) -> "Source":
        """Read a file.

        Raises:
            FileError: it doesn't exist, isn't a regular file, can't be read, is empty or isn't text.
        """
        data = read_bytes(path)
        if not data.strip():
            raise FileError(f"{path} is empty")
        if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):  # what some editors call Unicode
            data = data.decode("utf-16", errors="replace").encode("utf-8", errors="replace")
        if b"\0" in data:
            raise FileError(f"{path} is not a BVH file: it holds binary data")
        data = data.removeprefix(b"\xef\xbb\xbf")
        if b"\r" in data:
            data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        return cls(path, data)

    def line_at(self, offset: int) -> int:
        """Number of the line, from 1, that holds the byte at `offset`."""
        return self.data.count(b"\n", 0, offset) + 1

    def error(self, line: int, what: str) -> FileError:
        """The error to raise for what is wrong in a line."""
        return FileError(f"{self.path}, line {line}: {what}")


def shown(word: str, length: int = 40) -> str:
    """A word of the file as it can stand in a message: quoted, without control characters, not too long."""
    return repr(word if len(word) <= length else word[:length] + "...")
