"""What is compiled, told on standard error: code that this machine lacks takes seconds, once."""

import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from cape.kernels import compiling

ERASE = "\r\x1b[K"  # to the start of a terminal's line, and nothing behind it


class Telling:
    """Tells what is compiled: on a terminal in one line that changes, elsewhere at the start and at the end."""

    def __init__(self) -> None:
        """Nothing is being compiled."""
        self._begun = 0.0
        self._open = False  # a line on the terminal that more is written over
        self._bar: Callable[[str], None] | None = None

    def __call__(self, name: str, begun: int, total: int) -> None:
        """Tell of a piece, as `kernels.compiling.listener`."""
        if not self._begun:
            self._begun = time.perf_counter()
            self._begin(name, total)
        if not name:
            seconds, self._begun = time.perf_counter() - self._begun, 0.0
            self._end(f"compiled {_pieces(total)} in {seconds:.{0 if seconds >= 10.0 else 1}f} s")
        elif self._bar is not None:
            self._bar(f"compiling, once: {begun + 1} of {total}, {name}")
        elif sys.stderr.isatty():
            self._open = True
            _write(ERASE + _line(name, begun, total))

    @contextmanager
    def within(self, show: Callable[[str], None]) -> Iterator[None]:
        """Tell it in a bar that is on the terminal: `show` gets a text, an empty one when all is compiled."""
        self._bar = show if sys.stderr.isatty() else None
        try:
            yield
        finally:
            self._bar = None

    def close(self) -> None:
        """End a line that is still open, as where compiling was interrupted."""
        if self._open:
            self._open = False
            _write("\n")

    def _begin(self, name: str, total: int) -> None:
        if name and not sys.stderr.isatty():
            _write(_line(name, 0, total) + "\n")

    def _end(self, text: str) -> None:
        if self._bar is not None:
            self._bar("")
        _write((ERASE if self._open else "") + text + "\n")
        self._open = False


class _Lines(logging.Handler):
    """Warnings, a line each, on what is standard error at the time."""

    def emit(self, record: logging.LogRecord) -> None:
        telling.close()
        _write(record.getMessage() + "\n")


def tell() -> None:
    """Tell from now on what this process compiles, and what is wrong with where code is kept."""
    compiling.listener = telling
    compiling.log.addHandler(_Lines(logging.WARNING))


def _line(name: str, begun: int, total: int) -> str:
    return f"compiling {_pieces(total)} of code for this machine, once: {begun + 1} of {total}, {name}"


def _pieces(total: int) -> str:
    return f"{total} piece{'' if total == 1 else 's'}"


def _write(text: str) -> None:
    sys.stderr.write(text)
    sys.stderr.flush()


telling = Telling()
