"""Options of `cape replay` that are handed on to it as its arguments: those of the command line, and of a sweep."""

import os
from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import typer

from cape.cli.scenes.file import SceneFile
from cape.cli.scenes.keys import SCENE, Key, keys_of
from cape.cli.scenes.option import given, telling, without_rivals
from motions.errors import UnknownNameError, UserError

OWN = (
    "clip",
    "script",
    "output",
    "spawn",
    "json",
)  # options of `cape replay` that mean nothing here, or something else
YES, NO = ("true", "yes", "on"), ("false", "no", "off")
SEVERAL = ","
MOST = 100_000  # combinations of a sweep


def replay_keys() -> dict[str, Key]:
    """The options of `cape replay` that can be handed on, by their names."""
    from cape.cli.app import replay

    return {name: key for name, key in keys_of(replay).items() if name not in OWN}


def handed_on(context: typer.Context) -> tuple[str, ...]:
    """Those of a command's options that are on its command line, as arguments of `cape replay`."""
    known = replay_keys()
    found: list[str] = []
    for name in given(context, known):
        found += _as_arguments(known[name], context.params[known[name].parameter])
    return tuple(found)


def combinations(sweeps: Iterable[str], *, besides: Iterable[str] = ()) -> list[dict[str, str]]:
    """All combinations of swept values, by option; a single empty one where nothing is swept.

    Args:
        sweeps: each "NAME=VALUE,VALUE"; the first one varies slowest.
        besides: options that are given with a value of their own.

    Raises:
        UserError: one of them reads otherwise, names no option of `cape replay`, or one that is given already; or there
            are too many.
    """
    swept: dict[str, list[str]] = {}
    for text in sweeps:
        name, equals, values = text.partition("=")
        name = name.strip().removeprefix("--")
        chosen = list(dict.fromkeys(value.strip() for value in values.split(SEVERAL)))
        if not equals or not all(chosen):
            raise UserError(f"--sweep takes NAME=VALUE,VALUE, such as fabric=silk,denim, not {text!r}")
        if name not in replay_keys():
            raise UnknownNameError("option to sweep", name, replay_keys())
        if name in swept:
            raise UserError(f"--sweep {name} is given twice: list all of its values in one")
        if name in besides:
            raise UserError(f"--{name} is given besides --sweep {name}: leave one of them out")
        swept[name] = chosen
    count = 1
    for chosen in swept.values():
        count *= len(chosen)
    if count > MOST:
        raise UserError(f"the sweep has {count} combinations, more than {MOST}")
    return [dict(zip(swept, values, strict=True)) for values in product(*swept.values())]


def swept_arguments(combination: Mapping[str, str]) -> tuple[str, ...]:
    """A combination as arguments of `cape replay`.

    Raises:
        UserError: an option that is on or off is given another value.
    """
    known = replay_keys()
    found: list[str] = []
    for name, text in combination.items():
        key = known[name]
        if key.kind is not bool:
            found += _as_arguments(key, text.split() if key.count is not None else text)
        elif text.lower() in (*YES, *NO):
            found += _as_arguments(key, text.lower() in YES)
        else:
            raise UserError(f"--sweep {name} takes true and false, not {text!r}")
    return tuple(found)


def files_named(arguments: Sequence[str]) -> list[str]:
    """Check arguments of `cape replay` as it would before it reads a motion; gives the files that they name.

    Raises:
        UserError: a name or a number is wrong.
        typer.TyperException: an option can't be read.
    """
    from cape.cli.app import app, split
    from cape.cli.character import require_hitboxes
    from cape.cli.commands.replay import checked_cut
    from cape.cli.options import cut, motion

    command = typer.main.get_command(app).commands["replay"]  # pyright: ignore[reportAttributeAccessIssue]
    with command.make_context("cape batch", ["walk", *arguments]) as context:
        params = without_rivals(context, context.params)
        scene = params[SCENE]
        reading = motion(**{key.parameter: params[key.parameter] for key in keys_of(motion).values()})
        asked = cut(**{key.parameter: params[key.parameter] for key in keys_of(cut).values()})
        with telling(context, scene):
            reading.check()
            if params["hitboxes"] is not None:
                require_hitboxes(params["hitboxes"])
            checked_cut(asked, scene=scene, layers=split(params["layers"]), tab=params["tab"])
    known = replay_keys().values()
    values = [params[key.parameter] for key in known if key.kind is Path or key.file is not None]
    named = [each for value in values for each in (value if isinstance(value, (list, tuple)) else [value])]
    if isinstance(scene, SceneFile):
        named.append(scene.path)
    return list(dict.fromkeys(str(name) for name in named if name is not None and os.path.isfile(name)))


def _as_arguments(key: Key, value: Any) -> list[str]:
    option = f"--{key.name}"
    if key.name == SCENE:
        return [f"{option}={value.path if isinstance(value, SceneFile) else getattr(value, 'name', value)}"]
    if key.kind is bool:
        if value:
            return [option]
        return [] if key.default is False else [f"--no-{key.name}"]
    if key.count is None:
        return [f"{option}={value}"]
    if key.count < 0:
        return [f"{option}={each}" for each in value]
    return [option, *map(str, value)]
