"""What of a character's mesh belongs to each of its bones, in the bone's frame."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.skin import Skin, SkinPiece
from skeleton.rest import RestPose

FloatArray = NDArray[np.float64]

_ENDS = ("hand", "foot")
_LIMBS = ("shoulder", "upper_arm", "forearm", "thigh", "shin")
_SMALL = 0.1
"""Of the body's height: what is smaller and hangs at head or trunk, as a jaw, counts as part of it; hair does not."""


@dataclass(frozen=True, eq=False)
class BoneSurface:
    """The part of a mesh that follows one bone more than any other.

    Attributes:
        bone: name of the bone.
        vertices: in the bone's frame [m], shape (V, 3).
        triangles: vertex indices, counter-clockwise seen from outside, shape (T, 3).
    """

    bone: str
    vertices: FloatArray
    triangles: NDArray[np.int64]


def bone_surfaces(skin: Skin, bones: tuple[str, ...]) -> tuple[BoneSurface, ...]:
    """The surface of each of a body's bones that has any, in their order.

    A triangle goes with the bone that counts most for most of its corners, and its vertices to where that bone takes
    them: what others add is left out, which matters near joints alone.
    """
    found: dict[str, list[tuple[FloatArray, NDArray[np.int64]]]] = {}
    for piece in skin.pieces:
        _sort(skin, piece, found)
    surfaces = []
    for bone in bones:
        parts = found.get(bone, [])
        firsts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
        if parts:
            vertices = np.concatenate([vertices for vertices, _ in parts])
            triangles = np.concatenate([own + first for (_, own), first in zip(parts, firsts, strict=False)])
            surfaces.append(BoneSurface(bone, vertices, triangles))
    return tuple(surfaces)


def _sort(skin: Skin, piece: SkinPiece, found: dict[str, list[tuple[FloatArray, NDArray[np.int64]]]]) -> None:
    first, second, third = piece.dominant[piece.triangles].T
    owners = np.where(second == third, second, first)
    for bind in np.unique(owners):
        kept, triangles = np.unique(piece.triangles[owners == bind], return_inverse=True)
        matrix = skin.binds[bind]
        vertices = piece.vertices[kept] @ matrix[:, :3].T + matrix[:, 3]
        found.setdefault(skin.bones[bind], []).append((vertices, triangles.reshape(-1, 3)))


def joined(surfaces: tuple[BoneSurface, ...], rest: RestPose, segments: Mapping[str, str]) -> tuple[BoneSurface, ...]:
    """The same with fingers, toes, bones that twist a limb and small parts of a head on the bone of their role.

    Args:
        surfaces: of the bones, in the bones' order.
        rest: the pose in which they are put together.
        segments: the role that each bone belongs to.
    """
    height = float(np.ptp(rest.positions, axis=0).max())
    trunk = rest.chain(rest.bone("pelvis"), rest.bone("chest")) if {"pelvis", "chest"} <= set(rest.roles) else []
    gathered: dict[str, list[BoneSurface]] = {}
    for surface in surfaces:
        role = segments.get(surface.bone)
        main = surface.bone if role is None else rest.roles[role]
        if main != surface.bone and role is not None:
            limb = role.removeprefix("left_").removeprefix("right_")
            size = float(np.linalg.norm(np.ptp(surface.vertices, axis=0)))
            of_trunk = rest.bones.index(surface.bone) in trunk or surface.bone in rest.roles.values()
            if of_trunk or not (limb in _ENDS + _LIMBS or size < _SMALL * height):
                main = surface.bone
        gathered.setdefault(main, []).append(surface)
    return tuple(_as_one(bone, gathered[bone], rest) for bone in rest.bones if bone in gathered)


def _as_one(bone: str, parts: list[BoneSurface], rest: RestPose) -> BoneSurface:
    index = rest.bones.index(bone)
    back = quaternions.conjugate(rest.rotations_wxyz[index])
    vertices, triangles, count = [], [], 0
    for part in parts:
        points = part.vertices
        if part.bone != bone:
            own = rest.bones.index(part.bone)
            points = rest.positions[own] + quaternions.rotate(rest.rotations_wxyz[own], points)
            points = quaternions.rotate(back, points - rest.positions[index])
        vertices.append(points)
        triangles.append(part.triangles + count)
        count += len(points)
    return BoneSurface(bone, np.concatenate(vertices), np.concatenate(triangles))
