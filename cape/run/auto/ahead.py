"""Frames of a simulation that are taken before they are handed on, so that they can be taken again."""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cape.run.whereabouts import Mark
from cape.scene.poses import Bones, Pose, read_pose
from motions import quaternions

ROUNDING = 1e-9  # of a frame's length: differences of times of hours are rounded by less


class Coming(NamedTuple):
    """A frame to come: where the bones will be, and its length [s]."""

    pose: Pose
    dt: float


def is_as_long(dt: float, other: float) -> bool:
    """Tell whether a frame is as long as another [s], but for rounding."""
    return math.isclose(dt, other, rel_tol=ROUNDING)


class Ahead:
    """The frames that are to come, and those of them that have been taken already.

    Attributes:
        taken: in their order, until each is handed on.
    """

    def __init__(self, coming: Sequence[Coming]) -> None:
        """Hold what is to come."""
        self.taken: deque[Mark] = deque()
        self._coming = coming
        self._next = 0  # that is asked for

    def is_next(self, bones: Bones, names: Sequence[str], dt: float) -> bool:
        """Tell whether a frame is the one that was to come next, whatever way of reckoning has rounded its length."""
        if self._next >= len(self._coming):
            return False
        told = self._coming[self._next]
        if not is_as_long(dt, told.dt):
            return False
        pose = bones if isinstance(bones, Pose) else read_pose(bones, names).without_world()
        return all(np.array_equal(a, b) for a, b in zip(pose, told.pose, strict=True))

    @property
    def next(self) -> Coming:
        """The frame that is to come next."""
        return self._coming[self._next]

    def part(self, seconds: float) -> list[Coming]:
        """The frames from the next one on that last so long [s], and one at least; all, where less would be left."""
        frames, span = [], 0.0
        for coming in self._coming[self._next :]:
            if frames and span > seconds - 1e-9:
                break
            frames.append(coming)
            span += coming.dt
        return frames

    def pass_on(self) -> None:
        """Count the next frame as taken, which was so only now."""
        self._next += 1

    def hand_on(self) -> Mark:
        """The next frame that was taken."""
        self._next += 1
        return self.taken.popleft()


def onwards(before: Pose, now: Pose, count: int) -> list[Pose]:
    """So many poses of bones that move and turn on as they did from one pose to the next, which is the first."""
    way = now.positions - before.positions
    turn = quaternions.multiply(now.rotations_wxyz, quaternions.conjugate(before.rotations_wxyz))
    poses = [now]
    for _ in range(count - 1):
        last = poses[-1]
        poses.append(Pose(last.positions + way, quaternions.multiply(turn, last.rotations_wxyz)))
    return poses
