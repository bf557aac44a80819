"""Still pictures, several of them on one sheet."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from motions.files import whole_file

if TYPE_CHECKING:
    from PIL.Image import Image

    from cape.pictures.viewer import Viewer

Side = float | None  # where the eye stands, as in `Viewer.choose`
QUALITY = 88  # of JPEG files, of 100


def sheet(
    viewer: Viewer,
    times: Sequence[float],
    sides: Sequence[Side] = (None,),
    *,
    view: str | None = None,
    drawn: Callable[[], None] = lambda: None,
) -> Image:
    """Pictures of each time [s] side by side, a row for each side; those of a single time stand side by side.

    Args:
        viewer: with a recording.
        times: of the pictures [s].
        sides: from which they are seen.
        view: its name, None for the one that is shown first.
        drawn: called after each picture.

    Raises:
        UserError: there is no such view, or a time is outside of the recording.
    """
    rows = []
    for side in sides:
        viewer.choose(view, side=side)
        rows.append([])
        for seconds in times:
            rows[-1].append(viewer.picture(seconds))
            drawn()
    return joined([[row[0] for row in rows]] if len(times) == 1 else rows)


def joined(rows: Sequence[Sequence[Image]]) -> Image:
    """Pictures of one size as one, row by row."""
    from PIL import Image

    width, height = rows[0][0].size
    whole = Image.new("RGB", (width * len(rows[0]), height * len(rows)))
    for down, row in enumerate(rows):
        for across, picture in enumerate(row):
            whole.paste(picture, (across * width, down * height))
    return whole


def save(picture: Image, path: Path) -> None:
    """Write a picture, in the format of the path's suffix.

    Raises:
        FileError: it can't be written.
    """
    with picture_file(path) as file:
        picture.save(file, quality=QUALITY)


@contextmanager
def picture_file(path: Path) -> Iterator[io.BufferedWriter]:
    """Give what Pillow can write a picture to; the file takes its name as the block ends.

    Raises:
        FileError: it can't be written.
    """
    with whole_file(path) as partial, _Numberless(io.FileIO(partial, "w")) as file:
        yield file


class _Numberless(io.BufferedWriter):
    """A file that keeps its number to itself: by that Pillow writes what a disk has room for, and says nothing."""

    def fileno(self) -> int:
        raise io.UnsupportedOperation
