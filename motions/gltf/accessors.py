"""Arrays of numbers in a glTF file (3.6.2): plain, interleaved, sparse, and whole numbers that stand for fractions."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from motions.errors import FileError
from motions.gltf.document import Document
from motions.limits import LARGEST_NUMBER

KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}  # 3.6.2.2
WHOLE = (5121, 5123, 5125)
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}

FloatArray = NDArray[np.float64]


def values_of(document: Document, number: int, *, of: str | None = None, what: str = "") -> FloatArray:
    """The numbers of an accessor, those of whole numbers that stand for fractions as these, shape (count, width).

    Args:
        document: the file.
        number: of the accessor.
        of: the type that its elements must have, such as "VEC3"; None for any.
        what: what the numbers are, for the error of one that makes no sense; "" where that may be.

    Raises:
        FileError: it reaches beyond the file, or asks for more memory than any character needs.
    """
    accessor = document.list_of("accessors")[number]
    kind, width, count = np.dtype(KINDS[accessor["componentType"]]), WIDTHS[accessor["type"]], accessor["count"]
    if of not in (None, accessor["type"]):
        raise FileError(f"{document.label}: accessor {number} is of {accessor['type']}, not of {of}")
    if isinstance(count, bool) or not isinstance(count, int) or count < 1:
        raise FileError(f"{document.label}: accessor {number} has {count!r} elements")
    document.take(8 * width * count, f"accessor {number} with {count} elements")
    if "bufferView" in accessor:
        values = _elements(document, accessor, kind, width, count, f"accessor {number}")
    else:
        values = np.zeros((count, width))
    if "sparse" in accessor:
        _replace(document, accessor["sparse"], values, kind, number)
    if accessor.get("normalized") and kind.kind in "iu":
        values = np.maximum(values / np.iinfo(kind).max, -1.0)  # 3.6.2.2: the lowest of all is -1 as well
    if what:
        require_sane(document, values, what)
    return values


def whole_numbers_of(document: Document, number: int, of: str) -> NDArray[np.int64]:
    """The numbers of an accessor that counts or names something, shape (count, width).

    Raises:
        FileError: as `values_of`, or they are no whole numbers of 0 or more.
    """
    if document.list_of("accessors")[number]["componentType"] not in WHOLE:
        raise FileError(f"{document.label}: accessor {number} has to be of whole numbers")
    return values_of(document, number, of=of).astype(np.int64)


def require_sane(document: Document, values: FloatArray, what: str) -> None:
    """Check that numbers of any shape are finite, and that no product of theirs will overflow.

    Raises:
        FileError: one isn't.
    """
    if not (np.abs(values) <= LARGEST_NUMBER).all():
        raise FileError(f"{document.label}: {what} hold a number that isn't finite, or beyond {LARGEST_NUMBER:g}")


def _replace(document: Document, sparse: dict[str, Any], values: FloatArray, kind: np.dtype, number: int) -> None:
    """Put those elements in their places that a sparse accessor states (3.6.2.3)."""
    count, label = sparse["count"], f"the sparse accessor {number}"
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= len(values):
        raise FileError(f"{document.label}: {label} replaces {count!r} of {len(values)} elements")
    at = sparse["indices"]
    if at["componentType"] not in WHOLE:
        raise FileError(f"{document.label}: {label} has places that are no whole numbers")
    places = _elements(document, at, np.dtype(KINDS[at["componentType"]]), 1, count, label).ravel().astype(np.int64)
    if places.max() >= len(values):
        raise FileError(f"{document.label}: {label} replaces elements that it does not have")
    values[places] = _elements(document, sparse["values"], kind, values.shape[1], count, label)


def _elements(
    document: Document, where: dict[str, Any], kind: np.dtype, width: int, count: int, label: str
) -> FloatArray:
    """Elements of a view, at the view's own step, shape (count, width)."""
    data, first, length, stride = document.view(where["bufferView"])
    size, offset = kind.itemsize * width, where.get("byteOffset", 0)
    step = stride or size
    end = offset + step * (count - 1) + size
    if min(first, offset, step - size) < 0 or end > length:
        raise FileError(f"{document.label}: {label} reaches beyond the file's {len(data)} bytes")
    raw = np.frombuffer(data, np.uint8, end - offset, first + offset)
    rows = np.lib.stride_tricks.as_strided(raw, (count, size), (step, 1), writeable=False)
    with np.errstate(invalid="ignore"):  # of numbers that are none, which whoever asks will find
        return np.ascontiguousarray(rows).view(kind).astype(float)
