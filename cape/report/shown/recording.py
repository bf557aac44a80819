"""A scene's runs side by side in the Rerun viewer, their error as colour."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cape.bench.plot import COLOURS, NAMES
from cape.cloth.normals import vertex_normals
from cape.record.files.recording import recording_file
from cape.record.frames import Frames, send_once
from cape.record.solids import log_hitboxes, plane_paths
from cape.record.stage import DARK_BACKGROUND, log_character
from cape.report.measured.accuracy import error_of
from cape.report.measured.sweep import Sweep
from cape.report.measured.trajectory import Trajectory

if TYPE_CHECKING:
    import rerun.blueprint as rrb

FloatArray = NDArray[np.float64]

BYTES_PER_VERTEX = 28  # of a frame: position, normal, colour
MOST_BYTES = 150e6  # in a recording; longer ones leave out frames
COLOURS_MM = (0.1, 1.0, 10.0, 100.0)  # errors at which the colours stand
STOPS = np.array([(70, 110, 200), (60, 190, 130), (250, 210, 70), (220, 40, 50)], float)


def save_runs(done: Sweep, path: str | os.PathLike[str]) -> None:
    """Write the reference and the shown run of each solver as a recording.

    | Entity | Archetype | Holds |
    |---|---|---|
    | `/runs/<solver>/cape` | Mesh3D | the cloth; its colours tell each vertex's error by `error_colors` |
    | `/plots/<solver>` | Scalars | root mean square error of the frame [mm] |
    | `/world/...` | | what the cloth meets, as in the recording of a take |

    Raises:
        FileError: the file can't be written.
    """
    runs = {"reference": done.reference.trajectory, **done.shown}
    frames = min(len(run.times) for run in runs.values())
    size = BYTES_PER_VERTEX * runs["reference"].positions.shape[1] * frames * len(runs)
    numbers = np.arange(0, frames, math.ceil(size / MOST_BYTES))
    shown = Frames(numbers, done.stage.times[numbers])
    standard = done.stage.standard
    track = standard.track.first(frames)
    extent = _extent(runs["reference"].positions[numbers] - track.positions[numbers][:, :1])
    blueprint = _layout(done, list(runs), extent, plane_paths(standard.scene.colliders))
    room = int(2.0 * min(size, MOST_BYTES))
    with recording_file(path, name=standard.name, opening=lambda: ("cape report", blueprint), size=room) as file:
        log_character(file.stream, track, shown)
        log_hitboxes(file.stream, track, standard.scene.colliders, shown)
        for name, run in runs.items():
            _log_run(file.stream, name, run, done, shown)


def error_colors(errors: FloatArray) -> NDArray[np.uint8]:
    """Colours of errors [m] of any shape: blue at 0.1 mm, green at 1, yellow at 10, red at 100; shape (..., 3)."""
    places = np.log10(np.clip(1e3 * errors, COLOURS_MM[0], COLOURS_MM[-1]) / COLOURS_MM[0])
    channels = [np.interp(places, range(len(STOPS)), STOPS[:, channel]) for channel in range(3)]
    return np.rint(np.stack(channels, axis=-1)).astype(np.uint8)


def _log_run(stream: Any, name: str, run: Trajectory, done: Sweep, frames: Frames) -> None:
    import rerun as rr

    path = f"/runs/{name}/cape"
    cloth = done.stage.standard.scene.cloth
    send_once(stream, path, rr.Mesh3D.from_fields(triangle_indices=cloth.triangles))
    positions, exact = run.positions, done.reference.trajectory.positions
    for block in frames.blocks(BYTES_PER_VERTEX * positions.shape[1]):
        chosen = frames.numbers[block]
        places = positions[chosen].astype(np.float32)
        columns = {
            "vertex_positions": places,
            "vertex_normals": vertex_normals(places, cloth.triangles),
            "vertex_colors": error_colors(np.linalg.norm(positions[chosen] - exact[chosen], axis=2)),
        }
        frames.send(stream, path, rr.Mesh3D, columns, block=block)
    if name == "reference":
        return
    off = positions[frames.numbers] - exact[frames.numbers]
    rms = 1e3 * np.sqrt(np.mean(np.sum(off**2, axis=2), axis=1))
    send_once(stream, f"/plots/{name}", rr.SeriesLines(names=NAMES[name], colors=_rgb(COLOURS[name]), widths=2.0))
    frames.send(stream, f"/plots/{name}", rr.Scalars, {"scalars": rms[:, None]})


def _rgb(colour: str) -> tuple[int, int, int]:
    """The parts of a colour such as #1b6ca8."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def _layout(done: Sweep, names: list[str], extent: tuple[FloatArray, float], hidden: list[str]) -> rrb.Blueprint:
    """A view for each run, with the same eye, and the errors below."""
    import rerun.blueprint as rrb

    middle, size = extent
    views = []
    for name in names:
        if name == "reference":
            title = f"reference, {done.reference.trajectory.substeps} substeps"
        else:
            run = done.shown[name]
            rms = error_of(run, done.reference.trajectory).rms_mm
            title = f"{NAMES[name]}, {run.setting}: {rms:.3g} mm, {1.0 / run.seconds:.3g} x real time"
        views.append(
            rrb.Spatial3DView(
                origin="/world/character",
                contents=["+ /world/**", f"+ /runs/{name}/**", *(f"- {path}/**" for path in hidden)],
                name=title,
                background=DARK_BACKGROUND,
                line_grid=False,
                eye_controls=rrb.EyeControls3D(
                    position=list(middle + size * np.array([-1.3, -0.9, 0.4])), look_target=list(middle)
                ),
            )
        )
    errors = rrb.TimeSeriesView(origin="/plots", name="error [mm], root mean square over the vertices")
    time = rrb.TimePanel(timeline="time", state="collapsed", play_state="playing", loop_mode="all")
    return rrb.Blueprint(rrb.Vertical(rrb.Grid(*views), errors, row_shares=[4, 1]), time, collapse_panels=True)


def _extent(positions: FloatArray) -> tuple[FloatArray, float]:
    """Middle of the cloth's bounds and their largest side [m], relative to the first bone."""
    low, high = positions.min(axis=(0, 1)), positions.max(axis=(0, 1))
    return 0.5 * (low + high), float((high - low).max())
