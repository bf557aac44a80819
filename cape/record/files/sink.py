"""A file that Rerun writes through a pipe, so that a full disk is an error, and nobody waits for it.

Rerun's own writer only logs that a disk is full, and whoever hands anything to it afterwards may wait for ever.
"""

from __future__ import annotations

import os
import select
import shutil
import struct
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

AT_ONCE = 2**20  # [bytes]
BETWEEN_LOOKS = 1e-4  # [s]


class Sink:
    """Where a stream goes: a thread copies it into a file, and throws away what the file does not take.

    Attributes:
        path: of the file.
        written: how much is in it [bytes].
        error: why it takes no more, None while it does.
    """

    def __init__(self, path: Path) -> None:
        """A file that is there, and empty.

        Raises:
            OSError: it can't be opened.
        """
        self.path, self.written = path, 0
        self.error: OSError | None = None
        self._file = path.open("wb", buffering=0)
        self._out, self._in = os.pipe()
        self._idle = threading.Event()
        self._copying = threading.Thread(target=self._copy, name="cape-recording", daemon=True)

    def open(self, stream: rr.RecordingStream, blueprint: rrb.Blueprint) -> None:
        """Lead a stream here, with the layout that it opens with."""
        through = f"/dev/fd/{self._in}"
        if os.path.exists(through):
            self._copying.start()
            stream.save(through, default_blueprint=blueprint)
        else:
            stream.save(self.path, default_blueprint=blueprint)

    def settle(self) -> None:
        """Wait until the file has all that a stream has handed over, or does not take it."""
        if self._copying.is_alive():
            while _unread(self._out):
                time.sleep(BETWEEN_LOOKS)
            # What is no longer in the pipe was taken from it by a thread that was not idle then.
            self._idle.wait()

    def close(self) -> None:
        """Wait for the rest of a stream that was disconnected; may be repeated."""
        if self._in >= 0:
            os.close(self._in)
            self._in = -1
            if self._copying.ident is not None:
                self._copying.join()
            os.close(self._out)
            self._file.close()

    def _copy(self) -> None:
        while some := self._some_more():
            self._keep(some)
        self._idle.set()

    def _some_more(self) -> bytes:
        self._idle.set()
        select.select([self._out], [], [])
        self._idle.clear()
        return os.read(self._out, AT_ONCE)

    def _keep(self, some: bytes) -> None:
        rest = memoryview(some)
        try:
            while self.error is None and len(rest):
                count = self._file.write(rest)
                self.written += count
                rest = rest[count:]
        except OSError as error:
            self.error = error


def _unread(pipe: int) -> int:
    """How much is in a pipe [bytes]."""
    import fcntl
    import termios

    return struct.unpack("i", fcntl.ioctl(pipe, termios.FIONREAD, bytes(4)))[0]


def room_at(path: Path, *, written: int = 0) -> int:
    """How much more a file may hold of which so much is written [bytes]: what the disk has, and this process may write.

    Raises:
        OSError: there is no such folder.
    """
    free = shutil.disk_usage(path.parent).free
    if sys.platform == "win32":
        return free
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    return free if limit == resource.RLIM_INFINITY else min(free, limit - written)
