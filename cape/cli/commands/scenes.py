"""`cape scenes` and `cape scene`: scenes with names, and scene files written and looked at."""

import inspect
import json as json_format
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cape.assembly.self_contact import contact_thickness
from cape.cli.commands.replay import Cut, prepared
from cape.cli.figures.rows import print_rows
from cape.cli.options import cut, motion
from cape.cli.output import output_path
from cape.cli.scenes.file import SceneFile
from cape.cli.scenes.keys import keys
from cape.cli.scenes.writing import commented
from cape.cli.staging import Staged
from cape.scenes.registry import all_scenes
from motions.errors import FileError
from motions.files import write_text


def list_scenes(*, json: bool) -> int:
    """List the scenes with names; gives the exit status."""
    titles = {scene.name: scene.title for scene in all_scenes().values()}
    if json:
        print(json_format.dumps(titles))
    else:
        print_rows(list(titles.items()))
    return 0


def init(options: Mapping[str, Any], output: Path) -> int:
    """Write a scene file with some options set, and all others explained; gives the exit status."""
    path = output_path(output, "scene", ".toml")
    if path.exists():
        raise FileError(f"{path} is there already: give another name by -o, or remove it")
    write_text(path, commented(path, options))
    print_rows([("scene", str(path)), ("to replay it", f"cape replay --scene {path}")])
    return 0


def check(file: SceneFile) -> int:
    """Build what a scene file tells, and tell what that is; gives the exit status."""
    values = {key.parameter: file.options.get(key.name, key.default) for key in keys().values()}
    with file.telling():
        reading = motion(**{name: values[name] for name in inspect.signature(motion).parameters})
        cape = cut(**{name: values[name] for name in inspect.signature(cut).parameters})
        who, output = prepared(
            reading,
            cape,
            scene=file,
            output=values["output"],
            hitboxes=values["hitboxes"],
            layers=None,
            tab=values["tab"],
        )
    print_rows([("scene", str(file.path)), *_rows(who, cape), ("recording", str(output))])
    return 0


def _worn(cut: Cut) -> str:
    """What is worn, and of what."""
    if not cut.fabrics:
        return f"{' over '.join(cut.worn)} of {cut.fabric}"
    return " over ".join(f"{garment} of {fabric}" for garment, fabric in cut.fabric_names().items())


def _rows(who: Staged, cut: Cut) -> list[tuple[str, str]]:
    """What is simulated, and how."""
    scene = who.scene
    held = {vertex for a in scene.attachments for vertex in a.vertices.tolist()}
    wind = scene.wind
    air = "none" if wind is None else "moving" if wind.varies or any(wind.velocity) else "still"
    layers = "none" if scene.self_contact is None else f"layers stay {1000.0 * contact_thickness(scene):.1f} mm apart"
    return [
        ("motion", f"{who.name}, {who.track.frames} frames at {who.track.fps:g} fps"),
        *(("decided", decision) for decision in who.decisions),
        (
            "cloth",
            f"{_worn(cut)}, {scene.cloth.vertices} vertices, {len(held)} of them held",
        ),
        ("held by", ", ".join(dict.fromkeys(bone for a in scene.attachments for bone in a.bones)) or "nothing"),
        ("colliders", ", ".join(collider.name for collider in scene.colliders) or "none"),
        ("air", air),
        ("self-contact", layers),
        ("solver", cut.method().name),
    ]
