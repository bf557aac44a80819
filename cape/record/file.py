"""A recording file that appears under its name complete, or not at all."""

from __future__ import annotations

import os
import shutil
import uuid
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from motions.errors import FileError
from motions.files import begin_file

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb


@contextmanager
def recording_file(
    path: str | os.PathLike[str], *, application: str, name: str, blueprint: rrb.Blueprint, size: int
) -> Iterator[rr.RecordingStream]:
    """Open a stream into a file that takes its name when the block ends, and vanishes when the block fails.

    The data goes to a hidden file beside `path`.

    Args:
        path: the recording to write; one that is there is replaced at the end.
        application: Rerun's application id, under which the viewer keeps its layout.
        name: what the viewer calls the recording.
        blueprint: the layout that the recording opens with.
        size: how large it will be, roughly [bytes].

    Raises:
        FileError: the file can't be written.
    """
    import rerun as rr

    target = Path(path).resolve()
    try:
        if target.exists() and not target.is_file():
            raise FileError(f"can't write {path}: it is {'a directory' if target.is_dir() else 'no regular file'}")
        # Asked beforehand because a disk that fills up is only logged by Rerun's writer, and can leave it waiting.
        # Writing a BinaryStream's bytes oneself is no way out: each read starts a new file, with a header and an index
        # that point nowhere once they are joined, and a single read at the end holds the recording in memory.
        free = shutil.disk_usage(target.parent).free
        if free < size:
            raise FileError(f"can't write {path}: it takes about {size / 1e6:.0f} MB and {free / 1e6:.0f} MB are free")
        partial = begin_file(target)
    except OSError as error:
        raise FileError(f"can't write {path}: {error.strerror}") from error
    try:
        stream = rr.RecordingStream(application, recording_id=uuid.uuid4())
        try:
            stream.save(partial, default_blueprint=blueprint)
            stream.send_recording_name(name)
            yield stream
        finally:
            stream.disconnect()
        _check_complete(partial, path)
        try:
            partial.replace(target)
        except OSError as error:
            raise FileError(f"can't write {path}: {error.strerror}") from error
    finally:
        with suppress(OSError):
            partial.unlink()


def _check_complete(partial: Path, path: str | os.PathLike[str]) -> None:
    """Raise FileError for a file without its closing index: Rerun's writer thread only logs a full disk."""
    import rerun as rr

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rr.error_utils.RerunWarning)
        try:
            rr.chunk.RrdReader(partial).store()
        except RuntimeError as error:
            raise FileError(f"can't write {path}: the recording was cut short; is the disk full?") from error
