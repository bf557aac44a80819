"""Films: frames one after another, as a GIF or an MP4."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import IO, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cape.pictures.stills import picture_file, sheet
from motions.errors import UserError, ValueRangeError
from motions.files import whole_file

if TYPE_CHECKING:
    from PIL.Image import Image

    from cape.pictures.stills import Side
    from cape.pictures.viewer import Viewer

FPS = 25.0  # a whole number of the hundredths of a second in which a GIF tells times
CRF = 10  # of H.264: 0 loses nothing, 51 is the worst
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
    if path.suffix.lower() == ".gif":
        with picture_file(path) as file:
            _gif(first, pictures, file, fps)
    else:
        with whole_file(path) as partial:
            _mp4(first, pictures, partial, fps)


def _gif(first: Image, others: Iterable[Image], file: IO[bytes], fps: float) -> None:
    # A palette for each frame: what turns up later, such as the lining, may lack in the first one's.
    rest = (picture.quantize(256) for picture in others)
    first.quantize(256).save(file, save_all=True, append_images=rest, duration=round(1000.0 / fps), loop=0)


def _mp4(first: Image, others: Iterable[Image], path: Path, fps: float) -> None:
    even = (first.width // 2 * 2, first.height // 2 * 2)  # colours are kept for squares of four pixels
    with _encoder(path, even, fps) as frames:
        for picture in chain([first], others):
            frames.write(picture.crop((0, 0, *even)).tobytes())


@contextmanager
def _encoder(path: Path, size: tuple[int, int], fps: float) -> Iterator[IO[bytes]]:
    """Give what takes the pixels of frames in RGB; the file is whole as the block ends.

    Raises:
        OSError: it can't be written.
    """
    import imageio_ffmpeg

    # imageio_ffmpeg's own writer does not tell that the file was cut short.
    command = [
        imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24",
        "-s", "{}x{}".format(*size), "-r", f"{fps:.9g}", "-i", "-", "-an", "-c:v", "libx264", "-pix_fmt", "yuv420p",
        "-crf", str(CRF), "-movflags", "+faststart", str(path),
    ]  # fmt: skip
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=said,
            restore_signals=False,  # a file that may not grow is an error that it tells, and not its end
            start_new_session=True,  # what interrupts this process is not for it
        )
        assert process.stdin is not None
        try:
            with process.stdin:
                yield process.stdin
            status = process.wait()
        except BrokenPipeError:  # it has ended, and said why
            status = process.wait() or 1
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
        if status:
            said.seek(0)
            lines = said.read().decode(errors="replace").splitlines()
            raise OSError(lines[-1].rpartition(": ")[2] if lines else f"the encoder ended with status {status}")
