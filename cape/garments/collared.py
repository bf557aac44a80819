"""How a garment is cut that lies on the shoulders, from a collar around the neck.

Its yoke is a ring around the neck that follows the shoulders; from their edge on it grows wider as its flare tells, and
falls. A single flat piece would have far too much cloth at the hem or too little on the shoulders: what is too much is
taken up by darts, so that each row is as long as the garment is wide there, whatever the rows around it are.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cape.cloth import tailoring
from cape.cloth.cloth import GridCloth
from cape.cloth.fabric import Fabric
from cape.garments.base import Hold, Kept, Measures, Worn
from cape.garments.fitting import CLEARANCE, Fitted, Ring, room_between
from cape.garments.hood import BROW_STIFFNESS, with_hood
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]

STEEPEST = 0.9  # descent of the yoke per way outwards: beyond the shoulders' edge it does not follow the body
COLLAR = 0.045  # of the body's height: width of the collar, which chest and neck hold
HEM_LAYERS = 3.0  # of fabric in the sewn hem; the collar has twice as many
SEAMS = (np.pi / 2.0, -np.pi / 2.0)  # from the middle of the back to the left [rad]: over the shoulders
CLASPED = 1.0  # rad around the neck that a clasp may span
NAPE = 0.5  # rad to either side of the middle of the back: beyond it the neck's sides begin
STIFF = 0.6  # rad around the neck, over which a collar is even
LIFTED = 0.031  # of the body's height, by which cloth on top of a shoulder may lift off or slip, as from a shoulder pad
FIRM = 0.015  # the same right over the joint
ON_TOP = 0.047  # of the body's height from a shoulder's joint, seen from above: what lies on top of it
SPACING = 0.0252  # of the body's height, for about as many vertices as a cape that hangs from the shoulders


@dataclass(frozen=True, kw_only=True)
class Cut:
    """The shape of such a garment.

    Attributes:
        length: from the collar to the hem, of the body's height.
        flare: length of the hem divided by that of the ring around the shoulders.
        begin: where its left edge is around the neck, from the middle of the back to the left [rad].
        end: where its right edge is.
        hooded: whether it goes on above the neckline as a hood, which is worn over the head.
    """

    length: float
    flare: float
    begin: float
    end: float
    hooded: bool = False

    def fit(self, fitted: Fitted, measures: Measures) -> Worn:
        """Cut it for a body: held along its collar by chest and neck, half each, and at the brow where it is hooded.

        Raises:
            ValueRangeError: it can't be cut, as of `lay_out`.
            UnknownNameError: the body has no chest, or it is hooded, and no bone plays the head.
        """
        spacing = SPACING * fitted.height if measures.spacing is None else measures.spacing
        thickness = room_between(spacing, fitted.height)
        cloth, collar = lay_out(
            fitted,
            self.begin,
            self.end,
            length=measures.length_of(self.length * fitted.height),
            flare=self.flare if measures.flare is None else measures.flare,
            spacing=spacing,
            clearance=thickness + CLEARANCE,
            fabric=measures.fabric or Fabric(),
        )
        held = [Hold("chest", "collar", fitted.into_bone("chest", collar), half=fitted.neck_bone)]
        if self.hooded:
            cloth = with_hood(cloth, fitted, spacing=spacing, clearance=thickness + CLEARANCE)
            brow = cloth.region("brow")
            points = fitted.into_bone("head", cloth.positions[brow])
            held.append(Hold("head", "brow", points, BROW_STIFFNESS / len(brow)))
        return Worn(
            cloth, tuple(held), put_on=fitted, layered=True, thickness=thickness, kept=_kept_on_shoulders(cloth, fitted)
        )


def lay_out(
    fitted: Fitted,
    begin: float,
    end: float,
    *,
    length: float,
    flare: float,
    spacing: float,
    clearance: float,
    fabric: Fabric,
) -> tuple[GridCloth, FloatArray]:
    """Lay a garment around a body's neck.

    Args:
        fitted: the body.
        begin: angle of its left edge, from the middle of the back to the left [rad].
        end: that of its right edge, less than `begin`.
        length: from the collar to the hem [m].
        flare: length of the hem divided by that of the ring around the shoulders.
        spacing: mean distance of neighbouring vertices [m].
        clearance: least distance from the body, as it is cut [m].
        fabric: what it is made of.

    Returns:
        The cloth, in the wearer's frame without tension, and where the rows of its collar lie there [m], shape (n, 3).

    Raises:
        ValueRangeError: a size is not positive, the garment ends on the shoulders, the spacing is too wide for what
            hangs from them, or no collar fits the neck.
    """
    tailoring.require_positive(length=length, flare=flare, spacing=spacing)
    neckline = fitted.collar(clearance)
    radius, reach = neckline.radius, fitted.girth(clearance)
    if length <= reach - radius:
        raise ValueRangeError(f"a garment {length:.2f} m long ends on the shoulders, {reach - radius:.2f} m wide")
    if length - (reach - radius) < 2.0 * spacing:
        raise ValueRangeError(f"a spacing of {spacing:g} m is too wide for a garment {length:.2f} m long")
    edge = tailoring.cells((reach - radius) * np.hypot(1.0, STEEPEST), spacing)
    below = tailoring.cells(length - (reach - radius), spacing)
    down = np.append(np.linspace(0.0, reach - radius, edge + 1), np.linspace(reach - radius, length, below + 1)[1:])
    collar = 1 + max(round(COLLAR * fitted.height / spacing), 1)  # rows of it
    hem = max(flare, 1.0) * reach
    rings = np.interp(down, [0.0, max(reach - radius, down[1]), length], [radius, max(reach, radius), hem])
    columns = max(tailoring.cells((begin - end) * float(rings.mean()), spacing), 7) + 1
    angles = np.linspace(begin, end, columns)
    heights = _heights(fitted, rings, angles, down, edge, neckline, clearance)
    places = fitted.ring(rings[:, None], angles, heights)
    pattern = np.stack(
        np.broadcast_arrays(rings[:, None] * (angles[0] + angles[-1] - 2.0 * angles) / 2.0, down[:, None]), axis=-1
    ).reshape(-1, 2)
    rows = len(down)
    cloth = GridCloth(
        rows=rows,
        columns=columns,
        darted=True,
        pattern=pattern,
        positions=places.reshape(-1, 3),
        frame="wearer",
        fabric=fabric,
        gathers=_gathers(rings, down, edge, columns),
        layers=tailoring.sewn_edges(places, rows, columns, HEM_LAYERS),
        seams=tuple(int(np.abs(angles - at).argmin()) for at in SEAMS if angles[-1] < at < angles[0]),
        regions={**tailoring.grid_regions(rows, columns), **_fastened(collar, angles)},
    )
    return cloth, places[:collar].reshape(-1, 3)


def _kept_on_shoulders(cloth: GridCloth, fitted: Fitted) -> tuple[Kept, ...]:
    """What lies on top of both shoulders stays near them, however arms that rise push cloth up or draw it off: the more
    firmly the nearer to the joint, so that its cover stays there while cloth around may give.

    On one shoulder alone it may slip: kept there in a jump, it was strained more, and its layers passed through each
    other in a third of the frames.
    """
    kept = []
    for side, left in (("left", 1.0), ("right", -1.0)):
        off = cloth.positions - [0.0, left * fitted.shoulder_width / 2.0, 0.0]
        aside = np.hypot(off[:, 0], off[:, 1]) / (ON_TOP * fitted.height)
        vertices = np.setdiff1d(np.flatnonzero((aside < 1.0) & (off[:, 2] > 0.0)), cloth.region("collar"))
        if len(vertices):
            most = np.interp(aside[vertices], [0.0, 1.0], [FIRM, LIFTED]) * fitted.height
            kept.append(Kept(fitted.carrier(side), vertices, most))
    return tuple(kept) if len(kept) == 2 else ()


def _fastened(collar: int, angles: FloatArray) -> dict[str, NDArray[np.int64]]:
    """The vertices of the collar, of so many rows, and of both ends of a clasp where its ends are close."""
    columns, row = len(angles), collar // 2
    regions = {"collar": np.arange(collar * columns)}
    if 2.0 * np.pi - (angles[0] - angles[-1]) < CLASPED:
        regions["clasp"] = np.array([row * columns, (row + 1) * columns - 1])
    return regions


def _gathers(rings: FloatArray, down: FloatArray, edge: int, columns: int) -> FloatArray:
    """How much cloth each cell takes up, shape (rows - 1, columns - 1): what is cut as one piece below the row `edge`
    goes on above it as wide as it would be there, and is gathered."""
    middles, ways = (rings[1:] + rings[:-1]) / 2.0, (down[1:] + down[:-1]) / 2.0
    slope = (rings[-1] - rings[edge]) / (down[-1] - down[edge])
    cut = rings[edge] + slope * (ways - down[edge])
    return np.repeat(np.maximum(cut / middles, 1.0)[:, None], columns - 1, axis=1)


def _heights(
    fitted: Fitted,
    rings: FloatArray,
    angles: FloatArray,
    down: FloatArray,
    edge: int,
    neckline: Ring,
    clearance: float,
) -> FloatArray:
    """Heights of all vertices above the shoulder joints [m], shape (rows, columns).

    Let down from the `neckline`, they lie on the body up to the row `edge`, evened out; from there on they hang, as
    far down as the rows, which get wider, leave of the way.
    """
    heights = np.tile(neckline.height + neckline.rises(angles), (len(rings), 1))
    for row in range(edge + 1):
        before = heights[max(row - 1, 0)]
        heights[row] = _even(fitted.lie_on(rings[row], angles, clearance, before), angles)
        if row == 0:
            heights[row] = np.maximum(heights[row], _span(heights[row], angles))
        else:
            heights[row] = np.maximum(heights[row], before - STEEPEST * (rings[row] - rings[row - 1]))
    ways, wider = np.diff(down[edge:]), np.diff(rings[edge:])
    heights[edge + 1 :] = heights[edge] - np.cumsum(np.sqrt(np.maximum(ways**2 - wider**2, 0.0)))[:, None]
    return heights


def _span(heights: FloatArray, angles: FloatArray) -> FloatArray:
    """Heights of a collar that goes straight from beside the neck to beside the neck behind it, shape (n,)."""
    beside = [heights[side].max(initial=-np.inf) for side in (angles > NAPE, angles < -NAPE)]
    return np.where(np.abs(angles) <= np.pi / 2.0, min(beside), -np.inf)


def _even(heights: FloatArray, angles: FloatArray) -> FloatArray:
    """Heights without dents: nowhere lower than given, as even as a stiff collar."""
    apart = np.abs(angles[:, None] - angles)
    highest = np.where(apart <= STIFF / 2.0, heights, -np.inf).max(axis=1)
    weights = np.exp(-2.0 * (apart / STIFF) ** 2)
    return np.maximum(weights @ highest / weights.sum(axis=1), heights)
