"""Standard output and error that may refuse what is printed: a full device, a closed pipe, nothing at all."""

import io
import os
import sys

READER_GONE = 141  # the shells' status for what writes to a pipe that nobody reads any more


class ReaderGone(SystemExit):
    """Nobody reads standard output any more: the command ends without a word."""

    def __init__(self):
        """A thread that raises it ends alone."""
        super().__init__(READER_GONE)


class Stream(io.FileIO):
    """What a standard stream writes to. The first text that it can't take is lost, with all that follows.

    The command goes on: what it computes and writes to files is worth more than what it prints.

    Attributes:
        failure: why it did not take all, None while it did.
    """

    def __init__(self, number: int, *, ends: bool):
        """For a file descriptor that is open; `ends` to raise `ReaderGone` once nobody reads it."""
        super().__init__(number, "w", closefd=False)
        self.failure: OSError | None = None
        self._ends = ends

    def write(self, text, /) -> int:
        """Write bytes; gives how many are done with."""
        if self.failure is None:
            try:
                return super().write(text)
            except OSError as error:
                self.failure = error
                if self._ends and isinstance(error, BrokenPipeError):
                    raise ReaderGone from None
        return memoryview(text).nbytes


def guard() -> Stream:
    """Have `sys.stdout` and `sys.stderr` write to a `Stream` each; gives standard output's."""
    out, sys.stdout = _guarded(sys.stdout, 1, ends=True)
    _, sys.stderr = _guarded(sys.stderr, 2, ends=False)
    return out


def _guarded(stream, number: int, *, ends: bool) -> tuple[Stream, io.TextIOWrapper]:
    if stream is None:  # closed: a file that is opened must not get its number and be printed into
        os.dup2(os.open(os.devnull, os.O_RDONLY), number)
        stream = open(number, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    raw = Stream(stream.fileno(), ends=ends)
    if os.name == "nt" and stream.isatty():  # takes text by other means, and all of it
        return raw, stream
    stream.flush()
    text = io.TextIOWrapper(
        raw if stream.write_through else io.BufferedWriter(raw),  # pyright: ignore[reportArgumentType]
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
    return raw, text
