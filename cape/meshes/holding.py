"""Which vertices of a cloth a bone holds: a region, where an image is bright, those near the bone, or its top edge."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import MeshCloth
from cape.cloth.drawn.textures import read_image, sampled
from cape.meshes.cleaning.clean import parts_of
from cape.meshes.edges import top_edge
from cape.scene.holding.attachments import Attachment, attach
from motions.errors import UnknownNameError, ValueRangeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

IMAGES = (".png", ".jpg", ".jpeg")
BRIGHT = 0.5  # of white, from which on an image holds


def held_by_name(cloth: MeshCloth, name: str, distances: FloatArray, bone: str) -> IntArray:
    """The vertices that a bone holds.

    Args:
        cloth: whose.
        name: a region of it, the path of an image over its texture coordinates, or a distance from the bone's limb [m].
        distances: of the vertices from the bone's limb, as the cloth is modelled [m], shape (V,).
        bone: what errors call it.

    Raises:
        UnknownNameError: there is no such region.
        FileError: the image can't be read.
        ValueRangeError: the cloth has no texture coordinates, or there is no such vertex.
    """
    if name in cloth.regions:
        return cloth.regions[name]
    if name.lower().endswith(IMAGES):
        found = _bright(cloth, name)
    elif (most := _number(name)) is not None:
        found = np.flatnonzero(distances <= most)
        if not len(found):
            raise ValueRangeError(
                f"no vertex is within {most:g} m of {bone!r}; the closest is {distances.min():.3f} m off"
            )
    else:
        hint = "An image (.png) over the texture coordinates or a distance in metres chooses vertices, too"
        raise UnknownNameError("cloth region", name, cloth.regions, hint)
    if not len(found):
        raise ValueRangeError(f"{name} is dark at every vertex of the cloth: it holds none")
    return found


def attachments(cloth: MeshCloth, hold: Mapping[str, str], distances: Mapping[str, FloatArray]) -> list[Attachment]:
    """What holds a cloth as asked; what one before holds already stays with it.

    Args:
        cloth: the cloth.
        hold: bones by region, image or distance.
        distances: of the vertices from the limb of each of those bones [m], shape (V,).

    Raises:
        UserError: there is no such region or vertex, or a part of the cloth is held by nothing.
    """
    found: list[Attachment] = []
    for name, bone in hold.items():
        vertices = held_by_name(cloth, name, distances[bone], bone)
        free = np.setdiff1d(vertices, [i for before in found for i in before.vertices])
        if len(free):
            found.append(attach(cloth, bone, free))
    _require_all_held(cloth, found)
    return found


def by_the_shoulders(
    cloth: MeshCloth, modelled: FloatArray, left: str, right: str, shoulder_width: float
) -> list[Attachment]:
    """Hold the top edge of each part, its sides by the bones of their shoulder, in between by both.

    Args:
        cloth: the cloth.
        modelled: where its vertices are modelled, in the wearer's frame [m], shape (V, 3).
        left: the bone that carries the left shoulder.
        right: that of the right one.
        shoulder_width: distance of the shoulder joints [m].

    Raises:
        ValueRangeError: a part is closed, so that it has no edge.
    """
    part = parts_of(cloth.faces, cloth.vertices)
    tops = []
    for number in np.unique(part):
        edge = top_edge(modelled, cloth.faces[part[cloth.faces[:, 0]] == number])
        if not len(edge):
            raise ValueRangeError(
                f"the cloth is closed, without an edge that could be held{_where(modelled[part == number])}: "
                "name a region and a bone to hold it"
            )
        tops.append(edge)
    top = np.concatenate(tops)
    if left == right:
        return [attach(cloth, left, top)]
    share = np.clip(0.5 + modelled[top, 1] / shoulder_width, 0.0, 1.0)
    return [attach(cloth, (left, right), top, weights=np.stack([share, 1.0 - share], axis=1))]


def _bright(cloth: MeshCloth, path: str) -> IntArray:
    """The vertices on which an image is bright: what is drawn has the coordinates, and its nearest vertex tells."""
    from scipy.spatial import KDTree

    if cloth.visual is None or cloth.visual.uv is None:
        raise ValueRangeError(f"{path}: the cloth has no texture coordinates that an image could be laid over")
    bright = sampled(read_image(Path(path)), cloth.visual.uv)
    tree = KDTree(cloth.visual.places(cloth.positions))
    return np.flatnonzero(bright[tree.query(cloth.positions)[1]] >= BRIGHT)


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if 0.0 < value < np.inf else None


def _require_all_held(cloth: MeshCloth, found: list[Attachment]) -> None:
    part = parts_of(cloth.faces, cloth.vertices)
    held = part[np.concatenate([np.empty(0, np.int64), *(each.vertices for each in found)])]
    loose = np.setdiff1d(part, held)
    if len(loose):
        count = np.count_nonzero(part == loose[0])
        raise ValueRangeError(
            f"a part of {count} vertices{_where(cloth.positions[part == loose[0]])} is held by nothing and would fall: "
            "have a bone hold some of it, or leave it out of the mesh"
        )


def _where(points: FloatArray) -> str:
    return " around (" + ", ".join(f"{value:.2f}" for value in points.mean(axis=0)) + ")"
