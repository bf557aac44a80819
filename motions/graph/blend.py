"""Passing over from one clip to another: blends of two windows about the foot that stands, and what they cost."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.curves import step
from motions.graph.blend_source import Source, speeds, spins, touch
from motions.kinematics import forward_kinematics

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

TOLERANCE = 1e-3
"""By how much a blend may be faster than its clips [m/s, rad/s]: what rounding to four decimals makes of positions
[inch] at 120 frames a second in a BVH file, where a joint stands still."""

BOTH = -1
SUPPORTS = (BOTH, 0, 1)
"""Both feet, or the left or the right one alone: where the feet come closer or part, one has to give way."""

ROOT_SHARE = 0.05
"""Weight of the root beside a joint of a foot that stands through all of the window, 1: small, so that the foot stays
put, yet above 0, for windows in which no foot stands."""


@dataclass(frozen=True, eq=False)
class Blends:
    """M blends from windows of one clip to windows of another, of T frames with the two at the ends.

    Attributes:
        turns: unit quaternions (w, x, y, z) about +Z that take the second clip to the first, shape (M, 4).
        shifts: its shift over the ground after the turn [m], shape (M, 3), Z zero.
        rotations_wxyz: unit quaternions joint_to_parent, shape (M, T, J, 4).
        local_positions: in the parent's frame, the root's in the first clip's world [m], shape (M, T, J, 3).
        haste: largest ratio of a speed to its limit in the two clips between each two frames, shape (M, T - 1).
        slides: how far that joint of a foot slides over the ground which does so most [m], shape (M,).
        morphs: weights of the mesh's n morphs, shape (M, T, n).
    """

    turns: FloatArray
    shifts: FloatArray
    rotations_wxyz: FloatArray
    local_positions: FloatArray
    haste: FloatArray
    slides: FloatArray
    morphs: FloatArray

    def extra_frames(self) -> IntArray:
        """How many frames more each blend of N has to take so that no joint is too fast, shape (M,).

        With t(s) as in `blend_windows` speeds are divided by 1 + E / N step'(s / N), which must be the haste at least.
        """
        frames = self.haste.shape[1]
        slopes = np.diff(step(np.arange(frames + 1), 0.0, frames)) * frames
        return np.ceil(frames * ((self.haste - 1.0) / slopes).max(axis=1).clip(min=0.0)).astype(np.int64)


def blend_windows(
    a: Source,
    b: Source,
    leave: IntArray,
    enter: IntArray,
    headings: FloatArray,
    supports: IntArray,
    frames: int,
    *,
    extra: int = 0,
) -> Blends:
    """Pass from K windows of one clip to K windows of another, in each of S ways: all the first way, then the second.

    Rotations are blended by slerp (L. Kovar, M. Gleicher and F. Pighin, "Motion Graphs", ACM Trans. Graph. 21 (2002),
    eq. 6), with a weight whose second derivative has no jump, where eq. 7 takes a cubic. Eq. 5 blends the positions of
    the root; here those of a mean of root and feet are, in which a joint of a foot weighs the more the better it stands
    in both windows, and the root follows from the blended pose: so what stands on the ground stays there. The second
    clip is shifted by eq. 3 and 4 with these weights.

    Extra frames draw the blend out: where it would have been at the frame s it is at t = s + E step(s / N), so that it
    begins and ends at the speed of the clips.

    Args:
        a: the clip that is left.
        b: the clip that is entered, of the same joints and frame rate.
        leave: last frames of the first clip before the blends, shape (K,).
        enter: frames of the second that stand for them, not yet seen, shape (K,).
        headings: turns about +Z of the second clip towards the first [rad], shape (K,).
        supports: which feet may hold the body, among `SUPPORTS`, shape (S,).
        frames: number N of frames from `leave` on until the second clip alone is seen.
        extra: number E of frames that the blend takes besides.

    Returns:
        M = S K blends.
    """
    ways = len(supports)
    s = _drawn_out(frames, extra)
    weights = step(s, 0.0, frames)[:, None]
    turns = quaternions.from_rotation_vector(headings[:, None] * np.array([0.0, 0.0, 1.0]))

    morphs = (1 - weights) * a.morphs_at(leave[:, None] + s) + weights * b.morphs_at(enter[:, None] + s)
    rotations_a, local_a, points_a = a.at(leave[:, None] + s)
    rotations_b, local_b, points_b = b.at(enter[:, None] + s)
    rotations_b[:, :, 0] = quaternions.multiply(turns[:, None], rotations_b[:, :, 0])
    rotations = quaternions.slerp(rotations_a, rotations_b, weights)
    local = (1 - weights[..., None]) * local_a + weights[..., None] * local_b
    local[:, :, 0] = 0.0
    points = _points(a, rotations, local)

    held = np.concatenate([[0], a.feet])
    window = np.arange(frames + 1)
    firm = (a.standing[leave[:, None] + window] * b.standing[enter[:, None] + window]).mean(axis=1)
    may_hold = (supports[:, None] == BOTH) | (supports[:, None] == a.sides[a.feet])
    firm = (may_hold[:, None] * firm).reshape(ways * len(leave), len(a.feet))
    speed_limits = np.maximum(a.speed_limits, b.speed_limits) + TOLERANCE
    shares = np.concatenate([np.full((len(firm), 1), ROOT_SHARE), firm], axis=1) / speed_limits[held]
    shares /= shares.sum(axis=1, keepdims=True)
    # From here on by ways as well, which have all but places in common.
    turns, local, points = (np.concatenate([each] * ways) for each in (turns, local, points))
    held_a, held_b, held_here = (
        np.einsum("mh,mthi->mti", shares, p)
        for p in (*(np.concatenate([p[:, :, held]] * ways) for p in (points_a, points_b)), points[:, :, held])
    )
    held_b = quaternions.rotate(turns[:, None], held_b)
    shifts = (held_a - held_b).mean(axis=1) * np.array([1.0, 1.0, 0.0])
    local[:, :, 0] = (1 - weights) * held_a + weights * (held_b + shifts[:, None]) - held_here
    points += local[:, :, :1]

    fps = a.clip.fps
    speed = speeds(points, fps) / speed_limits
    spin = spins(rotations, fps) / (np.maximum(a.spin_limits, b.spin_limits) + TOLERANCE)
    haste = np.maximum(speed.max(axis=-1), np.concatenate([spin.max(axis=-1)] * ways))
    feet = points[:, :, a.feet]
    heights = (feet[:, 1:, :, 2] + feet[:, :-1, :, 2]) / 2 - np.minimum(a.ground, b.ground)
    slides = np.linalg.norm(np.diff(feet[..., :2], axis=1), axis=-1) * touch(heights)
    return Blends(
        turns,
        shifts,
        np.concatenate([rotations] * ways),
        local,
        haste=haste,
        slides=slides.sum(axis=1).max(axis=1, initial=0.0),
        morphs=np.concatenate([morphs] * ways),
    )


def _drawn_out(frames: int, extra: int) -> FloatArray:
    """s at t = 0, 1, ... N + E, where t = s + E step(s / N), shape (N + E + 1,)."""
    fine = np.linspace(0.0, frames, 64 * frames + 1)
    return np.interp(np.arange(frames + extra + 1), fine + extra * step(fine, 0.0, frames), fine)


def _points(source: Source, rotations: FloatArray, local_positions: FloatArray) -> FloatArray:
    """Joints and end sites in the world [m], shape (M, T, J + E, 3)."""
    clip = source.clip
    joints, to_world = forward_kinematics(
        clip.parents, local_positions.reshape(-1, len(clip.joints), 3), rotations.reshape(-1, len(clip.joints), 4)
    )
    at = clip.end_parents
    ends = joints[:, at] + quaternions.rotate(to_world[:, at], clip.end_offsets)
    return np.concatenate([joints, ends], axis=1).reshape(*rotations.shape[:2], -1, 3)
