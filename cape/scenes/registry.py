"""The scenes that have a name to be replayed by: a line for each."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cape.scene import tearing_scenes
from cape.scene.standard_scenes import STANDARD_SCENES, StandardScene
from cape.scenes import figures
from motions.errors import UnknownNameError


@dataclass(frozen=True)
class NamedScene:
    """A scene with a name.

    Attributes:
        name: as it is asked for.
        title: what it shows, in a line.
        make: builds it; None where it is a character with a garment, as the options tell.
        options: of `cape replay`, by their names without dashes.
    """

    name: str
    title: str
    make: Callable[..., StandardScene] | None = None
    options: Mapping[str, Any] = field(default_factory=dict)


SCENES: dict[str, NamedScene] = {
    scene.name: scene
    for scene in (
        NamedScene("sheet", "a sheet with a texture hangs in gusts of wind", figures.sheet),
        NamedScene("moved", "a sheet on cubes that move about", figures.moved),
        NamedScene("sphere", "a sheet falls onto a sphere", figures.on_sphere),
        NamedScene("cube", "a sheet falls onto a cube", figures.on_cube),
        NamedScene("look", "a ribbed silk in folds: weave, sheen and lining", figures.look),
        NamedScene("torn", "a heavy ball falls through a sheet, which tears", tearing_scenes.torn),
        NamedScene("caught", "a cape whose hem is caught walks off and leaves a piece behind", tearing_scenes.caught),
        NamedScene(
            "cape",
            "a character in a cape stands, walks, runs and kicks",
            options={"script": "idle 1s, walk 2s, run 2s, kick, idle 1s", "garment": ["back_cape"]},
        ),
        NamedScene(
            "hitboxes",
            "what the cape of a character meets: hit boxes and contacts",
            options={"clip": "kick", "garment": ["back_cape"], "tab": "hitboxes"},
        ),
    )
}


def all_scenes() -> dict[str, NamedScene]:
    """All scenes by their names: those to look at, then those that are measured with."""
    measured = {
        name: NamedScene(name, "one of those that cape report measures with", make)
        for name, make in STANDARD_SCENES.items()
        if name not in SCENES
    }
    return {**SCENES, **measured}


def named_scene(name: str) -> NamedScene:
    """The scene of that name.

    Raises:
        UnknownNameError: there is none; lists them.
    """
    scenes = all_scenes()
    if name not in scenes:
        raise UnknownNameError("scene", name, scenes)
    return scenes[name]
