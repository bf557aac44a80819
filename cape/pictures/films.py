"""Films: frames one after another, as a GIF or an MP4."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from motions.errors import FileError, UserError, ValueRangeError
from motions.files import whole_file

if TYPE_CHECKING:
    from PIL.Image import Image

    from cape.pictures.stills import Side
    from cape.pictures.viewer import Viewer

FPS = 25.0  # a whole number of the hundredths of a second in which a GIF tells times
SUFFIXES = (".gif", ".mp4")


def require_encoder(suffix: str) -> None:
    """Check that a film can be written.

    Raises:
        UserError: what encodes it is not installed.
    """
    if suffix != ".mp4":
        return
    try:
        import imageio_ffmpeg

        imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError):
        raise UserError("an MP4 needs imageio-ffmpeg: pip install 'cape[film]' (a GIF needs nothing)") from None


def frame_times(begin: float, end: float, fps: float) -> NDArray[np.float64]:
    """Times of a film's frames [s], from `begin` to `end` [s] at most, shape (F,).

    Raises:
        ValueRangeError: there is no frame.
    """
    if not begin <= end:
        raise ValueRangeError(f"a film can't go from {begin:g} to {end:g} s")
    return begin + np.arange(int((end - begin) * fps + 1e-6) + 1) / fps


def frames(
    viewer: Viewer, times: Iterable[float], sides: Sequence[Side] = (None,), *, view: str | None = None
) -> Iterator[Image]:
    """A picture for each time [s], seen from each of the sides side by side.

    Raises:
        UserError: there is no such view, or a time is outside of the recording.
    """
    from cape.pictures.stills import sheet

    if len(sides) > 1:
        yield from (sheet(viewer, [seconds], sides, view=view) for seconds in times)
        return
    viewer.choose(view, side=sides[0])
    yield from map(viewer.picture, times)


def save(pictures: Iterable[Image], path: Path, *, fps: float = FPS) -> None:
    """Write a film, in the format of the path's suffix, frame by frame as they come.

    Raises:
        FileError: it can't be written.
        UserError: what encodes it is not installed.
    """
    require_encoder(path.suffix.lower())
    pictures = iter(pictures)
    first = next(pictures)
    with whole_file(path) as partial:
        if path.suffix.lower() == ".gif":
            _gif(first, pictures, partial, fps)
        else:
            _mp4(first, pictures, partial, fps)


def _gif(first: Image, others: Iterable[Image], path: Path, fps: float) -> None:
    # A palette for each frame: what turns up later, such as the lining, may lack in the first one's.
    rest = (picture.quantize(256) for picture in others)
    first.quantize(256).save(path, save_all=True, append_images=rest, duration=round(1000.0 / fps), loop=0)


def _mp4(first: Image, others: Iterable[Image], path: Path, fps: float) -> None:
    import imageio_ffmpeg

    even = (first.width // 2 * 2, first.height // 2 * 2)  # colours are kept for squares of four pixels
    rate: Any = fps  # it is handed on as it is, though the library speaks of whole numbers
    writer = imageio_ffmpeg.write_frames(
        str(path), even, fps=rate, quality=8, macro_block_size=2, output_params=["-movflags", "+faststart"]
    )
    try:
        writer.send(None)
        for picture in chain([first], others):
            writer.send(picture.crop((0, 0, *even)).tobytes())
    except OSError as error:
        raise FileError(f"can't write the film: {' '.join(str(error).split())[-200:]}") from error
    finally:
        writer.close()
