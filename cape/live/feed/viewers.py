"""The Rerun viewer as a window of its own, or as a page in a browser: a process that ends with this one."""

from __future__ import annotations

import ipaddress
import os
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from cape.live.feed.sender import OWN_GROUP, be_nice
from motions.errors import UserError, ValueRangeError

LOOPBACK = "127.0.0.1"
WAYS = ("window", "web", "page", "none")
STARTING, ENDING = 20.0, 3.0  # [s] to wait for it
NO_DISPLAY = "there is no display here for a window: --web shows it in a browser, --no-viewer nowhere"
MEMORY = "1GB"  # that a viewer keeps of what it was sent
SERVED = "64MB"  # the same of what it hands on to browsers


class ViewerProcess:
    """A running viewer.

    Attributes:
        url: where it takes recordings.
        page: where a browser finds it; None for a window.
    """

    def __init__(self, *, web: bool = False, bind: str = LOOPBACK, arguments: tuple[str, ...] = ()) -> None:
        """Start it, and wait until it listens.

        Args:
            web: for browsers, instead of a window.
            bind: the address to listen on.
            arguments: more of the viewer's own.

        Raises:
            ValueRangeError: that is no address of this machine.
            UserError: it does not start; the text says why.
        """
        self._log = tempfile.NamedTemporaryFile(prefix="cape-viewer-")  # noqa: SIM115  (closed with the viewer)
        port, page = free_port(bind), free_port(bind)
        ways = ["--serve-web", "--web-viewer-port", str(page), "--server-memory-limit", SERVED] if web else []
        self._process = subprocess.Popen(
            [str(program()), "--bind", bind, "--port", str(port), "--memory-limit", MEMORY, "--hide-welcome-screen",
             *ways, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=self._log,
            env={"RUST_LOG": "warn", **os.environ},
            **OWN_GROUP,
        )  # fmt: skip
        be_nice(self._process.pid)
        named = address(bind)
        reached = named.strip("[]")
        self.url = f"rerun+http://{named}:{port}/proxy"
        self.page = f"http://{named}:{page}/?url=rerun%2Bhttp%3A%2F%2F{named}%3A{port}%2Fproxy" if web else None
        until = time.monotonic() + STARTING
        while not all(_listens(reached, each) for each in ([port, page] if web else [port])):
            if self._process.poll() is not None or time.monotonic() > until:
                said = self._said()
                self.close()
                raise UserError(f"the Rerun viewer does not start: {said}")
            time.sleep(0.02)

    @property
    def process(self) -> int:
        """Its number."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it is still there."""
        return self._process.poll() is None

    @property
    def failure(self) -> str:
        """Why it has ended by itself, empty where it runs, or was closed."""
        return self._said() if (self._process.poll() or 0) > 0 else ""

    def close(self) -> None:
        """End it, also where it is stopped."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(ENDING)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        with suppress(OSError):
            self._log.close()

    def _said(self) -> str:
        lines = Path(self._log.name).read_text(errors="replace").splitlines()
        if any("DISPLAY" in line for line in lines):
            return NO_DISPLAY
        telling = [line for line in lines if "rror" in line or "panicked" in line] or lines
        return telling[0].strip()[:200] if telling else "it says nothing"


def program() -> Path:
    """The viewer itself: the command `rerun` is a wrapper that passes no signals on.

    Raises:
        UserError: it is missing.
    """
    import rerun_cli

    path = Path(rerun_cli.__file__).parent / ("rerun.exe" if sys.platform == "win32" else "rerun")
    if not path.is_file():
        raise UserError(f"the Rerun viewer is missing at {path}: pip install --force-reinstall rerun-sdk")
    return path


def require_viewing(viewing: str) -> None:
    """Tell whether a run can be seen so.

    Raises:
        ValueRangeError: that is no way to see it, and no URL either.
    """
    if viewing not in WAYS and "://" not in viewing:
        known = ", ".join(f'"{way}"' for way in WAYS)
        raise ValueRangeError(
            f"viewer is {known}, or a URL such as rerun+http://{LOOPBACK}:9876/proxy, not {viewing!r}"
        )


def is_loopback(bind: str) -> bool:
    """Tell whether an address is reached from this machine alone.

    Raises:
        ValueRangeError: it is no address.
    """
    try:
        return ipaddress.ip_address(bind).is_loopback
    except ValueError:
        raise ValueRangeError(f"--bind takes an IP address, such as {LOOPBACK} or 0.0.0.0, not {bind!r}") from None


def address(bind: str) -> str:
    """What to call an address in a URL, as reached from this machine."""
    reached = LOOPBACK if ipaddress.ip_address(bind).is_unspecified else bind
    return f"[{reached}]" if ":" in reached else reached


def free_port(bind: str = LOOPBACK) -> int:
    """A port that nothing listens on at an address of this machine.

    Raises:
        ValueRangeError: it is none.
    """
    family = socket.AF_INET6 if ":" in bind else socket.AF_INET
    try:
        with socket.socket(family) as taken:
            taken.bind((bind, 0))
            return taken.getsockname()[1]
    except OSError as error:
        raise ValueRangeError(f"can't listen on {bind}: {error.strerror}") from error


def _listens(address: str, port: int) -> bool:
    with suppress(OSError), socket.create_connection((address, port), timeout=0.5):
        return True
    return False
