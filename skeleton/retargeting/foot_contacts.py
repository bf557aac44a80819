"""Feet on the ground: when a foot stands, where it stands still, and how far its sole may tilt above the floor."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from skeleton import proportions
from skeleton.model import Skeleton
from skeleton.robot.meshes.link_surfaces import link_surfaces

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SLOW = 0.5
"""An ankle of a standing foot moves by less than this many leg lengths a second."""

LOW = 0.05
"""An ankle of a standing foot is at most this many leg lengths higher than where the feet stand flat."""

BRIEF = 0.05
"""Contacts, and breaks between contacts, that are shorter [s] are noise."""

RELEASE = 0.1
"""Time [s] in which a foot is let go when it stands no longer."""

_FLOOR_QUANTILE = 0.05
_BISECTIONS = 30


def standing_height(ankles: FloatArray, leg: float, fps: float) -> float:
    """Height [m] of the ankles where the feet stand flat: a low quantile of those heights at which they move slowly.

    Args:
        ankles: positions of N ankles in the world [m], shape (N, F, 3).
        leg: length of a leg [m].
        fps: frames per second.
    """
    heights = ankles[..., 2]
    slow = np.stack([_speeds(ankle, fps) < SLOW * leg for ankle in ankles])
    return float(np.quantile(heights[slow], _FLOOR_QUANTILE) if slow.any() else heights.min())


def standing_frames(ankle: FloatArray, height: float, leg: float, fps: float) -> BoolArray:
    """Whether a foot stands, shape (F,): its ankle is low and slow, for longer than `BRIEF`.

    Args:
        ankle: positions in the world [m], shape (F, 3).
        height: of the ankle where the foot stands flat [m].
        leg: length of a leg [m].
        fps: frames per second.
    """
    stands = (ankle[:, 2] < height + LOW * leg) & (_speeds(ankle, fps) < SLOW * leg)
    for value in (False, True):
        for first, last in runs(stands == value):
            inside = value or (first > 0 and last < len(stands) - 1)
            if inside and last + 1 - first < BRIEF * fps:
                stands[first : last + 1] = not value
    return stands


def runs(mask: BoolArray) -> list[tuple[int, int]]:
    """First and last index of each row of true elements."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return [(int(first), int(end) - 1) for first, end in zip(edges[::2], edges[1::2], strict=True)]


def carry_between(corrections: FloatArray, stands: BoolArray) -> FloatArray:
    """Corrections that are known while a foot stands, led over from one stance to the next, shape (F, N).

    Before the first stance it is that of its first frame, after the last that of its last frame, zero without any. On
    the way they follow 3 t^2 - 2 t^3, which starts and ends without a jerk.

    Args:
        corrections: shape (F, N); only those of standing frames count.
        stands: shape (F,).
    """
    known = np.flatnonzero(stands)
    if not len(known):
        return np.zeros_like(corrections)
    frames = np.arange(len(stands))
    after = np.clip(np.searchsorted(known, frames), 0, len(known) - 1)
    before = np.clip(np.searchsorted(known, frames, side="right") - 1, 0, len(known) - 1)
    gap = np.maximum(known[after] - known[before], 1)
    t = np.clip((frames - known[before]) / gap, 0.0, 1.0)[:, None]
    smooth = t * t * (3.0 - 2.0 * t)
    return (1.0 - smooth) * corrections[known[before]] + smooth * corrections[known[after]]


def hold(stands: BoolArray, fps: float) -> FloatArray:
    """How firmly a foot is held, shape (F,): 1 while it stands, falling to 0 within `RELEASE` before and after."""
    frames, known = np.arange(len(stands)), np.flatnonzero(stands)
    if not len(known):
        return np.zeros(len(stands))
    away = np.abs(frames[:, None] - known).min(axis=1) / fps
    return np.clip(1.0 - away / RELEASE, 0.0, 1.0)


def planted(positions: FloatArray, stands: BoolArray, height: float) -> FloatArray:
    """Positions of an ankle that stays where it stands, at a height, shape (F, 3), and never gets below that height.

    In each stance the ankle rests at the mean of its positions; the correction is led over to the next stance.

    Args:
        positions: of the ankle in the world [m], shape (F, 3).
        stands: whether the foot stands, shape (F,).
        height: of the ankle where the foot stands flat [m].
    """
    corrections = np.zeros_like(positions)
    for first, last in runs(stands):
        row = slice(first, last + 1)
        spot = positions[row].mean(axis=0)
        spot[2] = height
        corrections[row] = spot - positions[row]
    result = positions + carry_between(corrections, stands)
    result[:, 2] = np.maximum(result[:, 2], height)
    return result


def leveled(rotations_wxyz: FloatArray) -> FloatArray:
    """Rotations whose z axis is turned upright by the shortest way, (F, 4) to (F, 4)."""
    upright = quaternions.rotate(rotations_wxyz, np.array([0.0, 0.0, 1.0]))
    return quaternions.multiply(quaternions.conjugate(quaternions.from_z_axis(upright)), rotations_wxyz)


def tilted_soles(rotations_wxyz: FloatArray, heights: FloatArray, stands: BoolArray, sole: FloatArray) -> FloatArray:
    """Sole_to_world of a foot that is level while it stands and never tilts into the floor, shape (F, 4).

    Where a tilt would take a point of the sole under the floor, only as much of it is left as there is room for.

    Args:
        rotations_wxyz: wanted sole_to_world, z square to the sole, shape (F, 4).
        heights: of the sole's origin, the ankle, above the floor [m], shape (F,).
        stands: whether the foot stands, shape (F,).
        sole: points of the foot from the ankle, in axes whose z is square to the sole [m], shape (P, 3).
    """
    level = leveled(rotations_wxyz)
    to_level = quaternions.to_rotation_vector(quaternions.multiply(level, quaternions.conjugate(rotations_wxyz)))
    corrections = quaternions.from_rotation_vector(carry_between(to_level, stands))
    wanted = quaternions.multiply(corrections, rotations_wxyz)
    level = leveled(wanted)
    share, too_much = np.zeros(len(wanted)), np.ones(len(wanted))
    fits = lowest_heights(heights, wanted, sole) >= 0.0
    for _ in range(_BISECTIONS):
        middle = (share + too_much) / 2
        above = lowest_heights(heights, quaternions.slerp(level, wanted, middle), sole) >= 0.0
        share, too_much = np.where(above, middle, share), np.where(above, too_much, middle)
    return quaternions.slerp(level, wanted, np.where(fits, 1.0, share))


def lowest_heights(heights: FloatArray, rotations_wxyz: FloatArray, sole: FloatArray) -> FloatArray:
    """Height of the lowest point of a foot [m], shape (F,).

    Args:
        heights: of the ankle [m], shape (F,).
        rotations_wxyz: sole_to_world, shape (F, 4).
        sole: points from the ankle in the sole's axes [m], shape (P, 3).
    """
    upwards = quaternions.rotate(quaternions.conjugate(rotations_wxyz), np.array([0.0, 0.0, 1.0]))
    return heights + (upwards @ sole.T).min(axis=1)


@dataclass(frozen=True, eq=False)
class Soles:
    """The feet of a robot as points.

    Attributes:
        points: of each side's foot from the origin of its bone, in the axes of the standing body (forward, left, up)
            [m], shape (P, 3).
        decisions: what had to be assumed, a sentence each.
    """

    points: dict[str, FloatArray]
    decisions: tuple[str, ...]

    @property
    def ankle_height(self) -> float:
        """Height of the ankle above a level sole [m], mean of both sides."""
        return float(np.mean([-points[:, 2].min() for points in self.points.values()]))


def soles_of(robot: Skeleton, standing_wxyz: FloatArray) -> Soles:
    """The undersides of a robot's feet, from their visual meshes or else from their collision shapes.

    Of the vertices those are kept that are the lowest at a tilt in steps of 5 degrees towards a heading in steps of 10.
    Tilts between have their lowest point within 6 degrees: less than 0.2 m (1 - cos 6 deg) = 1.1 mm lower, in a foot of
    0.2 m. Feet without meshes and shapes get a sole after `skeleton.proportions`.

    Args:
        robot: a robot, level on its feet in its rest pose.
        standing_wxyz: axes (forward, left, up) of the standing body, body_to_root, shape (4,).
    """
    feet = {side: robot.rest.bone(f"{side}_foot") for side in ("left", "right")}
    for kind in ("visual", "collision"):
        surfaces = link_surfaces(robot, kind, bones=[robot.bones[foot] for foot in feet.values()])
        points = {}
        for side, foot in feet.items():
            own = [surface.vertices for surface in surfaces if surface.bone == robot.bones[foot]]
            if own:
                to_root = robot.rest.rotations_wxyz[foot]
                into_sole = quaternions.multiply(quaternions.conjugate(standing_wxyz), to_root)
                vertices = quaternions.rotate(into_sole, np.concatenate(own))
                points[side] = _lowest_when_tilted(vertices, np.radians(np.arange(2.5, 90.0, 5.0)), 36)
        if len(points) == len(feet):
            return Soles(points, ())
    sole = _usual_sole(robot.rest.height)
    return Soles(dict.fromkeys(feet, sole), ("soles: by proportion of the height, since the feet have no geometry",))


def ground_points(points: FloatArray) -> FloatArray:
    """The few points of a foot that are its lowest, upright or tilted by up to 60 degrees, shape (Q, 3)."""
    return _lowest_when_tilted(points, np.radians([5.0, 30.0, 60.0]), 8)


def _lowest_when_tilted(points: FloatArray, tilts: FloatArray, headings: int) -> FloatArray:
    """The points that are the lowest at one of the tilts [rad], each towards so many headings."""
    tilts, towards = np.meshgrid(tilts, np.linspace(0.0, 2.0 * np.pi, headings, endpoint=False), indexing="ij")
    downwards = [np.sin(tilts) * np.cos(towards), np.sin(tilts) * np.sin(towards), -np.cos(tilts)]
    return points[np.unique(np.argmax(points @ np.reshape(downwards, (3, -1)), axis=0))]


def _usual_sole(height: float) -> FloatArray:
    """Corners of a sole under the ankle of a body of that height [m], shape (4, 3)."""
    half = proportions.RADII["foot"] * height
    down = -proportions.ANKLE_HEIGHT * height
    tip, heel = proportions.FOOT_REACH * height, -proportions.FOOT_REACH * height / 3
    return np.array([[x, y, down] for x in (heel, tip) for y in (-half, half)])


def _speeds(positions: FloatArray, fps: float) -> FloatArray:
    """Speed at each frame [m/s], shape (F,), by central differences."""
    if len(positions) < 2:
        return np.zeros(len(positions))
    return np.linalg.norm(np.gradient(positions, 1.0 / fps, axis=0), axis=1)
