"""Meshes that a robot's file names and nobody has: what stands in for them, so that one of them spoils nothing else."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from urllib.parse import unquote

from motions.files import printable
from skeleton.urdf.reader import read_urdf

Kind = Literal["visual", "collision"]

MOST_MISSING = 0.5  # share of a kind's pieces: beyond it the folders are wrong, and not a mesh


@dataclass(frozen=True)
class Mended:
    """A robot's file in which meshes are named by where they were found, and other shapes stand in for those missing.

    Attributes:
        text: the file, None where it can stay as it is.
        missing: link and mesh of each that is missing, and what stands in for it; none where too many are.
    """

    text: str | None
    missing: tuple[str, ...]


def mended(urdf: Path, folders: Sequence[str], kind: Kind) -> Mended:
    """Put a link's shape of the other kind in the place of each mesh of a kind that no folder holds, or nothing.

    A package whose folder has another name, as after a download, is taken to be the nearest folder above the robot's
    file that holds the mesh.

    Args:
        urdf: the robot's file.
        folders: that may hold the packages which it names.
        kind: whose meshes are wanted.

    Raises:
        FileError: the file can't be read.
    """
    robot = read_urdf(urdf)
    other: Kind = "collision" if kind == "visual" else "visual"
    told, pieces, renamed = [], 0, False
    places = {mesh: _place(mesh.get("filename", ""), urdf, folders) for mesh in robot.iter("mesh")}
    for mesh, place in places.items():
        if isinstance(place, Path):
            mesh.set("filename", str(place))
            renamed = True
    whole = ElementTree.tostring(robot, encoding="unicode") if renamed else None

    def is_missing(piece: ElementTree.Element) -> bool:
        mesh = piece.find("geometry/mesh")
        return mesh is not None and places[mesh] is None

    for link in robot.iter("link"):
        for piece in link.findall(kind):
            pieces += 1
            mesh = piece.find("geometry/mesh")
            if mesh is None or not is_missing(piece):
                continue
            stand_ins = [found for found in link.findall(other) if not is_missing(found)]
            link.remove(piece)
            for found in stand_ins:
                copy = ElementTree.SubElement(link, kind)
                copy.extend([part for part in found if part.tag in ("origin", "geometry")])
            words = f"its {other} shape stands in for it" if stand_ins else "it is left out"
            name = printable(mesh.get("filename", ""))
            told.append(f"the mesh {name} of {printable(link.get('name', ''))} is missing: {words}")
    if not told or len(told) > MOST_MISSING * pieces:
        return Mended(whole, ())
    return Mended(ElementTree.tostring(robot, encoding="unicode"), tuple(told))


def _place(name: str, urdf: Path, folders: Sequence[str]) -> Path | Literal["as named"] | None:
    """Where a mesh is found that isn't where its name tells; "as named" where it is, or has none, None for nowhere."""
    path = unquote(name.removeprefix("file://"))
    if not name.startswith(("package://", "model://")):
        return "as named" if not name or (urdf.parent / path).is_file() else None
    inside = name.partition("://")[2]
    if any((Path(folder) / inside).is_file() for folder in folders):
        return "as named"
    within = inside.partition("/")[2]
    above = [folder / within for folder in urdf.resolve().parents]
    return next((place for place in above if within and place.is_file()), None)
