"""A BVH file as joints, positions and rotations, still in its own unit and axes."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.bvh.hierarchy import CHANNELS, find_motion, parse_hierarchy
from motions.bvh.motion import parse_motion
from motions.bvh.source import Source
from motions.kinematics import forward_kinematics
from motions.skin import Skin

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Recording:
    """What a file of motion holds, in its own unit of length and its own axes.

    Attributes:
        joints: names of the J joints as in the file, parents first; not necessarily unique.
        parents: index of each joint's parent, -1 for the root, shape (J,).
        offsets: OFFSET of each joint, shape (J, 3).
        end_parents: joint at which each of the E end sites hangs, shape (E,).
        end_offsets: OFFSET of each end site, shape (E, 3).
        fps: frames per second.
        moving: indices of the M joints with position channels, shape (M,).
        positions: their positions in the parent's frame, which replace their OFFSET, shape (F, M, 3).
        rotations: unit quaternions (w, x, y, z) joint_to_parent, shape (F, J, 4).
        remarks: what the file says that was not believed, a sentence each.
        up: axis of the file that points up, where its format states that and the metre as unit; None where it doesn't.
        roles: the joint of each role that the file or its format tells.
        skin: the mesh on the joints, which are named by their numbers; None for none.
        morphs: weights of the skin's M morphs, shape (F, M); None for 0.
    """

    joints: tuple[str, ...]
    parents: IntArray
    offsets: FloatArray
    end_parents: IntArray
    end_offsets: FloatArray
    fps: float
    moving: IntArray
    positions: FloatArray
    rotations: FloatArray
    remarks: tuple[str, ...] = ()
    up: str | None = None
    roles: Mapping[str, int] = field(default_factory=dict)
    skin: Skin | None = None
    morphs: FloatArray | None = None

    def frames(self, which: IntArray | slice) -> "Recording":
        """The same recording with only some of its frames."""
        morphs = None if self.morphs is None else self.morphs[which]
        return replace(self, positions=self.positions[which], rotations=self.rotations[which], morphs=morphs)

    def local_positions(self) -> FloatArray:
        """Position of every joint in its parent's frame, shape (F, J, 3)."""
        local = np.repeat(self.offsets[None], len(self.rotations), axis=0)
        local[:, self.moving] = self.positions
        return local

    def points(self) -> FloatArray:
        """Positions of the joints and after them the end sites in the world, shape (F, J + E, 3)."""
        positions, rotations = forward_kinematics(self.parents, self.local_positions(), self.rotations)
        at = self.end_parents
        ends = positions[:, at] + quaternions.rotate(rotations[:, at], self.end_offsets)
        return np.concatenate([positions, ends], axis=1)


def read(path: Path, rate: float | None = None) -> Recording:
    """Read a BVH file, at a `rate` [1/s] or the file's own.

    Raises:
        FileError: the file can't be read or isn't a well-formed BVH file; names the line.
    """
    source = Source.read(path)
    start = find_motion(source)
    hierarchy = parse_hierarchy(source, start)
    motion = parse_motion(source, start, hierarchy, rate)

    joints = hierarchy.joints
    channels = [joint.channels or () for joint in joints]
    offsets = np.array([joint.offset for joint in joints], dtype=float)
    firsts = np.cumsum([0, *map(len, channels)])
    moving = [j for j, names in enumerate(channels) if any(name.endswith("position") for name in names)]
    positions = np.repeat(offsets[None, moving], len(motion.values), axis=0)
    for slot, joint in enumerate(moving):
        for column, name in enumerate(channels[joint], firsts[joint]):
            if name.endswith("position"):
                positions[:, slot, CHANNELS.index(name)] = motion.values[:, column]
    return Recording(
        joints=tuple(joint.name for joint in joints),
        parents=np.array([joint.parent for joint in joints]),
        offsets=offsets,
        end_parents=np.array([end.parent for end in hierarchy.ends], dtype=np.int64),
        end_offsets=np.array([end.offset for end in hierarchy.ends], dtype=float).reshape(-1, 3),
        fps=motion.fps,
        moving=np.array(moving, dtype=np.int64),
        positions=positions,
        rotations=_rotations(motion.values, channels),
        remarks=motion.remarks,
    )


def _rotations(values: FloatArray, channels: list[tuple[str, ...]]) -> FloatArray:
    """Quaternions of all joints, shape (F, J, 4); joints that share an order of axes are computed in one go."""
    by_order: dict[str, tuple[list[int], list[list[int]]]] = {}
    first = 0
    for joint, names in enumerate(channels):
        turning = [(column, name) for column, name in enumerate(names, first) if name.endswith("rotation")]
        members, columns = by_order.setdefault("".join(name[0] for _, name in turning), ([], []))
        members.append(joint)
        columns.append([column for column, _ in turning])
        first += len(names)
    rotations = np.empty((len(values), len(channels), 4))
    for axes, (members, columns) in by_order.items():
        angles = np.deg2rad(values[:, np.array(columns, dtype=np.int64).reshape(len(members), -1)])
        rotations[:, members] = quaternions.from_euler(angles, axes)
    return rotations
