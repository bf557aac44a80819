"""Meshes that a robot's file names and nobody has, or nobody can use as they are: what stands in for them, so that one
of them spoils nothing else."""

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from urllib.parse import unquote

from motions.errors import FileError
from motions.files import printable
from motions.limits import LARGEST_MESH
from skeleton.robot.meshes.large_meshes import LARGE, THINNED, thinned
from skeleton.urdf.reader import complete, read_urdf

Kind = Literal["visual", "collision"]

MISSING, UNREADABLE = "is missing", "can't be read"
MOST_MISSING = 0.5  # share of a kind's pieces: beyond it the folders are wrong, and not a mesh


@dataclass(frozen=True)
class Mended:
    """A robot's file in which meshes are named by where they were found, and other shapes stand in for those missing.

    Attributes:
        text: the file, None where it can stay as it is.
        missing: link and mesh of each that is missing or too large, and what stands in for it; none where too many are.
            Those that were thinned are among them.
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
        FileError: the file can't be read, or most of its meshes are too large.
    """
    robot = read_urdf(urdf)
    other: Kind = "collision" if kind == "visual" else "visual"
    told, pieces, large, renamed = [], 0, 0, complete(robot)
    lacks: dict[ElementTree.Element, str | None] = {}
    thinner: dict[str, None] = {}
    for mesh in robot.iter("mesh"):
        place, is_named = _place(mesh.get("filename", ""), urdf, folders)
        lacks[mesh] = _lacking(place)
        if place is not None and lacks[mesh] is None and _is_large(place):
            try:
                found, name = thinned(place), printable(mesh.get("filename", ""))
            except FileError:
                lacks[mesh] = UNREADABLE
                continue
            thinner[f"the mesh {name} has {found.before} triangles, and is thinned to {found.after}"] = None
            place, is_named = found.path, False
        if place is not None and not is_named:
            mesh.set("filename", str(place))
            renamed = True
    whole = ElementTree.tostring(robot, encoding="unicode") if renamed else None

    def lacking(piece: ElementTree.Element) -> str | None:
        mesh = piece.find("geometry/mesh")
        return None if mesh is None else lacks[mesh]

    for link in robot.iter("link"):
        for piece in link.findall(kind):
            pieces += 1
            wrong, mesh = lacking(piece), piece.find("geometry/mesh")
            if mesh is None or wrong is None:
                continue
            large += wrong not in (MISSING, UNREADABLE)
            stand_ins = [found for found in link.findall(other) if lacking(found) is None]
            link.remove(piece)
            for found in stand_ins:
                copy = ElementTree.SubElement(link, kind)
                copy.extend([part for part in found if part.tag in ("origin", "geometry")])
            words = f"its {other} shape stands in for it" if stand_ins else "it is left out"
            name = printable(mesh.get("filename", ""))
            told.append(f"the mesh {name} of {printable(link.get('name', ''))} {wrong}: {words}")
    if large > MOST_MISSING * pieces:
        raise FileError(f"{urdf}: {told[0].partition(':')[0]}; so are others: export them with fewer triangles")
    if not told or len(told) > MOST_MISSING * pieces:
        return Mended(whole, tuple(thinner))
    return Mended(ElementTree.tostring(robot, encoding="unicode"), (*told, *thinner))


def _lacking(place: Path | None) -> str | None:
    """What is wrong with a mesh at a place; None where nothing is."""
    if place is None:
        return MISSING
    size, most = place.stat().st_size, LARGEST_MESH if place.suffix.lower() in THINNED else LARGE
    return None if size <= most else f"has {size / 2**20:.0f} MB, more than {most / 2**20:.0f}"


def _is_large(place: Path) -> bool:
    return place.suffix.lower() in THINNED and place.stat().st_size > LARGE


def _place(name: str, urdf: Path, folders: Sequence[str]) -> tuple[Path | None, bool]:
    """Where a mesh is found, None for nowhere, and whether its name leads there."""
    path = unquote(name.removeprefix("file://"))  # any text: of one that can be no path os.path tells that it is none
    if not name.startswith(("package://", "model://")):
        place = urdf.parent / path
        return (place, True) if name and os.path.isfile(place) else (None, True)
    inside = name.partition("://")[2]
    for folder in folders:
        if os.path.isfile(place := Path(folder) / inside):
            return place, True
    within = inside.partition("/")[2]
    above = [folder / within for folder in urdf.resolve().parents]
    return next((place for place in above if within and os.path.isfile(place)), None), False
