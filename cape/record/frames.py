"""The frames of a recording and how columns of data go onto their timelines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import rerun as rr

# A chunk is what the viewer loads, and drops from memory, as a whole.
BYTES_PER_CHUNK = 8_000_000


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames to record.

    Attributes:
        numbers: which frames of the motion, or of the part of it that is given, they are, increasing, shape (F,).
        times: their times [s], shape (F,).
        begins: whether what holds at all times goes with them; not with frames that follow others.
        before: frames of the motion before the part that is given.
    """

    numbers: NDArray[np.int64]
    times: NDArray[np.float64]
    begins: bool = True
    before: int = 0

    def blocks(self, bytes_per_frame: int) -> Iterator[slice]:
        """Cut the frames into runs that fill a chunk each."""
        length = max(1, BYTES_PER_CHUNK // max(1, bytes_per_frame))
        for first in range(0, len(self.numbers), length):
            yield slice(first, min(first + length, len(self.numbers)))

    def send(
        self,
        stream: rr.RecordingStream,
        path: str,
        archetype: Any,
        columns: Mapping[str, NDArray[Any]],
        *,
        block: slice = slice(None),
        counts: NDArray[np.int64] | None = None,
    ) -> None:
        """Send components of an entity, a row for each frame.

        Args:
            stream: where to.
            path: the entity's path.
            archetype: the class of the archetype that the components belong to.
            columns: the components by name, shape (f, n, ...) each, with n instances in each of the f frames.
            block: which of the frames the f rows are.
            counts: of instances where frames differ in that, shape (f,); the columns are then of shape (sum, ...).
        """
        import rerun as rr

        numbers = self.before + self.numbers[block]
        nanoseconds = np.rint(self.times[block] * 1e9).astype("timedelta64[ns]")
        indexes = [rr.TimeColumn("frame", sequence=numbers), rr.TimeColumn("time", duration=nanoseconds)]
        batches = []
        for name, values in columns.items():
            flat = values if counts is not None else values.reshape(-1, *values.shape[2:])
            lengths = [values.shape[1]] * len(values) if counts is None else counts
            batches += archetype.columns(**{name: flat}).partition(lengths)
        # Strict: columns of different lengths would otherwise be dropped with a warning.
        stream.send_columns(path, indexes, batches, strict=True)


def send_once(stream: rr.RecordingStream, path: str, archetype: rr.AsComponents) -> None:
    """Send components of an entity that hold at all times."""
    stream.log(path, archetype, static=True, strict=True)
