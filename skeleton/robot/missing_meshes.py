"""Meshes that a robot's file names and nobody has: what stands in for them, so that one of them spoils nothing else."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from urllib.parse import unquote

from motions.errors import FileError
from motions.files import printable, read_bytes

Kind = Literal["visual", "collision"]

MOST_MISSING = 0.5  # share of a kind's pieces: beyond it the folders are wrong, and not a mesh


@dataclass(frozen=True)
class Mended:
    """A robot's file in which other shapes stand in for meshes that are missing.

    Attributes:
        text: the file, None where nothing is missing, or too much.
        missing: link and mesh of each that is missing, and what stands in for it.
    """

    text: str | None
    missing: tuple[str, ...]


def mended(urdf: Path, folders: Sequence[str], kind: Kind) -> Mended:
    """Put a link's shape of the other kind in the place of each mesh of a kind that no folder holds, or nothing.

    Args:
        urdf: the robot's file.
        folders: that may hold the packages which it names.
        kind: whose meshes are wanted.

    Raises:
        FileError: the file can't be read.
    """
    try:
        robot = ElementTree.fromstring(read_bytes(urdf))
    except ElementTree.ParseError as error:
        raise FileError(f"{urdf} can't be read as URDF: {error}") from None
    other: Kind = "collision" if kind == "visual" else "visual"
    told, pieces = [], 0
    for link in robot.iter("link"):
        for piece in link.findall(kind):
            pieces += 1
            name = _missing(piece, urdf, folders)
            if name is None:
                continue
            stand_ins = [found for found in link.findall(other) if _missing(found, urdf, folders) is None]
            link.remove(piece)
            for found in stand_ins:
                copy = ElementTree.SubElement(link, kind)
                copy.extend([part for part in found if part.tag in ("origin", "geometry")])
            words = f"its {other} shape stands in for it" if stand_ins else "it is left out"
            told.append(f"the mesh {printable(name)} of {printable(link.get('name', ''))} is missing: {words}")
    if not told or len(told) > MOST_MISSING * pieces:
        return Mended(None, ())
    return Mended(ElementTree.tostring(robot, encoding="unicode"), tuple(told))


def _missing(piece: ElementTree.Element, urdf: Path, folders: Sequence[str]) -> str | None:
    """Name of a piece's mesh that is in no folder; None where it is there, or the piece is no mesh."""
    mesh = piece.find("geometry/mesh")
    name = None if mesh is None else mesh.get("filename")
    if name is None:
        return None
    path = unquote(name.removeprefix("file://"))
    if name.startswith(("package://", "model://")):
        inside = name.partition("://")[2]
        return None if any((Path(folder) / inside).is_file() for folder in folders) else name
    return None if (urdf.parent / path).is_file() else name
