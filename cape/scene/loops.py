"""A motion that begins again where it ends: how far each round of it takes its bones."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cape.scene.poses import Pose
from motions import quaternions
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

ALIKE = 0.05  # m from where its bones would go on, within which a motion is taken to begin again
BESIDE = 0.1  # m from a bone's origin, at which places tell how it is turned
ROUNDING = 1e-9  # m
REPEATED = 0.5  # share of the gap after a step, below which a last frame is the first one once more


@dataclass(frozen=True, eq=False)
class Travel:
    """How far a motion takes its bones in a round, after which it begins again from there.

    Attributes:
        yaw: by which they have turned about +Z [rad].
        shift: by which they are then moved [m], level, shape (3,): what is at p in a round is at R(yaw) p + shift in
            the next.
        gap: how far the worst bone begins from where it would go on [m], also of places `BESIDE` it.
        bone: which that is.
    """

    yaw: float
    shift: FloatArray
    gap: float
    bone: str

    @property
    def loops(self) -> bool:
        """Whether the motion goes on as it begins; otherwise it jumps there."""
        return self.gap <= ALIKE

    @property
    def rotation_wxyz(self) -> FloatArray:
        """The turn as a unit quaternion, shape (4,)."""
        return np.array([np.cos(self.yaw / 2.0), 0.0, 0.0, np.sin(self.yaw / 2.0)])

    def forth(self, points: FloatArray) -> FloatArray:
        """Where points [m], shape (..., 3), are in the next round."""
        return self.shift + quaternions.rotate(self.rotation_wxyz, points)

    def back(self, points: FloatArray) -> FloatArray:
        """Where points [m], shape (..., 3), were in the round before."""
        return quaternions.rotate(quaternions.conjugate(self.rotation_wxyz), points - self.shift)

    @property
    def way_back(self) -> tuple[FloatArray, FloatArray]:
        """Shift [m] (3,) and unit quaternion wxyz (4,), the turn first, that take a round to the place of the last."""
        return self.back(np.zeros(3)), quaternions.conjugate(self.rotation_wxyz)

    def onwards(self, pose: Pose) -> Pose:
        """Where bones of a pose are in the next round."""
        return pose.turned(self.rotation_wxyz).moved(self.shift)


def round_of(track: BoneTrack) -> tuple[BoneTrack, Travel]:
    """One round of a motion, without a last frame that is the first one once more, and how far it takes its bones.

    From the round's last frame it is a step to the first one of the next. Where both would meet half way, each of them
    moving as it does beside the seam, they are laid over each other by least squares, as in eq. 2 to 4 of L. Kovar,
    M. Gleicher and F. Pighin, "Motion Graphs", ACM Trans. Graph. 21 (2002), for one frame.
    """
    places = _places(track)
    step = _travel(track, places[0] - 0.5 * (places[1] - places[0]), places[-1] + 0.5 * (places[-1] - places[-2]))
    # Where any two poses fit each other, as those of one level bone do, that tells nothing but rounding.
    if track.frames > 2 and step.gap > ROUNDING and _travel(track, places[0], places[-1]).gap < REPEATED * step.gap:
        return round_of(track.first(track.frames - 1))
    return track, step


def _places(track: BoneTrack) -> FloatArray:
    """Of each bone its origin and a place on each of its axes, in the two first and the two last frames [m].

    Shape (4, B, 4, 3).
    """
    ends = [0, 1, -2, -1]
    positions, rotations = track.positions[ends, :, None], track.rotations_wxyz[ends, :, None]
    beside = np.concatenate([np.zeros((1, 3)), BESIDE * np.eye(3)])
    return positions + quaternions.rotate(rotations, beside)


def _travel(track: BoneTrack, begin: FloatArray, end: FloatArray) -> Travel:
    """The level motion that brings places at the beginning to those at the end [m], shape (B, 4, 3)."""
    first, last = begin.reshape(-1, 3), end.reshape(-1, 3)
    a, b = first - first.mean(axis=0), last - last.mean(axis=0)
    yaw = float(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a[:, :2] * b[:, :2]).sum()))
    turn = np.array([np.cos(yaw / 2.0), 0.0, 0.0, np.sin(yaw / 2.0)])
    shift = (last - quaternions.rotate(turn, first)).mean(axis=0) * np.array([1.0, 1.0, 0.0])
    off = np.linalg.norm(quaternions.rotate(turn, begin) + shift - end, axis=2).max(axis=1)
    worst = int(off.argmax())
    return Travel(yaw, shift, float(off[worst]), track.names[worst])
