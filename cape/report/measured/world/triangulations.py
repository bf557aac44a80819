"""Strips and rings of cloth on triangulations that have nothing in common but the spacing of their vertices."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Square cells split all one way, or in turns; equilateral triangles; cells whose corners are moved at random.
KINDS = ("one-way", "alternating", "equilateral", "random")
RINGS = "rings"  # vertices on concentric circles
DISC_KINDS = (*KINDS, RINGS)
MOVED = 0.3  # of a cell, that corners of "random" are moved at most along either axis
NEAREST = 0.45  # of the spacing, between a vertex inside and a line that has vertices of its own
TIE = 1e-3  # of the squared spacing, by which vertices are lifted to tell how square cells are split


class Piece(NamedTuple):
    """A flat piece.

    `points` (V, 2) [m], `triangles` (T, 3), and `border`, how many of the points, from the first on, lie on its lines.
    """

    points: FloatArray
    triangles: IntArray
    border: int


def strip(kind: str, length: float, width: float, spacing: float) -> Piece:
    """A rectangle from (0, 0) to (length, width) [m], with vertices on its edges and on the line across its middle."""
    steps = np.array([math.sqrt(0.75) * spacing if kind == "equilateral" else spacing, spacing])
    size = np.array([length, width])
    cells = np.maximum(1, np.rint(size / steps / [2.0, 1.0])).astype(int) * [2, 1]
    x, y = (np.linspace(0.0, extent, count + 1) for extent, count in zip(size, cells, strict=True))
    across = [np.column_stack([np.full_like(y, place), y]) for place in (0.0, length / 2.0, length)]
    inner = np.delete(x, [0, cells[0] // 2, cells[0]])
    along = [np.column_stack([inner, np.full_like(inner, place)]) for place in (0.0, width)]
    border = np.concatenate([*across, *along])

    def far(p: FloatArray) -> NDArray[np.bool_]:
        sides = np.minimum(np.minimum(p[:, 0], length - p[:, 0]), np.abs(p[:, 0] - length / 2.0)) / steps[0]
        edges = np.minimum(p[:, 1], width - p[:, 1]) / steps[1]
        return np.minimum(sides, edges) > NEAREST

    inside = _lattice(kind, x, y)
    points = np.concatenate([border, inside[far(inside)]])
    return Piece(points, _triangles(kind, points, size / cells), len(border))


def ring(kind: str, inner: float, outer: float, spacing: float) -> Piece:
    """What lies between two circles around the origin [m], clamped up to the inner one.

    The first circles of vertices lie half a spacing inside and outside of the inner one: a cloth that is held at both
    is level there, and bends from between them on.
    """
    held = (inner - spacing / 2.0, inner + spacing / 2.0)
    border = np.concatenate([_circle(radius, spacing) for radius in (*held, outer)])
    if kind == RINGS:
        between = np.linspace(held[1], outer, round((outer - held[1]) / spacing) + 1)[1:-1]
        inside = np.concatenate([_circle(radius, spacing, turned=k % 2 == 0) for k, radius in enumerate(between)])
    else:
        reach = spacing * math.ceil(outer / spacing)
        steps = spacing * np.array([math.sqrt(0.75) if kind == "equilateral" else 1.0, 1.0])
        x, y = (step * np.arange(-math.ceil(reach / step), math.ceil(reach / step) + 1) for step in steps)
        lattice = _lattice(kind, x, y)
        radius = np.hypot(*lattice.T)
        near = (1.0 + NEAREST) / 2.0 * spacing  # circles and lattices do not follow each other
        inside = lattice[(radius > held[1] + near) & (radius < outer - near)]
    points = np.concatenate([border, inside])
    triangles = _triangles(kind, points, np.array([spacing, spacing]))
    hole = (np.hypot(*points[triangles].transpose(2, 0, 1)) < inner).all(axis=1)
    return Piece(points, triangles[~hole], len(border))


def held_by_ring(piece: Piece, inner: float, spacing: float) -> IntArray:
    """The vertices of a `ring` on both circles about the inner one."""
    return np.flatnonzero(np.hypot(*piece.points.T) < inner + 0.51 * spacing)


def _circle(radius: float, spacing: float, *, turned: bool = False) -> FloatArray:
    count = round(2.0 * math.pi * radius / spacing)
    angle = 2.0 * math.pi * (np.arange(count) + 0.5 * turned) / count
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _lattice(kind: str, x: FloatArray, y: FloatArray) -> FloatArray:
    """Corners of cells at the coordinates `x` and `y`, where the kind wants them, shape (V, 2)."""
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=2)
    steps = np.array([x[1] - x[0], y[1] - y[0]])
    if kind == "equilateral":
        points[1::2, :, 1] += steps[1] / 2.0
    if kind == "random":
        points += MOVED * steps * np.random.default_rng(1).uniform(-1.0, 1.0, points.shape)
    return points.reshape(-1, 2)


def _triangles(kind: str, points: FloatArray, steps: FloatArray) -> IntArray:
    """Triangles of the points, counterclockwise: Delaunay's, with ties on square cells told by the kind.

    They are the lower side of the convex hull of the points lifted to a paraboloid (Edelsbrunner and Seidel 1986);
    lifting two corners of a square a little further splits it along the other two.
    """
    from scipy.spatial import ConvexHull

    lifts: dict[str, Callable[[FloatArray], FloatArray]] = {
        "one-way": lambda q: -q[:, 0] * q[:, 1],
        "alternating": lambda q: np.cos(math.pi * q[:, 0]) * np.cos(math.pi * q[:, 1]),
    }
    heights = np.sum(points**2, axis=1)
    if kind in lifts:
        heights = heights + TIE * np.prod(steps) * lifts[kind](points / steps)
    hull = ConvexHull(np.column_stack([points, heights]))
    faces = hull.simplices[hull.equations[:, 2] < 0.0].astype(np.int64)
    p, q = points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
    doubled = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    faces[doubled < 0.0] = faces[doubled < 0.0][:, ::-1]
    # Points on a line of the border leave triangles without area along it.
    return faces[np.abs(doubled) > 1e-3 * np.prod(steps)]
