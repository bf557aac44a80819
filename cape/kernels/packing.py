"""Groups of arrays and numbers as compiled code reads them: through one pointer to a table of words.

Passed one by one, an array is seven values and more at each call, in compiling and in running; a group is one. Its
table has for an array the address and its lengths, for a number the bits, for a group within the group the address of
that one's table. Compiled code reads `group.field` as Python reads a NamedTuple's: the same source runs on both.

A `kind` tells what is in a table, in plain Python, so that the compiler need not be loaded to ask for code that exists.
"""

import ctypes
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class ArrayKind(NamedTuple):
    """An array: its dtype as text, its dimensions, and whether it has no gaps."""

    dtype: Any
    dimensions: int
    dense: bool

    def __str__(self) -> str:
        """In a few letters."""
        text = self.dtype if isinstance(self.dtype, str) else f"record of {len(self.dtype[-1])}"
        return f"{text}[{self.dimensions}{'' if self.dense else ' with gaps'}]"


class GroupKind(NamedTuple):
    """A group: the name of its NamedTuple, and name and kind of each field."""

    name: str
    fields: "tuple[tuple[str, Kind], ...]"

    def __str__(self) -> str:
        """With all its fields."""
        return f"{self.name}({', '.join(f'{name}: {kind}' for name, kind in self.fields)})"


Kind = ArrayKind | GroupKind | str
"""What a value is: an array, a group, or one of "int", "float", "single", "bool" and "none"."""


def words_of(kind: Kind) -> int:
    """How many words of a table a value takes."""
    if isinstance(kind, ArrayKind):
        return 1 + kind.dimensions * (1 if kind.dense else 2)
    return 0 if kind == "none" else 1


class Packed:
    """A NamedTuple of arrays, numbers, None and such NamedTuples, as compiled code reads it.

    The arrays are kept, and stay where they are: what is written to them is seen on both sides. Numbers are copied.

    Attributes:
        group: what was packed.
        kind: what is in it.
        address: of its table.
    """

    __slots__ = ("_inner", "_words", "address", "group", "kind")

    def __init__(self, group: Any, known: "dict[int, Packed] | None" = None) -> None:
        """Pack a group; `known` are those packed before, which it may share.

        Raises:
            TypeError: a field is nothing that compiled code could read.
        """
        known = {} if known is None else known
        self.group = group
        self._inner: list[Packed] = []
        fields, words = [], []
        for name, value in zip(group._fields, group, strict=True):
            kind, numbers = self._read(name, value, known)
            fields.append((name, kind))
            words += numbers
        self.kind = GroupKind(type(group).__name__, tuple(fields))
        self._words: NDArray[np.int64] = np.array(words or [0], np.int64)
        self.address = address_of(self._words)

    def _read(self, name: str, value: Any, known: "dict[int, Packed]") -> tuple[Kind, list[int]]:
        if value is None:
            return "none", []
        if isinstance(value, np.ndarray):
            dense = value.flags.c_contiguous
            kind = ArrayKind(dtype_text(value.dtype), value.ndim, dense)
            return kind, [address_of(value), *value.shape, *(() if dense else value.strides)]
        if isinstance(value, (bool, np.bool_)):
            return "bool", [int(value)]
        if isinstance(value, (int, np.integer)):
            return "int", [int(np.int64(int(value)))]
        if isinstance(value, np.floating) and value.itemsize == 4:
            return "single", [int(value.view(np.int32))]
        if isinstance(value, (float, np.floating)):
            return "float", [int(np.float64(value).view(np.int64))]
        if hasattr(value, "_fields"):
            packed = known.get(id(value))
            if packed is None:
                packed = known[id(value)] = Packed(value, known)
            self._inner.append(packed)
            return packed.kind, [packed.address]
        raise TypeError(f"{type(self.group).__name__}.{name} can't be packed: {type(value).__name__}")


class Arguments(tuple):
    """The arguments of a call, as a group whose fields have no names of their own."""

    _names = tuple(f"a{k}" for k in range(64))

    @property
    def _fields(self) -> tuple[str, ...]:
        return self._names[: len(self)]


def address_of(array: NDArray[Any]) -> int:
    """Where the first number of an array is."""
    buffer: Any = array
    try:
        # In a third of the time that the array's own word takes; but not of what is empty, read-only or in pieces.
        return ctypes.addressof(ctypes.c_char.from_buffer(buffer))
    except (TypeError, ValueError, BufferError):
        return array.__array_interface__["data"][0]


def dtype_text(dtype: np.dtype[Any]) -> Any:
    """A dtype as text, or of records as nested tuples: their size, whether they are aligned, and each field."""
    if dtype.names is None:
        return dtype.str
    fields: Any = dtype.fields
    return dtype.itemsize, dtype.isalignedstruct, tuple((name, *_field_text(*fields[name][:2])) for name in dtype.names)


def _field_text(dtype: np.dtype[Any], offset: int) -> tuple[Any, tuple[int, ...], int]:
    return dtype_text(dtype.base), dtype.shape, offset


def dtype_of(text: Any) -> np.dtype[Any]:
    """The dtype that `dtype_text` told of."""
    if isinstance(text, str):
        return np.dtype(text)
    size, aligned, fields = text
    return np.dtype(
        {
            "names": [name for name, _, _, _ in fields],
            "formats": [np.dtype((dtype_of(base), shape)) for _, base, shape, _ in fields],
            "offsets": [offset for _, _, _, offset in fields],
            "itemsize": size,
        },
        align=aligned,
    )
