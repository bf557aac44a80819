"""The library's border: an argument of another kind than was asked for is the caller's mistake, and told as one.

Nothing is looked at before something fails, so that right arguments cost nothing.
"""

import builtins
import functools
import sys
import types
from collections.abc import Callable, Iterable, Mapping, Sequence, Sized
from dataclasses import is_dataclass
from inspect import Parameter, signature
from os import PathLike
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from motions.errors import UserError, ValueRangeError

T = TypeVar("T", bound=Callable[..., Any])

MISTAKEN = (TypeError, AttributeError, ValueError, OverflowError, LookupError)
"""What an argument of the wrong kind leads to somewhere."""
PACKAGES = ("motions", "skeleton", "cape")
VARIOUS = (Parameter.VAR_POSITIONAL, Parameter.VAR_KEYWORD)
MOST, MOST_WHOLE = 1e300, 2**63
"""What no sensible quantity comes near, and no array holds."""
LOOKED_AT = 100  # elements of a sequence
SHOWN = 60  # characters of a value


def checked(thing: T) -> T:
    """Have a function, or what makes and what is public in a class, raise ValueRangeError for arguments of another kind
    than its annotations say, where it fails at all."""
    return _checked(thing, first=False)


def checked_first(thing: T) -> T:
    """The same, and have a function, or what makes a class, look at its arguments before anything else: for what is
    called seldom, and would keep an argument of another kind to fail with it much later."""
    return _checked(thing, first=True)


def _checked(thing: T, *, first: bool) -> T:
    owner: Any = thing
    if not isinstance(owner, type):
        return _told(thing, first=first)
    plain = getattr(owner, "plain", ())  # what is compiled as it stands
    for name, member in list(vars(owner).items()):
        if name in plain or (name.startswith("_") and name != "__init__"):
            continue
        if isinstance(member, classmethod | staticmethod):
            setattr(owner, name, type(member)(_told(member.__func__)))
        elif isinstance(member, types.FunctionType):
            setattr(owner, name, _told(member, first=first and name == "__init__"))
    return thing


def _told(function: Callable[..., Any], *, first: bool = False) -> Any:
    @functools.wraps(function)
    def run(*arguments: Any, **named: Any) -> Any:
        if first and (told := _mistake(function, arguments, named, texts=True)) is not None:
            raise ValueRangeError(told)
        try:
            return function(*arguments, **named)
        except MISTAKEN as error:
            if isinstance(error, UserError) or (told := _mistake(function, arguments, named)) is None:
                raise
            raise ValueRangeError(told) from error

    return run


def _mistake(
    function: Callable[..., Any], arguments: Sequence[Any], named: Mapping[str, Any], *, texts: bool = False
) -> str | None:
    """Which argument is of another kind than it says in the annotations, in a sentence; None where none is.

    `texts` tells whether a text may stand for what is an array otherwise, such as the name of a region.
    """
    try:
        given = signature(function).bind(*arguments, **named)
    except TypeError:  # it is not called so at all
        return None
    owner = type(arguments[0]) if arguments and function.__name__ == "__init__" else None
    hints = get_type_hints(owner if is_dataclass(owner) else function, None, _Known(function.__globals__))
    kept = [name for name in given.arguments if given.signature.parameters[name].kind not in VARIOUS and name in hints]
    values = given.arguments
    wrong = [name for name in kept if not fits(values[name], hints[name], loosely=texts)]
    if not texts:
        wrong += [name for name in kept if isinstance(values[name], str | bytes) and _is_array(hints[name])]
    if not wrong:
        return None
    name, value = wrong[0], values[wrong[0]]
    shown = repr(value)[:SHOWN] if isinstance(value, int | float | str | bytes) else f"a {type(value).__name__}"
    return f"{name} must be {_words(hints[name])}, not {shown}"


class _Known(dict[str, Any]):
    """What names in annotations stand for: anything, where they are imported for a type checker alone."""

    def __missing__(self, name: str) -> Any:
        places = (builtins, *(sys.modules.get(package) for package in PACKAGES))
        return next((getattr(place, name) for place in places if hasattr(place, name)), Any)


def fits(value: Any, hint: Any, *, loosely: bool = False) -> bool:
    """Tell whether a value is of the kind that an annotation says; true where that can't be told.

    `loosely` takes numbers of any size, and does not look into containers.
    """
    origin, parts = get_origin(hint), get_args(hint)
    if hint is Any or isinstance(hint, TypeVar):
        return True
    if hint is None or hint is type(None):
        return value is None
    if _is_array(hint):
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
        return loosely or bool(abs(value) < (MOST_WHOLE if isinstance(value, int) else MOST))
    kind = origin or hint
    if kind is Callable:
        return callable(value)
    if not isinstance(kind, type):
        return True
    if issubclass(kind, tuple | Sequence) and kind is not str and not hasattr(kind, "_fields"):
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


def _is_array(hint: Any) -> bool:
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


def _words(hint: Any) -> str:
    """What a user calls the kind that an annotation says."""
    origin, parts = get_origin(hint), get_args(hint)
    if _is_array(hint):
        return "an array of numbers" + (" or None" if type(None) in parts else "")
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(map(_words, parts)))
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
        return "a sequence, each " + _words(parts[0])
    if isinstance(kind, type) and issubclass(kind, Mapping):
        return "a mapping"
    if kind is Callable:
        return "a function"
    return names.get(kind, f"a {getattr(kind, '__name__', kind)}")
