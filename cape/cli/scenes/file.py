"""Scene files: TOML of the options of `cape replay` by their names, and tables of fabrics, attachments, colliders."""

import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import motions
from cape.cli.scenes.keys import KINDS, Key, keys
from cape.cli.scenes.lines import Lines
from cape.cli.scenes.tables import (
    ATTACHMENT,
    ATTACHMENT_KEYS,
    COLLIDER,
    FABRIC,
    FABRIC_KEYS,
    TABLES,
    Table,
    Tables,
    collider_of,
    fabric_of,
)
from motions.errors import FileError, UnknownNameError, UserError
from motions.files import printable, read_bytes, text_of
from motions.limits import LARGEST_NUMBER

LARGEST = 2**18  # bytes: a scene of a thousand colliders has most of that
# A key of so many parts is none, and tomllib takes their square in time.
_DEEP = re.compile(r"""(?:\.[ \t]*(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*){32}""")
MOST_TOLD = 60  # characters of a value, in an error


@dataclass(frozen=True)
class SceneFile:
    """A scene as a file tells it.

    Attributes:
        path: of the file.
        options: of `cape replay` by their names without dashes; paths are from the current folder.
        fabrics: tables of fabrics by name.
        attachments: tables of what holds the garment besides its own.
        colliders: tables of what it meets besides the body.
        text: of the file.
    """

    path: Path
    options: Mapping[str, Any] = field(default_factory=dict)
    fabrics: Mapping[str, Table] = field(default_factory=dict)
    attachments: tuple[Table, ...] = ()
    colliders: tuple[Table, ...] = ()
    text: str = field(default="", compare=False)

    @property
    def name(self) -> str:
        """What the scene is called: its file without a suffix."""
        return text_of(self.path.stem)

    @cached_property
    def lines(self) -> Lines:
        """Where everything stands."""
        return Lines(self.text)

    def where(self, *path: str | int) -> str:
        """The file and the line of what stands there, as errors begin."""
        return f"{self.path}, line {self.lines[path]}"

    @cached_property
    def tables(self) -> Tables:
        """The tables, read.

        Raises:
            FileError: one makes no sense; tells its line.
        """
        fabrics = {}
        for name, table in self.fabrics.items():
            fabrics[name] = self._read(table, fabric_of, FABRIC, name)
        solids = []
        for number, table in enumerate(self.colliders):
            where = f"{self.where(COLLIDER, number)}: collider {number + 1}"
            solids.append(collider_of(table, where))
            if solids[-1].name in (solid.name for solid in solids[:-1]):
                raise FileError(f"{where}: there is a collider named {solids[-1].name!r} already")
        places = [self.where(ATTACHMENT, number) for number in range(len(self.attachments))]
        places += [self.where(COLLIDER, number) for number in range(len(self.colliders))]
        return Tables(fabrics, self.attachments, tuple(solids), tuple(places))

    def _read(self, table: Table, make: Callable[[Table], Any], *path: str | int) -> Any:
        try:
            return make(table)
        except UserError as error:
            # The key that the error speaks of, where it does.
            told = str(error)
            about = (k for k, v in table.items() if re.search(rf"\b{re.escape(k)}\b", told) or repr(v) in told)
            key = next(about, None)
            raise FileError(f"{self.where(*path, *([] if key is None else [key]))}: {error}") from None

    @contextmanager
    def telling(self, overridden: Iterable[str] = ()):
        """Tell errors of the block with the line of the key that they speak of.

        Args:
            overridden: keys whose values are not those of the file.
        """
        try:
            yield
        except UserError as error:
            told = str(error)
            if told.startswith(str(self.path)):
                raise
            keys = [(key,) for key in self.options if key not in overridden and self._is_about(told, key)]
            # How far vertices are from a bone is known once the garment is put on.
            holds = [(ATTACHMENT, number) for number, table in enumerate(self.attachments) if _is_beyond(told, table)]
            if not keys and not holds:
                raise
            raise FileError(f"{self.where(*[*keys, *holds][0])}: {told}") from None

    def _is_about(self, told: str, key: str) -> bool:
        """Whether an error speaks of a key, or quotes its value."""
        values = self.options[key] if isinstance(self.options[key], list | tuple) else [self.options[key]]
        texts = [str(value) for value in values if isinstance(value, str | Path)]
        texts += [part for text in texts if "=" in text for part in text.split("=")]
        quoted = any(repr(text) in told or (re.search(r"[./]", text) and text in told) for text in texts)
        name = re.escape(key).replace(r"\-", "[-_ ]")
        return quoted or re.match(rf"(a |an |the |wind |--)?{name}\b", told) is not None


def _is_beyond(told: str, table: Table) -> bool:
    bones = [table["bone"]] if "bone" in table else [*table["bones"]]
    return "within" in table and " within " in told and repr(bones[0]) in told


def read_scene(path: str | Path) -> SceneFile:
    """Read a scene file, whose paths are from its own folder.

    Raises:
        FileError: it is missing, is no TOML, or holds what makes no sense; tells the line, and what was expected.
    """
    path = Path(path)
    content = read_bytes(path)
    if len(content) > LARGEST:
        raise FileError(f"{path} has {len(content) / 1e6:.1f} MB: a scene file has {LARGEST / 1e6:.1f} at most")
    return scene_of(content, path)


def scene_of(content: bytes, path: Path) -> SceneFile:
    """The scene that a file of this content tells.

    Raises:
        FileError: it is no TOML, or holds what makes no sense; tells the line, and what was expected.
    """
    try:
        text = content.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise FileError(f"{path}, line {line}: no text in UTF-8") from None
    lines = Lines(text)
    if deep := _DEEP.search(text):
        raise FileError(f"{path}, line {text.count(chr(10), 0, deep.start()) + 1}: no TOML: nested too deeply")
    try:
        found = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        line, told = lines.broken(error)
        raise FileError(f"{path}, line {line}: no TOML: {printable(told)}") from None
    scene = _Reader(SceneFile(path, text=text)).scene(found)
    _ = scene.tables  # told now, with its line
    return scene


class _Reader:
    """Checks what a file holds against what it may hold."""

    def __init__(self, file: SceneFile):
        self._file = file

    def scene(self, found: Mapping[str, Any]) -> SceneFile:
        self._only(found, (*keys(), *TABLES))
        fabrics = found.get(FABRIC, {})
        if not isinstance(fabrics, dict):
            raise self._wrong((FABRIC,), f"tables [{FABRIC}.NAME]", fabrics)
        for name, table in fabrics.items():
            self._fabric(name, table)
        attachments, colliders = (self._tables(found, name) for name in (ATTACHMENT, COLLIDER))
        for number, table in enumerate(attachments):
            self._attachment(number, table)
        for number, table in enumerate(colliders):
            if not isinstance(table, dict):
                raise self._wrong((COLLIDER, number), "a table", table)
        options = {key: self._option(keys()[key], value, fabrics) for key, value in found.items() if key in keys()}
        return SceneFile(self._file.path, options, fabrics, tuple(attachments), tuple(colliders), self._file.text)

    def _option(self, key: Key, value: Any, fabrics: Iterable[str]) -> Any:
        place = (key.name,)
        if key.count is None:
            self._require(place, _is(key.kind, value), key.expected, value)
            return self._single(key, value, place, fabrics)
        several = [value] if key.count < 0 and _is(key.kind, value) else value
        right = isinstance(several, list) and key.count in (-1, len(several))
        self._require(place, right and all(_is(key.kind, one) for one in several), key.expected, value)
        return [self._single(key, one, place, fabrics) for one in several]

    def _single(self, key: Key, value: Any, place: tuple[str], fabrics: Iterable[str]) -> Any:
        if key.one_of is not None:
            known = [*(fabrics if key.name == "fabric" else ()), *key.one_of.names()]
            apart, of = key.one_of.separator, key.one_of.of
            for text in [value] if apart is None else [part.strip() for part in value.split(apart)]:
                what, equals, name = text.rpartition("=") if of is not None else ("", "", text)
                if of is not None and equals and what not in of():
                    raise self._told(place, "garment", what, of())
                if name not in known:
                    raise self._told(place, key.name, name, known)
        if key.kind is Path:
            return self._file.path.parent / value
        if key.file is not None:
            return _placed(value, self._file.path.parent, script=key.file.script)
        return float(value) if key.kind is float else value

    def _fabric(self, name: str, table: Any) -> None:
        place = (FABRIC, name)
        self._require(place, isinstance(table, dict), "a table", table)
        self._only(table, FABRIC_KEYS, *place)
        for key, value in table.items():
            right = _is(str, value) if key == "base" else _is(float, value) or _are(float, value, 2)
            self._require((*place, key), right, "a text" if key == "base" else "a number, or one for warp and one "
                          "for weft in a list", value)  # fmt: skip

    def _attachment(self, number: int, table: Any) -> None:
        place = (ATTACHMENT, number)
        self._require(place, isinstance(table, dict), "a table", table)
        self._only(table, ATTACHMENT_KEYS, *place)
        for key, value in table.items():
            expected, right = _ATTACHMENT_VALUES[key]
            self._require((*place, key), right(value), expected, value)
        for pair in (("bone", "bones"), ("region", "vertices")):
            if all(key in table for key in pair):
                raise FileError(f"{self._file.where(*place)}: give {pair[0]} or {pair[1]}, not both")
        if not {"bone", "bones"} & set(table):
            raise FileError(
                f"{self._file.where(*place)}: an attachment lacks its bone, or its bones with their weights"
            )

    def _tables(self, found: Mapping[str, Any], name: str) -> list[Any]:
        tables = found.get(name, [])
        self._require((name,), isinstance(tables, list), f"tables [[{name}]]", tables)
        return tables

    def _only(self, table: Mapping[str, Any], known: Iterable[str], *place: str | int) -> None:
        for key in table:
            if key not in known:
                raise self._told((*place, key), "key", key, known)

    def _require(self, place: tuple[str | int, ...], right: bool, expected: str, value: Any) -> None:
        if not right:
            raise self._wrong(place, expected, value)

    def _wrong(self, place: tuple[str | int, ...], expected: str, value: Any) -> FileError:
        told = printable(repr(value)) if not isinstance(value, bool) else str(value).lower()
        told = told if len(told) <= MOST_TOLD else told[: MOST_TOLD - 3] + "..."
        name = next((part for part in reversed(place) if isinstance(part, str)), "")
        return FileError(f"{self._file.where(*place)}: {printable(name)[:MOST_TOLD]} is {expected}, not {told}")

    def _told(self, place: tuple[str | int, ...], kind: str, name: str, known: Iterable[str]) -> FileError:
        return FileError(f"{self._file.where(*place)}: {UnknownNameError(kind, printable(name)[:MOST_TOLD], known)}")


def _is(kind: type, value: Any) -> bool:
    """Whether a value of TOML is of one of `KINDS`."""
    if kind is float or (kind is int and not isinstance(value, float)):
        numeric = isinstance(value, int | float) and not isinstance(value, bool)
        return numeric and abs(value) <= LARGEST_NUMBER  # False for what is no number
    return isinstance(value, str) and "\0" not in value if kind in (str, Path) else isinstance(value, kind)


def _are(kind: type, value: Any, count: int | None = None) -> bool:
    right = isinstance(value, list) and len(value) > 0 and count in (None, len(value))
    return right and all(_is(kind, one) for one in value)


def _are_points(value: Any) -> bool:
    return isinstance(value, list) and len(value) > 0 and all(_are(float, point, 3) for point in value)


_ATTACHMENT_VALUES: Mapping[str, tuple[str, Callable[[Any], bool]]] = {
    "bone": (KINDS[str], lambda value: _is(str, value)),
    "bones": (
        "a table of bones and their weights",
        lambda value: isinstance(value, dict) and all(_is(float, weight) for weight in value.values()),
    ),
    "region": (KINDS[str], lambda value: _is(str, value)),
    "vertices": ("a list of whole numbers", lambda value: _are(int, value)),
    "within": (KINDS[float], lambda value: _is(float, value)),
    "points": ("a list of points, each a list of 3 numbers", _are_points),
    "stiffness": (KINDS[float], lambda value: _is(float, value)),
    "damping": (KINDS[float], lambda value: _is(float, value)),
    "along": ("a list of points, each a list of 3 numbers", _are_points),
}


def _placed(value: str, folder: Path, *, script: bool) -> str:
    """A name as it is, or a file's path from a folder; of a script all that are in it."""
    if script:
        try:
            steps = motions.parse_script(value)
        except UserError:
            return value  # told where it is played
        placed = [type(step)(_placed(step.clip, folder, script=False), step.seconds) for step in steps]
        return ", ".join(map(str, placed))
    return str(folder / value) if names_file(value) else value


def names_file(value: str) -> bool:
    """Whether a text that may be a name or a path is a path: it has a suffix or a folder."""
    return "://" not in value and ("/" in value or Path(value).suffix != "")
