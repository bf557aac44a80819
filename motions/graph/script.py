"""Scripts of what a character does, such as `idle 2s, walk 3s, kick`: from text to steps and back."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motions.border import checked, checked_first
from motions.errors import UserError, ValueRangeError

LONGEST = 3600.0
"""The longest time of a step [s]: an hour at 60 fps takes 200 MB, so a slip of the pen doesn't fill the memory."""

_NUMBER = r"(\d+(?:\.\d+)?|\.\d+)"
_TIME = re.compile(_NUMBER + r"\s*(ms|s|)", re.ASCII)
# A last word that begins like a number counts as a time, if perhaps a mistaken one, but not a file's name ("01.bvh").
_NAME_AND_TIME = re.compile(rf"(?P<name>.*?)((\s+|\A)(?P<time>[+-]?{_NUMBER}(\w*|\s+m?s)))?", re.DOTALL)
_PART = re.compile(r'\s*("(?P<quoted>([^"]|"")*)"(?P<after>[^",]*)|(?P<plain>[^",]*))(?P<end>,|\Z)')


@checked_first
@dataclass(frozen=True)
class Step:
    """One part of a script.

    Attributes:
        clip: name of the clip.
        seconds: how long it lasts [s]; None plays it once through.

    Raises:
        ValueRangeError: the name is empty, or the time isn't above 0 and at most `LONGEST`.
    """

    clip: str
    seconds: float | None = None

    def __post_init__(self) -> None:
        """Check name and time."""
        if not self.clip:
            raise ValueRangeError("the name of a clip is missing")
        if self.seconds is not None and not 0.0 < self.seconds <= LONGEST:
            raise ValueRangeError(f"a time must be above 0 s and at most {LONGEST:g} s, not {self.seconds:g} s")

    def __str__(self) -> str:
        """The step as a script tells it."""
        name = self.clip
        if re.search('[",]', name) or name != name.strip() or _split(name)[1]:
            name = '"' + name.replace('"', '""') + '"'
        return name if self.seconds is None else f"{name} {np.format_float_positional(self.seconds, trim='-')}s"


@checked
def parse_script(text: str) -> tuple[Step, ...]:
    """Read a script: steps separated by commas, each the name of a clip and, unless it plays once through, a time.

    A time is a number of seconds (`3s`, `3`, `0.5s`) or milliseconds (`500ms`). A name that holds a comma or a double
    quote, or that ends like a time, stands in double quotes, and a double quote within them is written twice.

    Raises:
        UserError: a part can't be read; tells which, and what is wrong with it.
    """
    steps: list[Step] = []
    at, end = 0, ","
    while end:
        part = _PART.match(text, at)
        try:
            if part is None:
                raise UserError("a double quote is out of place")
            steps.append(_step(part))
        except UserError as error:
            said = (text[at:] if part is None else part.group().removesuffix(",")).strip()
            shown = said if len(said) <= 60 else said[:57] + "..."
            raise UserError(f"can't read part {len(steps) + 1} of the script, {shown!r}: {error}") from None
        at, end = part.end(), part["end"]
    return tuple(steps)


@checked
def format_script(steps: Sequence[Step]) -> str:
    """The script of these steps; `parse_script` reads the same steps from it."""
    return ", ".join(map(str, steps))


def _step(part: re.Match[str]) -> Step:
    if part["quoted"] is None:
        name, time = _split(part["plain"].strip())
    else:
        name, time = part["quoted"].replace('""', '"'), part["after"].strip()
    return Step(name, _seconds(time) if time else None)


def _split(text: str) -> tuple[str, str]:
    """Name and time of a step that isn't quoted, either of them empty where it is missing."""
    found = _NAME_AND_TIME.fullmatch(text)
    return (text, "") if found is None else (found["name"], found["time"] or "")


def _seconds(time: str) -> float:
    found = _TIME.fullmatch(time)
    if found is None:
        raise UserError(f"{time!r} is no time; times are written 3s, 0.5s or 500ms")
    return float(found[1]) / (1000.0 if found[2] == "ms" else 1.0)
