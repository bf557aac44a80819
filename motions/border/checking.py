"""What looks at the arguments of what is public: where it fails, or before that.

`checked` looks at nothing before something fails, so that right arguments cost nothing.
"""

import builtins
import functools
import sys
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from inspect import Parameter, signature
from typing import Any, TypeVar, get_type_hints

from motions.border.kinds import fits, is_array, words
from motions.errors import UserError, ValueRangeError

T = TypeVar("T", bound=Callable[..., Any])

MISTAKEN = (TypeError, AttributeError, ValueError, OverflowError, LookupError)
"""What an argument of the wrong kind leads to somewhere."""
PACKAGES = ("motions", "skeleton", "cape")
VARIOUS = (Parameter.VAR_POSITIONAL, Parameter.VAR_KEYWORD)
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
        wrong += [name for name in kept if isinstance(values[name], str | bytes) and is_array(hints[name])]
    if not wrong:
        return None
    name, value = wrong[0], values[wrong[0]]
    shown = repr(value)[:SHOWN] if isinstance(value, int | float | str | bytes) else f"a {type(value).__name__}"
    return f"{name} must be {words(hints[name])}, not {shown}"


class _Known(dict[str, Any]):
    """What names in annotations stand for: anything, where they are imported for a type checker alone."""

    def __missing__(self, name: str) -> Any:
        places = (builtins, *(sys.modules.get(package) for package in PACKAGES))
        unknown = _Module() if name.islower() else Any
        return next((getattr(place, name) for place in places if hasattr(place, name)), unknown)


class _Module:
    """A module that is imported for a type checker alone: whatever it holds is anything."""

    def __getattr__(self, name: str) -> Any:
        return Any
