"""`cape replay`: a clip with a cape, to a recording."""

import json as json_format
import sys
import warnings
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from cape.cli.character import Reading, open_viewer, output_path
from cape.cli.rows import print_rows
from cape.dress import dress
from cape.fabric import fabric
from cape.record import LAYERS
from cape.record.layers import check_layers
from cape.simulate import SlowWarning, simulate
from cape.simulation import Diverged
from cape.solvers import solver
from cape.take import Take
from cape.wind import Wind
from motions.errors import ValueRangeError


@dataclass(frozen=True)
class Cut:
    """The cape and how to simulate it, as asked on the command line."""

    fabric: str
    spacing: float | None
    length: float | None
    solver: str
    substeps: int | None
    wind: tuple[float, float, float]


def run(reading: Reading, cut: Cut, *, output: Path | None, layers: list[str] | None, spawn: bool, json: bool) -> int:
    """Simulate, record, report; gives the exit status."""
    material, method = fabric(cut.fabric), solver(cut.solver, substeps=cut.substeps)
    check_layers(layers, LAYERS)
    clip, body, track = reading.character()
    path = output_path(output, clip)
    scene = dress(body, track, length=cut.length, spacing=cut.spacing, fabric=material, wind=Wind(velocity=cut.wind))
    console = Console(stderr=True)
    for decision in clip.decisions:
        console.print(f"{clip.name}: {decision}", style="dim", highlight=False, soft_wrap=True)
    with _told(console), _progress(console) as advance:
        try:
            take = simulate(scene, track, solver=method, name=clip.name, progress=advance)
        except Diverged as error:
            raise ValueRangeError(f"the cape can't be put on: {error}") from error
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        take.save(path, layers=layers)
    notes = [*take.warnings, *(str(w.message) for w in caught if w.category is UserWarning)]
    facts = _facts(take, len({track.index(bone) for bone in scene.bones}), notes, path)
    if json:
        print(json_format.dumps(facts))
    else:
        _print_table(take, facts)
    if spawn:
        open_viewer(path)
    return 130 if take.result.startswith("stopped") else 0


@contextmanager
def _told(console: Console):
    """Print warnings as they come, a line each."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", SlowWarning)
        warnings.showwarning = lambda message, *_, **__: console.print(str(message), highlight=False, soft_wrap=True)
        yield


@contextmanager
def _progress(console: Console):
    """Show a bar with an estimate of the time left, on a terminal only."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not sys.stderr.isatty()) as progress:
        task = progress.add_task("putting the cape on", total=None)
        yield lambda done, of: progress.update(task, completed=done, total=of, description="simulating")


def _facts(take: Take, bones: int, notes: list[str], path: Path) -> dict[str, Any]:
    frames = len(take.positions)
    fps = take.bones.fps if frames > 1 else 0.0
    seconds = (frames - 1) / fps if frames > 1 else 0.0
    return {
        "frames": frames,
        "fps": round(fps, 3),
        "vertices": take.positions.shape[1],
        "bones": bones,
        "capsules": len(take.capsules),
        "solver": take.solver,
        "substeps": take.substeps,
        "compile_s": round(take.compile_s, 3),
        "settle_s": round(take.settle_s, 3),
        "solve_s": round(take.solve_s, 3),
        "realtime_factor": round(seconds / take.solve_s, 2) if take.solve_s > 0.0 else None,
        "stretch_max": round(float(take.stretch_max.max()), 5),
        "stretch_p99": round(take.stretch_p99, 5),
        "penetration_max_mm": round(float(take.penetration.max()) * 1000.0, 3),
        "result": take.result,
        "warnings": notes,
        "output": str(path),
    }


def _print_table(take: Take, facts: dict[str, Any]) -> None:
    frame = int(take.stretch_max.argmax())
    deepest = int(take.penetration.argmax())
    where = take.colliders[take.penetrated[deepest]].name if take.penetrated[deepest] >= 0 else ""
    penetration = f"{facts['penetration_max_mm']:.1f} mm" + (f" in {where} at frame {deepest}" if where else "")
    stretch = f"{take.stretch_max[frame]:.1%} at frame {frame}, 99 % of edges below {take.stretch_p99:.1%}"
    factor = facts["realtime_factor"]
    rows = [
        ("motion", f"{facts['frames']} frames at {facts['fps']:g} fps"),
        ("bones, capsules", f"{facts['bones']}, {facts['capsules']}"),
        ("cape", f"{facts['vertices']} vertices"),
        ("solver", f"{facts['solver']}, {facts['substeps']} substeps a frame"),
        ("compile time", f"{facts['compile_s']:.2f} s, and {facts['settle_s']:.2f} s to put the cape on"),
        ("run time", f"{facts['solve_s']:.2f} s" + (f", {factor:g} times real time" if factor else "")),
        ("largest stretch", stretch),
        ("deepest penetration", penetration),
        ("result", facts["result"]),
        *(("", note) for note in facts["warnings"]),
        ("recording", facts["output"]),
    ]
    print_rows(rows)
