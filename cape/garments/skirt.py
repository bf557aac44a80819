"""A skirt: a band around the waist, and below it a front and a back panel that flare to the hem."""

import numpy as np
from numpy.typing import NDArray

from cape.cloth import tailoring
from cape.cloth.cloth import MeshCloth
from cape.cloth.fabric import Fabric
from cape.cloth.sewing import Panel, sewn
from cape.garments.base import Garment, Hold, Measures, Worn
from cape.garments.fitting import CLEARANCE, Fitted, room_between
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]

LENGTH = 0.31  # of the body's height: from the waist to the knees
FLARE = 3.0
STEEPEST = 0.8  # of a flare that lies flat, at most, where none is asked for
SPACING = 0.0155  # of the body's height
BAND = 0.025  # of the body's height: width of the waistband
HELD = 0.6  # of it, from its upper edge, that the pelvis holds: what hands at the hips press on must give way
HEM_LAYERS = 3.0  # of fabric in the hem and the side seams; the waistband has twice as many
HIGHEST = 0.6  # of the way from the hips to the shoulders, below which a waist is looked for
TRIED = 20  # heights there
AROUND = 96  # directions in which the body is measured
FEWEST = 8  # columns of each panel


def fit(fitted: Fitted, measures: Measures) -> Worn:
    """Cut it around the narrowest place above the hips, to be held by the pelvis along the edge of its band.

    Raises:
        ValueRangeError: a size is not positive, the hem too wide for the length, or the spacing for the skirt.
        UnknownNameError: the body has no pelvis.
    """
    body = fitted.with_raised_arms()
    length, flare, spacing = measures.sizes(body.height, length=LENGTH, flare=FLARE, spacing=SPACING)
    thickness = room_between(spacing, body.height)
    skirt = lay_out(
        body, length=length, flare=measures.flare and flare, spacing=spacing, clearance=thickness + CLEARANCE,
        fabric=measures.fabric or Fabric(),
    )  # fmt: skip
    held = Hold("pelvis", "waist", body.into_bone("pelvis", skirt.positions[skirt.region("waist")]))
    return Worn(skirt, (held,), put_on=body, layered=True, thickness=thickness)


def lay_out(
    body: Fitted, *, length: float, flare: float | None, spacing: float, clearance: float, fabric: Fabric
) -> MeshCloth:
    """Lay a skirt around a body's waist.

    Args:
        body: whose.
        length: from the waist to the hem, along the cloth [m].
        flare: length of the hem divided by that of the waist; None for `FLARE`, or less where that would lie flat.
        spacing: mean distance of neighbouring vertices [m].
        clearance: least distance from the body, as it is cut [m].
        fabric: what it is made of.

    Raises:
        ValueRangeError: the hem is too wide for the length, or the spacing too wide for the skirt.
    """
    top, outline = _waist(body, clearance)
    girth = _girth(outline)
    band = BAND * body.height
    below = length - band
    if below < max(band, 2.0 * spacing):
        raise ValueRangeError(f"a spacing of {spacing:g} m is too wide for a skirt {length:.2f} m long")
    widest = 1.0 + 2.0 * np.pi * below / girth
    if flare is None:
        flare = min(FLARE, max(STEEPEST * widest, 1.0))
    columns = tailoring.cells(girth * (1.0 + max(flare, 1.0)) / 4.0, spacing)
    if columns < FEWEST:
        raise ValueRangeError(f"a spacing of {spacing:g} m is too wide for a waist of {girth:.2f} m")
    down = tailoring.spaced((0.0, band, length), spacing)
    share = np.maximum(down - band, 0.0) / below  # of the way from the band to the hem
    wider = max(flare - 1.0, 0.0) * girth / (2.0 * np.pi)
    if wider >= below:
        raise ValueRangeError(f"a skirt {length:.2f} m long can't have a flare of {flare:g}: {widest:.2f} lies flat")
    heights = top - np.minimum(down, band) - share * np.sqrt(below**2 - wider**2)
    angles = np.linspace(np.pi / 2.0, -1.5 * np.pi, 2 * columns + 1)  # from the left side over the back
    radii = np.interp(angles, *outline, period=2.0 * np.pi) + wider * share[:, None]
    for row, height in enumerate(heights):
        skin = np.interp(angles, *_outline(body, height, clearance), period=2.0 * np.pi)
        radii[row] = np.maximum(np.maximum(radii[row], skin), radii[max(row - 1, 0)])
    places = np.stack(
        np.broadcast_arrays(body.hips[0] - radii * np.cos(angles), radii * np.sin(angles), heights[:, None]), axis=-1
    )
    back, front = places[:, : columns + 1], places[:, columns:]
    across = np.linspace(-1.0, 1.0, columns + 1) * girth / 4.0
    return sewn([_panel(back, across, down, band), _panel(front, -across, down, band)], fabric=fabric)


def _panel(places: FloatArray, across: FloatArray, down: FloatArray, band: float) -> Panel:
    """One half, from side seam to side seam; both lie alike in the picture of their threads, one upon the other."""
    rows, columns = places.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    return Panel(
        places=places,
        threads=np.stack(np.meshgrid(across, down), axis=-1),
        layers=tailoring.sewn_edges(places, rows, columns, HEM_LAYERS),
        regions={"waist": index[down <= HELD * band].ravel(), "hem": index[-1]},
    )


def _waist(body: Fitted, clearance: float) -> tuple[float, tuple[FloatArray, FloatArray]]:
    """Height of the narrowest place between hips and shoulders [m], and its outline."""
    hips = body.hips[2]
    heights = hips * (1.0 - np.linspace(0.0, HIGHEST, TRIED))
    outlines = [_outline(body, height, clearance) for height in heights]
    narrowest = int(np.argmin([_girth(outline) for outline in outlines]))
    return float(heights[narrowest]), outlines[narrowest]


def _outline(body: Fitted, height: float, clearance: float) -> tuple[FloatArray, FloatArray]:
    """Angles from the middle of the back to the left [rad], and how far off the trunk's axis a cloth that is drawn
    around the body lies there [m]."""
    angles = np.linspace(-np.pi, np.pi, AROUND, endpoint=False)
    outwards = np.stack([-np.cos(angles), np.sin(angles), np.zeros(AROUND)], axis=1)
    ways = body.way_out(np.array([body.hips[0], 0.0, height]), outwards, clearance)
    corners = tailoring.hull(ways[:, None] * outwards[:, :2])
    drawn = tailoring.evenly(np.concatenate([corners, corners[:1]]), 4 * AROUND)[:-1]
    return np.arctan2(drawn[:, 1], -drawn[:, 0]), np.linalg.norm(drawn, axis=1)


def _girth(outline: tuple[FloatArray, FloatArray]) -> float:
    """Length of an outline [m]."""
    angles, radii = outline
    places = radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return tailoring.length_of(np.concatenate([places, places[:1]]))


SKIRT = Garment("skirt", "hangs from the waist around the hips, and flares to the knees", fit, under_arms=True)
