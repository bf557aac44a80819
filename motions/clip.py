"""A motion clip: a joint tree and the pose of each of its joints over time."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Clip:
    """An immutable motion of a joint tree, in metres, right-handed and Z up.

    The pose of joint j relative to its parent is `local_positions` (or `offsets`, where that is None) followed by
    `rotations_wxyz`; the pose of the root is relative to the world.

    Attributes:
        name: what the clip is called, by default the stem of its file.
        joints: names of the J joints, unique, parents before children, the root first.
        parents: index of each joint's parent, shape (J,), -1 for the root.
        offsets: position of each joint's origin in its parent's frame [m], shape (J, 3), zero for the root.
        end_parents: joint at which each of the E end sites hangs, shape (E,).
        end_offsets: position of each end site in its joint's frame [m], shape (E, 3).
        fps: frames per second.
        root_positions: position of the root in the world [m], shape (F, 3).
        rotations_wxyz: unit quaternions (w, x, y, z) joint_to_parent, shape (F, J, 4), signs continuous over frames.
        local_positions: position of each joint in its parent's frame [m], shape (F, J, 3), or None where all joints
            but the root stay at their offsets.
        decisions: what the reader had to decide (unit, up axis, dropped frames, renamed joints), a sentence each.
    """

    name: str
    joints: tuple[str, ...]
    parents: IntArray
    offsets: FloatArray
    end_parents: IntArray
    end_offsets: FloatArray
    fps: float
    root_positions: FloatArray
    rotations_wxyz: FloatArray
    local_positions: FloatArray | None = None
    decisions: tuple[str, ...] = field(default=())
