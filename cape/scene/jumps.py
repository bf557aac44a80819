"""Jumps of the bones from one frame to the next: scene cuts, teleports, an inserted pose, the seam of a loop."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cape.scene.poses import Pose
from motions.border import checked
from motions.errors import UnknownNameError, ValueRangeError
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]


@checked
@dataclass(frozen=True, kw_only=True)
class Cuts:
    """What counts as a jump of the bones rather than a motion, and what becomes of the cloth.

    Attributes:
        speed: of a bone's origin [m/s] from which on it has jumped; hands and feet stay below 30 m/s.
        spin: of a bone that holds the cloth [rad/s] from which on it has jumped.
        then: "carry" moves the cloth along as a whole, shape and speeds kept, and a garment for which there would be a
            limb in the way, or whose wearer holds it otherwise, is put on anew; "reset" always does that.

    Raises:
        ValueRangeError: a limit is not positive.
        UnknownNameError: `then` is neither.
    """

    speed: float = 50.0
    spin: float = 60.0
    then: Literal["carry", "reset"] = "carry"

    def __post_init__(self) -> None:
        """Check the settings."""
        for name in ("speed", "spin"):
            if not getattr(self, name) > 0.0:
                raise ValueRangeError(f"the {name} of a cut must be positive, not {getattr(self, name)}")
        if self.then not in ("carry", "reset"):
            raise UnknownNameError("way to treat a cut", self.then, ("carry", "reset"))

    def between(self, before: Pose, after: Pose, dt: float, holding: NDArray[np.int64]) -> bool:
        """Tell whether bones jump from one pose to the next, `dt` [s] later; those `holding` the cloth may not spin."""
        moved = after.positions - before.positions
        if float(np.einsum("bi,bi->b", moved, moved).max()) > (self.speed * dt) ** 2:
            return True
        if holding.size == 0 or self.spin * dt >= math.pi:
            return False
        cosines = np.einsum("bi,bi->b", before.rotations_wxyz[holding], after.rotations_wxyz[holding])
        return float(np.abs(cosines).min()) < math.cos(0.5 * self.spin * dt)

    def frames(self, track: BoneTrack, holding: Iterable[str]) -> list[int]:
        """Frames of a track to which bones jump; those `holding` the cloth, by name or role, may not spin.

        Raises:
            UnknownNameError: the track has no such bone.
        """
        held = np.array([track.index(bone) for bone in holding], dtype=np.int64)
        jumps = self.among(track.positions, track.rotations_wxyz, np.diff(track.times), held)
        return (np.flatnonzero(jumps) + 1).tolist()

    def among(
        self, positions: FloatArray, rotations_wxyz: FloatArray, steps: FloatArray, holding: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        """Tell for each step of bones through F poses whether it is a jump, as `between` does.

        Positions [m] have shape (F, B, 3), rotations (F, B, 4), steps [s] and what is told (F - 1,).
        """
        moved = np.sum(np.diff(positions, axis=0) ** 2, axis=2).max(axis=1, initial=0.0)
        jumps = moved > (self.speed * steps) ** 2
        if holding.size:
            held = rotations_wxyz[:, holding]
            cosines = np.abs(np.sum(held[1:] * held[:-1], axis=2)).min(axis=1)
            angles = 0.5 * self.spin * steps
            jumps |= (angles < 0.5 * math.pi) & (cosines < np.cos(angles))
        return jumps


def seam(track: BoneTrack) -> BoneTrack:
    """The step from a track's last frame to its first, where it begins again."""
    ends = [-1, 0]
    times = np.array([0.0, track.times[-1] - track.times[-2]])
    places, turns = track.positions[ends], track.rotations_wxyz[ends]
    return replace(track, times=times, positions=places, rotations_wxyz=turns, skin=None, morphs=None)


def rigid_motion(before: FloatArray, after: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The rotation R (3, 3) and shift t [m] (3,) that bring points (n, 3) closest to others: after = R before + t.

    Least squares by the singular value decomposition (Kabsch 1976, "A solution for the best rotation to relate two sets
    of vectors"). Where points on a line leave the rotation open it is one of the least.
    """
    from_middle, to_middle = before.mean(axis=0), after.mean(axis=0)
    u, _, vt = np.linalg.svd((before - from_middle).T @ (after - to_middle))
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T)) or 1.0])
    rotation = vt.T @ mirror @ u.T
    return rotation, to_middle - rotation @ from_middle
