"""A mesh that is named on the command line, as what a character wears."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from cape.cli.character import Character
from cape.cloth.drawn.textures import read_textures
from cape.meshes.reading import read_cloth
from cape.meshes.source import AS_IS
from cape.meshes.wearing import wear
from cape.scene.scene import Scene
from motions.errors import UserError, ValueRangeError
from motions.files import printable

if TYPE_CHECKING:
    from cape.cli.commands.replay import Cut


@dataclass(frozen=True)
class MeshOptions:
    """A mesh and how to wear it, as asked on the command line.

    Attributes:
        cloth: the mesh file; None for one of the garments.
        up: its up axis.
        place: the bone in whose frame it is modelled.
        modelled_height: height of the body that it is modelled on [m]; None for this body's.
        arms: of that body, from the direction down [degrees]; None to find out.
        remesh: length of the edges that are simulated [m].
        visual: a mesh that is drawn in its place.
        texture: an image to be laid over it.
    """

    cloth: Path | None = None
    up: str | None = None
    place: str | None = None
    modelled_height: float | None = None
    arms: float | None = None
    remesh: float | None = None
    visual: Path | None = None
    texture: Path | None = None

    @property
    def files(self) -> tuple[str | None, ...]:
        """What is read."""
        return tuple(None if path is None else str(path) for path in (self.cloth, self.visual, self.texture))

    def check(self) -> None:
        """Look at what can be told wrong before a motion is read.

        Raises:
            UserError: an option belongs to a mesh and there is none, or the height is out of range.
        """
        if self.cloth is None:
            for option, value in (
                ("--cloth-up", self.up), ("--place", self.place), ("--scale-to-body", self.modelled_height),
                ("--cloth-arms", self.arms), ("--remesh", self.remesh), ("--cloth-visual", self.visual),
            ):  # fmt: skip
                if value is not None:
                    raise UserError(f"{option} belongs to a mesh: name it by --cloth")
        if self.modelled_height is not None and not 0.0 < self.modelled_height < float("inf"):
            raise ValueRangeError(f"--scale-to-body takes a height above 0, not {self.modelled_height}")


def mesh_scene(cut: "Cut", cloth: Path, who: Character) -> Scene:
    """A character in a mesh; tells on standard error what was done to it.

    Raises:
        UserError: the mesh can't be read, is no cloth, or can't be worn.
    """
    asked = cut.mesh
    body = who.body
    if cut.spacing is not None or cut.length is not None:
        raise UserError("--spacing and --length are of garments; of a mesh --remesh sets the spacing")
    worn, notes = read_cloth(
        cloth,
        up=AS_IS if asked.up is None and asked.place is not None else asked.up,
        scale=1.0 if asked.modelled_height is None else body.height() / asked.modelled_height,
        spacing=asked.remesh,
        visual=asked.visual,
        fabric=cut.cloth_fabric(),
        textures=None if asked.texture is None else read_textures(asked.texture),
    )
    console = Console(stderr=True)
    for note in notes:
        told = printable(f"{cloth.name}: {note}")
        console.print(told, style="dim", highlight=False, markup=False, soft_wrap=True)
    scene = wear(
        worn,
        body,
        who.track,
        hold=cut.held(),
        place=asked.place,
        arms=asked.arms,
        colliders=who.hitboxes.solids,
        wind=cut.air(),
        self_contact=cut.self_contact,
    )
    return replace(scene, tearing=cut.tearing(), strain_limit=bool(cut.strain_limit))
