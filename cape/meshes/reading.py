"""Reading a cloth: from a mesh file over what cleans and remeshes it to a `MeshCloth`."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from cape.cloth.cloth import Cloth, MeshCloth
from cape.cloth.drawn.textures import Textures
from cape.cloth.fabric import Fabric
from cape.meshes.cleaning.clean import clean
from cape.meshes.embedding import embedded
from cape.meshes.files.glb import read_glb
from cape.meshes.files.obj import read_obj
from cape.meshes.files.ply import read_ply
from cape.meshes.remeshing import remeshed
from cape.meshes.source import AS_IS, Source
from motions.border import checked
from motions.errors import FileError, UnknownNameError, UserError, ValueRangeError
from motions.files import read_bytes
from motions.limits import MOST_CLOTH_VERTICES, MOST_MESH_TRIANGLES

READERS = {".glb": read_glb, ".obj": read_obj, ".ply": read_ply}
REGION = 0.5  # from which value of a map on a vertex belongs to the region


def read_source(path: str | os.PathLike[str], *, up: str | None = None) -> Source:
    """The mesh in a file, as it is.

    Args:
        path: an OBJ, PLY or GLB file, in metres.
        up: the up axis of an OBJ or PLY file, "y" (the default) or "z"; GLB has Y up. "as-is" leaves the axes alone.

    Raises:
        FileError: it can't be read, or is of another kind.
        UnknownNameError: there is no such up axis.
        ValueRangeError: another up axis than Y is named for a GLB file.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in READERS:
        raise FileError(f"{path} is no mesh that can be read; available: {', '.join(READERS)}")
    if kind == ".glb" and up not in (None, "y", AS_IS):
        raise ValueRangeError(f"{path}: GLB has Y up, not {up}")
    return READERS[kind](read_bytes(path), str(path), up=up or "y")


@checked
def read_cloth(
    path: str | os.PathLike[str],
    *,
    up: str | None = None,
    scale: float = 1.0,
    spacing: float | None = None,
    visual: str | os.PathLike[str] | None = None,
    fabric: Fabric | None = None,
    textures: Textures | None = None,
) -> tuple[MeshCloth, tuple[str, ...]]:
    """Read a mesh as a cloth without tension as it is modelled, x forward, y left, z up.

    Groups, attributes and a skin's bones become its regions: the vertices at which their value is 0.5 or more. What the
    file draws, with its texture coordinates, is drawn; what is simulated is merged, cleaned and remeshed.

    Args:
        path: an OBJ, PLY or GLB file, in metres.
        up: the up axis of an OBJ or PLY file, "y" (the default) or "z"; GLB has Y up. "as-is" leaves the axes alone.
        scale: factor on all positions.
        spacing: length of the edges of what is simulated [m]; None for the file's own.
        visual: another file of such a kind, with the same axes and scale, that is drawn in its place.
        fabric: what it is made of.
        textures: in place of the file's.

    Returns:
        The cloth, and what was done to the mesh, a sentence each.

    Raises:
        FileError: a file can't be read.
        ValueRangeError: the mesh is no cloth, for a reason that is told with its places, or it is too large.
        UnknownNameError: there is no such up axis.
    """
    if not 0.0 < scale < np.inf:
        raise ValueRangeError(f"the scale of a cloth must be positive and finite, not {scale}")
    try:
        source = _scaled(read_source(path, up=up), scale)
        cleaned = clean(source)
        simulated = cleaned if spacing is None else remeshed(cleaned, spacing)
        _require_few(simulated)
        regions = {name: np.flatnonzero(values >= REGION) for name, values in simulated.weights.items()}
        cloth = Cloth.from_mesh(
            simulated.positions,
            simulated.triangles,
            fabric=fabric,
            regions={name: region for name, region in regions.items() if len(region)},
        )
    except (FileError, UnknownNameError):
        raise
    except UserError as error:
        raise ValueRangeError(f"{path}: {error}") from None
    drawn = source if visual is None else _scaled(read_source(visual, up=up), scale)
    textures = textures or drawn.textures
    if visual is not None or spacing is not None or drawn.uv is not None:
        cloth = replace(cloth, visual=_drawn(drawn, cloth, str(path if visual is None else visual)))
    return replace(cloth, textures=textures), simulated.notes


def _drawn(source: Source, cloth: MeshCloth, label: str):
    """What is drawn, on what is simulated.

    Raises:
        ValueRangeError: a vertex is not finite, or there are too many triangles.
    """
    source = source.compact()
    if not np.isfinite(source.positions).all() or len(source.triangles) > MOST_MESH_TRIANGLES:
        raise ValueRangeError(f"{label}: what is drawn must be finite, of {MOST_MESH_TRIANGLES} triangles at most")
    return embedded(source.positions, source.triangles, source.uv, cloth.positions, cloth.faces)


def _scaled(source: Source, scale: float) -> Source:
    return replace(source, positions=scale * source.positions)


def _require_few(source: Source) -> None:
    if (count := len(source.positions)) > MOST_CLOTH_VERTICES:
        raise ValueRangeError(
            f"the mesh has {count} vertices, more than {MOST_CLOTH_VERTICES}: remesh it to a spacing, such as 0.03 m"
        )
