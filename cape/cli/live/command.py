"""`cape live`: run, steer, and write what was recorded, however the run ends."""

import json as json_format
import shutil
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from cape.cli.commands.replay import Cut
from cape.cli.compiling_told import telling
from cape.cli.exports.writing import is_recording, require_writable, write_what_fits
from cape.cli.live.bindings import Bindings
from cape.cli.live.cast import Cast, cast
from cape.cli.live.terminal import Terminal
from cape.cli.output import output_path
from cape.cli.reading import Reading
from cape.cli.scenes.file import SceneFile
from cape.cli.words import gathered
from cape.live.feed.viewers import is_loopback
from cape.live.keeping import Keeper
from cape.live.live import FPS, Live
from cape.record.files.sink import room_at
from cape.record.write import OVERHEAD
from cape.scenes.registry import NamedScene
from cape.solvers import Solver
from motions.errors import FileError, ValueRangeError
from motions.files import printable

LISTENING = ("window", "web", "page")  # viewers that are opened here, and take what comes to an address
SPARE = 20_000_000  # [bytes] that stay free on the disk of the recording, or
SHARE = 0.02  # of a disk, if that is less
WRITES = 1.2  # times what frames take where they are kept, that they may take in the recording


def run(
    reading: Reading,
    cut: Cut,
    *,
    scene: SceneFile | NamedScene | None,
    output: Path | None,
    hitboxes: str | None,
    viewer: str,
    bind: str,
    seconds: float | None,
    json: bool,
) -> int:
    """Run until it is ended; gives the exit status."""
    if seconds is not None and not seconds > 0.0:
        raise ValueRangeError(f"--seconds must be above 0, not {seconds:g}")
    if not is_loopback(bind) and viewer in LISTENING:
        _tell(f"listening on {bind}: whoever reaches this machine there sees the cape")
    file = scene if isinstance(scene, SceneFile) else None
    if file is not None:
        cut = replace(cut, tables=file.tables)
    cut.check()
    solver = cut.method()
    if not isinstance(solver, Solver):
        raise ValueRangeError("a live run takes a solver by its name, which it leaves where it falls behind")
    if output is not None:
        require_writable(output, recorded_only={})
        inputs = (*reading.files, *cut.mesh.files, hitboxes, None if file is None else file.path)
        output = output_path(output, "", inputs=inputs)
    who = cast(reading, cut, scene=scene if isinstance(scene, NamedScene) else None, hitboxes=hitboxes)
    for decision in gathered(f"{who.name}: {decision}" for decision in who.decisions):
        _tell(decision)
    for collider, reason in who.scene.left_out.items():
        _tell(f"{who.name}: {collider} is left out: {reason}")
    live = Live(
        who.scene, who.source, name=who.name, fps=reading.frame_rate or FPS, solver=solver, viewer=viewer, bind=bind,
        keep=output is not None, surfaces=who.surfaces, skin=who.skin,
    )  # fmt: skip
    with _ended_by_signals(live):
        try:
            live.start()
            if live.page is not None:
                _tell(f"open {live.page}")
            _steer(live, who, seconds=seconds, output=output)
        finally:
            live.close()
        full = _finish(live, output, who)
    if json:
        print(json_format.dumps(_facts(live, output)))
    if full is not None:
        raise FileError(f"can't write all of {output}: {full}")
    return 0


def _steer(live: Live, who: Cast, *, seconds: float | None, output: Path | None) -> None:
    """Have the keys do what they do until the run ends."""
    bindings = Bindings(live, who)
    terminal = Terminal(live, bindings.press, bindings.help)

    def watch() -> None:
        live.look()
        if seconds is not None and live.status.clock >= seconds:
            live.end("")
        if live.keeper is not None and output is not None and not live.kept_enough and _is_full(live.keeper, output):
            live.stop_keeping("the disk is nearly full: recording stopped")

    with telling.within(lambda text: live.say(text)):
        terminal.run(watch)


def _is_full(keeper: Keeper, output: Path) -> bool:
    """Tell whether what was kept is about all that there is room for."""
    try:
        free, disk = room_at(output.resolve()), shutil.disk_usage(output.resolve().parent).total
    except OSError:
        return False
    return free < (OVERHEAD if is_recording(output) else 0) + WRITES * keeper.size + min(SPARE, SHARE * disk)


def _finish(live: Live, output: Path | None, who: Cast) -> str | None:
    """Tell why it has ended, and write the recording; gives why that is not of all frames, None where it is."""
    failed, full = live.failed, None
    if live.status.ended:
        _tell(f"ended: {live.status.ended}")
    if output is not None and live.keeper is not None:
        take = live.take()
        kind, full = write_what_fits(take, output, who.scene, surfaces=who.surfaces)
        if full is None and live.kept_enough:
            full = f"the disk was nearly full after {len(take.positions)} of {live.status.frame + 1} frames"
        if full is None:
            _tell(f"{kind} of {len(take.positions)} frames: {output}")
    if failed is not None:
        raise failed
    return full


def _facts(live: Live, output: Path | None) -> dict[str, object]:
    status = live.status
    return {
        "frames": status.frame,
        "seconds": round(status.time, 3),
        "clock_s": round(status.clock, 3),
        "realtime_factor": round(status.time / status.clock, 3) if status.clock > 0.0 else None,
        "step_ms": round(status.step_ms, 3),
        "late_ms": round(status.late_ms, 3),
        "solver": status.solver,
        "substeps": status.substeps,
        "given_up": status.given_up,
        "result": status.ended or "finished",
        "output": None if output is None else str(output),
    }


@contextmanager
def _ended_by_signals(live: Live) -> Iterator[None]:
    """Have whatever ends this process end the run in order, and what is recorded be written."""
    ways = {"SIGINT": "interrupted", "SIGTERM": "told to end", "SIGHUP": "the terminal was closed"}
    known = {getattr(signal, name): why for name, why in ways.items() if hasattr(signal, name)}
    before = {number: signal.signal(number, lambda got, _: live.end(known[got])) for number in known}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _tell(text: str) -> None:
    with suppress(OSError):
        Console(stderr=True).print(printable(text), style="dim", highlight=False, markup=False, soft_wrap=True)
        sys.stderr.flush()
