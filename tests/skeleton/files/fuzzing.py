"""Files damaged at random, led by what of the readers they reach: a damaged file that reaches a new line is damaged on.

As of Zalewski's American Fuzzy Lop, in its plainest form; the same files in every run.
"""

import random
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

from tests.support.processes import ROOT

WORDS = (
    b"", b"0", b"-1", b"nan", b"inf", b"-inf", b"1e400", b"1e-400", b"9" * 400, b"1e" + b"9" * 50, b"\x00", b"\n",
    b" ", b"\xff\xfe", b"\xef\xbb\xbf", b"\x1b[31m", b"{", b"}", b"[", b"]", b'"', b"<", b"/>", b"&#0;", b",", b";",
    "é".encode(), b"(" * 50, b"[" * 500, b"1" * 5000, b"true", b"2147483648", b"18446744073709551616",
)  # fmt: skip
MOST_BYTES = 20_000


def fuzz(read: Callable[[bytes], object], seeds: Sequence[bytes], *, cases: int, expected: type[Exception]) -> int:
    """Give damaged files to a reader; only `expected` errors may come out. Tells how many lines were reached."""
    chance = random.Random(0)
    known, corpus = set[tuple[str, int]](), list(seeds)
    for seed in seeds:
        known |= _reached(read, seed, (expected,))
    for _ in range(cases):
        data = damaged(chance.choice(corpus), corpus, chance)
        try:
            reached = _reached(read, data, (expected,))
        except Exception as error:
            error.add_note(f"the file: {data[:2000]!r}")
            raise
        if not reached <= known:
            known |= reached
            corpus.append(data)
    return len(known)


def damaged(data: bytes, others: Sequence[bytes], chance: random.Random) -> bytes:
    """Damage a file in one to four places."""
    for _ in range(chance.randint(1, 4)):
        at = chance.randint(0, len(data))
        length = min(chance.choice((1, 1, 1, 4, 16, 100)), len(data) - at)
        match chance.randrange(8):
            case 0:
                data = data[:at] + data[at + length :]
            case 1:
                data = data[:at] + data[at : at + length] + data[at:]
            case 2:
                data = data[:at] + bytes(chance.randrange(256) for _ in range(length)) + data[at + length :]
            case 3:
                data = data[:at] + chance.choice(WORDS) + data[at:]
            case 4:
                data = data[:at] + chance.choice(WORDS) + data[at + length :]
            case 5:
                data = _with_number(data, chance)
            case 6:
                other = chance.choice(others)
                data = data[:at] + other[chance.randint(0, len(other)) :]
            case _:
                data = data[:at]
    return data[:MOST_BYTES]


def _with_number(data: bytes, chance: random.Random) -> bytes:
    """Another word in the place of one."""
    words = data.split(b" ")
    words[chance.randrange(len(words))] = chance.choice(WORDS)
    return b" ".join(words)


def _reached(read: Callable[[bytes], object], data: bytes, expected: tuple[type[Exception], ...]) -> set[Any]:
    """Lines of the packages that are reached; their order doesn't count."""
    lines: set[tuple[str, int]] = set()

    def local(frame: FrameType, event: str, _: object) -> Any:
        lines.add((frame.f_code.co_filename, frame.f_lineno))
        return local

    def enter(frame: FrameType, event: str, _: object) -> Any:
        return local if _is_own(frame.f_code.co_filename) else None

    before = sys.gettrace()
    sys.settrace(enter)
    try:
        read(data)
    except expected:
        pass
    finally:
        sys.settrace(before)
    return lines


def _is_own(file: str) -> bool:
    known = _OWN.get(file)
    if known is None:
        known = _OWN[file] = any(Path(file).is_relative_to(ROOT / name) for name in ("motions", "skeleton"))
    return known


_OWN: dict[str, bool] = {}
