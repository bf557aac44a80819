"""The formats there are: a line for each suffix."""

import importlib.util
import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np

from cape.exports import glb, obj, ply, usd
from cape.exports.moving_mesh import MovingMesh, moving_mesh
from cape.results.take import Take
from motions.errors import UnknownNameError, UserError


@dataclass(frozen=True)
class Format:
    """A format of files.

    Attributes:
        name: in a few words.
        write: writes a mesh to a path, and gives all files that it made.
        module: what writes it, None where nothing else is needed.
        package: that has the module.
        beside: what the names of further files have after the stem of the path's own, a regular expression.
        require_size: raises ValueRangeError where it can't hold so many frames of so many vertices.
    """

    name: str
    write: Callable[[MovingMesh, Path], tuple[Path, ...]]
    module: str | None = None
    package: str = ""
    beside: str | None = None
    require_size: Callable[[int, int], None] = lambda frames, vertices: None


_USD = Format("USD", usd.write, "pxr", "usd-core", r"_.+\.(png|jpg)")
_OBJ = r"\.(obj|mtl)|_albedo\.png"

FORMATS: dict[str, Format] = {
    ".usd": _USD,
    ".usda": _USD,
    ".usdc": _USD,
    ".glb": Format("binary glTF", glb.write, "pygltflib", "pygltflib", require_size=glb.require_size),
    ".obj": Format("OBJ, PC2 and MDD", obj.write, beside=rf"{_OBJ}|\.(pc2|mdd)"),
    ".pc2": Format("PC2 and OBJ", obj.write_pc2, beside=_OBJ),
    ".mdd": Format("MDD and OBJ", obj.write_mdd, beside=_OBJ),
    ".ply": Format("a PLY file for each frame", ply.write, beside=r"_\d{4,}\.ply"),
}
"""By suffix."""


def format_of(path: str | PathLike[str]) -> Format:
    """The format of a path, by its suffix; what writes it is there.

    Raises:
        UnknownNameError: there is none; lists them.
        UserError: a package is missing; its text says how to get it.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in FORMATS:
        hint = "cape replay, cape export and take.save write recordings (.rrd)." if suffix == ".rrd" else ""
        raise UnknownNameError("format of exports", suffix or Path(path).name, FORMATS, hint)
    found = FORMATS[suffix]
    if found.module is not None and importlib.util.find_spec(found.module) is None:
        raise UserError(f"{found.name} needs {found.package}: pip install {found.package} (OBJ and PLY need nothing)")
    return found


def may_write(path: str | PathLike[str], name: str) -> bool:
    """Whether an export to a path may make a file of this name in the path's folder."""
    path = Path(path)
    if name == path.name:
        return True
    beside = FORMATS[path.suffix.lower()].beside if path.suffix.lower() in FORMATS else None
    # Case aside, since some file systems do not tell small letters from capitals.
    return beside is not None and re.fullmatch(f"{re.escape(path.stem)}({beside})", name, re.IGNORECASE) is not None


def export(take: Take, path: str | PathLike[str], *, joints: int | None = None) -> tuple[Path, ...]:
    """Write a take in the format of the path's suffix; gives all files that were made.

    Args:
        take: what to write.
        path: the file.
        joints: of a GLB, how many joints in chains make the cloth's motion, None for a morph target for each frame; a
            warning tells how far that is from the take.

    Raises:
        UserError: the format is unknown or lacks its package, a file can't be written, or there is nothing to write.
    """
    require_format(path, joints=joints)
    mesh = moving_mesh(take)
    if joints is None:
        return format_of(path).write(mesh, Path(path))
    from cape.exports.skinned import glb as skinned_glb

    skin = skinned_glb.write(mesh, Path(path), joints=joints, held=take.held)
    off = np.linalg.norm(skin.positions() - mesh.positions, axis=2)
    warnings.warn(
        f"{joints} joints put the cloth {1000.0 * np.sqrt(np.square(off).mean()):.1f} mm (root mean square) from where "
        f"it was simulated, {1000.0 * off.max():.0f} mm at most: more of them are closer",
        stacklevel=3,
    )
    return (Path(path),)


def require_format(path: str | PathLike[str], *, joints: int | None = None) -> None:
    """Check that a path's format can be written, and has joints where some are asked for.

    Raises:
        UserError: it can't.
    """
    found = format_of(path)
    if joints is not None and found is not FORMATS[".glb"]:
        raise UserError(f"joints are for binary glTF (.glb), not for {found.name}")
