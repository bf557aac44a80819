"""The physics' side of the feed: it puts frames into the mailbox, and looks after the process that takes them."""

import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from cape.live.feed.mailbox import LiveFrame, Mailbox
from cape.live.feed.sending import write_setup
from cape.record.moments import Shown
from motions.errors import UserError

NICER = 5  # by how much a viewer gives way to who computes
ENDING = 1.5  # [s] that the process has to end by itself
FOLDER = "/dev/shm"
OWN_GROUP: dict[str, Any] = {"process_group": 0} if os.name == "posix" else {}
"""Ctrl-C is for who computes. In a session of its own a process would not give way: Linux shares out time by these."""


class Sender:
    """A mailbox, and the process that sends what is in it to a viewer.

    Attributes:
        put: how many frames have been put there.
    """

    def __init__(
        self,
        *where: str,
        vertices: int,
        bones: int,
        morphs: int = 0,
        told: int = 0,
        module: str = "cape.live.feed.sending",
        hear: Callable[[str], None] | None = None,
    ) -> None:
        """Start the process.

        Args:
            where: what the module is given besides the mailbox: the URL of a viewer.
            vertices: that there is room for.
            bones: the same.
            morphs: the same.
            told: bytes of text, the same.
            module: what the process runs.
            hear: called with each line that it prints, on a thread of its own.

        Raises:
            UserError: the mailbox can't be made.
        """
        try:
            place = FOLDER if os.access(FOLDER, os.W_OK) else None
            self._folder = tempfile.TemporaryDirectory(prefix="cape-live-", dir=place, ignore_cleanup_errors=True)
            self._box = Mailbox.create(Path(self._folder.name) / "frames", vertices, bones, morphs, told)
        except OSError as error:
            raise UserError(f"can't show anything: no room for frames in memory: {error.strerror}") from error
        self.put, self._setup = 0, -1
        self._seen, self._seen_at = -1, time.monotonic()
        self._process = subprocess.Popen(
            [sys.executable, "-m", module, self._folder.name, *where],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL if hear is None else subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "RUST_LOG": "off"},
            **OWN_GROUP,
        )
        assert self._process.stdin is not None
        self._bell = self._process.stdin.fileno()
        os.set_blocking(self._bell, False)
        if hear is not None:
            threading.Thread(target=self._listen, args=(hear,), name="cape-page", daemon=True).start()

    def _listen(self, hear: Callable[[str], None]) -> None:
        lines = self._process.stdout
        if lines is not None:
            for line in lines:
                hear(line.decode(errors="replace"))

    @property
    def process(self) -> int:
        """Its number."""
        return self._process.pid

    @property
    def room(self) -> int:
        """For how many vertices there is room."""
        return self._box.vertices

    def show(self, shown: Shown) -> int:
        """Have frames from now on be of something else to see; gives the number of its set-up."""
        self._setup += 1
        write_setup(Path(self._folder.name), self._setup, shown)
        with suppress(OSError):
            (Path(self._folder.name) / f"setup-{self._setup - 3}").unlink()
        return self._setup

    def send(self, frame: LiveFrame) -> None:
        """Have a frame be the newest; returns at once, whatever the viewer does."""
        self._box.put(frame)
        self.put += 1
        # A full pipe has enough bytes to wake who reads them; a broken one is seen by `alive`.
        with suppress(OSError):
            os.write(self._bell, b".")

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

    @property
    def sent(self) -> int:
        """Number of the last frame that went on to the viewer, -1 for none."""
        return self._box.sent

    @property
    def stuck_s(self) -> float:
        """For how long no frame has gone on to the viewer [s]."""
        now, sent = time.monotonic(), self._box.sent
        if sent != self._seen:
            self._seen, self._seen_at = sent, now
        return now - self._seen_at

    def close(self) -> None:
        """End the process, which may be waiting for a viewer that does not read."""
        if self._process.stdin is not None:
            with suppress(OSError):
                self._process.stdin.close()
        try:
            self._process.wait(ENDING)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._folder.cleanup()


def be_nice(process: int) -> None:
    """Have a process give way to who computes, where there are not enough cores for both."""
    with suppress(OSError, AttributeError):
        os.setpriority(os.PRIO_PROCESS, process, os.getpriority(os.PRIO_PROCESS, process) + NICER)
