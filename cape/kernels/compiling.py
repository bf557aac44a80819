"""Compiling several pieces on all cores: in helpers, each of which takes the piece that suits it best of what is left.

Each piece is claimed by who makes a file of its name first. Helpers are processes of their own, as numba compiles on
one thread of a process at a time; they hand over what they made in the folder of compiled code. This process compiles
along where numba is loaded already, or where there is no such folder, and what no helper could make.
"""

import contextlib
import logging
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path

from cape.kernels import store
from cape.kernels.jit import Function
from cape.kernels.store import Request

log = logging.getLogger("cape.compiling")

WORTH = 3  # pieces for each helper at least: the first takes a second to start, and what they share each compiles

POLLED = 0.02  # s between looks at how far helpers are

ASIDE = "cape-compiling"  # name of a thread that compiles a piece

Listener = Callable[[str, int, int], None]

listener: Listener | None = None
"""Told of each piece that is begun: its name, how many were begun before, how many there are.

At the end, when all are there, it is called once more with no name.
"""


def compile_all(requests: Sequence[Request]) -> None:
    """Compile all requests."""
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
                _end(helper)
    # What no helper could make.
    for request in store.missing(requests):
        _make(request)
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
    mine: set[str] = set()
    while True:
        claimed = set(os.listdir(claims))
        left = [request for request in requests if request.file not in claimed]
        if not left:
            return
        own = _functions(request for request in requests if request.file in mine)
        others = _functions(request for request in requests if request.file in claimed - mine) - own
        request = max(left, key=lambda request: _fit(request, own, others))
        if not _claim(claims, request):
            continue
        mine.add(request.file)
        if begun is not None:
            begun.look()
        log.info("compiling %s, %d of %d", request.name, len(claimed) + 1, len(requests))
        _make(request)


def _make(request: Request) -> None:
    """Compile a piece, on a thread of its own where this is the main thread, which hears of an interrupt at once.

    LLVM hears of none, and numba would take it for a fault of the code: the piece at hand is then finished behind it.
    """
    if threading.current_thread() is not threading.main_thread():
        store.make(request)
        return
    failed: list[BaseException] = []

    def make() -> None:
        try:
            store.make(request)
        except BaseException as error:
            failed.append(error)

    aside = threading.Thread(target=make, name=ASIDE)
    aside.start()
    while aside.is_alive():
        aside.join(POLLED)
    if failed:
        raise failed[0]


def is_going_on() -> bool:
    """Tell whether a piece is still being compiled that nobody waits for any more."""
    return any(thread.name == ASIDE for thread in threading.enumerate())


def _fit(request: Request, own: frozenset[Function], others: frozenset[Function]) -> tuple[int, int]:
    """How well a piece suits who has compiled some functions, while others do others; then, how large it is.

    What pieces share is compiled once by each process, so that pieces which share much belong together.
    """
    needed = _needed(request.function)
    return _length(needed & own) - _length(needed & others), _length(needed)


def _functions(requests: Iterable[Request]) -> frozenset[Function]:
    return frozenset[Function]().union(*(_needed(request.function) for request in requests))


@cache
def _needed(function: Function) -> frozenset[Function]:
    """A function and all that it calls."""
    known: set[Function] = set()
    waiting = [function]
    while waiting:
        function = waiting.pop()
        if function in known:
            continue
        known.add(function)
        code = function.python.__code__
        called = [function.python.__globals__.get(name) for name in code.co_names]
        called += [cell.cell_contents for cell in function.python.__closure__ or ()]
        waiting += [each for each in called if isinstance(each, Function)]
    return frozenset(known)


def _length(functions: Iterable[Function]) -> int:
    """How long compiling takes, roughly: the length of the bytecode."""
    return sum(len(function.python.__code__.co_code) for function in functions)


def _claim(claims: Path, request: Request) -> bool:
    try:
        (claims / request.file).touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def _start_helpers(requests: Sequence[Request], claims: Path, *, count: int) -> list["subprocess.Popen[bytes]"]:
    """Start so many processes that help; where processes can be forked the first one forks the others."""
    count = min(count, len(requests) // WORTH)
    if count < 1 or store.folder() is None or not sys.executable:
        return []
    forks = hasattr(os, "fork")
    command = [sys.executable, "-c", _HELPER, str(claims), str(count if forks else 1), str(store.ROOT)]
    helpers = []
    for _ in range(1 if forks else count):
        with contextlib.suppress(OSError):
            helper = subprocess.Popen(
                [*command, *filter(None, sys.path)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,  # what goes wrong there is done again here, and told
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},  # a process with threads is not forked well
                start_new_session=forks,
            )
            assert helper.stdin is not None
            with contextlib.suppress(BrokenPipeError):
                helper.stdin.write(pickle.dumps([pickle.dumps(request) for request in requests]))
                helper.stdin.close()
            helpers.append(helper)
    return helpers


def _end(helper: "subprocess.Popen[bytes]") -> None:
    """End a helper, and those that it has forked."""
    with contextlib.suppress(ProcessLookupError, PermissionError):  # the latter, on macOS, where all have ended
        if hasattr(os, "killpg"):
            os.killpg(helper.pid, signal.SIGKILL)
        else:
            helper.kill()
    helper.wait()


# Packages stand for themselves without what they export, and scipy, which numba looks for to multiply matrices, is not
# found: a helper needs neither, and starts in half the time.
_HELPER = """
import sys, types
claims, count, root = sys.argv[1:4]
sys.path[:] = sys.argv[4:]
sys.modules["scipy"] = None
for name in ("cape", "skeleton"):
    package = sys.modules[name] = types.ModuleType(name)
    package.__path__ = [f"{root}/{name}"]
from cape.kernels import compiling
compiling.help_out(claims, int(count))
"""


def help_out(claims: str, count: int) -> None:
    """Compile what the process that started this one wants, as far as it can be found from here, in `count` forks."""
    from cape.kernels import compiler  # noqa: F401  (once, before forking)

    requests = []
    for text in pickle.load(sys.stdin.buffer):  # from that process
        with contextlib.suppress(Exception):
            requests.append(pickle.loads(text))
    forked = []
    for _ in range(count - 1):
        child = os.fork()
        if child == 0:
            forked = []
            break
        forked.append(child)
    _work(requests, Path(claims))
    for child in forked:
        os.waitpid(child, 0)
