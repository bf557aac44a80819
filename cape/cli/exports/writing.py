"""What a simulation's result is written as, which the output's suffix tells: a recording, a kept take or an export."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from cape import exports, record
from cape.results.take import Take
from motions.errors import UserError
from motions.skin import Skin
from skeleton.robot.link_surfaces import LinkSurface

KEPT = ".npz"


def require_writable(path: Path, *, recorded_only: Mapping[str, bool]) -> None:
    """Check, before anything is simulated, that what the suffix asks for can be written.

    Args:
        path: the output.
        recorded_only: options that make sense of recordings alone, and whether they are given.

    Raises:
        UserError: a package is missing, or such an option is given with something else than a recording.
    """
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
    layers: Sequence[str] | None,
    surfaces: Sequence[LinkSurface],
    skin: Skin | None = None,
    tab: str = "cape",
) -> str:
    """Write a take as its path's suffix tells, a recording by default; gives what that is, in a word.

    Raises:
        UserError: it can't be written.
    """
    suffix = path.suffix.lower()
    if suffix == KEPT:
        take.keep(path)
        return "take"
    if suffix in exports.FORMATS:
        take.export(path)
        return "export"
    record.save(take, path, layers=layers, surfaces=surfaces, skin=skin, tab=tab)
    return "recording"
