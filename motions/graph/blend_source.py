"""What a blend needs to know of a clip: where its joints are, how fast they get, and when its feet stand."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.bodies.roles import SIDES, find_roles
from motions.clip import Clip
from motions.curves import between_rows

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LIFT = 0.01
"""Height over its lowest from which on a joint of a foot no longer touches the ground [m]; in a walk the toes that
swing forward pass at 1.5 cm."""

STILL = 0.2
"""Speed from which on a joint of a foot doesn't stand [m/s]; in a walk the foot that swings reaches 4 m/s."""


@dataclass(frozen=True, eq=False)
class Source:
    """A clip, of F frames, J joints and E end sites, with what follows from it.

    Attributes:
        clip: the clip.
        morphs: weights of the M morphs of the mesh that it has in common with others, shape (F, M).
    """

    clip: Clip
    morphs: FloatArray

    @property
    def third(self) -> int:
        """A third of the clip, in whole frames: what may be blended at either end and leave something between."""
        return (self.clip.frames - 1) // 3

    @cached_property
    def points(self) -> FloatArray:
        """Joints and end sites in the world [m], shape (F, J + E, 3)."""
        return self.clip.world_points()

    @cached_property
    def speed_limits(self) -> FloatArray:
        """Largest speed of each joint and end site [m/s], shape (J + E,)."""
        return speeds(self.points, self.clip.fps).max(axis=0)

    @cached_property
    def spin_limits(self) -> FloatArray:
        """Largest angular speed of each joint against its parent [rad/s], shape (J,)."""
        return spins(self.clip.rotations_wxyz, self.clip.fps).max(axis=0)

    @cached_property
    def sides(self) -> IntArray:
        """0 for joints of the left foot, from the ankle down, 1 for the right, as far as names tell, else -1, (J,)."""
        roles = find_roles(self.clip.joints, self.clip.parents.tolist())
        ankles = {roles.get(f"{side}_foot"): number for number, side in enumerate(SIDES)}
        sides = np.full(len(self.clip.joints), -1)
        for joint, (name, parent) in enumerate(zip(self.clip.joints, self.clip.parents, strict=True)):
            sides[joint] = ankles.get(name, sides[parent] if parent >= 0 else -1)
        return sides

    @cached_property
    def feet(self) -> IntArray:
        """The joints of both feet, T of them, shape (T,)."""
        return np.flatnonzero(self.sides >= 0)

    @cached_property
    def ground(self) -> FloatArray:
        """Height that each joint of the feet is below of for a tenth of the time, as where it stands [m], shape (T,).

        The lowest height of all would be centimetres under the places where recorded feet stand.
        """
        return np.quantile(self.points[:, self.feet, 2], 0.1, axis=0)

    @cached_property
    def standing(self) -> FloatArray:
        """How well each joint of the feet stands, from 0 to 1, shape (F, T)."""
        at = self.points[:, self.feet]
        moved = speeds(at, self.clip.fps)
        fastest = np.maximum(np.concatenate([moved[:1], moved]), np.concatenate([moved, moved[-1:]]))
        return touch(at[..., 2] - self.ground) * _fading(fastest / STILL)

    def at(self, frames: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Poses at frames and between them.

        Args:
            frames: counted from 0, shape (M, N).

        Returns:
            Unit quaternions joint_to_parent (w, x, y, z), shape (M, N, J, 4), positions in the parent's frame [m], the
            root's in the world, shape (M, N, J, 3), and points as `points` [m], shape (M, N, J + E, 3).
        """
        whole = frames.astype(np.int64)
        if (whole == frames).all():
            return self._at_whole(whole)
        poses = self.clip.sample(frames.ravel() / self.clip.fps)
        local = poses.local_positions
        if local is None:
            local = np.repeat(self.clip.offsets[None], frames.size, axis=0)
            local[:, 0] = poses.root_positions
        before = np.minimum(whole, self.clip.frames - 2)
        share = (frames - before)[..., None, None]
        points = (1 - share) * self.points[before] + share * self.points[before + 1]
        return poses.rotations_wxyz.reshape(*frames.shape, -1, 4), local.reshape(*frames.shape, -1, 3), points

    def morphs_at(self, frames: FloatArray) -> FloatArray:
        """Weights of the morphs at frames and between them, counted from 0, shape (...) to (..., M)."""
        return between_rows(np.arange(len(self.morphs), dtype=float), self.morphs, frames)

    def _at_whole(self, frames: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        clip = self.clip
        if clip.local_positions is not None:
            return clip.rotations_wxyz[frames], clip.local_positions[frames], self.points[frames]
        local = np.tile(clip.offsets, (*frames.shape, 1, 1))
        local[:, :, 0] = clip.root_positions[frames]
        return clip.rotations_wxyz[frames], local, self.points[frames]


def touch(heights: FloatArray) -> FloatArray:
    """How much joints of feet at these heights over their lowest [m] touch the ground, from 0 to 1."""
    return _fading(heights / LIFT)


def speeds(points: FloatArray, fps: float) -> FloatArray:
    """Speeds between the frames [m/s], shape (..., F, P, 3) to (..., F - 1, P)."""
    x, y, z = np.moveaxis(np.diff(points, axis=-3), -1, 0)
    return np.sqrt(x * x + y * y + z * z) * fps


def spins(rotations: FloatArray, fps: float) -> FloatArray:
    """Angular speeds between the frames [rad/s], unit quaternions (..., F, J, 4) to (..., F - 1, J)."""
    turns = quaternions.multiply(quaternions.conjugate(rotations[..., :-1, :, :]), rotations[..., 1:, :, :])
    w, x, y, z = np.moveaxis(turns, -1, 0)
    return 2.0 * np.arctan2(np.sqrt(x * x + y * y + z * z), np.abs(w)) * fps


def _fading(x: FloatArray) -> FloatArray:
    """1 at 0 and below, 0 from 1 on, between them 2 - 2^x.

    The weight of a sliding foot in H. Zhang, S. Starke, T. Komura and J. Saito, "Mode-adaptive neural networks for
    quadruped motion control", ACM Trans. Graph. 37 (2018).
    """
    return 2.0 - 2.0 ** np.clip(x, 0.0, 1.0)
