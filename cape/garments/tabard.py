"""A tabard: a front and a back panel, sewn together on the shoulders around a hole for the head, open at the sides."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cape.cloth import tailoring
from cape.cloth.cloth import MeshCloth
from cape.cloth.fabric import Fabric
from cape.cloth.sewing import Panel, sewn
from cape.garments.back_cape import NARROWEST, WIDEST
from cape.garments.base import Garment, Hold, Measures, Worn
from cape.garments.fitting import CLEARANCE, Fitted, room_between
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]

LENGTH = 0.47  # of the body's height: from the shoulders to above the knees
WIDTH = 1.12  # of the distance of the shoulder joints
FLARE = 0.85
SPACING = 0.015  # of the body's height
HEM_LAYERS = 3.0  # of fabric in its edges; the shoulder seams have twice as many
HOLE = 0.012  # of the body's height: room between the neck and the edge of the hole
DEEPER = 0.02  # of the body's height: the same in front, besides
ROUNDED = 3.0  # exponent of the superellipse that the hole is; 2 is an ellipse, more come near a rectangle
BELT = 0.75  # of the way from the shoulders to the hips: the waist, where it is belted
STIFFNESS = 20.0  # N/m of each of the springs that the belt is
CHEST = 0.02  # of the body's height below the shoulder joints, from where on both panels hang straight
ACROSS = 25  # lines across a panel on which the body is measured
LEVELS = 60  # heights there, and places along the top of the shoulders
DOWN = 400  # points along each of them
REACH = 0.075  # of the body's height to the front and back of the neck, where the top of the shoulders is looked for
HIGHEST = 0.12  # of the body's height above the shoulder joints: where there is nothing but neck and head
LOW = 0.06  # of the body's height below the shoulder joints: inside of any chest
BETWEEN = 0.5  # of the clearance
ABOVE = ("head", "neck")  # what comes through the hole


def fit(fitted: Fitted, measures: Measures) -> Worn:
    """Cut it to the shoulders, to be held by the chest along the edge of its hole, and by a belt.

    Raises:
        ValueRangeError: a size is not positive, or the spacing too wide for the tabard.
        UnknownNameError: the body has no chest or pelvis.
    """
    body = fitted.with_raised_arms()
    length, flare, spacing = measures.sizes(body.height, length=LENGTH, flare=FLARE, spacing=SPACING)
    thickness = room_between(spacing, body.height)
    tabard = lay_out(
        body, length=length, flare=flare, spacing=spacing, clearance=thickness + CLEARANCE,
        fabric=measures.fabric or Fabric(),
    )  # fmt: skip
    held = (
        Hold(bone, region, body.into_bone(bone, tabard.positions[tabard.region(region)]), stiffness)
        for bone, region, stiffness in (("chest", "neckline", None), ("pelvis", "belt", STIFFNESS))
    )
    return Worn(tabard, tuple(held), put_on=body, layered=True, thickness=thickness)


@dataclass(frozen=True)
class _Hole:
    """The hole for the head: half of its width, and how far it reaches in front, or behind, from the shoulders [m]."""

    half: float
    depth: float

    def rounded(self, places: FloatArray, edge: float) -> FloatArray:
        """Places across and along a panel [m], shape (..., 2), drawn in so that the hole's rectangle becomes round.

        What is on its edge comes to lie on a superellipse, what is as far out as `edge` [m], in widths of the hole,
        stays.
        """
        scaled = np.abs(places) / [self.half, self.depth]
        out = np.maximum(scaled.max(axis=-1), 1.0)
        on_edge = scaled / out[..., None]
        drawn = np.maximum((on_edge**ROUNDED).sum(axis=-1), 1.0) ** (-1.0 / ROUNDED)
        share = np.clip((edge / self.half - out) / (edge / self.half - 1.0), 0.0, 1.0)
        return places * (1.0 - (1.0 - drawn) * share)[..., None]


def lay_out(
    body: Fitted, *, length: float, flare: float, spacing: float, clearance: float, fabric: Fabric
) -> MeshCloth:
    """Lay a tabard over a body's shoulders.

    Args:
        body: whose.
        length: from the shoulders to the hem [m].
        flare: width of the hem divided by that on the shoulders.
        spacing: mean distance of neighbouring vertices [m].
        clearance: least distance from the body, as it is cut [m].
        fabric: what it is made of.

    Raises:
        ValueRangeError: the spacing is too wide for the tabard, or no collar fits the neck.
    """
    height = body.height
    half = WIDTH * float(np.clip(body.shoulder_width, NARROWEST * height, WIDEST * height)) / 2.0
    aside = body.collar(clearance)[0] + HOLE * height
    half = max(half, aside + 2.0 * spacing)
    sides = _profiles(body, np.linspace(-half, half, ACROSS), aside, length, clearance)
    front, back = (_depth(body, profiles[ACROSS // 2], length, clearance) for profiles in sides)
    holes = _Hole(aside, front + (HOLE + DEEPER) * height), _Hole(aside, back + HOLE * height)
    if length < 2.0 * holes[0].depth:
        raise ValueRangeError(f"a spacing of {spacing:g} m is too wide for a tabard {length:.2f} m long")
    across = tailoring.spaced((-half, -aside, aside, half), spacing)
    panels = []
    for hole, profiles, outwards in zip(holes, sides, (1.0, -1.0), strict=True):
        down = tailoring.spaced((0.0, hole.depth, length), spacing)
        flat = hole.rounded(np.stack(np.meshgrid(outwards * across, down), axis=-1), half)
        places = _laid(profiles, flat, half, length)
        below_hole = np.maximum(flat[..., 1] - hole.depth, 0.0) / (length - hole.depth)
        places[..., 1] *= 1.0 + (flare - 1.0) * below_hole
        cut = (down[1:, None] <= hole.depth) & (across[:-1] >= -aside) & (across[1:] <= aside)
        belted = int(np.argmin(np.abs(places[:, 0, 2] - BELT * body.hips[2])))
        panels.append(_panel(places, flat * [1.0, outwards], cut, belted))
    return sewn(panels, fabric=fabric)


def _depth(body: Fitted, thread: FloatArray, length: float, clearance: float) -> float:
    """How far down the middle of a panel, a thread forward and up [m] (n, 2), it is clear of what comes through [m]."""
    places = np.stack([thread[:, 0], np.zeros(len(thread)), thread[:, 1]], axis=1)
    # The rest of the body it lies on, no nearer than that but for what lies between lines.
    near = np.flatnonzero(body.distances(places, within=clearance) < BETWEEN * clearance)
    return length * float(near.max(initial=0)) / len(thread)


def _panel(places: FloatArray, threads: FloatArray, cut: NDArray[np.bool_], belted: int) -> Panel:
    """A panel from the shoulders down, without the cells that are `cut` out, hemmed all around; one row is belted."""
    rows, columns = places.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    beside = np.zeros((rows, columns), dtype=bool)
    for corner in np.ndindex(2, 2):
        beside[corner[0] : rows - 1 + corner[0], corner[1] : columns - 1 + corner[1]] |= cut
    layers = tailoring.sewn_edges(places, rows, columns, HEM_LAYERS)
    hemmed = np.any([beside[a : rows - 1 + a, b : columns - 1 + b] for a, b in np.ndindex(2, 2)], axis=0)
    return Panel(
        places=places,
        threads=threads,
        layers=np.where(hemmed, np.maximum(layers, HEM_LAYERS), layers),
        kept=~cut,
        regions={"neckline": index[beside], "bottom": index[-1], "belt": index[belted]},
    )


def _profiles(
    body: Fitted, across: FloatArray, aside: float, length: float, clearance: float
) -> tuple[FloatArray, FloatArray]:
    """How cloth that is drawn over the shoulders runs down in front and behind, on lines so far to the left [m] (n,).

    Where the hole is, up to so far `aside` [m], it goes on as beside it: not over what comes through.

    Returns:
        For either side forward and up [m] at even distances from the top of the shoulders to the hem, which is level,
        shape (n, DOWN, 2).
    """
    height, ahead = body.height, float(body.neck[0])
    levels = np.linspace(-length, HIGHEST * height, LEVELS)
    straight = levels < -CHEST * height
    beside = np.where(across < 0.0, -1.0, 1.0) * np.maximum(np.abs(across), aside)
    origins = np.stack(np.broadcast_arrays(0.0, np.where(straight[:, None], across, beside), levels[:, None]), axis=-1)
    before, behind = (
        sign * body.way_out(origins, np.array([sign, 0.0, 0.0]), clearance, without=ABOVE) for sign in (1.0, -1.0)
    )
    before[straight] = before[straight].max(axis=1, keepdims=True)
    behind[straight] = behind[straight].min(axis=1, keepdims=True)
    along = ahead + np.linspace(-REACH, REACH, LEVELS) * height
    origins = np.stack(np.broadcast_arrays(along, beside[:, None], -LOW * height), axis=-1)
    tops = body.way_out(origins, np.array([0.0, 0.0, 1.0]), clearance, without=ABOVE) - LOW * height
    drawn = []
    for line in range(len(across)):
        sides = [np.stack([side[:, line], levels], axis=1)[side[:, line] != 0.0] for side in (before, behind)]
        top = np.stack([along, tops[line]], axis=1)[tops[line] > -LOW * height]
        drawn.append(_over(np.concatenate([*sides, top]), levels[0], ahead))
    ways = [[tailoring.length_of(part) for part in pair] for pair in drawn]
    hem = levels[0] + float(np.mean(ways)) - length
    front, back = (np.stack([tailoring.evenly(_down_to(pair[side], hem), DOWN) for pair in drawn]) for side in (0, 1))
    return front, back


def _down_to(thread: FloatArray, hem: float) -> FloatArray:
    """A thread that ends where it hangs, made as long as to reach down to a height [m]."""
    return np.concatenate([thread[thread[:, 1] > hem], [[thread[-1, 0], hem]]])


def _over(skin: FloatArray, lowest: float, ahead: float) -> tuple[FloatArray, FloatArray]:
    """The way of a taut thread over points of the skin [m] (n, 2), down to the `lowest` height [m]: from the top,
    `ahead` of the shoulder joints, to the front, and to the back."""
    ends = np.array([[skin[:, 0].max(), lowest], [skin[:, 0].min(), lowest]])
    corners = tailoring.hull(np.concatenate([skin, ends]))
    first = int(np.argmin(np.linalg.norm(corners - ends[0], axis=1)))
    corners = np.roll(corners, -first, axis=0)  # against the clock: up the front, over the top, down the back
    last = int(np.argmin(np.linalg.norm(corners - ends[1], axis=1)))
    thread = tailoring.evenly(corners[: last + 1], 4 * DOWN)
    high = thread[:, 1] > lowest / 2.0
    top = int(np.argmin(np.where(high, np.abs(thread[:, 0] - ahead), np.inf)))
    return thread[top::-1], thread[top:]


def _laid(profiles: FloatArray, flat: FloatArray, half: float, length: float) -> FloatArray:
    """Where points of a flat panel, across and down [m] (..., 2), lie on the body [m], shape (..., 3)."""
    lines, downs = ((np.clip(share, 0.0, 1.0) * (count - 1)) for share, count in (
        ((flat[..., 0] + half) / (2.0 * half), ACROSS), (flat[..., 1] / length, DOWN),
    ))  # fmt: skip
    line, down = np.minimum(lines.astype(int), ACROSS - 2), np.minimum(downs.astype(int), DOWN - 2)
    a, b = (lines - line)[..., None], (downs - down)[..., None]
    near = (1.0 - b) * profiles[line, down] + b * profiles[line, down + 1]
    far = (1.0 - b) * profiles[line + 1, down] + b * profiles[line + 1, down + 1]
    place = (1.0 - a) * near + a * far
    return np.stack([place[..., 0], flat[..., 0], place[..., 1]], axis=-1)


TABARD = Garment(
    "tabard",
    "a front and a back panel from the shoulders to above the knees, belted, open at the sides",
    fit,
    under_arms=True,
)
