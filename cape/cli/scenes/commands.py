"""`cape scene`: scene files written and looked at."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cape.cli.options import Hitboxes, cut, gathered, help_alone, motion

if TYPE_CHECKING:
    from cape.cli.commands.replay import Cut
    from cape.cli.reading import Reading

scene_files = typer.Typer(
    callback=help_alone,
    invoke_without_command=True,
    rich_markup_mode=None,
    help="Write a scene file for cape replay --scene, or look at one.",
)


@scene_files.command()
@gathered(reading=motion, cape=cut)
def init(
    context: typer.Context,
    reading: "Reading",
    cape: "Cut",
    hitboxes: Hitboxes = None,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The scene file; one that is there is left alone.")
    ] = Path("scene.toml"),
) -> int:
    """Write a scene file that says what these options say, and explains all others."""
    from cape.cli.commands.scenes import init as write
    from cape.cli.scenes.keys import keys
    from cape.cli.scenes.option import given

    own = {name: key for name, key in keys().items() if name != "output"}
    return write({name: context.params[own[name].parameter] for name in given(context, own)}, output)


@scene_files.command()
def check(file: Annotated[Path, typer.Argument(help="The scene file.", show_default=False)]) -> int:
    """Read a scene file and all that it names, build the scene, and tell what is in it: nothing is simulated."""
    from cape.cli.commands.scenes import check as look
    from cape.cli.scenes.file import read_scene

    return look(read_scene(file))
