"""Compiling several pieces on all cores: in helpers, each of which takes the largest piece that is left.

Each piece is claimed by who makes a file of its name first. Helpers are new processes, as numba compiles on one thread
of a process at a time; they hand over what they made in the folder of compiled code. This process compiles along where
numba is loaded already, or where there is no such folder, and what no helper could make.
"""

import contextlib
import logging
import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from cape.kernels import store
from cape.kernels.jit import Function
from cape.kernels.store import Request

log = logging.getLogger("cape.compiling")

WORTH = 3  # pieces for each helper at least: one takes a second to start

POLLED = 0.02  # s between looks at how far helpers are

Listener = Callable[[str, int, int], None]

listener: Listener | None = None
"""Told of each piece that is begun: its name, how many were begun before, how many there are.

At the end, when all are there, it is called once more with no name.
"""


def compile_all(requests: Sequence[Request]) -> None:
    """Compile all requests."""
    requests = sorted(requests, key=lambda request: -_extent(request.function, set()))
    with tempfile.TemporaryDirectory(prefix="cape-") as name:
        claims = Path(name)
        begun = _Begun(requests, claims)
        alongside = "numba" in sys.modules
        helpers = _start_helpers(requests, claims, count=_cores() - alongside)
        try:
            if alongside or not helpers:
                _work(requests, claims, begun)
            while any(helper.poll() is None for helper in helpers):
                begun.look()
                time.sleep(POLLED)
            begun.look()
        finally:
            for helper in helpers:
                helper.kill()
                helper.wait()
    # What no helper could make.
    for request in store.missing(requests):
        store.make(request)
    if listener is not None:
        listener("", len(requests), len(requests))
    log.info("compiled %d pieces", len(requests))


class _Begun:
    """The pieces that were begun, by whomever: the listener is told of each once."""

    def __init__(self, requests: Sequence[Request], claims: Path) -> None:
        self._names = {request.file: request.name for request in requests}
        self._claims = claims
        self._told: set[str] = set()

    def look(self) -> None:
        """Tell of what was begun since the last look."""
        for file in sorted(set(os.listdir(self._claims)) - self._told):
            if listener is not None:
                listener(self._names[file], len(self._told), len(self._names))
            self._told.add(file)


def _work(requests: Sequence[Request], claims: Path, begun: _Begun | None = None) -> None:
    for request in requests:
        done = len(os.listdir(claims))
        if not _claim(claims, request):
            continue
        if begun is not None:
            begun.look()
        log.info("compiling %s, %d of %d", request.name, done + 1, len(requests))
        store.make(request)


def _extent(function: Function, known: set[Function]) -> int:
    """How long compiling takes, roughly: the length of the bytecode of a function and of all that it calls."""
    if function in known:
        return 0
    known.add(function)
    python = function.python
    called = [python.__globals__.get(name) for name in python.__code__.co_names]
    called += [cell.cell_contents for cell in python.__closure__ or ()]
    return len(python.__code__.co_code) + sum(_extent(each, known) for each in called if isinstance(each, Function))


def _claim(claims: Path, request: Request) -> bool:
    try:
        (claims / request.file).touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def _start_helpers(requests: Sequence[Request], claims: Path, *, count: int) -> list["subprocess.Popen[bytes]"]:
    if store.folder() is None or not sys.executable:
        return []
    helpers = []
    for _ in range(min(count, len(requests) // WORTH)):
        with contextlib.suppress(OSError):
            helper = subprocess.Popen(
                [sys.executable, "-c", _HELPER, str(claims), str(store.ROOT), *filter(None, sys.path)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,  # what goes wrong there is done again here, and told
            )
            assert helper.stdin is not None
            with contextlib.suppress(BrokenPipeError):
                helper.stdin.write(pickle.dumps([pickle.dumps(request) for request in requests]))
                helper.stdin.close()
            helpers.append(helper)
    return helpers


# Packages stand for themselves without what they export, and scipy, which numba looks for to multiply matrices, is not
# found: a helper needs neither, and starts in half the time.
_HELPER = """
import sys, types
claims, root = sys.argv[1:3]
sys.path[:] = sys.argv[3:]
sys.modules["scipy"] = None
for name in ("cape", "skeleton"):
    package = sys.modules[name] = types.ModuleType(name)
    package.__path__ = [f"{root}/{name}"]
from cape.kernels import compiling
compiling.help_out(claims)
"""


def help_out(claims: str) -> None:
    """Compile what the process that started this one wants, as far as it can be found from here."""
    requests = []
    for text in pickle.load(sys.stdin.buffer):  # from that process
        with contextlib.suppress(Exception):
            requests.append(pickle.loads(text))
    _work(requests, Path(claims))
