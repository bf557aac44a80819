"""Scene files written: what one holds, or all that one may hold, explained."""

import os
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import motions
from cape.cli.options import cut, motion
from cape.cli.scenes.file import SceneFile, names_file
from cape.cli.scenes.keys import Key, keys, keys_of
from cape.cli.scenes.tables import ATTACHMENT, COLLIDER, FABRIC
from motions.files import write_text
from skeleton.robot.solid_files import quoted

WIDTH = 110  # characters of a line of explanation

HEAD = """\
A scene, for cape replay --scene {name}. Each key is an option of cape replay, by its name without dashes; options on \
the command line go before what stands here. Paths are from the folder of this file. Lengths are in metres, Z is up. \
Keys that are commented out are as they are by default, or are not used; what stands there is an example."""

EXAMPLES: Mapping[str, Any] = {
    "script": "idle 2s, walk 3s, kick",
    "skeleton": "g1",
    "unit": "cm",
    "up": "z",
    "height": 1.8,
    "attach": ["left_shoulder=LeftCollar"],
    "fps": 60.0,
    "rate": 60.0,
    "start": 0.0,
    "end": 2.0,
    "packages": ["robots"],
    "hitboxes": "body",
    "layers": "cape,body,floor",
    "output": "hero.rrd",
    "fabric": ["worsted", "skirt=denim"],
    "spacing": 0.04,
    "substeps": 100,
    "wind-file": "mast.csv",
    "wind": [-3.0, 0.0, 0.0],
    "gusts": 0.3,
    "turbulence": 0.5,
    "seed": 1,
}
RUNS: Mapping[str, Any] = {"clip": "walk", "garment": ["shoulder_cape"], "fabric": ["cape"], "wind": [-2.0, 0.0, 0.0]}
"""What stands in a scene of which nothing is asked."""

TABLES_TOLD = """
# Tables come last. A fabric of one's own, in SI units (kg/m2, N/m, N m, s), which differs from one that cape fabrics
# lists; a pair is along warp and weft. It is worn with fabric = "velvet" above, or with fabric = ["skirt=velvet"] by a
# garment alone.
#[fabrics.velvet]
#base = "worsted"
#density = 0.3
#stretch = [2500.0, 2000.0]
#bend = 2e-5

# What holds the garment besides its own: a bone (or a role, such as chest), or bones with their weights, and the region
# or the vertices that it holds, or those within a distance of it. stiffness [N/m] is that of springs.
#[[attachment]]
#bone = "chest"
#within = 0.25
#stiffness = 20.0

# What it meets besides the body, on a bone or standing in the world; cape hitboxes --write FILE.toml writes the kinds.
#[[collider]]
#name = "post"
#kind = "capsule"
#start = [1.0, 0.5, 0.0]
#end = [1.0, 0.5, 2.0]
#radius = 0.1
"""


def save(scene: SceneFile, path: str | Path) -> None:
    """Write a scene to a file; read again, it is the same.

    Raises:
        FileError: the file can't be written.
    """
    write_text(Path(path), text_of(scene, Path(path)))


def text_of(scene: SceneFile, path: Path) -> str:
    """A scene as the text of a file, from whose folder paths are told."""
    lines = [_line(keys()[name], value, path.parent) for name, value in scene.options.items()]
    for name, table in scene.fabrics.items():
        lines += ["", f"[{FABRIC}.{quoted(name)}]", *_entries(table)]
    for kind, tables in ((ATTACHMENT, scene.attachments), (COLLIDER, scene.colliders)):
        for table in tables:
            lines += ["", f"[[{kind}]]", *_entries(table)]
    return "\n".join(lines) + "\n"


def commented(path: Path, options: Mapping[str, Any]) -> str:
    """A scene file with some options, or those of `RUNS`, and all that it may hold besides, explained.

    Args:
        path: of the file, from whose folder paths are told.
        options: by their names without dashes, paths from the current folder.
    """
    asked = dict(options or RUNS)
    if not {"clip", "script"} & set(asked):
        asked["clip"] = RUNS["clip"]
    moving, worn = keys_of(motion), keys_of(cut)
    groups = {
        "Who moves, and how": [key for name, key in keys().items() if name in moving],
        "What is worn, the air, and how to simulate it": [key for name, key in keys().items() if name in worn],
        "What is recorded and told": [k for name, k in keys().items() if name not in moving and name not in worn],
    }
    lines = _comment(HEAD.format(name=path))
    for title, group in groups.items():
        lines += ["", f"# ---- {title} ----"]
        for key in group:
            lines += ["", *_comment(key.help)]
            lines.append(_line(key, asked[key.name], path.parent) if key.name in asked else "#" + _example(key))
    return "\n".join(lines) + "\n" + TABLES_TOLD


def _comment(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False)


def _example(key: Key) -> str:
    value = EXAMPLES.get(key.name)
    if value is None and key.one_of is not None:
        value = key.default or next(iter(key.one_of.names()))
    if value is None:
        kinds: Mapping[type, Any] = {str: "...", Path: "file", float: 1.0, int: 1, bool: not key.default}
        one = kinds[key.kind]
        value = one if key.count is None else [one] * abs(key.count)
    return f"{key.name} = {_value(value)}"


def _line(key: Key, value: Any, folder: Path) -> str:
    several = isinstance(value, list | tuple)
    told = [_told(key, one, folder) for one in value] if several else _told(key, value, folder)
    return f"{key.name} = {_value(told)}"


def _told(key: Key, value: Any, folder: Path) -> Any:
    """A value of an option as the file tells it: paths from its folder, unless they are from the root."""
    if key.kind is Path:
        return _from(folder, str(value))
    if key.file is None:
        return value
    if key.file.script:
        steps = motions.parse_script(value)
        return ", ".join(str(type(step)(_named(step.clip, folder), step.seconds)) for step in steps)
    return _named(value, folder)


def _named(value: str, folder: Path) -> str:
    return _from(folder, value) if names_file(value) else value


def _from(folder: Path, path: str) -> str:
    if os.path.isabs(path):
        return path
    told = os.path.relpath(path, folder)
    return told if names_file(told) else os.path.join(".", told)


def _entries(table: Mapping[str, Any]) -> Iterable[str]:
    return [f"{_key(key)} = {_value(value)}" for key, value in table.items()]


def _key(key: str) -> str:
    return key if key.isascii() and key.replace("_", "").replace("-", "").isalnum() else quoted(key)


def _value(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_key(key)} = {_value(part)}" for key, part in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    return repr(value)
