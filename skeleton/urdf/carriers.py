"""Bones of a Pinocchio model: each is a joint, or what is fixed to one, and one way leads to where any of them is."""

# Pinocchio lies in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from motions import quaternions

if TYPE_CHECKING:
    import pinocchio

FloatArray = NDArray[np.float64]

_AT_ONCE = 4096  # frames whose rotations are held as matrices


@dataclass(frozen=True, eq=False)
class Carriers:
    """Which joint of a model carries each of B bones, and where.

    Attributes:
        joints: index of the Pinocchio joint, shape (B,).
        fixed: whether the bone is fixed to its joint, and not the joint itself, shape (B,).
        positions: origin of the bone in the joint's frame [m], zero for a joint itself, shape (B, 3).
        rotations: bone_to_joint, the identity for a joint itself, shape (B, 3, 3).
    """

    joints: NDArray[np.int64]
    fixed: NDArray[np.bool_]
    positions: FloatArray
    rotations: FloatArray

    @staticmethod
    def of_joints(count: int) -> "Carriers":
        """Of bones which are the joints of a model, all of them in their order."""
        turns = np.tile(np.eye(3), (count, 1, 1))
        return Carriers(np.arange(1, count + 1), np.zeros(count, dtype=bool), np.zeros((count, 3)), turns)

    def in_joint(self, bone: int, points: FloatArray) -> FloatArray:
        """Points of a bone's frame (..., 3) in the frame of the joint that carries it [m]."""
        return self.positions[bone] + points @ self.rotations[bone].T


@dataclass(frozen=True, eq=False)
class RobotBones:
    """The bones of a robot: its joints and, named after their fixed joints, the links that are fixed to them.

    Attributes:
        names: of the B bones, parents first.
        parents: index of each bone's parent, -1 for none, shape (B,).
        carriers: which joint carries each.
        links: the bone that each link is on, by the link's name.
    """

    names: tuple[str, ...]
    parents: NDArray[np.int64]
    carriers: Carriers
    links: Mapping[str, str]

    @staticmethod
    def of(model: "pinocchio.Model") -> "RobotBones":
        """Those of a model from a URDF file; what is fixed to the world and not to a joint is left out."""
        import pinocchio as pin

        frames = model.frames.tolist()
        kinds = (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT)
        kept = [i for i, frame in enumerate(frames) if frame.type in kinds and frame.parentJoint > 0]
        bone_of = {frame: bone for bone, frame in enumerate(kept)}

        def above(frame: int) -> int:
            while (frame := int(frames[frame].parentFrame)) > 0:
                if frame in bone_of:
                    return bone_of[frame]
            return -1

        names = _unique([frames[i].name for i in kept], [frames[i].type == pin.FrameType.JOINT for i in kept])
        carriers = Carriers(
            joints=np.array([int(frames[i].parentJoint) for i in kept], dtype=np.int64),
            fixed=np.array([frames[i].type != pin.FrameType.JOINT for i in kept], dtype=bool),
            positions=np.array([frames[i].placement.translation for i in kept]).reshape(-1, 3),
            rotations=np.array([frames[i].placement.rotation for i in kept]).reshape(-1, 3, 3),
        )
        links = {
            frame.name: names[above(i)]
            for i, frame in enumerate(frames)
            if frame.type == pin.FrameType.BODY and above(i) >= 0
        }
        return RobotBones(names, np.array([above(i) for i in kept], dtype=np.int64), carriers, links)


def _unique(names: list[str], is_joint: list[bool]) -> tuple[str, ...]:
    """Names of which what is fixed gives way: a file may have a fixed joint of the name that an added root has."""
    taken = {name for name, joint in zip(names, is_joint, strict=True) if joint}
    unique = []
    for name, joint in zip(names, is_joint, strict=True):
        while not joint and name in taken:
            name += "_fixed"
        taken.add(name)
        unique.append(name)
    return tuple(unique)


def poses_in(
    model: "pinocchio.Model", carriers: Carriers, configurations: FloatArray, bones: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """World positions [m], shape (F, B, 3), and unit quaternions bone_to_world, shape (F, B, 4), of the asked bones.

    Args:
        model: whose joints carry the bones.
        carriers: of all bones.
        configurations: of the model, shape (F, nq).
        bones: indices of the asked bones.
    """
    import pinocchio as pin

    data = model.createData()
    # Views into Pinocchio's memory, which save making an object for each bone and frame: that takes longer than the
    # kinematics themselves.
    placements = [data.oMi[int(joint)] for joint in carriers.joints[bones]]
    origins = [placement.translation for placement in placements]
    matrices = [placement.rotation for placement in placements]
    positions = np.empty((len(configurations), len(bones), 3))
    rotations = np.empty((len(configurations), len(bones), 4))
    turns = np.empty((_AT_ONCE, len(bones), 3, 3))
    fixed = np.flatnonzero(carriers.fixed[bones])
    on = np.asarray(bones, dtype=np.int64)[fixed]
    for first in range(0, len(configurations), _AT_ONCE):
        block = configurations[first : first + _AT_ONCE]
        for k, configuration in enumerate(block):
            pin.forwardKinematics(model, data, configuration)
            positions[first + k], turns[k] = origins, matrices
        some = slice(first, first + len(block))
        positions[some, fixed] += np.einsum("fbij,bj->fbi", turns[: len(block), fixed], carriers.positions[on])
        turns[: len(block), fixed] = turns[: len(block), fixed] @ carriers.rotations[on]
        rotations[some] = quaternions.from_matrix(turns[: len(block)])
    return positions, rotations
