"""Compiling several pieces on all cores: in this process and in helpers, each of which takes the largest that is left.

Each piece is claimed by who makes a file of its name first. Helpers are new processes, as numba compiles on one thread
of a process at a time; they hand over what they made in the folder of compiled code, and without it there are none.
"""

import contextlib
import logging
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from cape.kernels import store
from cape.kernels.jit import Function
from cape.kernels.store import Request

log = logging.getLogger("cape.compiling")

WORTH = 3  # pieces for each helper at least: one takes a second to start

listener: Callable[[str, int, int], None] | None = None
"""Told of each piece that this process begins to compile: its name, how many were begun before, how many there are.

At the end, when all are there, it is called once more with no name.
"""


def compile_all(requests: Sequence[Request]) -> None:
    """Compile all requests, in this process and in helpers."""
    requests = sorted(requests, key=lambda request: -_extent(request.function, set()))
    with tempfile.TemporaryDirectory(prefix="cape-") as name:
        claims = Path(name)
        helpers = _start_helpers(requests, claims)
        try:
            _work(requests, claims, tell=True)
        finally:
            for helper in helpers:
                with contextlib.suppress(BaseException):
                    helper.wait()
    # What a helper claimed and did not finish.
    for request in store.missing(requests):
        store.make(request)
    if listener is not None:
        listener("", len(requests), len(requests))
    log.info("compiled %d pieces", len(requests))


def _work(requests: Sequence[Request], claims: Path, *, tell: bool) -> None:
    for request in requests:
        done = len(os.listdir(claims))
        if not _claim(claims, request):
            continue
        if tell and listener is not None:
            listener(request.name, done, len(requests))
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


def _start_helpers(requests: Sequence[Request], claims: Path) -> list["subprocess.Popen[bytes]"]:
    if store.folder() is None or not sys.executable:
        return []
    cores = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
    count = min(cores - 1, len(requests) // WORTH)
    helpers = []
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    for _ in range(count):
        with contextlib.suppress(OSError):
            helper = subprocess.Popen(
                [sys.executable, "-m", "cape.kernels.compiling", str(claims)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,  # what goes wrong there is done again here, and told
                env=environment,
            )
            assert helper.stdin is not None
            with contextlib.suppress(BrokenPipeError):
                helper.stdin.write(pickle.dumps(requests))
                helper.stdin.close()
            helpers.append(helper)
    return helpers


if __name__ == "__main__":
    _work(pickle.load(sys.stdin.buffer), Path(sys.argv[1]), tell=False)  # from the process that started this one
