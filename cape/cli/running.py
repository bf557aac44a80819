"""A simulation as a command runs it: with a bar on a terminal, and warnings as they come."""

import importlib
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Sequence
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from cape.cli.compiling_told import telling
from cape.cli.words import gathered
from cape.results.so_far import SoFar
from cape.results.take import Take
from cape.run.auto import Auto
from cape.run.simulate import SlowWarning, simulate
from cape.run.simulation import DEFAULT_CUTS
from cape.run.whereabouts import Diverged
from cape.scene.jumps import Cuts
from cape.scene.scene import Scene
from cape.solvers import Solver
from motions.errors import ValueRangeError
from motions.files import printable
from skeleton import BoneTrack


class Moving(Protocol):
    """What moves: its name, the motion of its bones, and what had to be decided about both, a sentence each."""

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def track(self) -> BoneTrack: ...  # noqa: D102
    @property
    def decisions(self) -> tuple[str, ...]: ...  # noqa: D102


BEFORE = "putting the cape on"
RECORDER = ("rerun.blueprint", "pyarrow.compute")  # what recordings are written by, slow to import


def simulated(
    scene: Scene,
    who: Moving,
    *,
    solver: Solver | Auto | None = None,
    cuts: Cuts | None = DEFAULT_CUTS,
    check_steps: bool = False,
    loop: bool = False,
    on_frame: Callable[[int, SoFar], None] | None = None,
    modules: Sequence[str] = (),
) -> Take:
    """Simulate, telling on standard error what was decided about the motion and how far it has got.

    The `modules` will be needed afterwards: they are imported meanwhile.

    Raises:
        ValueRangeError: the cape can't be put on.
    """
    console = Console(stderr=True)
    for told in gathered(printable(f"{who.name}: {decision}") for decision in who.decisions):
        console.print(told, style="dim", highlight=False, markup=False, soft_wrap=True)
    with _told(console), _loading(modules) as begin, _progress(console) as advance:

        def progress(done: int, of: int) -> None:
            begin()
            advance(done, of)

        try:
            return simulate(
                scene, who.track, solver=solver, cuts=cuts, check_steps=check_steps, loop=loop, name=who.name,
                progress=progress, on_frame=on_frame,
            )  # fmt: skip
        except Diverged as error:
            raise ValueRangeError(f"the cape can't be put on: {error}") from error


@contextmanager
def ended_in_order():
    """End what the block has begun, such as a viewer, also where this process is told to terminate."""
    before = signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def ended_before_interrupts():
    """Give what, once called, lets the block end before an interrupt is heard; a second one is heard at once.

    What is done would be lost where the writing of its end is broken off.
    """
    handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
    held: list[int] = []

    def hold(number: int, _: FrameType | None) -> None:
        held.append(number)
        restore()

    def begin() -> None:
        for number in {signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)}:
            if callable(handler := signal.getsignal(number)):
                handlers[number] = handler
                signal.signal(number, hold)

    def restore() -> None:
        for number, handler in handlers.items():
            signal.signal(number, handler)

    try:
        yield begin
    finally:
        restore()
    if held:
        handlers[held[0]](held[0], None)


@contextmanager
def _told(console: Console):
    """Print warnings as they come, a line each."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", SlowWarning)
        warnings.showwarning = lambda message, *_, **__: console.print(str(message), highlight=False, soft_wrap=True)
        yield


@contextmanager
def _loading(modules: Sequence[str]):
    """Give what begins to import modules that are needed afterwards: compiled code leaves the interpreter to them."""

    def load() -> None:
        for module in modules:
            with suppress(Exception):  # whoever needs it will tell
                importlib.import_module(module)

    thread = threading.Thread(target=load, name="cape-loading")

    def begin() -> None:
        if thread.ident is None:
            thread.start()

    try:
        yield begin
    finally:
        if thread.ident is not None:
            thread.join()


@contextmanager
def _progress(console: Console):
    """Show a bar with an estimate of the time left, on a terminal only."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not sys.stderr.isatty()) as progress:
        task = progress.add_task(BEFORE, total=None)
        with telling.within(lambda text: progress.update(task, description=text or BEFORE)):
            yield lambda done, of: progress.update(task, completed=done, total=of, description="simulating")
