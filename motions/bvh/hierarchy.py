"""The first half of a BVH file: the joint tree and the meaning of each motion channel."""

import re
from dataclasses import dataclass, field

import numpy as np

from motions.bvh.source import Source, shown
from motions.errors import FileError
from motions.files import printable
from motions.limits import LARGEST_NUMBER

CHANNELS = ("Xposition", "Yposition", "Zposition", "Xrotation", "Yrotation", "Zrotation")

_CHANNEL = {name.lower(): name for name in CHANNELS}
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_SIGN_INSIDE = re.compile(r"(?<=[\d.])[+-]", re.ASCII)


@dataclass
class Joint:
    """A joint as the file states it.

    Attributes:
        name: its name in the file.
        parent: index of its parent, -1 for the root.
        line: where it begins.
        offset: OFFSET in the file's unit, None until it is read.
        channels: names out of `CHANNELS` in the order of their columns, None until they are read.
    """

    name: str
    parent: int
    line: int
    offset: tuple[float, float, float] | None = None
    channels: tuple[str, ...] | None = None


@dataclass
class EndSite:
    """An end site as the file states it: the joint it hangs at, where it begins and its OFFSET."""

    parent: int
    line: int
    offset: tuple[float, float, float] | None = None


@dataclass
class Hierarchy:
    """The tree in the order of the file, so parents come before children."""

    joints: list[Joint] = field(default_factory=list)
    ends: list[EndSite] = field(default_factory=list)

    @property
    def columns(self) -> int:
        """Number of motion values in a frame."""
        return sum(len(joint.channels or ()) for joint in self.joints)


def parse_number(word: str) -> float | None:
    """The number that a word states, None where it states none or one too large to be meant."""
    number = float(word) if _NUMBER.fullmatch(word) else np.inf
    return number if abs(number) <= LARGEST_NUMBER else None


def why_no_number(word: str) -> str:
    """What is wrong with a word that `parse_number` refuses."""
    if re.fullmatch(r"[+-]?\d*,\d+", word):
        return f"{shown(word)} has a decimal comma; BVH needs a point"
    if _NUMBER.fullmatch(word):
        return f"{shown(word)} is too large to be meant"
    if _SIGN_INSIDE.search(word) and all(map(_NUMBER.fullmatch, _SIGN_INSIDE.sub(" ", word).split())):
        return f"{shown(word)} is several numbers in one: a space is missing"
    return f"{shown(word)} is not a finite number"


def parse_hierarchy(source: Source, end: int) -> Hierarchy:
    """Read the tree from the first `end` bytes of a file.

    Raises:
        FileError: anything that isn't a well-formed tree with one root, with the line.
    """
    return _Parser(source, end).parse()


class _Parser:
    """Walks over the words with a stack of what is open; a word is a brace or what stands between blanks."""

    def __init__(self, source: Source, end: int):
        text = source.data[:end].decode("utf-8", errors="replace").replace("{", " { ").replace("}", " } ")
        self.source = source
        self.words = [(word, number) for number, line in enumerate(text.split("\n"), 1) for word in line.split()]
        self.last_line = max(1, text.rstrip().count("\n") + 1)
        self.at = 0
        self.tree = Hierarchy()
        self.open: list[int | EndSite] = []

    def parse(self) -> Hierarchy:
        word, line = self.next("HIERARCHY")
        if word.upper() != "HIERARCHY":
            raise self.source.error(line, f"not a BVH file: it begins with {shown(word)}, not HIERARCHY")
        word, line = self.next("ROOT")
        if word.upper() != "ROOT":
            raise self.source.error(line, f"expected ROOT, found {shown(word)}")
        self.begin_joint(line)
        while self.open:
            word, line = self.next("a closing brace")
            self.statement(word, line)
        if self.at < len(self.words):
            word, line = self.words[self.at]
            what = "a second root; a clip has one" if word.upper() == "ROOT" else f"{shown(word)} after the last brace"
            raise self.source.error(line, what)
        if self.tree.columns == 0:
            raise self.source.error(self.last_line, "no joint has a channel, so nothing can move")
        return self.tree

    def next(self, expected: str) -> tuple[str, int]:
        if self.at == len(self.words):
            still = f"; {self.describe(self.open[-1])} is still open" if self.open else ""
            raise self.source.error(self.last_line, f"the hierarchy ends where {expected} was expected{still}")
        self.at += 1
        return self.words[self.at - 1]

    def describe(self, node: "int | EndSite") -> str:
        if isinstance(node, EndSite):
            return f"the end site of line {node.line}"
        joint = self.tree.joints[node]
        return f"joint {shown(joint.name)} of line {joint.line}"

    def statement(self, word: str, line: int) -> None:
        node = self.open[-1]
        keyword = word.upper()
        if keyword == "}":
            self.close(line)
        elif keyword == "OFFSET":
            self.offset(line)
        elif keyword == "CHANNELS" and not isinstance(node, EndSite):
            self.channels(self.tree.joints[node], line)
        elif keyword == "JOINT" and not isinstance(node, EndSite):
            self.begin_joint(line)
        elif keyword == "END" and not isinstance(node, EndSite):
            self.begin_end_site(node, line)
        else:
            raise self.source.error(line, f"unexpected {shown(word)} in {self.describe(node)}")

    def rest_of_line(self, line: int) -> str:
        """The words up to the end of the line or a brace, as one name."""
        first = self.at
        while self.at < len(self.words) and self.words[self.at][1] == line and self.words[self.at][0] not in "{}":
            self.at += 1
        return printable(" ".join(word for word, _ in self.words[first : self.at]))

    def open_brace(self, after: str) -> None:
        word, line = self.next("an opening brace")
        if word != "{":
            raise self.source.error(line, f"expected an opening brace after {after}, found {shown(word)}")

    def begin_joint(self, line: int) -> None:
        name = self.rest_of_line(line)
        if not name:
            raise self.source.error(line, "a joint without a name")
        parent = self.open[-1] if self.open else -1
        assert isinstance(parent, int)
        self.open_brace(f"joint {shown(name)}")
        self.tree.joints.append(Joint(name, parent, line))
        self.open.append(len(self.tree.joints) - 1)

    def begin_end_site(self, parent: int, line: int) -> None:
        self.rest_of_line(line)
        self.open_brace("the end site")
        self.tree.ends.append(EndSite(parent, line))
        self.open.append(self.tree.ends[-1])

    def close(self, line: int) -> None:
        node = self.open.pop()
        item = node if isinstance(node, EndSite) else self.tree.joints[node]
        if item.offset is None:
            raise self.source.error(line, f"{self.describe(node)} closes without an OFFSET")
        if isinstance(item, Joint) and item.channels is None:
            item.channels = ()

    def offset(self, line: int) -> None:
        node = self.open[-1]
        item = node if isinstance(node, EndSite) else self.tree.joints[node]
        if item.offset is not None:
            raise self.source.error(line, f"{self.describe(node)} has a second OFFSET")
        x, y, z = (self.number("OFFSET needs three numbers") for _ in range(3))
        item.offset = (x, y, z)

    def number(self, need: str) -> float:
        word, line = self.next("a number")
        number = parse_number(word)
        if number is None:
            raise self.source.error(line, f"{need}; {why_no_number(word)}")
        return number

    def channels(self, joint: Joint, line: int) -> None:
        if joint.channels is not None:
            raise self.source.error(line, f"joint {shown(joint.name)} has a second CHANNELS")
        count, line = self.next("the number of channels")
        channels: list[str] = []
        while self.at < len(self.words) and self.words[self.at][0].lower() in _CHANNEL:
            channels.append(_CHANNEL[self.words[self.at][0].lower()])
            self.at += 1
        following, following_line = self.words[self.at] if self.at < len(self.words) else ("", line)
        if following.lower().endswith(("position", "rotation")):
            raise self.source.error(following_line, f"unknown channel {shown(following)}; known: {', '.join(CHANNELS)}")
        if count != str(len(channels)):
            raise self.source.error(line, f"CHANNELS declares {shown(count)} channels and lists {len(channels)}")
        if len(set(channels)) < len(channels):
            raise self.source.error(line, f"joint {shown(joint.name)} lists a channel twice")
        joint.channels = tuple(channels)


def find_motion(source: Source) -> int:
    """Offset of the keyword MOTION, which ends the hierarchy.

    Raises:
        FileError: there is none.
    """
    match = re.search(rb"^[ \t]*MOTION[ \t]*$", source.data, re.MULTILINE | re.IGNORECASE)
    if match:
        return match.start()
    # Without it, what is wrong with the hierarchy says more than that MOTION is missing.
    parse_hierarchy(source, len(source.data))
    raise FileError(f"{source.path}, line {source.line_at(len(source.data.rstrip()))}: the file ends without MOTION")
