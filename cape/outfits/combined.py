"""Several cloths as one, whose parts meet as layers of one cloth do."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cape.assembly.self_contact import rest_shape
from cape.cloth.cloth import Cloth, GridCloth, MeshCloth
from cape.cloth.fabric import Fabric
from cape.cloth.patches.patchwork import Patchwork
from cape.cloth.sewing import along_threads
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

APART = 0.1  # m between the parts in the picture of the pattern


@dataclass(frozen=True, eq=False)
class Part:
    """One of the cloths.

    Attributes:
        name: what it is called.
        cloth: as it was cut; its vertices follow those of the parts before it.
        start: number of its first vertex.
    """

    name: str
    cloth: Cloth
    start: int

    @property
    def vertices(self) -> slice:
        """Where its vertices are among those of all."""
        return slice(self.start, self.start + self.cloth.vertices)


@dataclass(frozen=True, eq=False, kw_only=True)
class Outfit(MeshCloth):
    """Cloths that are not sewn together.

    Attributes:
        parts: the cloths, from the innermost outwards.
    """

    parts: tuple[Part, ...] = ()


def combined(names: Sequence[str], cloths: Sequence[Cloth], places: Sequence[FloatArray]) -> Outfit:
    """Make one cloth of several, each of its own fabric.

    Regions are called by the part and their own name: "skirt.hem". The `fabric` of all is that of the outermost.

    Args:
        names: of the cloths.
        cloths: as they were cut, from the innermost outwards.
        places: where the vertices of each start in the world [m], shape (V, 3).

    Raises:
        ValueRangeError: there is none, two share a name, or one is of several fabrics itself.
    """
    if not names or len(set(names)) < len(names):
        raise ValueRangeError(f"cloths that are worn together need different names, not {', '.join(names) or 'none'}")
    meshes = [as_mesh(cloth) for cloth in cloths]
    if any(mesh.patchwork is not None for mesh in meshes):
        raise ValueRangeError("a cloth that is worn with others is of one fabric")
    starts = np.cumsum([0, *(mesh.vertices for mesh in meshes)]).tolist()
    lefts = np.cumsum([0.0, *(np.ptp(mesh.pattern[:, 0]) + APART for mesh in meshes)])
    threads = [None if m.threads is None else m.threads + start for m, start in zip(meshes, starts, strict=False)]
    return Outfit(
        pattern=np.concatenate(
            [m.pattern - m.pattern.min(axis=0) + [left, 0.0] for m, left in zip(meshes, lefts, strict=False)]
        ),
        positions=np.concatenate(list(places)),
        rest=np.concatenate([rest_shape(mesh) for mesh in meshes]),
        fabric=cloths[-1].fabric,
        patchwork=_patchwork(meshes),
        layers=np.concatenate([np.ones(len(m.faces)) if m.layers is None else m.layers for m in meshes]),
        regions={
            f"{name}.{region}": start + vertices
            for name, mesh, start in zip(names, meshes, starts, strict=False)
            for region, vertices in mesh.regions.items()
        },
        faces=np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]),
        corners=np.concatenate([mesh.corners for mesh in meshes]),
        threads=None if any(t is None for t in threads) else np.concatenate([t for t in threads if t is not None]),
        parts=tuple(map(Part, names, cloths, starts)),
    )


def _patchwork(meshes: Sequence[MeshCloth]) -> Patchwork | None:
    """Which of the meshes' triangles are of which fabric; None where all are of one."""
    fabrics = list(dict.fromkeys(mesh.fabric for mesh in meshes))
    if len(fabrics) == 1:
        return None
    return Patchwork(tuple(fabrics), np.concatenate([np.full(len(m.faces), fabrics.index(m.fabric)) for m in meshes]))


def of_fabric(cloth: Cloth, fabric: Fabric) -> Cloth:
    """A cloth as it is, all of another fabric; an outfit with all of its parts."""
    if isinstance(cloth, Outfit):
        parts = tuple(replace(part, cloth=replace(part.cloth, fabric=fabric)) for part in cloth.parts)
        return replace(cloth, fabric=fabric, patchwork=None, parts=parts)
    if isinstance(cloth, MeshCloth):
        return replace(cloth, fabric=fabric, patchwork=None)
    return replace(cloth, fabric=fabric)


def as_mesh(cloth: Cloth) -> MeshCloth:
    """A cloth as a mesh of the same triangles and threads.

    Cloth that is gathered into a cell of a grid counts as that many layers, whose weft resists as well: a mesh knows
    but one number of layers for both threads.
    """
    if isinstance(cloth, MeshCloth):
        return cloth
    if not isinstance(cloth, GridCloth):
        raise TypeError(f"no mesh is known for a {type(cloth).__name__}")
    index = np.arange(cloth.vertices).reshape(cloth.rows, cloth.columns)
    faces, corners = cloth.triangles.astype(np.int64), cloth.corners_at_rest
    if cloth.darted:
        row, column = np.indices(index.shape)
        corners = along_threads(corners, np.stack([column.ravel(), row.ravel()], axis=1).astype(float)[faces])
    layers = np.ones((cloth.rows - 1, cloth.columns - 1))
    for several in (cloth.layers, cloth.gathers):
        layers = layers if several is None else layers * several
    across, down = ((index[:, :-1], index[:, 1:]), (index[:-1], index[1:]))
    return MeshCloth(
        pattern=cloth.pattern,
        positions=cloth.positions,
        frame=cloth.frame,
        fabric=cloth.fabric,
        layers=np.tile(layers.ravel(), 2),
        regions=cloth.regions,
        faces=faces,
        corners=corners,
        threads=np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in (across, down)]),
    )


def started_at(cloth: Cloth, places: FloatArray) -> MeshCloth:
    """A cloth as a mesh that starts at some places in the world [m], shape (V, 3).

    Without tension it is where it was before: what lies close together as it starts still meets.
    """
    mesh = as_mesh(cloth)
    return replace(mesh, positions=places, rest=rest_shape(mesh), frame="world", neckline=None)
