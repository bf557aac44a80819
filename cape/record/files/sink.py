"""A file that Rerun writes through a pipe, so that a full disk is an error, and nobody waits for it.

Rerun's own writer only logs that a disk is full, and whoever hands anything to it afterwards may wait for ever.
"""

from __future__ import annotations

import os
import shutil
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

AT_ONCE = 2**20  # [bytes]


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
        self._copying = threading.Thread(target=self._copy, name="cape-recording", daemon=True)

    def open(self, stream: rr.RecordingStream, blueprint: rrb.Blueprint) -> None:
        """Lead a stream here, with the layout that it opens with."""
        self._copying.start()
        through = f"/dev/fd/{self._in}"
        stream.save(through if os.path.exists(through) else self.path, default_blueprint=blueprint)

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
        while some := os.read(self._out, AT_ONCE):
            rest = memoryview(some)
            try:
                while self.error is None and len(rest):
                    count = self._file.write(rest)
                    self.written += count
                    rest = rest[count:]
            except OSError as error:
                self.error = error


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
