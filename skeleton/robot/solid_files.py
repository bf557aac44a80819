"""Solids in a TOML file that a person can read and edit.

One table `[[solid]]` for each:

    [[solid]]
    name = "left_forearm"
    kind = "capsule"
    bone = "left_elbow_joint"
    start = [0.0, 0.0, 0.0]
    end = [0.1, 0.0, -0.01]
    radius = 0.05

Numbers are written with all of their digits, so that what is read is what was written.
"""

import json
import tomllib
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from motions.errors import FileError, UnknownNameError, UserError
from motions.files import fault_of_toml, read_bytes, write_text
from motions.limits import LARGEST_MARKUP, LARGEST_NUMBER, MOST_COLLIDERS
from skeleton.shapes import SHAPES, Shape, shape_named, word_of

_COMMON = {"friction": 0, "thickness": 0}
_TEXTS = ("name", "kind", "bone")

_HEADER = """\
# Hitboxes of a robot: solids that move with its bones.
# Lengths are in metres, in the frame of the bone; without a bone in the world, whose z axis points up.
# rotation_wxyz is a unit quaternion from the solid's own axes to the bone's, and may be left out; friction (Coulomb's
# coefficient) and thickness (distance at which cloth is stopped) may be added to any solid. The kinds, and what is
# written of each:
"""


def write_solids(path: str | Path, robot: str, solids: Sequence[Shape], remarks: Mapping[str, str]) -> None:
    """Write a robot's solids; a file that is there is replaced at the end.

    Args:
        path: the file, by custom with the suffix .toml.
        robot: its name.
        solids: in the frames of its bones.
        remarks: comments on solids, by name.

    Raises:
        FileError: the file can't be written.
        UnknownNameError: a solid is of no shape in `skeleton.shapes.SHAPES`.
    """
    tables = [_table(solid, remarks.get(solid.name)) for solid in solids]
    write_text(Path(path), "\n".join([_header(), f"robot = {quoted(robot)}\n", *tables]))


def read_solids(path: str | Path, bones: Collection[str] | None = None) -> tuple[str, tuple[Shape, ...]]:
    """A robot's name and its solids.

    Args:
        path: a file that `write_solids` wrote or a person did.
        bones: names of the bones that there are; not checked by default.

    Raises:
        FileError: the file is missing, is no TOML, or a table in it makes no sense; names the table and what it may
            hold.
    """
    try:
        content = tomllib.loads(read_bytes(Path(path), most=LARGEST_MARKUP).decode())
    except FileError:
        raise
    except (RecursionError, ValueError) as error:  # of TOML, of its encoding, or of a number of thousands of digits
        raise FileError(f"{path} is no TOML file: {fault_of_toml(error)}") from None
    _only(content, ("robot", "solid"), str(path))
    robot, tables = content.get("robot", ""), content.get("solid", [])
    if not isinstance(robot, str):
        raise FileError(f"{path}: robot is a text, not {robot!r}")
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise FileError(f"{path}: solids are tables [[solid]]")
    if len(tables) > MOST_COLLIDERS:
        raise FileError(f"{path} holds {len(tables)} solids, more than {MOST_COLLIDERS}")
    solids: dict[str, Shape] = {}
    for number, table in enumerate(tables, start=1):
        where = f"{path}: solid {number}" + (f" ({table['name']!r})" if "name" in table else "")
        solid = solid_of(table, where, bones)
        if solid.name in solids:
            raise FileError(f"{where}: there is a solid of that name already")
        solids[solid.name] = solid
    return robot, tuple(solids.values())


def _header() -> str:
    """What a file begins with: what it is, and what it may hold."""
    return _HEADER + "".join(f"#   {word}: {', '.join(shape.numbers)}\n" for word, shape in SHAPES.items())


def _table(solid: Shape, remark: str | None) -> str:
    """The table of a solid.

    Raises:
        UnknownNameError: it is of no shape in `skeleton.shapes.SHAPES`.
    """
    lines = [] if remark is None else [f"# {line}" for line in remark.splitlines()]
    lines += ["[[solid]]", f"name = {quoted(solid.name)}", f'kind = "{word_of(solid)}"']
    if solid.bone is not None:
        lines.append(f"bone = {quoted(solid.bone)}")
    for key in {**solid.numbers, **_COMMON}:
        value = getattr(solid, key)
        if value is not None:
            lines.append(f"{key} = {np.asarray(value, dtype=float).tolist()!r}")
    return "\n".join(lines) + "\n"


def quoted(text: str) -> str:
    """A text as a TOML string: JSON's escapes are among TOML's, which besides wants one for DEL."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def solid_of(table: Mapping[str, Any], where: str, bones: Collection[str] | None) -> Shape:
    """The solid of a table as it stands in a TOML file.

    Args:
        table: its keys and values.
        where: what errors begin with.
        bones: names of the bones that there are; None not to check.

    Raises:
        FileError: the table makes no sense.
    """
    for key in ("name", "kind"):
        if key not in table:
            raise FileError(f"{where} lacks {key!r}")
    for key in _TEXTS:
        if not isinstance(table.get(key, ""), str):
            raise FileError(f"{where}: {key} is a text, not {table[key]!r}")
    try:
        shape = shape_named(table["kind"])
    except UnknownNameError as error:
        raise FileError(f"{where}: {error}") from None
    numbers, needed = {**shape.numbers, **_COMMON}, [key for key in shape.numbers if key not in shape.optional]
    _only(table, (*_TEXTS, *numbers), where)
    if missing := [key for key in needed if key not in table]:
        raise FileError(f"{where} lacks {', '.join(missing)}; a {table['kind']} has {', '.join(needed)}")
    bone = table.get("bone")
    if bones is not None and bone is not None and bone not in bones:
        raise FileError(f"{where}: no bone named {bone!r}; available: {', '.join(bones)}")
    values = {key: _numbers(table[key], size, f"{where}: {key}") for key, size in numbers.items() if key in table}
    try:
        return shape(**{"name": table["name"], "bone": bone, **values})
    except UserError as error:
        raise FileError(f"{where}: {error}") from None


def _only(table: Mapping[str, Any], known: Sequence[str], where: str) -> None:
    if unknown := [key for key in table if key not in known]:
        raise FileError(f"{where}: no key named {unknown[0]!r}; available: {', '.join(known)}")


def _numbers(value: Any, size: int, where: str) -> Any:
    """A number, or an array of so many.

    Raises:
        FileError: it is something else.
    """
    entries = value if size else [value]
    if not isinstance(entries, list) or len(entries) != max(size, 1) or not all(map(_is_number, entries)):
        raise FileError(f"{where} is {f'a list of {size} numbers' if size else 'a number'}, not {repr(value)[:60]}")
    return np.array(entries, dtype=float) if size else float(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST_NUMBER
