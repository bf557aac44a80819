"""The keys of a scene file: the options of `cape replay`, as they are declared there."""

import inspect
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from typer.models import ParameterInfo

from cape.cli.marks import MayBeFile, OneOf

SCENE = "scene"  # the option that names the file

KINDS = {str: "a text", float: "a number", int: "a whole number", bool: "true or false", Path: "a path, as a text"}


@dataclass(frozen=True)
class Key:
    """A key of a scene file, and the option that it stands for.

    Attributes:
        name: of both, the option's without dashes.
        parameter: of the command, which the option sets.
        kind: of its value, or of each of several, one of `KINDS`.
        count: how many values there are; None for one alone, -1 for any number.
        help: what the option means.
        default: its value where it is not given.
        one_of: which texts it may be; None for any.
        file: how it may be a file; None where it is none, or always one.
    """

    name: str
    parameter: str
    kind: type
    count: int | None
    help: str
    default: Any
    one_of: OneOf | None = None
    file: MayBeFile | None = None

    @property
    def expected(self) -> str:
        """What its value looks like."""
        if self.count is None:
            return KINDS[self.kind]
        each = KINDS[self.kind].removeprefix("a ").removesuffix(", as a text")
        return f"a list of {f'{self.count} ' if self.count > 0 else ''}{each}s"


@cache
def keys() -> Mapping[str, Key]:
    """All keys by their names, in the order of the options."""
    from cape.cli.app import replay

    found = keys_of(replay)
    return {name: key for name, key in found.items() if name != SCENE}


def keys_of(command: Callable[..., Any]) -> dict[str, Key]:
    """The options of a command by their names, in their order."""
    found = [
        _key(parameter)
        for parameter in inspect.signature(command).parameters.values()
        if typing.get_origin(parameter.annotation) is Annotated
    ]
    return {key.name: key for key in found}


def _key(parameter: inspect.Parameter) -> Key:
    annotation, *marks = typing.get_args(parameter.annotation)
    info = next(mark for mark in marks if isinstance(mark, ParameterInfo))
    kind, count = _kind(annotation)
    return Key(
        name=_name(parameter.name, info),
        parameter=parameter.name,
        kind=kind,
        count=count,
        help=info.help or "",
        default=parameter.default,
        one_of=next((mark for mark in marks if isinstance(mark, OneOf)), None),
        file=next((mark for mark in marks if isinstance(mark, MayBeFile)), None),
    )


def _name(parameter: str, info: ParameterInfo) -> str:
    """An option's long name without dashes, the first of those that turn it on and off."""
    # In an annotation the first name stands where a default would.
    told = (info.default, *(info.param_decls or ()))
    long = [name.split("/")[0] for name in told if isinstance(name, str) and name.startswith("--")]
    return (long[0] if long else parameter.replace("_", "-")).removeprefix("--")


def _kind(annotation: Any) -> tuple[type, int | None]:
    """The kind of a value, and how many there are."""
    if isinstance(annotation, types.UnionType) or typing.get_origin(annotation) is typing.Union:
        (annotation,) = (part for part in typing.get_args(annotation) if part is not types.NoneType)
    parts = typing.get_args(annotation)
    if typing.get_origin(annotation) is tuple:
        return parts[0], len(parts)
    return (parts[0], -1) if typing.get_origin(annotation) is list else (annotation, None)
