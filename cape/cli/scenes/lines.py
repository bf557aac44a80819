"""On which line of a TOML text each key stands, which `tomllib` does not tell."""

import re
import tomllib
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any

from motions.files import fault_of_toml

Path = tuple[str | int, ...]
"""Keys, and places in arrays, from the outermost inwards."""

# What a text of TOML is made of, as far as one tells where a statement ends: texts, comments, brackets, ends of lines.
_PIECES = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'|#[^\n]*|[\[\]{}\n]|[^"\'#\[\]{}\n]+|.',
    re.DOTALL,
)
DEEPEST = 4
_PLACE = re.compile(r"\(at line (\d+), column \d+\)")


class Lines:
    """The lines of a text's keys."""

    def __init__(self, text: str):
        """`text` should be TOML; of one that is none only `broken` makes sense."""
        self._text = text

    def __getitem__(self, path: Path) -> int:
        """The line of a key, or of what it stands in where it has none of its own."""
        while path and path not in self._lines:
            path = path[:-1]
        return self._lines.get(path, 1)

    def broken(self, error: ValueError | RecursionError) -> tuple[int, str]:
        """The line where `tomllib` failed with an error, and what is wrong there."""
        if place := _PLACE.search(str(error)):
            return int(place[1]), _PLACE.sub("", str(error)).strip()
        told = fault_of_toml(error).replace("(at end of document)", "at the end of the file")
        if isinstance(error, tomllib.TOMLDecodeError):
            return self._text.count("\n") + 1, told
        return next((line for line, piece in _statements(self._text) if not _is_toml(piece)), 1), told

    @cached_property
    def _lines(self) -> dict[Path, int]:
        found: dict[Path, int] = {}
        counts: dict[Path, int] = {}
        table: Path = ()
        for line, statement in _statements(self._text):
            content = tomllib.loads(statement)
            header = statement.startswith("[")
            if header:
                table = _headed(content, counts, several=statement.startswith("[["))
                for end in range(1, len(table) + 1):
                    found.setdefault(table[:end], line)
            for path in () if header else _paths(content):
                found.setdefault((*table, *path), line)
        return found


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Statements, each with the line where it begins: what ends with a line outside of all brackets."""
    pieces: list[str] = []
    line, begun, depth = 1, 1, 0
    for match in _PIECES.finditer(text):
        piece = match[0]
        if piece == "\n" and depth <= 0:
            if statement := "".join(pieces).strip():
                yield begun, statement
            pieces, depth, begun = [], 0, line + 1
        elif not piece.startswith("#"):
            pieces.append(piece)
            depth += (piece in "[{") - (piece in "]}")
        line += piece.count("\n")
    if statement := "".join(pieces).strip():
        yield begun, statement


def _is_toml(text: str) -> bool:
    try:
        tomllib.loads(text)
    except (ValueError, RecursionError):
        return False
    return True


def _headed(content: Mapping[str, Any], counts: dict[Path, int], *, several: bool) -> Path:
    """The path of the table that a header begins, whose content alone is given.

    `counts` tells how many tables the arrays of tables have so far, in which headers speak of the last.
    """
    path: Path = ()
    value: Any = content
    while value:
        ((key, value),) = value.items()
        path = (*path, key)
        if several and isinstance(value, list):
            counts[path] = counts.get(path, 0) + 1
            value = {}
        if path in counts:
            path = (*path, counts[path] - 1)
    return path


def _paths(value: Any, deep: int = DEEPEST) -> Iterator[Path]:
    """The paths of what is in a value, as far as anything in a scene is nested."""
    inside = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list) else ()
    for key, part in inside if deep else ():
        yield (key,)
        yield from ((key, *path) for path in _paths(part, deep - 1))
