"""A character's bones as joints of a file: what each mesh hangs at, and every pose told from the joint above."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.skin import Skin
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Joints:
    """The bones, in their order, and after them a joint more for each binding that finds its bone's taken.

    A file has one pose to a joint in which the mesh hangs at it; a bone may have several, of meshes that were made in
    different poses.

    Attributes:
        names: of the J joints.
        parents: joint above each, -1 for none, shape (J,).
        of_bindings: joint of each of the skin's N bindings, no two the same, shape (N,).
        positions: in the frame of the joint above, those without one in the world [m], shape (F, J, 3).
        rotations_wxyz: the same, continuous over the frames, shape (F, J, 4).
    """

    names: list[str]
    parents: NDArray[np.int64]
    of_bindings: NDArray[np.int64]
    positions: FloatArray
    rotations_wxyz: FloatArray


def joints_of(bones: BoneTrack, skin: Skin | None = None) -> Joints:
    """The joints of a motion, and of a mesh that hangs at its bones."""
    names, of_bindings, more = list(bones.names), [], []
    parents = [-1] * len(names) if bones.parents is None else bones.parents.tolist()
    for bone in () if skin is None else skin.bones:
        joint = bones.index(bone)
        if joint in of_bindings:
            more.append(joint)
            joint = len(names)
            parents.append(more[-1])
            names.append(f"{bone} again")
        of_bindings.append(joint)
    positions, rotations = _from_parents(bones)
    still, unturned = (
        np.zeros((bones.frames, len(more), 3)),
        np.tile([1.0, 0.0, 0.0, 0.0], (bones.frames, len(more), 1)),
    )
    return Joints(
        names=names,
        parents=np.array(parents, dtype=np.int64),
        of_bindings=np.array(of_bindings, dtype=np.int64),
        positions=np.concatenate([positions, still], axis=1),
        rotations_wxyz=np.concatenate([rotations, unturned], axis=1),
    )


def _from_parents(bones: BoneTrack) -> tuple[FloatArray, FloatArray]:
    """Poses of bones in their parents' frames, those without one in the world: [m] (F, B, 3), wxyz (F, B, 4)."""
    positions, rotations = bones.positions.copy(), bones.rotations_wxyz.copy()
    if bones.parents is not None:
        children = np.flatnonzero(bones.parents >= 0)
        above = bones.parents[children]
        back = quaternions.conjugate(bones.rotations_wxyz[:, above])
        positions[:, children] = quaternions.rotate(back, bones.positions[:, children] - bones.positions[:, above])
        rotations[:, children] = quaternions.multiply(back, bones.rotations_wxyz[:, children])
    return positions, quaternions.make_continuous(rotations)
