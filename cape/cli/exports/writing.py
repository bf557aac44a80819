"""What a simulation's result is written as, which the output's suffix tells: a recording, a kept take or an export."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from cape import exports, record
from cape.cli.output import require_suffix
from cape.cli.running import RECORDER
from cape.cli.staging import Staged
from cape.record.files.sink import room_at
from cape.results import take_file
from cape.results.so_far import SoFar
from cape.results.take import Take
from cape.scene.scene import Scene
from motions.errors import FileError, UserError, ValueRangeError
from motions.skin import Skin
from skeleton.robot.meshes.link_surfaces import LinkSurface
from skeleton.track import worn_by

RECORDED = ".rrd"
KEPT = ".npz"
SUFFIXES = (RECORDED, KEPT, *exports.FORMATS)


@dataclass(frozen=True)
class Output:
    """Where a simulation's result goes.

    Attributes:
        kind: what it is, in a word.
        finish: what writes the rest when it is over; raises UserError where that can't be.
        on_frame: the same of `cape.simulate`, None where nothing is written before.
        modules: that writing needs, and that take long to import.
        full: tells why it does not hold all frames, None where it does.
    """

    kind: str
    finish: Callable[[Take], None]
    on_frame: Callable[[int, SoFar], None] | None = None
    modules: tuple[str, ...] = ()
    full: Callable[[], str | None] = lambda: None


def require_writable(path: Path, *, recorded_only: Mapping[str, bool]) -> None:
    """Check, before anything is simulated, that what the suffix asks for can be written.

    Args:
        path: the output.
        recorded_only: options that make sense of recordings alone, and whether they are given.

    Raises:
        UserError: it names none of these, a package is missing, or such an option is given with something else than a
            recording.
    """
    require_suffix(path, SUFFIXES, "Pictures and films are drawn by cape render.")
    suffix = path.suffix.lower()
    if suffix in exports.FORMATS:
        exports.format_of(path)
    elif suffix != KEPT:
        record.require_recorder()
        return
    if given := [option for option, is_given in recorded_only.items() if is_given]:
        raise UserError(f"{' and '.join(given)} is for recordings (.rrd), not for {path.name}")


def write(
    take: Take,
    path: Path,
    *,
    layers: Sequence[str] | None = None,
    surfaces: Sequence[LinkSurface] = (),
    skin: Skin | None = None,
    tab: str = "cape",
) -> str:
    """Write a take as its path's suffix tells, a recording by default; gives what that is, in a word.

    Raises:
        UserError: it can't be written.
    """
    suffix = path.suffix.lower()
    if suffix == KEPT:
        _with_skin(take, skin).keep(path)
    elif suffix in exports.FORMATS:
        _with_skin(take, skin).export(path)
    else:
        record.save(take, path, layers=layers, surfaces=surfaces, skin=skin, tab=tab)
    return _kind(path)


def write_what_fits(
    take: Take, path: Path, scene: Scene, *, surfaces: Sequence[LinkSurface] = ()
) -> tuple[str, str | None]:
    """Write a take of a scene as its path's suffix tells, or as many of its first frames as there is room for.

    Returns:
        What that is, in a word, and why it does not hold all frames; None where it does.

    Raises:
        UserError: not even two frames can be written.
    """
    if (kind := _kind(path)) == "recording":
        from cape.record.growing import growing_file

        with growing_file(path, scene, take.bones, name=take.name, surfaces=surfaces, whole=False) as file:
            file.finish(take)
        return kind, file.full
    return kind, _write_fitting(take, lambda part: write(part, path, surfaces=surfaces))


def _write_fitting(take: Take, written: Callable[[Take], object]) -> str | None:
    """Write a take, or as many of its first frames as there is room for; gives why these are not all, if so.

    Raises:
        UserError: not even two frames can be written.
    """
    fits = of = len(take.positions)
    while True:
        try:
            written(take if fits == of else take.part(0, fits))
            return None if fits == of else f"the first {fits} of {of} frames are written, more did not fit"
        except (FileError, ValueRangeError):
            fits //= 2
            if fits < 2:
                raise


def _with_skin(take: Take, skin: Skin | None) -> Take:
    """The take with its character's mesh, where its bones tell of none."""
    if take.bones.skin is not None:
        return take
    return replace(take, bones=replace(take.bones, **worn_by(take.bones.names, skin, None)))


def is_recording(path: Path) -> bool:
    """Tell whether a path's suffix asks for a recording for the viewer."""
    return _kind(path) == "recording"


def _kind(path: Path) -> str:
    suffix = path.suffix.lower()
    return "take" if suffix == KEPT else "export" if suffix in exports.FORMATS else "recording"


@contextmanager
def begun(path: Path, who: Staged, *, loop: bool, layers: Sequence[str] | None, tab: str = "cape") -> Iterator[Output]:
    """Begin what the path's suffix tells, a recording by default; it is whole when the block ends.

    A recording is written while frames come; that of a loop, whose frames are known at the end, as far as there is room
    then.

    Raises:
        UserError: it can't be written.
    """
    kind = _kind(path)
    if kind != "recording":
        frames, vertices, short = who.track.frames, who.scene.cloth.vertices, None
        (take_file if kind == "take" else exports.format_of(path)).require_size(frames, vertices)
        _require_room(path, take_file.POSITION * frames * vertices)

        def finish(take: Take) -> None:
            nonlocal short
            short = _write_fitting(take, lambda part: write(part, path, surfaces=who.surfaces, skin=who.skin))

        yield Output(kind, finish, full=lambda: short)
    else:
        from cape.record.growing import growing_file

        with growing_file(
            path, who.scene, who.track, name=who.name, layers=layers, surfaces=who.surfaces, skin=who.skin, tab=tab
        ) as file:
            note = None if loop else file.note
            yield Output(kind, file.finish, on_frame=note, modules=RECORDER, full=lambda: file.full)


def _require_room(path: Path, size: int) -> None:
    """Check, before anything is simulated, that there is room for a file of so many bytes at least."""
    if (room := room_at(path.resolve())) < size:
        raise FileError(f"can't write {path}: it takes {size / 1e6:.2g} MB and more, and {room / 1e6:.2g} MB are free")
