"""Rows of numbers that a long run leaves: in memory at first, then in a file of their own that nobody else sees.

Half an hour of motion has gigabytes of vertices. What is on disk is mapped into memory, so that it is an array like any
other; who goes through all of it lets go of what is behind.
"""

import mmap
import os
import tempfile
from collections.abc import Iterator
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

IN_MEMORY = 2**26
"""Bytes that are kept in memory."""
BLOCK = 2**25
"""Bytes that are looked at at a time."""
FOLDER = "/var/tmp"
"""Where large files of no further use belong by the Filesystem Hierarchy Standard; /tmp is often memory itself."""


class Kept:
    """Rows of one shape, added one after the other.

    Attributes:
        shape: of a row.
        in_memory: bytes from which on they are on disk.
    """

    def __init__(self, shape: tuple[int, ...], dtype: type[np.generic], *, in_memory: int = IN_MEMORY) -> None:
        """Nothing is kept yet; from so many bytes on it is on disk."""
        self.shape, self._dtype = shape, np.dtype(dtype)
        self._row = self._dtype.itemsize * int(np.prod(shape, dtype=np.int64))
        self._parts: list[NDArray[Any]] = []
        self._count = 0
        self._file: IO[bytes] | None = None
        self.in_memory = self._most = in_memory

    def __len__(self) -> int:
        """How many rows there are."""
        return self._count

    @property
    def size(self) -> int:
        """How much they are [bytes]."""
        return self._count * self._row

    def add(self, rows: NDArray[Any]) -> None:
        """Add rows, shape (n, ...)."""
        if self._file is None and (self._count + len(rows)) * self._row > self._most:
            self._move_to_disk()
        self._put(np.ascontiguousarray(rows, self._dtype))
        self._count += len(rows)

    def cut(self, count: int) -> None:
        """Keep no more than so many of the first rows."""
        kept = self.array()[:count].copy()
        self._file, self._parts, self._count = None, [], 0
        self.add(kept)

    def array(self) -> NDArray[Any]:
        """All rows so far, shape (n, ...)."""
        if self._file is None:
            self._parts = [np.concatenate([np.empty((0, *self.shape), self._dtype), *self._parts])]
            return self._parts[0][: self._count]
        self._file.flush()
        mapped = mmap.mmap(self._file.fileno(), self._count * self._row)
        return np.frombuffer(mapped, self._dtype).reshape(-1, *self.shape)

    def _put(self, rows: NDArray[Any]) -> None:
        if self._file is None:
            self._parts.append(rows.copy())
            return
        try:
            _write(self._file, rows)
        except OSError:  # the disk is full
            self._back_to_memory()
            self._put(rows)

    def _move_to_disk(self) -> None:
        try:
            folder = FOLDER if os.access(FOLDER, os.W_OK) and "TMPDIR" not in os.environ else None
            file = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115  (closed with the last array)
            for part in self._parts:
                _write(file, part)
        except OSError:  # there is no such folder, or its disk is full
            self._most = 2**63
            return
        self._file, self._parts = file, []

    def _back_to_memory(self) -> None:
        """Read what was written, and write no more."""
        assert self._file is not None
        self._file.seek(0)
        text = self._file.read(self._count * self._row)
        self._file, self._most = None, 2**63
        self._parts = [np.frombuffer(text, self._dtype).reshape(-1, *self.shape).copy()]


def _write(file: IO[bytes], rows: NDArray[Any]) -> None:
    """Write all of some rows, of which a disk that is nearly full takes a part before it tells.

    Raises:
        OSError: it is full.
    """
    rest = rows.reshape(-1).view(np.uint8).data
    while len(rest):
        rest = rest[file.write(rest) :]


def let_go(array: NDArray[Any]) -> None:
    """Free the memory that an array on disk takes by having been looked at; its numbers stay what they are."""
    base: Any = array
    while isinstance(base, np.ndarray):
        base = base.base
    base = base.obj if isinstance(base, memoryview) else base
    if isinstance(base, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        base.madvise(mmap.MADV_DONTNEED)


def blocks(array: NDArray[Any]) -> Iterator[slice]:
    """Parts of an array one after the other, each let go of when the next is asked for."""
    length = max(1, BLOCK // max(1, array[:1].nbytes))
    for first in range(0, len(array), length):
        yield slice(first, min(first + length, len(array)))
        let_go(array)
