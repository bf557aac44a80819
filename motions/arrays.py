"""Arrays of numbers from an NPZ file, none of which is made before it is known to be sound."""

import io
import lzma
import math
import tokenize
import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from motions.errors import FileError
from motions.files import read_bytes
from motions.limits import LARGEST_ARRAYS

KINDS = "fiubUS"
"""Of numbers, truth values and texts: numpy's letters."""


_DAMAGED = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, ValueError, EOFError, OSError, NotImplementedError, RuntimeError,
    # By the head of an array, which numpy reads as Python's own notation of a dictionary.
    SyntaxError, TypeError, tokenize.TokenError, MemoryError, OverflowError,
)  # fmt: skip


def read_arrays(path: Path, *, only: Collection[str] | None = None) -> dict[str, NDArray[np.generic]]:
    """All arrays of an NPZ file, by name; what would have to be unpickled is left out, and refused if it is all.

    Args:
        path: the file.
        only: names of the arrays that are wanted, whatever others are like; None for all.

    Raises:
        FileError: the file is missing or damaged, is no NPZ file, holds something else than arrays of numbers or texts,
            or asks for more memory than any motion needs.
    """
    data, arrays, room = read_bytes(path), {}, LARGEST_ARRAYS
    left_out: list[str] = []
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            for member in archive.infolist():
                if only is not None and member.filename.removesuffix(".npy") not in only:
                    continue
                with archive.open(member) as file:
                    name = member.filename.removesuffix(".npy")
                    shape, kind = _head(file)
                    if kind.kind == "O":  # such as a None that was saved along
                        left_out.append(name)
                        continue
                    size = math.prod(shape) * kind.itemsize
                    if kind.kind not in KINDS:
                        raise FileError(f"{path}: array {name!r} is of {kind}, not of numbers")
                    if size > min(room, member.file_size):
                        raise FileError(f"{path}: array {name!r} claims {size / 2**20:.0f} MB, which it does not hold")
                    room -= size
                with archive.open(member) as file:
                    arrays[name] = np.lib.format.read_array(file, allow_pickle=False)
    except FileError:
        raise
    except _DAMAGED as error:
        raise FileError(f"{path} can't be read as NPZ: {error}") from None
    if left_out and not arrays:
        raise FileError(f"{path}: array {left_out[0]!r} is of object, not of numbers")
    return arrays


def array_names(path: Path) -> set[str]:
    """The names of an NPZ file's arrays, none of which is read; none of a file that is missing or no NPZ."""
    try:
        with zipfile.ZipFile(path) as archive:
            return {name.removesuffix(".npy") for name in archive.namelist()}
    except (OSError, ValueError, zipfile.BadZipFile, NotImplementedError):
        return set()


def _head(file: IO[bytes]) -> tuple[tuple[int, ...], np.dtype]:
    """Shape and kind that the head of an array states."""
    version = np.lib.format.read_magic(file)
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}.get(version)
    if read is None:
        raise ValueError(f"arrays of format {version} are unknown")
    shape, _, kind = read(file)
    return shape, kind
