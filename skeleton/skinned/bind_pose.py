"""The pose in which a character's mesh was made: arms out, both sides alike, as no motion has it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.skin import Skin
from skeleton.rest import RestPose

FloatArray = NDArray[np.float64]

_ALIKE = 0.2
"""Of a bone's length, or of a tenth of the body's if that is more: by how much it may differ in the mesh's pose."""


def in_bind_pose(rest: RestPose, skin: Skin) -> RestPose:
    """The bones as the mesh was bound to them, what it isn't bound to as it is relative to the bone above.

    Where that is no pose of these bones, as with meshes that were bound in different poses, the rest pose stays.
    """
    known: dict[int, tuple[FloatArray, FloatArray]] = {}
    for bone, bind in zip(skin.bones, skin.binds, strict=True):
        index = rest.bones.index(bone)
        determinant = float(np.linalg.det(bind[:, :3]))
        if index not in known and determinant > 0.0:
            scale = np.cbrt(determinant)
            u, _, v = np.linalg.svd(bind[:, :3].T)
            known[index] = -scale * np.linalg.solve(bind[:, :3], bind[:, 3]), quaternions.from_matrix(u @ v)
    positions, rotations = np.zeros_like(rest.positions), np.zeros_like(rest.rotations_wxyz)
    for bone, parent in enumerate(rest.parents):
        above = np.array([1.0, 0.0, 0.0, 0.0]) if parent < 0 else rest.rotations_wxyz[parent]
        turn = np.array([1.0, 0.0, 0.0, 0.0]) if parent < 0 else rotations[parent]
        turn = quaternions.multiply(turn, quaternions.conjugate(above))
        way = rest.positions[bone] - (0.0 if parent < 0 else rest.positions[parent])
        derived = (0.0 if parent < 0 else positions[parent]) + quaternions.rotate(turn, way)
        positions[bone], rotations[bone] = known.get(
            bone, (derived, quaternions.multiply(turn, rest.rotations_wxyz[bone]))
        )
    children = np.flatnonzero(rest.parents >= 0)
    lengths = [
        np.linalg.norm(each[children] - each[rest.parents[children]], axis=1) for each in (rest.positions, positions)
    ]
    size = float(np.ptp(rest.positions, axis=0).max())
    if not known or (np.abs(lengths[0] - lengths[1]) > _ALIKE * np.maximum(lengths[0], 0.1 * size)).any():
        return rest
    back = quaternions.conjugate(rotations[0])
    return replace(
        rest,
        positions=quaternions.rotate(back, positions - positions[0]),
        rotations_wxyz=quaternions.multiply(back, rotations),
    )
