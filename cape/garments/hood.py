"""How a hood is cut that goes on from a neckline over the head.

Its rows are cuts through a hood by planes that all pass through an axis in front of the throat: the first is the edge
around the face, the last the neckline. Each is as a thread would lie that is drawn around head and neck there. So the
hood is as round as the head, and needs no seam.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cape.cloth import tailoring
from cape.cloth.cloth import GridCloth
from cape.garments.fitting import Fitted

FloatArray = NDArray[np.float64]

EASE = 0.012  # of the body's height: room between head and hood
BROW = 0.6  # of the way from the middle of the head to its front, where the edge crosses it
HEAD = 0.065  # of the body's height: the middle of the head below its top
PLANES = 33  # that are looked at
LEVELS = 48  # of each plane in which the head's width is measured
TALLEST = 0.3  # of the body's height above the throat, up to which there is a head
# Rows come together at the throat, where the closest threads tell how short steps must be: with 0.035 of the body's
# height, and rows as far apart as the garment's, they are 333 a frame of the walk, instead of 212.
AHEAD = 0.052  # of the body's height: that axis in front of the throat
ROWS_APART = 1.25  # of the garment's spacing, over the middle of the head
UNDER_HOOD = ("head", "neck")
HEM = 3.0  # layers of fabric in the edge around the face
HELD = 0.3  # of that edge, over the brow, that the head holds
BROW_STIFFNESS = 150.0  # N/m of all springs together that do


def with_hood(cloth: GridCloth, fitted: Fitted, *, spacing: float, clearance: float) -> GridCloth:
    """A garment that goes on above its neckline, its top row, as a hood, with the region "brow" of the edge above it.

    Args:
        cloth: the garment, as it lies on the body; of its regions "left" and "right" end at the neckline.
        fitted: the body.
        spacing: mean distance of the garment's rows [m].
        clearance: least distance from the body [m].

    Raises:
        UnknownNameError: no bone plays the head.
    """
    columns = cloth.columns
    above = hood(fitted, cloth.positions[:columns], spacing, clearance)
    rows, brow = len(above), max(round(HELD * columns / 2.0), 1)
    picture = cloth.pattern[:columns] - np.arange(rows, 0, -1)[:, None, None] * [0.0, spacing]
    own = np.ones((rows, columns - 1))
    layers = own if cloth.layers is None else np.concatenate([own, cloth.layers])
    layers[0] = HEM
    return replace(
        cloth,
        rows=cloth.rows + rows,
        pattern=np.concatenate([picture.reshape(-1, 2), cloth.pattern]),
        positions=np.concatenate([above.reshape(-1, 3), cloth.positions]),
        gathers=None if cloth.gathers is None else np.concatenate([own, cloth.gathers]),
        layers=layers,
        regions={
            **{name: vertices + rows * columns for name, vertices in cloth.regions.items()},
            "brow": np.arange((columns - 1) // 2 - brow, columns // 2 + brow + 1),
        },
    )


def hood(fitted: Fitted, neckline: FloatArray, spacing: float, clearance: float) -> FloatArray:
    """Lay a hood over the head.

    Args:
        fitted: the body.
        neckline: where it begins, from the left side of the throat behind the neck to the right one [m], shape (n, 3).
        spacing: mean distance of the garment's rows [m].
        clearance: least distance from the body [m].

    Returns:
        The rows above the neckline, that around the face first [m], shape (rows, n, 3).

    Raises:
        UnknownNameError: no bone plays the head.
    """
    columns, ahead = len(neckline), AHEAD * fitted.height
    throat, nape = (neckline[0] + neckline[-1]) / 2.0, (neckline[(columns - 1) // 2] + neckline[columns // 2]) / 2.0
    back = (nape - throat) * [1.0, 0.0, 1.0]
    axis = throat - ahead * back / np.linalg.norm(back)
    crown = fitted.crown
    face = crown - [0.0, 0.0, HEAD * fitted.height]
    front = BROW * float(fitted.way_out(face, np.array([1.0, 0.0, 0.0]), clearance, only=UNDER_HOOD))
    first = np.arctan2(crown[2] - axis[2], crown[0] + front - axis[0])
    last = np.arctan2(back[2], back[0]) % (2.0 * np.pi)
    room = clearance + EASE * fitted.height
    threads = [_thread(fitted, axis, angle, neckline, room) for angle in np.linspace(first, last, PLANES)]
    rows = tailoring.cells(_over_head(threads), ROWS_APART * spacing)
    surface = np.array([tailoring.evenly(thread, columns) for thread in threads])
    surface += np.linspace(0.0, 1.0, PLANES)[:, None, None] * (neckline - surface[-1])
    return np.stack([tailoring.evenly(column, rows + 1) for column in surface.transpose(1, 0, 2)], axis=1)[:-1]


def _thread(fitted: Fitted, axis: FloatArray, angle: float, neckline: FloatArray, room: float) -> FloatArray:
    """The way around head and neck, from the left side of the throat to the right, in the plane through an axis [m]
    at an angle from straight ahead [m], shape (n, 3)."""
    up, left = np.array([np.cos(angle), 0.0, np.sin(angle)]), np.array([0.0, 1.0, 0.0])
    levels = np.linspace(AHEAD, TALLEST, LEVELS) * fitted.height
    origins = axis + levels[:, None] * up
    sides = [sign * fitted.way_out(origins, sign * left, room, only=UNDER_HOOD) for sign in (1.0, -1.0)]
    ends = np.array([[neckline[0, 1], levels[0]], [neckline[-1, 1], levels[0]]])
    top = max(float(fitted.way_out(axis, up, room, only=UNDER_HOOD)), levels[1])
    around = [np.stack([side, levels], axis=1)[side != 0.0] for side in sides]
    corners = tailoring.hull(np.concatenate([*around, [[0.0, top]], ends]))
    starts = [int(np.argmin(np.linalg.norm(corners - end, axis=1))) for end in ends]
    corners = np.roll(corners, -starts[0], axis=0)[: (starts[1] - starts[0]) % len(corners) + 1]
    return axis + corners[:, :1] * left + corners[:, 1:] * up


def _over_head(threads: list[FloatArray]) -> float:
    """Length of the way over the middle of the head [m]."""
    return tailoring.length_of(np.array([tailoring.evenly(thread, 3)[1] for thread in threads]))
