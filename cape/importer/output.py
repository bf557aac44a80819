"""The viewer at the other end of standard output: the recording goes to it, and nothing else."""

from __future__ import annotations

import os
import select
import sys
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

NOTES = "/notes"


class Viewer:
    """A stream to the viewer; what is logged before `open` is kept until then."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        """Take a stream that has no sink yet."""
        self._stream = stream
        self._is_open = False

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
        """Hand over what has been logged."""
        self._stream.flush()

    def close(self) -> None:
        """End the recording in order, also one that holds nothing but notes."""
        if not self._is_open:
            self.open()
        self.flush()
        self._stream.disconnect()


def keep_from_text() -> None:
    """Have whatever prints to standard output print to standard error: a recording goes there."""
    sys.stdout = sys.stderr


def end_with_viewer() -> None:
    """End this process, quietly and at once, when nobody reads its standard output any more.

    Rerun's writer only logs that a pipe is closed, and whoever hands anything to it afterwards waits for ever.
    """
    if not hasattr(select, "poll"):
        return

    def watch() -> None:
        closed = select.poll()
        closed.register(1, 0)  # errors alone, which are told in any case
        closed.poll()
        os._exit(0)

    threading.Thread(target=watch, name="cape-viewer", daemon=True).start()
