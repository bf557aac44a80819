"""A piece of cloth: a grid of vertices cut from a flat pattern, and where it starts in space."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.fabric import Fabric
from motions.errors import UnknownNameError, ValueRangeError

FloatArray = NDArray[np.float64]
# Cells are a little wider than high on average, so that they are not much narrower at the neckline, where the
# narrowest ones set the largest stable step.
WIDER_CELLS = 1.12
MOST_CELLS = 4000  # along one side; 16 million vertices are more than any machine steps
SLACK = 1.1  # length of the neckline over that of the way it is worn: room for the shoulders to move

Frame = Literal["world", "wearer"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Cloth:
    """A grid of rows x columns vertices, row after row from the top, the columns from the wearer's left to the right.

    Attributes:
        rows: number of rows.
        columns: number of columns.
        pattern: the flat pattern, u along the rows and v down [m], shape (V, 2).
        positions: where the vertices start [m], shape (V, 3), in `frame`.
        frame: "world", or "wearer": origin between the wearer's shoulder joints, x forward, y left, z up.
        neckline: where the top row is worn, in the wearer's frame [m], shape (columns, 3); None: where it starts.
        fabric: what it is made of.
        layers: how many layers of the fabric each cell has, shape (rows - 1, columns - 1); None for one everywhere.
        regions: names for sets of vertices, such as "top_left".
    """

    rows: int
    columns: int
    pattern: FloatArray
    positions: FloatArray
    frame: Frame = "world"
    neckline: FloatArray | None = None
    fabric: Fabric = field(default_factory=Fabric)
    layers: FloatArray | None = None
    regions: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)

    @classmethod
    def rectangle(
        cls,
        *,
        width: float = 1.0,
        height: float = 1.0,
        spacing: float = 0.03,
        fabric: Fabric | None = None,
        origin: ArrayLike = (0.0, 0.0, 0.0),
        right: ArrayLike = (0.0, -1.0, 0.0),
        down: ArrayLike = (0.0, 0.0, -1.0),
    ) -> "Cloth":
        """Cut a rectangle whose top left corner is at `origin`, its edges along `right` and `down` (world, any length).

        `width`, `height` and `spacing` in metres; the spacing is rounded so that whole cells fill the rectangle.

        Raises:
            ValueRangeError: a size is not positive, or the directions are parallel.
        """
        _require_positive(width=width, height=height, spacing=spacing)
        rows, columns = _cells(height, spacing) + 1, _cells(width, spacing) + 1
        u, v = np.meshgrid(np.linspace(0.0, width, columns), np.linspace(0.0, height, rows))
        across, along = _unit(right, "right"), _unit(down, "down")
        if np.linalg.norm(np.cross(across, along)) < 1e-6:
            raise ValueRangeError("the directions right and down of a rectangle must not be parallel")
        pattern = np.stack([u.ravel(), v.ravel()], axis=1)
        positions = np.asarray(origin, dtype=float) + pattern[:, :1] * across + pattern[:, 1:] * along
        return cls(
            rows=rows,
            columns=columns,
            pattern=pattern,
            positions=positions,
            fabric=fabric or Fabric(),
            regions=_grid_regions(rows, columns),
        )

    @classmethod
    def cape(
        cls,
        *,
        length: float = 1.1,
        flare: float = 2.0,
        spacing: float = 0.024,
        shoulder_width: float = 0.36,
        hem_layers: float = 5.0,
        fabric: Fabric | None = None,
    ) -> "Cloth":
        """Cut a cape: an annular sector whose inner edge lies around the back of the neck, from shoulder to shoulder.

        Args:
            length: from the neckline to the hem [m].
            flare: length of the hem divided by that of the neckline, more than 1.
            spacing: mean distance of neighbouring vertices [m].
            shoulder_width: distance of the wearer's shoulder joints [m], which the neckline's length follows.
            hem_layers: layers of fabric in the sewn edge, one cell wide; the collar, two cells wide, has twice as many:
                it holds the weight of a cape that hangs from its corners.
            fabric: what it is made of.

        It starts spread out flat behind the wearer, in the wearer's frame, and is put on before the first frame.

        Raises:
            ValueRangeError: a size is not positive, the flare is not above 1, or the spacing is too wide for the cape.
        """
        _require_positive(length=length, spacing=spacing, shoulder_width=shoulder_width)
        if not 1.0 < flare < 20.0:
            raise ValueRangeError(f"the flare of a cape must be above 1 and below 20, not {flare}")
        neckline = _neckline(shoulder_width)
        inner = SLACK * _length(neckline)
        rows = _cells(length, spacing / WIDER_CELLS) + 1
        columns = _cells(inner * (1.0 + flare) / 2.0, spacing * WIDER_CELLS) + 1
        if rows < 4 or columns < 8:
            raise ValueRangeError(f"a spacing of {spacing:g} m is too wide for a cape {length:.2f} m long")
        angle = inner * (flare - 1.0) / length
        radius = inner / angle
        theta, rho = np.meshgrid(
            np.linspace(-angle / 2.0, angle / 2.0, columns), np.linspace(radius, radius + length, rows)
        )
        pattern = np.stack([(rho * np.sin(theta)).ravel(), (rho * np.cos(theta) - radius).ravel()], axis=1)
        # Spread out behind the back and falling away from it: no limb is likely to be there.
        tilt = math.radians(25.0)
        back, up = -0.28, 0.12
        positions = np.stack(
            [back - pattern[:, 1] * math.cos(tilt), -pattern[:, 0], up - pattern[:, 1] * math.sin(tilt)], axis=1
        )
        return cls(
            rows=rows,
            columns=columns,
            pattern=pattern,
            positions=positions,
            frame="wearer",
            neckline=_worn(neckline, columns),
            fabric=fabric or Fabric(),
            layers=_sewn_edges(rows, columns, hem_layers),
            regions=_grid_regions(rows, columns),
        )

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for array in (self.pattern, self.positions, self.neckline, *self.regions.values()):
            if array is not None:
                array.flags.writeable = False

    @property
    def vertices(self) -> int:
        """Number of vertices."""
        return self.rows * self.columns

    @property
    def triangles(self) -> NDArray[np.int32]:
        """Vertex indices, two triangles a cell, shape (2 (rows - 1) (columns - 1), 3)."""
        corner = (np.arange(self.rows - 1)[:, None] * self.columns + np.arange(self.columns - 1)).ravel()
        right, down, across = corner + 1, corner + self.columns, corner + self.columns + 1
        faces = np.concatenate([np.stack([corner, down, right], axis=1), np.stack([across, right, down], axis=1)])
        return faces.astype(np.int32)

    @property
    def texcoords(self) -> NDArray[np.float32]:
        """Texture coordinates, 0 to 1 along rows and down, shape (V, 2)."""
        u, v = np.meshgrid(np.linspace(0.0, 1.0, self.columns), np.linspace(0.0, 1.0, self.rows))
        return np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float32)

    def masses(self) -> FloatArray:
        """Mass of each vertex [kg], shape (V,): a third of its triangles' area in the pattern times the density."""
        faces = self.triangles
        a, b, c = (self.pattern[faces[:, k]] for k in range(3))
        doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        layers = np.ones(1) if self.layers is None else np.tile(self.layers.ravel(), 2)
        third = np.abs(doubled) * self.fabric.density * layers / 6.0
        shares = np.bincount(faces.ravel(), weights=np.repeat(third, 3), minlength=self.vertices)
        return shares.astype(float)

    def region(self, vertices: str | Sequence[int] | NDArray[np.integer]) -> NDArray[np.int64]:
        """Resolve a region's name or check indices, which come back as given.

        Raises:
            UnknownNameError: there is no such region.
            ValueRangeError: an index is outside of the cloth or no whole number, or there is none.
        """
        if isinstance(vertices, str):
            if vertices not in self.regions:
                raise UnknownNameError("cloth region", vertices, self.regions)
            return self.regions[vertices]
        given = np.asarray(vertices)
        if given.size == 0:
            raise ValueRangeError("no vertices given")
        if given.dtype.kind not in "iu":
            raise ValueRangeError(f"vertices are given by a region's name or by whole numbers, not by {given.dtype}")
        indices = given.astype(np.int64).ravel()
        if (outside := (indices < 0) | (indices >= self.vertices)).any():
            raise ValueRangeError(f"vertex {indices[outside][0]} is outside of a cloth of {self.vertices} vertices")
        return indices


def _require_positive(**sizes: float) -> None:
    for name, value in sizes.items():
        if not 0.0 < value < math.inf:
            raise ValueRangeError(f"{name.replace('_', ' ')} must be positive and finite, not {value}")


def _cells(size: float, spacing: float) -> int:
    cells = max(1, round(min(size / spacing, 1e9)))
    if cells > MOST_CELLS:
        raise ValueRangeError(
            f"a spacing of {spacing:g} m is too fine for {size:.2f} m: at most {MOST_CELLS} cells a side"
        )
    return cells


def _unit(direction: ArrayLike, name: str) -> FloatArray:
    vector = np.asarray(direction, dtype=float)
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not 0.0 < length < math.inf:
        raise ValueRangeError(f"{name} must be three finite numbers, not all zero")
    return vector / length


def _grid_regions(rows: int, columns: int) -> dict[str, NDArray[np.int64]]:
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


def _sewn_edges(rows: int, columns: int, layers: float) -> FloatArray:
    cells = np.ones((rows - 1, columns - 1))
    cells[-1] = cells[:, 0] = cells[:, -1] = layers
    cells[:2] = 2.0 * layers
    return cells


def _worn(curve: FloatArray, columns: int) -> FloatArray:
    """Where the top row is worn: both ends of the curve at the pattern's own spacing, the slack all in the middle."""
    pattern, curve_length = np.linspace(0.0, SLACK * _length(curve), columns), _length(curve)
    excess, end = pattern[-1] - curve_length, _held_end(columns)
    distances = pattern.copy()
    distances[columns - end :] -= excess
    distances[end : columns - end] = np.interp(
        pattern[end : columns - end], pattern[[end - 1, columns - end]], distances[[end - 1, columns - end]]
    )
    return _along(curve, distances)


def _held_end(columns: int) -> int:
    """Number of vertices at either end of the top row that a shoulder holds."""
    return max(2, columns // 8)


def _length(curve: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())


def _along(curve: FloatArray, distances: FloatArray) -> FloatArray:
    """Points of a curve at given distances along it."""
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    return np.stack([np.interp(distances, travelled, curve[:, k]) for k in range(3)], axis=1)
