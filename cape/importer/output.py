"""The viewer at the other end of standard output: the recording goes to it, and nothing else."""

from __future__ import annotations

import os
import select
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

NOTES = "/notes"
PATIENCE = 0.5  # s between two looks whether a viewer that takes nothing is still there


class Viewer:
    """A stream to the viewer; what is logged before `open` is kept until then."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        """Take a stream that has no sink yet."""
        self._stream = stream
        self._is_open = False
        self._closed = select.poll() if hasattr(select, "poll") else None
        if self._closed is not None:
            self._closed.register(1, 0)  # of a pipe: POLLERR, as soon as nobody reads it

    def open(self, blueprint: rrb.Blueprint | None = None) -> None:
        """Begin to write to standard output."""
        self._stream.stdout(default_blueprint=blueprint)
        self._is_open = True

    def note(self, text: str, *, level: str = "INFO", frame: int = 0, time: float = 0.0) -> None:
        """Put a line into the notes, at a frame and its time [s]; what goes to standard error is shown nowhere."""
        import rerun as rr

        self._stream.set_time("frame", sequence=frame)
        self._stream.set_time("time", duration=time)
        self._stream.log(NOTES, rr.TextLog(text, level=level))
        self._stream.reset_time()

    def flush(self) -> None:
        """Hand over what has been logged.

        Raises:
            BrokenPipeError: nobody reads it any more.
        """
        while True:
            if self._closed is not None and self._closed.poll(0):
                raise BrokenPipeError
            try:
                # A pipe that is closed in the meantime ends the thread that writes, for which this would wait for ever.
                self._stream.flush(timeout_sec=PATIENCE)
                return
            except RuntimeError:
                continue  # a slow viewer, or a closed one

    def close(self) -> None:
        """End the recording in order, also one that holds nothing but notes.

        Raises:
            BrokenPipeError: nobody reads it any more.
        """
        if not self._is_open:
            self.open()
        self.flush()
        self._stream.disconnect()


def keep_from_text() -> None:
    """Have whatever prints to standard output print to standard error: a recording goes there."""
    sys.stdout = sys.stderr


def leave() -> None:
    """End this process at once: threads that would still write to a closed pipe complain about it."""
    sys.stderr.flush()
    os._exit(0)
