"""Garments that another one is girded over: its waistband gathers what hangs wider than it.

A panel that hangs flat in front or behind is laid around the body from there on down, thread along thread: what was so
far from its middle is then so far along the band. So the other garment can be put on over it, below which it falls out
again as far as there is room.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.cloth import tailoring
from cape.scene.colliders import Ellipsoid
from cape.scene.holding.attachments import Attachment
from cape.scene.scene import Scene
from motions import quaternions
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BEYOND = 0.02  # m above a waistband, from where on down it gathers what is below it
FULL = 0.96  # of a quarter of the band that a panel may cover from its middle, so that two of them do not meet
QUARTER = 64  # points of it
HIGH = 0.045  # m from the middle of each solid that keeps a garment off what its band has gathered to its top
BELOW = 0.6  # of that, by which the middle of the uppermost is below the band
STAGES, RESTS = 12, 4  # in which cloth is gathered, and then comes to rest
LEVEL = 1e-12  # m2; a band whose heights' squares differ by less is of one height
WAIST = "waist"  # the region of those that gird others


class Band(NamedTuple):
    """A waistband: the bone that holds it, where its vertices are at the first frame [m], shape (n, 3), and the room
    that it leaves to what is below it [m]."""

    bone: str
    places: FloatArray
    room: float


def girded(places: FloatArray, band: Band) -> tuple[IntArray, FloatArray]:
    """What hangs outside of a waistband, at its height and below, and where it would lie within.

    Args:
        places: of the vertices below it [m], shape (V, 3).
        band: what goes around.

    Returns:
        Some vertices, shape (m,), and their places within [m], shape (m, 3), at the heights that they had.
    """
    outline, heights = tailoring.hull(band.places[:, :2]), band.places[:, 2]
    around = tailoring.evenly(np.concatenate([outline, outline[:1]]), 4 * QUARTER)[:-1]
    middle = around.mean(axis=0)
    axes = np.linalg.svd(around - middle)[2]  # from side to side first: a body is wider than it is deep
    around = (around - middle) @ axes.T
    ways = (places[:, :2] - middle) @ axes.T
    near = places[:, 2] < heights.max() + BEYOND
    # A band is a little wider at one edge than at the other.
    own = (band.places[:, :2] - middle) @ axes.T
    shares = _length(own) / np.interp(_angle(own), *_by_angle(around), period=2.0 * np.pi)
    spread = heights - heights.mean()
    slope = spread @ shares / max(spread @ spread, LEVEL)
    share = np.clip(shares.mean() + slope * (places[:, 2] - heights.mean()), shares.min(), shares.max())
    vertices, laid = [np.zeros(0, np.int64)], [np.zeros((0, 2))]
    for side, front in product((1.0, -1.0), repeat=2):
        mine = ways * [side, front]
        # Each vertex belongs to one quarter: those in the middle to the first side, those at a side to the front.
        here = near & ((mine[:, 0] > 0.0) | ((mine[:, 0] == 0.0) & (side > 0.0)))
        here &= (mine[:, 1] > 0.0) | ((mine[:, 1] == 0.0) & (front > 0.0))
        angles = np.linspace(0.0, np.pi / 2.0, QUARTER)
        radii = np.interp(angles, *_by_angle(around * [side, front]), period=2.0 * np.pi)
        out = np.flatnonzero(here & (_length(mine) > share * np.interp(_angle(mine), angles, radii) - band.room))
        if len(out):
            quarter = radii[:, None] * np.stack([np.sin(angles), np.cos(angles)], axis=1)
            far = mine[out, 0] / share[out]
            on = tailoring.along(quarter, far * min(1.0, FULL * tailoring.length_of(quarter) / far.max()))
            on *= (share[out] - band.room / _length(on))[:, None]
            vertices.append(out)
            laid.append(on * [side, front])
    chosen = np.concatenate(vertices)
    return chosen, np.concatenate([np.concatenate(laid) @ axes + middle, places[chosen, 2:]], axis=1)


def hangs_out(places: FloatArray, bands: Sequence[Band]) -> bool:
    """Tell whether some of a garment's vertices (V, 3) [m] hang outside of a waistband at its height."""
    return any(len(girded(places[places[:, 2] > b.places[:, 2].min() - BEYOND], b)[0]) > 0 for b in bands)


def _length(ways: FloatArray) -> FloatArray:
    return np.linalg.norm(ways, axis=1)


def _angle(ways: FloatArray) -> FloatArray:
    """From straight ahead to the side [rad], of ways to the side and ahead (n, 2)."""
    return np.arctan2(ways[:, 0], ways[:, 1])


def _by_angle(ways: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Angles of ways (n, 2) in ascending order [rad], and their lengths."""
    order = np.argsort(_angle(ways))
    return _angle(ways)[order], _length(ways)[order]


def gathered(
    scene: Scene,
    places: FloatArray,
    band: Band,
    track: BoneTrack,
    settled: Callable[[Scene, FloatArray], FloatArray],
) -> tuple[Scene, FloatArray]:
    """Gather a garment within the waistband of one that is worn over it.

    Args:
        scene: of the garment.
        places: where its vertices have come to rest at the first frame [m], shape (V, 3).
        band: what goes around it.
        track: the motion.
        settled: where the vertices of a scene get from some places [m], both of shape (V, 3).

    Returns:
        The scene, in which springs hold what is gathered where it is now, and the places.
    """
    vertices, within = girded(places, band)
    held = [a.vertices for a in scene.attachments if not a.soft]
    free = ~np.isin(vertices, np.concatenate([*held, np.zeros(0, np.int64)]))
    vertices, within = vertices[free], within[free]
    if not len(vertices):
        return scene, places
    before = places[vertices]
    others = [rest for a in scene.attachments if (rest := _without(a, vertices)) is not None]
    for share in np.minimum(np.arange(1, STAGES + RESTS + 1) / STAGES, 1.0):
        now = before + share * (within - before)
        places = places.copy()
        places[vertices] = now
        drawn = Attachment(band.bone, vertices, _into(track, band.bone, now))
        places = settled(replace(scene, attachments=[*others, drawn]), places)
    followed = [_moved(a, vertices, places, track) for a in scene.attachments]
    return replace(scene, attachments=followed), places


def upright_box(level: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The middle (2,) and half the sizes (2,) of a box around places (n, 2) [m], along the ways in which they spread,
    and its turn about the vertical, a quaternion (w, x, y, z)."""
    axes = np.linalg.svd(level - level.mean(axis=0), full_matrices=True)[2]
    ways = level @ axes.T
    turn = np.arctan2(axes[0, 1], axes[0, 0]) / 2.0
    middle = (ways.min(axis=0) + ways.max(axis=0)) / 2.0 @ axes
    return middle, np.ptp(ways, axis=0) / 2.0, np.array([np.cos(turn), 0.0, 0.0, np.sin(turn)])


def bulges(name: str, places: FloatArray, band: Band) -> list[Ellipsoid]:
    """What keeps a band's garment off what is gathered, at places (V, 3) [m]: one upon the other, up to the band."""
    found: list[Ellipsoid] = []
    for height in np.arange(band.places[:, 2].min() - BELOW * HIGH, places[:, 2].min(), -HIGH):
        within = places[np.abs(places[:, 2] - height) < HIGH / 2.0, :2]
        if not len(within):
            continue
        middle, halves, rotation = upright_box(within)
        radii = np.append(halves + band.room / 2.0, HIGH)
        center = np.append(middle, height)
        found.append(
            Ellipsoid(name=f"within {name} at {height:.2f} m", center=center, radii=radii, rotation_wxyz=rotation)
        )
    return found


def _into(track: BoneTrack, bone: str, places: FloatArray) -> FloatArray:
    """Places at the first frame, in a bone's frame [m], shape (n, 3)."""
    origins, rotations = track.at(0)
    index = track.index(bone)
    return quaternions.rotate(quaternions.conjugate(rotations[index]), places - origins[index])


def _without(held: Attachment, vertices: IntArray) -> Attachment | None:
    """What is held besides some vertices."""
    kept = ~np.isin(held.vertices, vertices)
    if not kept.any():
        return None
    arrays = {name: getattr(held, name) for name in ("points", "weights", "stiffness", "damping")}
    some = {name: None if array is None else array[kept] for name, array in arrays.items()}
    return replace(held, vertices=held.vertices[kept], **some)


def _moved(held: Attachment, vertices: IntArray, places: FloatArray, track: BoneTrack) -> Attachment:
    """What springs hold, with those of some vertices where these are now."""
    moved = np.isin(held.vertices, vertices)
    if held.points is None or not held.soft or not moved.any():
        return held
    points = held.points.copy()
    points[moved] = _into(track, held.bone, places[held.vertices[moved]])
    return replace(held, points=points)
