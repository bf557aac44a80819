"""`cape render`: pictures and films of a recording, or of a clip that is replayed first."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from cape.cli.character import read_character
from cape.cli.commands.replay import Cut
from cape.cli.figures.rows import print_rows
from cape.cli.measuring import sections
from cape.cli.output import output_path
from cape.cli.reading import Reading
from cape.cli.running import RECORDER, ended_in_order, simulated
from cape.cli.words import gathered
from cape.pictures import films, stills
from cape.pictures.eye import side_of
from cape.pictures.stills import Side
from cape.pictures.viewer import Viewer, require_recording, require_viewer, viewer
from motions.errors import UnknownNameError, UserError, ValueRangeError
from motions.files import scratch_folder, text_of

STILLS = (".png", ".jpg", ".jpeg")
LEAST, MOST = 16, 4096  # [pixels] of a picture's side
MOST_FPS = 100.0  # of a film: a GIF tells times in hundredths of a second


@dataclass(frozen=True, kw_only=True)
class Shots:
    """What to draw, as asked on the command line.

    Attributes:
        view: name of the view, None for the one that the recording opens with.
        times: of the pictures [s], none for halfway.
        sides: from which they are seen.
        size: width and height of each picture [pixels].
        film_fps: frames of a film per second.
    """

    view: str | None
    times: tuple[float, ...]
    sides: tuple[Side, ...]
    size: tuple[int, int]
    film_fps: float

    @classmethod
    def asked(
        cls, *, view: str | None, times: Sequence[float], sides: Sequence[str], size: str, film_fps: float
    ) -> Self:
        """Read the options.

        Raises:
            UserError: one of them makes no sense.
        """
        if not all(map(math.isfinite, times)):
            raise ValueRangeError("--at takes seconds")
        numbers = re.fullmatch(r"(\d+)x(\d+)", size)
        width, height = map(int, numbers.groups()) if numbers else (0, 0)
        if not (LEAST <= width <= MOST and LEAST <= height <= MOST):
            raise ValueRangeError(f"--size takes WxH of {LEAST} to {MOST} pixels, such as 1280x720, not {size!r}")
        if not 0.0 < film_fps <= MOST_FPS:
            raise ValueRangeError(
                f"a film has at most {MOST_FPS:g} frames per second, and more than 0, not {film_fps:g}"
            )
        return cls(
            view=view,
            times=tuple(times),
            sides=tuple(map(side_of, sides)) or (None,),
            size=(width, height),
            film_fps=film_fps,
        )


def run(reading: Reading, cut: Cut, shots: Shots, *, output: Path | None, hitboxes: str | None) -> int:
    """Draw; gives the exit status."""
    recording = _recording(reading, cut, hitboxes)
    # What can be told at once is told before a viewer starts, and that none starts before anything is simulated.
    name = text_of(Path(reading.clip or "script").stem)
    path = output_path(output, name, ".png", inputs=(*reading.files, *cut.mesh.files, hitboxes))
    suffix = path.suffix.lower()
    if suffix not in (*STILLS, *films.SUFFIXES):
        raise UnknownNameError("kind of picture", path.suffix or path.name, (*STILLS, *films.SUFFIXES))
    film = suffix in films.SUFFIXES
    if film and shots.times:
        raise UserError("--at chooses still pictures: a film takes --start and --end")
    if recording is not None and not film and (reading.start, reading.end) != (None, None):
        raise UserError("--start and --end choose the part of a recording that is filmed: a still picture takes --at")
    films.require_encoder(suffix)
    begin, end = reading.start, reading.end
    with scratch_folder() as folder:
        if recording is None:
            cut.check()
            require_viewer()
            recording, begin, end = folder / "replayed.rrd", None, None  # the clip itself is trimmed
            if not _replay(reading, cut, recording, hitboxes):
                return 130
        with ended_in_order(), viewer(shots.size) as shown:
            shown.open(recording)
            text = _film(shown, shots, path, begin, end) if film else _still(shown, shots, path)
    print_rows([("film" if film else "picture", f"{path}, {text}")])
    return 0


def _recording(reading: Reading, cut: Cut, hitboxes: str | None) -> Path | None:
    """The recording to draw, None where a clip is to be replayed."""
    if reading.clip is None or Path(reading.clip).suffix.lower() != ".rrd":
        return None
    if (reading, cut, hitboxes) != (Reading(reading.clip, start=reading.start, end=reading.end), Cut(), None):
        raise UserError(f"{reading.clip} is recorded already: garment, fabric, skeleton and the like are for clips")
    return require_recording(reading.clip)


def _replay(reading: Reading, cut: Cut, path: Path, hitboxes: str | None) -> bool:
    """Simulate and record; False where that was interrupted."""
    who = read_character(reading, hitboxes=hitboxes)
    take = simulated(cut.scene(who), who, solver=cut.method(), cuts=cut.way_at_cuts(), loop=cut.loop, modules=RECORDER)
    take.save(path, surfaces=who.surfaces, skin=who.skin)
    print_rows([("result", take.result), *(("", warning) for warning in gathered(take.warnings))])
    return not take.result.startswith("stopped")


def _still(shown: Viewer, shots: Shots, path: Path) -> str:
    times = shots.times or (0.5 * (shown.begin + shown.end),)
    with sections() as told:
        drawn = told("drawing", len(times) * len(shots.sides))
        picture = stills.sheet(shown, times, shots.sides, view=shots.view, drawn=drawn)
    stills.save(picture, path)
    return f"{picture.width} x {picture.height} pixels at {', '.join(f'{seconds:.2f}' for seconds in times)} s"


def _film(shown: Viewer, shots: Shots, path: Path, begin: float | None, end: float | None) -> str:
    times = films.frame_times(
        shown.begin if begin is None else begin, shown.end if end is None else end, shots.film_fps
    )
    with sections() as told:
        drawn = told("filming", len(times))

        def counted():
            for picture in films.frames(shown, times, shots.sides, view=shots.view):
                yield picture
                drawn()

        films.save(counted(), path, fps=shots.film_fps)
    return f"{len(times)} frames, {len(times) / shots.film_fps:.1f} s"
