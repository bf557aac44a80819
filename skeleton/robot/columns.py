"""Which column of a table is which number of a robot's configuration, by the columns' names."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motions.errors import FileError

FloatArray = NDArray[np.float64]

TIME_NAMES = ("time", "times", "t", "timestamp", "seconds")
FRAME_NAMES = ("", "#", "frame", "frames", "frame_id", "frame_idx", "frame_index", "frame_number", "index", "step")
"""Of columns that count the rows, as programs that write tables put before them; some give them no name."""

_SECONDS = {"": 1.0, "s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6}

_ROOT = {
    "x": r"(?:p|pos|t)[ _.]?x|x", "y": r"(?:p|pos|t)[ _.]?y|y", "z": r"(?:p|pos|t)[ _.]?z|z",
    "qx": r"(?:q|quat|rot)[ _.]?x", "qy": r"(?:q|quat|rot)[ _.]?y",
    "qz": r"(?:q|quat|rot)[ _.]?z", "qw": r"(?:q|quat|rot)[ _.]?w",
}  # fmt: skip
_BEFORE_ROOT = r"(?:(?:root|base|pelvis|floating_base|trans|translation|position|orientation)[ _./]+)*"
_UNIT = re.compile(r"[ _]*[\[(](?P<in>[^\])]*)[\])]$|_(?P<after>rad|deg|m)$")
_DEGREES = ("deg", "degrees", "degree", "°")
_LISTED = 4  # names that a message lists


class Order(NamedTuple):
    """Where each expected number stands among columns, which of them are in degrees, and whether by their names."""

    places: list[int]
    degrees: NDArray[np.bool_]
    by_name: bool


@dataclass(frozen=True)
class Numbers:
    """The numbers of a robot's configuration.

    Attributes:
        names: of all, in the robot's order.
        following: those of joints that follow others, which a file may leave out: all or none.
    """

    names: tuple[str, ...]
    following: frozenset[str] = frozenset()

    @property
    def widths(self) -> tuple[int, int]:
        """How many columns there may be."""
        return len(self.names), len(self.names) - len(self.following)

    def of_width(self, width: int) -> tuple[str, ...]:
        """The names that so many columns hold; all where neither fits."""
        leading = tuple(name for name in self.names if name not in self.following)
        return leading if width == len(leading) else self.names

    def filled(self, rows: FloatArray) -> FloatArray:
        """Rows with a zero for each number that was left out."""
        if rows.ndim != 2 or not self.following or rows.shape[1] != len(self.names) - len(self.following):
            return rows
        full = np.zeros((len(rows), len(self.names)))
        full[:, [name not in self.following for name in self.names]] = rows
        return full


def order_of(header: Sequence[str], expected: Sequence[str], where: str) -> Order:
    """Where each expected number stands among columns that are named.

    A prefix or suffix that all joints of either side share doesn't count, nor do units in brackets, nor case. Columns
    that are numbered, and not named, are in the expected order.

    Raises:
        FileError: the names don't fit; tells which are missing and which are unknown.
    """
    plain = [_plain(name) for name in header]
    degrees = np.array([unit in _DEGREES for _, unit in plain])
    by_name = not _are_numbered(header)
    if not by_name:
        found = dict(enumerate(range(len(header))))
        places = [found.get(k) for k in range(len(expected))]
    else:
        mine, theirs = [_root_name(name) for name, _ in plain], [name.lower() for name in expected]
        whole, bare = _places(mine, theirs), _places(_without_shared(mine), _without_shared(theirs))
        places = min(whole, bare, key=lambda found: found.count(None))
    missing = [name for name, place in zip(expected, places, strict=True) if place is None]
    unknown = [header[place] for place in sorted(set(range(len(header))) - {p for p in places if p is not None})]
    if missing or unknown:
        told = [f"{word} {_some(names)}" for word, names in (("lacks", missing), ("has", unknown)) if names]
        raise FileError(
            f"{where}: the row of names does not fit the robot: it {', and '.join(told)}; "
            "leave it out where columns are in the robot's order"
        )
    order = [place for place in places if place is not None]
    return Order(order, degrees[order], by_name)


def seconds_in(name: str) -> float | None:
    """The seconds in the unit of a column of times; None where its name is that of something else."""
    name = name.strip().strip("\"'").lower()
    found = re.fullmatch(r"(.*?)(?:[ _]*[\[(](s|sec|ms|us)[\])]|[ _](s|sec|ms|us))?", name)
    return _SECONDS[found[2] or found[3] or ""] if found and found[1] in TIME_NAMES else None


def counts_rows(name: str, values: FloatArray) -> bool:
    """Tell whether a column counts frames: by its name, and as it holds whole numbers that grow."""
    named = name.strip().strip("\"'").lower() in FRAME_NAMES
    return named and bool((values == np.round(values)).all() and (np.diff(values) > 0.0).all())


def _places(names: Sequence[str], expected: Sequence[str]) -> list[int | None]:
    """Where each expected name stands among others; None where it does not, or stands twice."""
    return [names.index(name) if names.count(name) == 1 else None for name in expected]


def _plain(name: str) -> tuple[str, str]:
    """A name in lower case without its unit, and the unit."""
    name = name.strip().strip("\"'").lower()
    found = _UNIT.search(name)
    return (name, "") if found is None else (name[: found.start()], found["in"] or found["after"] or "")


def _root_name(name: str) -> str:
    """The usual name of a number of the root, by whichever of its names."""
    for usual, others in _ROOT.items():
        if re.fullmatch(_BEFORE_ROOT + f"(?:{others})", name):
            return usual
    return name


def _without_shared(names: list[str]) -> list[str]:
    """Names without what those of all joints begin and end with, up to a separator."""
    names = [name.lower() for name in names]
    joints = [name for name in names if name not in _ROOT]
    if len(joints) < 2:
        return names
    before, after = _shared_start(joints), _shared_start([name[::-1] for name in joints])[::-1]
    return [name if name in _ROOT else name.removeprefix(before).removesuffix(after) for name in names]


def _shared_start(names: list[str]) -> str:
    """What all names begin with, up to a separator."""
    first, last = min(names), max(names)
    shared = next((k for k, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(first))
    return re.sub(r"[^ _./:]*$", "", first[:shared])


def _are_numbered(header: Sequence[str]) -> bool:
    """Tell whether names are but numbers from 0 or 1 on, with or without a word before them."""
    found = [re.fullmatch(r"(\D*)(\d{1,9})", name.strip()) for name in header]
    if not all(found):
        return False
    numbers = [int(match[2]) for match in found if match]
    return len({match[1] for match in found if match}) == 1 and numbers in (
        list(range(len(header))), list(range(1, len(header) + 1)),
    )  # fmt: skip


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(map(repr, names[:_LISTED])) + more
