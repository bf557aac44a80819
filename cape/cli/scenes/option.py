"""The option `--scene`: a file, or a name, whose options hold where the command line gives no others."""

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer

from cape.cli.scenes.file import SceneFile, read_scene
from cape.cli.scenes.keys import Key, keys
from cape.scenes.registry import NamedScene, all_scenes, named_scene
from motions.errors import UnknownNameError

# Where one of these is on the command line, a scene's options in its partner say something else.
RIVALS = (("clip",), ("script",)), (("solver", "substeps"), ("tolerance", "budget")), (("unit",), ("height",))


def scene_asked(text: str) -> SceneFile | NamedScene:
    """The scene that a file or a name means.

    Raises:
        UserError: the file can't be read or makes no sense, or there is no scene of that name.
    """
    if text in all_scenes():
        return named_scene(text)
    if Path(text).suffix.lower() == ".toml" or os.path.exists(text):
        return read_scene(text)
    raise UnknownNameError("scene", text, all_scenes(), "Or give a TOML file, such as cape scene init writes")


def take_options(context: typer.Context, text: str | None) -> Any:
    """Read what `--scene` names, and have its options hold where the command line tells nothing: a callback."""
    if text is None:
        return None
    scene = scene_asked(text)
    context.default_map = {keys()[name].parameter: value for name, value in scene.options.items()}
    return scene


def given(context: typer.Context, known: Mapping[str, Key]) -> list[str]:
    """Those of the keys whose options are on the command line."""
    return [key.name for key in known.values() if _is_given(context, key.parameter)]


def _is_given(context: typer.Context, parameter: str) -> bool:
    source = context.get_parameter_source(parameter)
    return source is not None and source.name == "COMMANDLINE"


def without_rivals(context: typer.Context, values: Mapping[str, Any]) -> dict[str, Any]:
    """The values of parameters, those of a scene left out that contradict what is on the command line."""
    if not context.default_map:
        return dict(values)
    settled, asked = dict(values), given(context, keys())
    for one, other in (*RIVALS, *((b, a) for a, b in RIVALS)):
        if _any(asked, one) and not _any(asked, other):
            settled.update({keys()[name].parameter: keys()[name].default for name in other})
    return {name: settled[name] for name in values}


def _any(asked: Iterable[str], names: Iterable[str]) -> bool:
    return not set(asked).isdisjoint(names)


@contextmanager
def telling(context: typer.Context, scene: SceneFile | NamedScene | None) -> Iterator[None]:
    """Tell errors of the block with the line of a scene's file that they speak of."""
    if not isinstance(scene, SceneFile):
        yield
        return
    with scene.telling(given(context, keys())):
        yield
