"""A terminal beside a live run: its keys as they are pressed, and a line that tells how it goes."""

import asyncio
import os
import shutil
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress

from cape.live.live import Live
from motions.files import printable

PAINTED = 0.1  # [s] between looks at how it goes
CLEAR = "\r\x1b[K"
CALLED = {"c-i": "tab", "c-m": "enter", "c-h": "backspace"}  # keys that come as what they were on a teletype
GONE: tuple[type[Exception], ...] = (OSError,)  # what is raised by a terminal that has vanished
with suppress(ImportError):  # Windows
    import termios

    GONE = OSError, termios.error


class Terminal:
    """What is read and painted, as far as this is a terminal."""

    def __init__(self, live: Live, press: Callable[[str], bool], help_lines: Callable[[], Sequence[str]]) -> None:
        """Take the keys to what they do, and what "?" shows."""
        self._live, self._press, self._help = live, press, help_lines
        self._paints = sys.stderr.isatty() and os.environ.get("TERM", "") != "dumb"
        self._said = ""

    def run(self, watch: Callable[[], None]) -> None:
        """Read keys until the run ends, also where the terminal vanishes; `watch` is called ten times a second."""
        try:
            asyncio.run(self._run(watch))
        except GONE:
            self._live.end("the terminal was closed")

    async def _run(self, watch: Callable[[], None]) -> None:
        if not sys.stdin.isatty():
            await self._paint_on(watch, lambda: False)
            return
        from prompt_toolkit.input import create_input
        from prompt_toolkit.keys import Keys

        keys = create_input()

        def read() -> None:
            for key in keys.read_keys():
                self._take(key.key.value if isinstance(key.key, Keys) else key.key)

        with keys.raw_mode(), keys.attach(read):
            self.show(["? tells the keys, q ends"])
            await self._paint_on(watch, lambda: keys.closed)
        self._put(CLEAR)

    async def _paint_on(self, watch: Callable[[], None], closed: Callable[[], bool]) -> None:
        while self._live.running:
            watch()
            if closed():
                self._live.end("the terminal was closed")
            self._paint()
            await asyncio.sleep(PAINTED)

    def _take(self, key: str) -> None:
        if key == "?":
            self.show(self._help())
        elif not self._press(key) and key.isprintable():
            self._live.say(f"no key {CALLED.get(key, key)}: ? tells which there are")

    def show(self, lines: Sequence[str]) -> None:
        """Write lines above the one that is painted."""
        self._put((CLEAR if self._paints else "") + "".join(f"{printable(line)}\r\n" for line in lines))
        self._paint()

    def _paint(self) -> None:
        status = self._live.status
        if self._paints:
            width = shutil.get_terminal_size((100, 24)).columns
            self._put(CLEAR + printable(status.line(width)))
        elif status.message and status.message != self._said:
            self._said = status.message
            self._put(f"{printable(status.message)}\n")

    def _put(self, text: str) -> None:
        sys.stderr.write(text)
        sys.stderr.flush()
