"""The springs of a cloth of several fabrics, piece by piece."""

from collections.abc import Callable, Hashable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.fabrics import patchwork_of
from cape.assembly.membrane import plane_stiffness
from cape.assembly.springs import Springs
from cape.cloth.cloth import Cloth, MeshCloth
from cape.cloth.fabric import Fabric


class Piece(NamedTuple):
    """What of a cloth is of a fabric, or of fabrics that are alike: one of these, its springs among the vertices of the
    whole, and which of the vertices are of it, shape (N,)."""

    fabric: Fabric
    springs: Springs
    vertices: NDArray[np.bool_]


def pieces_of(cloth: Cloth, springs: Springs) -> list[Piece]:
    """The pieces of a cloth by their fabrics."""
    return _sorted_by(cloth, springs, lambda fabric: fabric)


def alike_pieces(cloth: Cloth, springs: Springs) -> list[Piece]:
    """The same by what kernels take as one number for all: damping times, and what a membrane resists with."""

    def numbers(fabric: Fabric) -> Hashable:
        plane = plane_stiffness(fabric).tobytes() if springs.membrane is not None else None
        return fabric.damping_time, fabric.bend_damping_time, plane

    return _sorted_by(cloth, springs, numbers)


def _sorted_by(cloth: Cloth, springs: Springs, kind: Callable[[Fabric], Hashable]) -> list[Piece]:
    """Pieces of fabrics of one kind each, in the order of the fabrics."""
    patches = patchwork_of(cloth)
    if patches is None or not isinstance(cloth, MeshCloth):
        return [Piece(cloth.fabric, springs, np.ones(cloth.vertices, dtype=bool))]
    kinds: dict[Hashable, list[int]] = {}
    for number, fabric in enumerate(patches.fabrics):
        kinds.setdefault(kind(fabric), []).append(number)
    if len(kinds) == 1:
        if springs.membrane is not None:
            plane = plane_stiffness(patches.fabrics[0])
            springs = replace(springs, membrane=replace(springs.membrane, stiffness=plane))
        return [Piece(patches.fabrics[0], springs, np.ones(cloth.vertices, dtype=bool))]
    number = patches.at_vertices(cloth.faces)
    return [_piece(patches.fabrics[some[0]], springs, np.isin(number, some)) for some in kinds.values()]


def _piece(fabric: Fabric, springs: Springs, vertices: NDArray[np.bool_]) -> Piece:
    linked = vertices[springs.first]
    bent = vertices[springs.bend_vertices].all(axis=1)  # rows are filled up with a vertex of theirs
    membrane = springs.membrane
    if membrane is not None:
        membrane, _ = membrane.among(np.flatnonzero(vertices[membrane.faces[:, 0]]))
        membrane = replace(membrane, stiffness=plane_stiffness(fabric))
    return Piece(fabric, Springs(**springs.among(linked, np.flatnonzero(bent)), membrane=membrane), vertices)
