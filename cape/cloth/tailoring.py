"""How cloth is cut and worn: a cape's flat pattern, neckline and sewn edges, a skirt's rings, the names of parts."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motions.errors import ValueRangeError
from motions.limits import LARGEST_NUMBER

FloatArray = NDArray[np.float64]
# Cells are a little wider than high on average, so that they are not much narrower at the neckline, where the
# narrowest ones set the largest stable step.
WIDER_CELLS = 1.12
MOST_CELLS = 2700  # along one side; 7 million vertices are more than any machine steps
LEAST_SIZE = 1e-9  # m, of a cloth or its cells
HEM = 0.024  # m, width of the sewn edge; the collar is twice as wide
SLACK = 1.1  # length of the neckline over that of the way it is worn: room for the shoulders to move


def arrays_in(thing: object, *names: str) -> list[NDArray[np.generic]]:
    """The arrays that a thing holds under some names, where it holds any; lists would fail much later.

    Raises:
        ValueRangeError: one is no array.
    """
    found = {name: value for name in names if (value := getattr(thing, name, None)) is not None}
    for name, value in found.items():
        if not isinstance(value, np.ndarray):
            raise ValueRangeError(f"{name} must be an array, not a {type(value).__name__}")
    return list(found.values())


def require_positive(**sizes: float) -> None:
    """Check sizes by their names.

    Raises:
        ValueRangeError: one is not positive, or not finite.
    """
    for name, value in sizes.items():
        if not LEAST_SIZE <= value <= LARGEST_NUMBER:
            raise ValueRangeError(f"{name.replace('_', ' ')} must be positive and finite, not {value}")


def cells(size: float, spacing: float) -> int:
    """Number of cells along a side [m], at least one.

    Raises:
        ValueRangeError: there would be too many.
    """
    count = max(1, round(min(size / spacing, 1e9)))
    if count > MOST_CELLS:
        raise ValueRangeError(
            f"a spacing of {spacing:g} m is too fine for {size:.2f} m: at most {MOST_CELLS} cells a side"
        )
    return count


def spaced(stops: Sequence[float], spacing: float) -> FloatArray:
    """Numbers from each of some to the next, as evenly as whole cells of about a spacing make them [m], shape (n,).

    Raises:
        ValueRangeError: there would be too many.
    """
    parts = [np.linspace(a, b, cells(b - a, spacing) + 1)[:-1] for a, b in pairwise(stops)]
    return np.append(np.concatenate(parts), stops[-1])


def unit(direction: ArrayLike, name: str) -> FloatArray:
    """Scale a direction to length 1.

    Raises:
        ValueRangeError: it is zero, not finite, or no vector of three.
    """
    vector = np.asarray(direction, dtype=float)
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not 0.0 < length < math.inf:
        raise ValueRangeError(f"{name} must be three finite numbers, not all zero")
    return vector / length


def annular_sector(
    length: float, flare: float, spacing: float, shoulder_width: float
) -> tuple[int, int, FloatArray, FloatArray]:
    """Lay out a cape: rows, columns, its flat pattern (V, 2) and its neckline as worn (columns, 3) [m].

    Raises:
        ValueRangeError: the spacing is too wide for the cape.
    """
    curve = _neckline(shoulder_width)
    inner = SLACK * length_of(curve)
    rows = cells(length, spacing / WIDER_CELLS) + 1
    columns = cells(inner * (1.0 + flare) / 2.0, spacing * WIDER_CELLS) + 1
    if rows < 4 or columns < 8:
        raise ValueRangeError(f"a spacing of {spacing:g} m is too wide for a cape {length:.2f} m long")
    angle = inner * (flare - 1.0) / length
    radius = inner / angle
    theta, rho = np.meshgrid(
        np.linspace(-angle / 2.0, angle / 2.0, columns), np.linspace(radius, radius + length, rows)
    )
    pattern = np.stack([(rho * np.sin(theta)).ravel(), (rho * np.cos(theta) - radius).ravel()], axis=1)
    return rows, columns, pattern, _worn(curve, columns)


def spread_out(pattern: FloatArray) -> FloatArray:
    """Where a cape starts, in the wearer's frame [m], shape (V, 3): flat behind the back, where no limb is likely."""
    tilt = math.radians(25.0)
    back, up = -0.28, 0.12
    return np.stack(
        [back - pattern[:, 1] * math.cos(tilt), -pattern[:, 0], up - pattern[:, 1] * math.sin(tilt)], axis=1
    )


def frustum(
    waist: float, length: float, flare: float, spacing: float
) -> tuple[FloatArray, NDArray[np.int64], FloatArray, dict[str, NDArray[np.int64]]]:
    """Lay out a skirt: rings of as many vertices each, whose circumferences grow evenly from the waist to the hem.

    The rings are regular polygons of the given circumferences, so that between neighbours of two rings lie flat panels
    from waist to hem.

    Returns:
        Vertices around the Z axis, ring after ring from the waist at z = 0 down [m], shape (V, 3); triangles, outwards
        by the right-hand rule, shape (T, 3); the skirt folded flat along its front and back [m], shape (V, 2); and the
        regions "waist" and "hem".

    Raises:
        ValueRangeError: the spacing is too wide for the skirt, or the hem too wide for its length.
    """
    rings = cells(length, spacing) + 1
    around = cells(waist * (1.0 + flare) / 2.0, spacing)
    if rings < 3 or around < 8:
        raise ValueRangeError(f"a spacing of {spacing:g} m is too wide for a skirt of {waist:.2f} by {length:.2f} m")
    girths = waist * np.linspace(1.0, flare, rings)
    radii = girths / (2.0 * around * math.sin(math.pi / around))
    if abs(radii[-1] - radii[0]) >= length:
        widest = 1.0 + length / radii[0]
        raise ValueRangeError(
            f"a skirt {length:.2f} m long can't have a flare of {flare}: less than {widest:.2f} lies flat"
        )
    down = np.linspace(0.0, length, rings)
    heights = -down * math.sqrt(1.0 - ((radii[-1] - radii[0]) / length) ** 2)
    angles = 2.0 * math.pi * np.arange(around) / around
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    places = np.concatenate([radii[:, None, None] * circle, np.tile(heights[:, None, None], (1, around, 1))], axis=2)
    from_front = np.abs((2.0 * np.arange(around) / around + 1.0) % 2.0 - 1.0) - 0.5
    folded = np.stack([girths[:, None] / 2.0 * from_front, np.tile(down[:, None], (1, around))], axis=2)
    index = np.arange(rings * around).reshape(rings, around)
    regions = {"waist": index[0].copy(), "hem": index[-1].copy()}
    return places.reshape(-1, 3), _around(index), folded.reshape(-1, 2), regions


def _around(index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Two triangles in each cell of closed rings of vertices (rings, around)."""
    upper, lower = index[:-1], index[1:]
    next_upper, next_lower = np.roll(upper, -1, axis=1), np.roll(lower, -1, axis=1)
    return np.stack([upper, lower, next_lower, upper, next_lower, next_upper], axis=2).reshape(-1, 3)


def sewn_edges(pattern: FloatArray, rows: int, columns: int, layers: float) -> FloatArray:
    """Layers of fabric in each cell, on average over it: a hem at the sides and the end, a collar twice as thick.

    So a cape weighs the same at any spacing. `pattern` may also be a shape in space, of a cloth that does not lie flat.
    """
    points = pattern.reshape(rows, columns, -1)
    heights = np.linalg.norm(np.diff(points[:, 0], axis=0), axis=1)
    widths = np.linalg.norm(np.diff((points[:-1] + points[1:]) / 2.0, axis=1), axis=2)
    collar = _covered(heights, 2.0 * HEM)[:, None]
    end = _covered(heights[::-1], HEM)[::-1, None]
    sides = np.minimum(_covered(widths.T, HEM) + _covered(widths.T[::-1], HEM)[::-1], 1.0).T
    hem = 1.0 - (1.0 - end) * (1.0 - sides)
    return collar * 2.0 * layers + (1.0 - collar) * (1.0 + (layers - 1.0) * hem)


def _covered(sizes: FloatArray, width: float) -> FloatArray:
    """Share of each cell that a strip as wide covers [m], laid over cells of these sizes from the first on."""
    begins = np.cumsum(sizes, axis=0) - sizes
    return np.clip((width - begins) / sizes, 0.0, 1.0)


def grid_regions(rows: int, columns: int) -> dict[str, NDArray[np.int64]]:
    """Name the edges and, of the top row, the first and the last eighth and what lies between."""
    index = np.arange(rows * columns).reshape(rows, columns)
    end = _held_end(columns)
    return {
        "top": index[0].copy(),
        "bottom": index[-1].copy(),
        "left": index[:, 0].copy(),
        "right": index[:, -1].copy(),
        "top_left": index[0, :end].copy(),
        "top_middle": index[0, end : columns - end].copy(),
        "top_right": index[0, columns - end :].copy(),
    }


def _neckline(shoulder_width: float) -> FloatArray:
    """Trace a fine curve from the front of the left shoulder behind the neck to the right one, shape (n, 3) [m].

    An arc of 140 degrees of an ellipse, in the wearer's frame.
    """
    angle = np.radians(np.linspace(70.0, -70.0, 721))
    half_width, depth = 0.48 * shoulder_width, 0.3 * shoulder_width
    return np.stack(
        [-depth * np.cos(angle), half_width * np.sin(angle), np.full_like(angle, 0.16 * shoulder_width)], axis=1
    )


def _worn(curve: FloatArray, columns: int) -> FloatArray:
    """Where the top row is worn: both ends of the curve at the pattern's own spacing, the slack all in the middle."""
    pattern, curve_length = np.linspace(0.0, SLACK * length_of(curve), columns), length_of(curve)
    excess, end = pattern[-1] - curve_length, _held_end(columns)
    distances = pattern.copy()
    distances[columns - end :] -= excess
    distances[end : columns - end] = np.interp(
        pattern[end : columns - end], pattern[[end - 1, columns - end]], distances[[end - 1, columns - end]]
    )
    return along(curve, distances)


def _held_end(columns: int) -> int:
    """Number of vertices at either end of the top row that a shoulder holds: an eighth of it, to the nearest."""
    return max(2, round((columns - 1) / 8))


def hull(points: FloatArray) -> FloatArray:
    """Corners of the convex hull of points in a plane [m], shape (n, 2), against the clock.

    Raises:
        ValueRangeError: they lie on a line.
    """
    if np.linalg.matrix_rank(points - points[:1], tol=1e-6) < 2:
        raise ValueRangeError("there is no body for a garment to go around")
    from_the_left = points[np.lexsort((points[:, 1], points[:, 0]))].tolist()
    corners: list[list[float]] = []
    for way in (from_the_left, from_the_left[::-1]):  # below, and back above
        side: list[list[float]] = []
        for x, y in way:
            while len(side) > 1:
                (ax, ay), (bx, by) = side[-2:]
                if (bx - ax) * (y - ay) > (by - ay) * (x - ax):
                    break
                side.pop()
            side.append([x, y])
        corners += side[:-1]
    return np.array(corners)


def length_of(curve: FloatArray) -> float:
    """Length of a curve [m], shape (n, k)."""
    return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())


def along(curve: FloatArray, distances: FloatArray) -> FloatArray:
    """Points of a curve, shape (n, k), at given distances along it [m]."""
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    return np.stack([np.interp(distances, travelled, component) for component in curve.T], axis=1)


def evenly(curve: FloatArray, count: int) -> FloatArray:
    """So many points of a curve, shape (n, k), at even distances along it, its ends among them."""
    return along(curve, np.linspace(0.0, length_of(curve), count))
