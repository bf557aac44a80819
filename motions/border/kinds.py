"""Whether a value is of the kind that an annotation says, and what a user calls that kind."""

import types
from collections.abc import Callable, Iterable, Mapping, Sequence, Sized
from os import PathLike
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

import numpy as np

MOST, MOST_WHOLE = 1e300, 2**63
"""What no sensible quantity comes near, and no array holds."""
LOOKED_AT = 100  # elements of a sequence


def fits(value: Any, hint: Any, *, loosely: bool = False) -> bool:
    """Tell whether a value is of the kind that an annotation says; true where that can't be told.

    `loosely` takes numbers of any size, and does not look into containers.
    """
    origin, parts = get_origin(hint), get_args(hint)
    if hint is Any or isinstance(hint, TypeVar):
        return True
    if hint is None or hint is type(None):
        return value is None
    if is_array(hint):
        return (value is None and type(None) in parts) or _is_numbers(value, hint)
    if origin in (Union, types.UnionType):
        return any(fits(value, part, loosely=loosely) for part in parts)
    if origin is Literal:
        return any(type(value) is type(part) and value == part for part in parts)
    if hint is bool:
        return isinstance(value, bool | np.bool_)
    if hint in (int, float):
        kinds = (int, np.integer) if hint is int else (int, float, np.integer, np.floating)
        if isinstance(value, bool) or not isinstance(value, kinds):
            return False
        # As a number of Python's, since those of few bits can't be compared with what is beyond them.
        return loosely or abs(value.item() if isinstance(value, np.generic) else value) < (
            MOST_WHOLE if isinstance(value, int) else MOST
        )
    kind = origin or hint
    if kind is Callable:
        return callable(value)
    if not isinstance(kind, type):
        return True
    if issubclass(kind, tuple | Sequence) and kind not in (str, bytes) and not hasattr(kind, "_fields"):
        # A list or an array in place of a tuple does as well.
        if isinstance(value, str | bytes | Mapping) or not isinstance(value, Sized) or getattr(value, "ndim", 1) == 0:
            return False
    elif not isinstance(value, kind):
        return False
    return loosely or _holds(value, kind, parts)


def _holds(value: Any, kind: type, parts: Sequence[Any]) -> bool:
    """Tell whether a container's elements are of the kinds that its annotation says."""
    if not parts:
        return True
    if issubclass(kind, Mapping):
        return all(fits(k, parts[0]) and fits(v, parts[1]) for k, v in list(value.items())[:LOOKED_AT])
    if issubclass(kind, tuple) and parts[-1] is not Ellipsis:
        return len(value) == len(parts) and all(map(fits, value, parts))
    if issubclass(kind, Sequence | set | frozenset):
        return not isinstance(value, str | bytes) and all(fits(each, parts[0]) for each in list(value)[:LOOKED_AT])
    return True


def is_array(hint: Any) -> bool:
    """Tell whether an annotation is of an array, or of what makes one: `ArrayLike` has complex numbers in its union."""
    return get_origin(hint) is np.ndarray or (complex in get_args(hint) and bytes in get_args(hint))


def _is_numbers(value: Any, hint: Any) -> bool:
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, OverflowError):  # ragged
        return False
    if array.dtype.kind in "SU" and array.ndim == 0:
        return get_origin(hint) is not np.ndarray
    if array.dtype.kind not in "fiub" or (array.ndim == 0 and get_origin(hint) is np.ndarray):
        return False
    whole = "int" in str(get_args(hint)[-1:])
    return not whole or bool((np.isfinite(array) & (array == np.round(array)) & (abs(array) < 2**62)).all())


def words(hint: Any) -> str:
    """What a user calls the kind that an annotation says."""
    origin, parts = get_origin(hint), get_args(hint)
    if is_array(hint):
        return "an array of numbers" + (" or None" if type(None) in parts else "")
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(map(words, parts)))
    if origin is Literal:
        return " or ".join(map(repr, parts))
    if hint is None or hint is type(None):
        return "None"
    names: dict[Any, str] = {
        float: "a number", int: "a whole number", str: "a text", bool: "True or False", PathLike: "a path",
        Iterable: "several values",
    }  # fmt: skip
    kind = origin or hint
    if isinstance(kind, type) and issubclass(kind, tuple | Sequence) and parts:
        return "a sequence, each " + words(parts[0])
    if isinstance(kind, type) and issubclass(kind, Mapping):
        return "a mapping"
    if kind is Callable:
        return "a function"
    return names.get(kind, f"a {getattr(kind, '__name__', kind)}")
