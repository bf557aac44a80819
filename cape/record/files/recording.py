"""A recording file that appears under its name complete, or not at all."""

from __future__ import annotations

import os
import uuid
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from cape.record.files.sink import Sink, room_at
from motions.errors import FileError, UserError
from motions.files import begin_file

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb


class RecordingFile:
    """A recording that is being written, under another name yet.

    Attributes:
        path: whose name it is going to take.
    """

    def __init__(
        self, path: str | os.PathLike[str], sink: Sink, name: str, opening: Callable[[], tuple[str, rrb.Blueprint]]
    ) -> None:
        """The recording that is to take the name `path`; `name` and `opening` are those of `recording_file`."""
        self.path = path
        self._sink, self._name, self._opening = sink, name, opening
        self._stream: rr.RecordingStream | None = None

    @property
    def stream(self) -> rr.RecordingStream:
        """To send to."""
        if self._stream is None:
            import rerun as rr

            application, blueprint = self._opening()
            self._stream = rr.RecordingStream(application, recording_id=uuid.uuid4())
            self._sink.open(self._stream, blueprint)
            self._stream.send_recording_name(self._name)
        return self._stream

    def disconnect(self) -> None:
        """Send no more, if anything was sent."""
        if self._stream is not None:
            self._stream.disconnect()

    @property
    def room(self) -> int:
        """How much more there is room for [bytes]; what was sent is on the disk then."""
        self.stream.flush()
        self._sink.settle()
        return room_at(self._sink.path, written=self._sink.written)

    def check(self) -> None:
        """Check that all that was sent so far could be written.

        Raises:
            FileError: it could not.
        """
        if self._sink.error is not None:
            raise FileError(f"can't write {self.path}: {self._sink.error.strerror}")


@contextmanager
def recording_file(
    path: str | os.PathLike[str], *, name: str, opening: Callable[[], tuple[str, rrb.Blueprint]], size: int
) -> Iterator[RecordingFile]:
    """Open a file that takes its name when the block ends, and vanishes when the block fails.

    The data goes to a hidden file beside `path`. Rerun is imported when something is sent, not before.

    Args:
        path: the recording to write; one that is there is replaced at the end.
        name: what the viewer calls the recording.
        opening: gives Rerun's application id, under which the viewer keeps its layout, and the layout that the
            recording opens with.
        size: how large it will be, roughly [bytes].

    Raises:
        FileError: the file can't be written.
    """
    with _told(path):
        target = Path(path).resolve()
        if target.exists() and not target.is_file():
            raise FileError(f"can't write {path}: it is {'a directory' if target.is_dir() else 'no regular file'}")
        if (room := room_at(target)) < size:
            raise FileError(f"can't write {path}: it takes about {size / 1e6:.3g} MB and {room / 1e6:.3g} MB are free")
        partial = begin_file(target)
    try:
        with _told(path):
            sink = Sink(partial)
        try:
            file = RecordingFile(path, sink, name, opening)
            try:
                yield file
                _ = file.stream  # opened also where nothing was sent
            finally:
                file.disconnect()
        finally:
            sink.close()
        file.check()
        _check_complete(partial, path)
        with _told(path):
            partial.replace(target)
    finally:
        with suppress(OSError):
            partial.unlink()


@contextmanager
def _told(path: str | os.PathLike[str]) -> Iterator[None]:
    """Raise FileError for what the system says against a file."""
    try:
        yield
    except OSError as error:
        raise FileError(f"can't write {path}: {error.strerror}") from error
    except UserError:
        raise
    except ValueError as error:  # of a name that no file may have
        raise FileError(f"can't write {os.fspath(path)!r}: {error}") from error


def _check_complete(partial: Path, path: str | os.PathLike[str]) -> None:
    """Raise FileError for a file without its closing index."""
    import rerun as rr

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rr.error_utils.RerunWarning)
        try:
            rr.chunk.RrdReader(partial).store()
        except RuntimeError as error:
            raise FileError(f"can't write {path}: the recording was cut short") from error
