"""A sash: a band from the left shoulder across chest and back to the right hip, its ends sewn together there."""

import numpy as np
from numpy.typing import NDArray

from cape.cloth import tailoring
from cape.cloth.fabric import Fabric
from cape.cloth.sewing import Panel, sewn
from cape.garments.base import Garment, Hold, Measures, Worn
from cape.garments.fitting import CLEARANCE, Fitted, room_between
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]

WIDTH = 0.055  # of the body's height
SPACING = 0.0105  # of the body's height
HEM_LAYERS = 3.0  # of fabric in its edges
SLACK = 1.04  # length of it over that around the trunk: room to bend
STRAP = 0.03  # of the body's height: how far from the top of the shoulder, to the front and to the back, it is held
BONE = 0.05  # of the body's height above the hip joints: the crest of the hip, above the thigh
HIP = 0.04  # of the body's height: how far from its lowest point it is drawn to the hip
STIFFNESS = 20.0  # N/m of each spring that does
AROUND = 96  # directions in which the body is measured
ACROSS = 5  # lines along the band on which it is
FEWEST = 24  # rows
ARM = 1.15  # of the way to the shoulder joint: what is farther out is the arm
ABOVE, ARMS = ("neck", "head"), ("left_upper_arm", "right_upper_arm")  # what a sash does not go around


def fit(fitted: Fitted, measures: Measures) -> Worn:
    """Cut it as long as it takes around the trunk, to be held on the shoulder by the chest, and at the hip.

    Raises:
        ValueRangeError: a size is not positive, or asked for that follows from the body, or the spacing too wide.
        UnknownNameError: the body has no chest or pelvis.
    """
    body = fitted.with_raised_arms()
    if measures.length is not None or measures.flare is not None:
        raise ValueRangeError("a sash is as long as it takes around the body, and even: it takes no length or flare")
    spacing = SPACING * body.height if measures.spacing is None else measures.spacing
    tailoring.require_positive(spacing=spacing)
    thickness = room_between(spacing, body.height)
    middle, up = _plane(body, thickness + CLEARANCE)
    across = np.cross([1.0, 0.0, 0.0], up)
    loop = SLACK * _loop(body, middle, up, thickness + CLEARANCE)
    rows = 2 * tailoring.cells(tailoring.length_of(loop) / 2.0, spacing)
    if rows < FEWEST:
        raise ValueRangeError(f"a spacing of {spacing:g} m is too wide for a sash around a trunk")
    width = WIDTH * body.height
    loop = tailoring.evenly(loop, rows + 1)
    offsets = np.linspace(-0.5, 0.5, tailoring.cells(width, spacing) + 1) * width
    places = middle + loop[:, None, :1] * [1.0, 0.0, 0.0] + loop[:, None, 1:] * up + offsets[:, None] * across
    # Half a way round it comes back: so its picture, too, is one band whose ends meet.
    along = np.linspace(-1.0, 1.0, rows + 1) * tailoring.length_of(loop) / 2.0
    index = np.arange(places[..., 0].size).reshape(places.shape[:2])
    from_top = np.abs(along - along[int(np.argmax(loop[:, 1]))])
    band = Panel(
        places=places,
        threads=np.stack(np.broadcast_arrays(offsets, np.abs(along)[:, None]), axis=-1),
        layers=tailoring.sewn_edges(places, rows + 1, len(offsets), HEM_LAYERS),
        regions={
            "shoulder": index[from_top <= STRAP * body.height].ravel(),
            "hip": index[np.abs(along) >= along[-1] - HIP * body.height].ravel(),
        },
    )
    sash = sewn([band], fabric=measures.fabric or Fabric())
    held = (
        Hold(bone, region, body.into_bone(bone, sash.positions[sash.region(region)]), stiffness)
        for bone, region, stiffness in (("chest", "shoulder", None), ("pelvis", "hip", STIFFNESS))
    )
    return Worn(sash, tuple(held), put_on=body, layered=True, thickness=thickness)


def _plane(body: Fitted, clearance: float) -> tuple[FloatArray, FloatArray]:
    """Middle of the plane of the loop [m] and the direction in it up to the shoulder; forwards is the other one."""
    joint = body.shoulder_width / 2.0
    aside = (min(body.collar(clearance)[0], joint) + joint) / 2.0  # midway between the neck and the arm
    rise = float(body.way_out(np.array([0.0, aside, -joint]), np.array([0.0, 0.0, 1.0]), clearance, without=ABOVE))
    hip = np.array([body.hips[0], 0.0, body.hips[2] + BONE * body.height])
    hip[1] = -float(body.way_out(hip, np.array([0.0, -1.0, 0.0]), clearance))
    shoulder = np.array([hip[0], aside, rise - joint])
    return (hip + shoulder) / 2.0, (shoulder - hip) / np.linalg.norm(shoulder - hip)


def _loop(body: Fitted, middle: FloatArray, up: FloatArray, clearance: float) -> FloatArray:
    """The way of a band that is drawn around the body, from the hip over the chest: forwards and up in the plane of
    the loop [m], shape (n, 2), the first point once more at the end."""
    angles = np.linspace(-np.pi, np.pi, AROUND, endpoint=False) - np.pi / 2.0
    outwards = np.cos(angles)[:, None] * [1.0, 0.0, 0.0] + np.sin(angles)[:, None] * up
    offsets = np.linspace(-0.5, 0.5, ACROSS) * WIDTH * body.height
    origins = middle + offsets[:, None, None] * np.cross([1.0, 0.0, 0.0], up)
    ways = body.way_out(origins, outwards, clearance, without=ABOVE)
    at_arms = np.abs((origins + ways[..., None] * outwards)[..., 1]) > ARM * body.shoulder_width / 2.0
    ways = np.where(at_arms, body.way_out(origins, outwards, clearance, without=ABOVE + ARMS), ways).max(axis=0)
    corners = tailoring.hull(ways[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1))
    corners = np.roll(corners, -int(np.argmin(np.abs(np.arctan2(corners[:, 0], -corners[:, 1])))), axis=0)
    return np.concatenate([corners, corners[:1]])


SASH = Garment("sash", "a band from the left shoulder across chest and back to the right hip", fit, under_arms=True)
