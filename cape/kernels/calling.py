"""Compiled functions called from Python."""

import ctypes
from typing import Any

import numpy as np

from cape.kernels import store
from cape.kernels.jit import COMPILER_OFF, Function
from cape.kernels.packing import Arguments, GroupKind, Packed

NUMBERS = {
    "int": np.dtype(np.int64),
    "unsigned": np.dtype(np.uint64),
    "float": np.dtype(np.float64),
    "single": np.dtype(np.float32),
    "bool": np.dtype(np.bool_),
}
"""What a function may return."""

_PROTOTYPE = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
_WORDS = 32  # of a result, more than any function returns
_Room = ctypes.c_int64 * _WORDS  # of which one is made in a tenth of the time that an array of numpy's takes

_entries: dict[tuple[Function, GroupKind], "Entry"] = {}


class Entry:
    """A compiled function of one group of arguments; other threads may go on while it runs."""

    def __init__(self, code: store.Code) -> None:
        """Make code in memory callable."""
        self._call = _PROTOTYPE(code.address)
        self._single = NUMBERS.get(code.returns) if isinstance(code.returns, str) else None
        self._several = None
        if not isinstance(code.returns, str):
            self._several = np.dtype([(f"f{k}", NUMBERS[name]) for k, name in enumerate(code.returns)], align=True)

    def __call__(self, address: int) -> Any:
        """Call it with the group whose table is at an address."""
        room = _Room()
        place = ctypes.addressof(room)
        self._call(place, place + 8 * (_WORDS - 1), address)
        returns = self._several if self._single is None else self._single
        if returns is not None:
            return np.frombuffer(memoryview(room), returns, 1)[0].item()
        return None


class Bound:
    """A function with its arguments, to be called again and again; what is written to the arrays is seen.

    Attributes:
        request: what the call needs compiled.
    """

    def __init__(self, function: Function, *arguments: Any) -> None:
        """Keep the arguments; nothing is compiled before the first call."""
        self._function, self._arguments = function, arguments
        self._packed = Packed(Arguments(arguments))
        assert isinstance(self._packed.kind, GroupKind)
        self.request = store.Request(function, (self._packed.kind,), spread=True)
        self._entry: Entry | None = None

    def __call__(self) -> Any:
        """Call it."""
        if COMPILER_OFF:
            return self._function.python(*self._arguments)
        if self._entry is None:
            self._entry = entry_of(self._function, self._packed.kind)
        return self._entry(self._packed.address)


def entry_of(function: Function, kind: GroupKind) -> Entry:
    """The entry of a function for arguments of these kinds."""
    key = function, kind
    entry = _entries.get(key)
    if entry is None:
        entry = _entries[key] = Entry(store.code_of(store.Request(function, (kind,), spread=True)))
    return entry
