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
from cape.garments.base import Hold, Measures, Worn
from cape.garments.fitting import Fitted
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]

CLEARANCE = 0.008  # m between the body and the garment as it is cut
ROOM = 0.008  # m that the collar is wider than the neck, besides
STEEPEST = 0.9  # descent of the yoke per way outwards: beyond the shoulders' edge it does not follow the body
COLLAR_ROWS = 2  # that the chest holds
HEM_LAYERS = 3.0  # of fabric in the sewn hem; the collar has twice as many
STIFF = 0.6  # rad around the neck, over which a collar is even
SPACING = 0.0172  # of the body's height, for fewer vertices than two threads share: triangles in contact are all one's


@dataclass(frozen=True, kw_only=True)
class Cut:
    """The shape of such a garment.

    Attributes:
        length: from the collar to the hem, of the body's height.
        flare: length of the hem divided by that of the ring around the shoulders.
        begin: where its left edge is around the neck, from the middle of the back to the left [rad].
        end: where its right edge is.
    """

    length: float
    flare: float
    begin: float
    end: float

    def fit(self, fitted: Fitted, measures: Measures) -> Worn:
        """Cut it for a body, to be held by the chest along its collar."""
        cloth, collar = lay_out(
            fitted,
            self.begin,
            self.end,
            length=self.length * fitted.height if measures.length is None else measures.length,
            flare=self.flare if measures.flare is None else measures.flare,
            spacing=SPACING * fitted.height if measures.spacing is None else measures.spacing,
            fabric=measures.fabric or Fabric(),
        )
        held = Hold("chest", "collar", fitted.into_bone("chest", collar))
        return Worn(cloth, (held,), arms_lowered=True)


def lay_out(
    fitted: Fitted, begin: float, end: float, *, length: float, flare: float, spacing: float, fabric: Fabric
) -> tuple[GridCloth, FloatArray]:
    """Lay a garment around a body's neck.

    Args:
        fitted: the body.
        begin: angle of its left edge, from the middle of the back to the left [rad].
        end: that of its right edge, less than `begin`.
        length: from the collar to the hem [m].
        flare: length of the hem divided by that of the ring around the shoulders.
        spacing: mean distance of neighbouring vertices [m].
        fabric: what it is made of.

    Returns:
        The cloth, in the wearer's frame without tension, and where the rows of its collar lie there [m], shape (n, 3).

    Raises:
        ValueRangeError: a size is not positive, the garment ends on the shoulders, or no collar fits the neck.
    """
    for name, value in (("length", length), ("flare", flare), ("spacing", spacing)):
        if not 0.0 < value < np.inf:
            raise ValueRangeError(f"the {name} must be positive and finite, not {value}")
    neck, top = fitted.collar(CLEARANCE)
    radius, reach = neck + ROOM, fitted.girth(CLEARANCE)
    down = np.linspace(0.0, length, tailoring.cells(length, spacing) + 1)
    edge = int(np.searchsorted(down, reach - radius))
    if edge + COLLAR_ROWS >= len(down):
        raise ValueRangeError(f"a garment {length:.2f} m long ends on the shoulders, {reach - radius:.2f} m wide")
    hem = max(flare, 1.0) * reach
    rings = np.interp(down, [0.0, max(reach - radius, down[1]), length], [radius, max(reach, radius), hem])
    columns = max(tailoring.cells((begin - end) * float(rings.mean()), spacing), 7) + 1
    angles = np.linspace(begin, end, columns)
    heights = _heights(fitted, rings, angles, down, edge, top)
    places = np.stack(
        np.broadcast_arrays(fitted.neck[0] - rings[:, None] * np.cos(angles), rings[:, None] * np.sin(angles), heights),
        axis=-1,
    )
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
        layers=tailoring.sewn_edges(places, rows, columns, HEM_LAYERS),
        regions={**tailoring.grid_regions(rows, columns), "collar": np.arange(COLLAR_ROWS * columns)},
    )
    return cloth, places[:COLLAR_ROWS].reshape(-1, 3)


def _heights(
    fitted: Fitted, rings: FloatArray, angles: FloatArray, down: FloatArray, edge: int, top: float
) -> FloatArray:
    """Heights of all vertices above the shoulder joints [m], shape (rows, columns).

    Let down from the height `top`, they lie on the body up to the row `edge`, evened out; from there on they hang, as
    far down as the rows, which get wider, leave of the way.
    """
    heights = np.full((len(rings), len(angles)), top)
    for row in range(edge + 1):
        before = heights[max(row - 1, 0)]
        heights[row] = _even(fitted.lie_on(rings[row], angles, CLEARANCE, before), angles)
        if row:
            heights[row] = np.maximum(heights[row], before - STEEPEST * (rings[row] - rings[row - 1]))
    ways, wider = np.diff(down[edge:]), np.diff(rings[edge:])
    heights[edge + 1 :] = heights[edge] - np.cumsum(np.sqrt(np.maximum(ways**2 - wider**2, 0.0)))[:, None]
    return heights


def _even(heights: FloatArray, angles: FloatArray) -> FloatArray:
    """Heights without dents: nowhere lower than given, as even as a stiff collar."""
    apart = np.abs(angles[:, None] - angles)
    highest = np.where(apart <= STIFF / 2.0, heights, -np.inf).max(axis=1)
    weights = np.exp(-2.0 * (apart / STIFF) ** 2)
    return np.maximum(weights @ highest / weights.sum(axis=1), heights)
