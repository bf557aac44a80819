"""What a scene file tells beyond options: fabrics of its own, more attachments and colliders, each a table."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from cape.cloth.cloth import Cloth
from cape.cloth.fabric import Fabric
from cape.cloth.fabrics import FABRICS, fabric
from cape.scene.holding.attachments import Attachment, attach
from cape.scene.scene import Scene
from motions.errors import FileError, UnknownNameError, UserError
from skeleton.robot.solid_files import solid_of
from skeleton.shapes import Shape
from skeleton.track import BoneTrack

Table = Mapping[str, Any]

FABRIC, ATTACHMENT, COLLIDER = "fabrics", "attachment", "collider"
TABLES = (FABRIC, ATTACHMENT, COLLIDER)

BASE = "base"  # the fabric that another differs from
FABRIC_KEYS = (BASE, *(field.name for field in fields(Fabric)))
ATTACHMENT_KEYS = ("bone", "bones", "region", "vertices", "within", "points", "stiffness", "damping", "along")


@dataclass(frozen=True, eq=False)
class Tables:
    """The tables of a scene file, read.

    Attributes:
        fabrics: by name.
        attachments: what makes each of them for a cloth.
        colliders: in the frames of bones, or in the world.
        places: where in the file attachments and colliders stand, in this order.
    """

    fabrics: Mapping[str, Fabric]
    attachments: tuple[Table, ...] = ()
    colliders: tuple[Shape, ...] = ()
    places: tuple[str, ...] = ()

    def fabric(self, name: str) -> Fabric:
        """The fabric of that name, the file's own before those that are known.

        Raises:
            UnknownNameError: there is none.
        """
        if name in self.fabrics:
            return self.fabrics[name]
        if name not in FABRICS:
            raise UnknownNameError("fabric", name, (*self.fabrics, *FABRICS))
        return fabric(name)

    def require_bones(self, track: BoneTrack) -> None:
        """Look for the bones of all colliders.

        Raises:
            FileError: there is no such bone, nor a role of that name; tells the line.
        """
        for solid, where in zip(self.colliders, self.places[len(self.attachments) :], strict=True):
            if solid.bone is not None:
                with told_at(where):
                    track.index(solid.bone)

    def added_to(self, scene: Scene, track: BoneTrack) -> Scene:
        """A scene with the attachments, which take over their vertices from its own.

        Raises:
            FileError: one makes no sense there, or its bone is not in the track; tells the line.
        """
        added: list[Attachment] = []
        for table, where in zip(self.attachments, self.places, strict=False):
            with told_at(where):
                one = attached(scene.cloth, table)
                for bone in one.bones:
                    track.index(bone)
                added.append(one)
        if not added:
            return scene
        taken = np.concatenate([one.vertices for one in added])
        own = [part for one in scene.attachments if (part := _without(one, taken)) is not None]
        return replace(scene, attachments=(*own, *added))


NONE = Tables({})


@contextmanager
def told_at(where: str) -> Iterator[None]:
    """Tell errors of the block with the place that they are about."""
    try:
        yield
    except UserError as error:
        raise FileError(f"{where}: {error}") from None


def attached(cloth: Cloth, table: Table) -> Attachment:
    """The attachment that a table tells, of a cloth.

    Raises:
        UserError: it makes no sense, or not for this cloth.
    """
    held = table.get("region", table.get("vertices"))
    return attach(
        cloth,
        table["bone"] if "bone" in table else table["bones"],
        held,
        **{key: table[key] for key in ("within", "points", "stiffness", "damping", "along") if key in table},
    )


def fabric_of(table: Table) -> Fabric:
    """The fabric that a table tells.

    Raises:
        UserError: there is no such fabric to differ from, or a value is out of range.
    """
    given = {key: tuple(value) if isinstance(value, list) else value for key, value in table.items() if key != BASE}
    return replace(fabric(table[BASE]) if BASE in table else Fabric(), **given)


def collider_of(table: Table, where: str) -> Shape:
    """The collider that a table tells.

    Raises:
        FileError: it makes no sense.
    """
    return solid_of(table, where, None)


def _without(attachment: Attachment, taken: Any) -> Attachment | None:
    """An attachment without some vertices; None where none is left."""
    kept = ~np.isin(attachment.vertices, taken)
    if kept.all() or not kept.any():
        return attachment if kept.all() else None
    each = {
        name: None if (values := getattr(attachment, name)) is None else values[kept]
        for name in ("points", "weights", "stiffness", "damping")
    }
    return replace(attachment, vertices=attachment.vertices[kept], **each)
