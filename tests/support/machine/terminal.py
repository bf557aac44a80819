"""A command in a pseudo-terminal, its keys, and how soon they are answered."""

import os
import pty
import re
import select
import subprocess
import sys
import time
from bisect import bisect
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from cape.results.take import Take
from tests.support.command import CAPE

LONG = 120.0  # s that something may take on a machine that is busy
READY = r"\? tells the keys"
TURNED = 0.015  # rad in a frame, more than a character sways that stands
STAMPED = """
import sys, time
import cape.live.live as live
from cape.cli import main

stamps, advance = open("stamps", "w", buffering=1), live.Live._advance

def noted(self):
    stamps.write(f"{time.monotonic()}\\n")
    advance(self)

live.Live._advance = noted
main()
"""


class Terminal:
    """A command in a terminal of its own."""

    def __init__(self, command: Sequence[str], *, folder: Path):
        self.folder, self.said = folder, ""
        self._end, own = pty.openpty()
        self.process = subprocess.Popen(
            [*command],
            cwd=folder,
            stdin=own,
            stdout=subprocess.PIPE,
            stderr=own,
            start_new_session=True,
            env={**os.environ, "TERM": "xterm"},
        )
        os.close(own)

    def wait_for(self, pattern: str) -> re.Match[str]:
        """Wait until something is said."""
        end = time.monotonic() + LONG
        while (found := re.search(pattern, self.said)) is None:
            assert time.monotonic() < end, self.said[-2000:]
            assert self._read(), self.said[-2000:]
        return found

    def reach(self, frame: int) -> int:
        """Wait until so many frames are done; gives how many."""
        end = time.monotonic() + LONG
        while True:
            told = re.findall(r"frame (\d+) ", self.said)
            if told and int(told[-1]) >= frame:
                return int(told[-1])
            assert time.monotonic() < end, self.said[-2000:]
            assert self._read(), self.said[-2000:]

    def press(self, keys: str) -> float:
        """Type; what is said from here on counts. Tells when that was, by the monotonic clock [s]."""
        while select.select([self._end], [], [], 0.0)[0] and self._read():
            pass
        self.said = ""
        now = time.monotonic()
        os.write(self._end, keys.encode())
        return now

    def hang_up(self) -> None:
        """Close the terminal."""
        os.close(self._end)
        self._end = -1

    def ended(self) -> int:
        """Wait for the end; gives the status."""
        end = time.monotonic() + LONG
        while self.process.poll() is None and time.monotonic() < end:
            if self._end >= 0:
                self._read()
            else:
                time.sleep(0.05)
        assert self.process.stdout is not None
        self.printed = self.process.stdout.read().decode()
        return self.process.wait(1.0)

    def _read(self) -> bool:
        if not select.select([self._end], [], [], 0.1)[0]:
            return self.process.poll() is None
        with suppress(OSError):
            data = os.read(self._end, 65536).decode(errors="replace")
            self.said += data
            return bool(data)
        return False

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        if self._end >= 0:
            os.close(self._end)


@contextmanager
def terminal(*arguments: str, folder: Path, command: Sequence[str] = (str(CAPE),)) -> Iterator[Terminal]:
    """`cape live` with some arguments, and without a viewer; `command` is what else is `cape`."""
    run = Terminal([*command, "live", "--no-viewer", *arguments], folder=folder)
    try:
        yield run
    finally:
        run.close()


def stamped() -> list[str]:
    """A command that is `cape`, and writes to a file `stamps` when each frame of a live run begins [s]."""
    return [sys.executable, "-c", STAMPED]


def answers(take: Take, stamps: Path, pressed: Sequence[float]) -> list[tuple[int, float]]:
    """How a character has answered keys that turn it, and were pressed at some times [s], one after the other.

    Returns:
        For each in how many frames that began since, 1 where in the first one; and after how many seconds that began.
    """
    begun = [float(line) for line in stamps.read_text().split()]
    w, x, y, z = take.bones.rotations_wxyz[:, take.bones.names.index(take.bones.roles["pelvis"])].T
    heading = np.unwrap(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
    turned, found = np.abs(np.diff(heading)) > TURNED, []  # the first of these leads to the frame that began first
    for at in pressed:
        next_one = bisect(begun, at)
        assert turned[next_one:].any()
        answered = next_one + int(np.argmax(turned[next_one:]))
        found.append((answered - next_one + 1, begun[answered] - at))
    return found
