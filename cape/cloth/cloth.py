"""A piece of cloth: vertices cut from a flat pattern, on a grid or any triangle mesh, and where it starts in space."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.cloth import tailoring
from cape.cloth.drawn.textures import Textures
from cape.cloth.drawn.visual import Visual
from cape.cloth.fabric import Fabric
from cape.cloth.patches.patchwork import Patchwork
from motions import quaternions
from motions.border import checked
from motions.errors import UnknownNameError, ValueRangeError
from motions.limits import LARGEST_NUMBER
from skeleton.shapes import UNIT_TOLERANCE

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

Frame = Literal["world", "wearer"]


@checked
@dataclass(frozen=True, eq=False, kw_only=True)
class Cloth(ABC):
    """Vertices with a flat pattern; made by `Cloth.rectangle`, `Cloth.cape`, `Cloth.skirt` or `Cloth.from_mesh`.

    Attributes:
        pattern: the flat pattern, u along the weft and v down along the warp [m], shape (V, 2).
        positions: where the vertices start [m], shape (V, 3), in `frame`.
        frame: "world", or "wearer": origin between the wearer's shoulder joints, x forward, y left, z up.
        neckline: where the first n vertices are worn, in the wearer's frame [m], shape (n, 3); None: where they start.
        fabric: what it is made of.
        layers: how many layers of the fabric each cell of a grid or each triangle of a mesh has; None for one.
        regions: names for sets of vertices, such as "top_left".
        visual: what is drawn in its place; None to draw what is simulated.
        textures: of what is drawn; None for those of its fabric.
    """

    pattern: FloatArray
    positions: FloatArray
    frame: Frame = "world"
    neckline: FloatArray | None = None
    fabric: Fabric = field(default_factory=Fabric)
    layers: FloatArray | None = None
    regions: Mapping[str, IntArray] = field(default_factory=dict)
    visual: Visual | None = None
    textures: Textures | None = None

    @staticmethod
    def rectangle(
        *,
        width: float = 1.0,
        height: float = 1.0,
        spacing: float = 0.03,
        fabric: Fabric | None = None,
        origin: ArrayLike = (0.0, 0.0, 0.0),
        right: ArrayLike = (0.0, -1.0, 0.0),
        down: ArrayLike = (0.0, 0.0, -1.0),
    ) -> "GridCloth":
        """Cut a rectangle whose top left corner is at `origin`, its edges along `right` and `down` (world, any length).

        `width`, `height` and `spacing` in metres; the spacing is rounded so that whole cells fill the rectangle.

        Raises:
            ValueRangeError: a size is not positive, the origin not finite, or the directions are parallel.
        """
        tailoring.require_positive(width=width, height=height, spacing=spacing)
        rows, columns = tailoring.cells(height, spacing) + 1, tailoring.cells(width, spacing) + 1
        u, v = np.meshgrid(np.linspace(0.0, width, columns), np.linspace(0.0, height, rows))
        across, along = tailoring.unit(right, "right"), tailoring.unit(down, "down")
        if np.linalg.norm(np.cross(across, along)) < 1e-6:
            raise ValueRangeError("the directions right and down of a rectangle must not be parallel")
        pattern = np.stack([u.ravel(), v.ravel()], axis=1)
        corner = np.asarray(origin, dtype=float)
        if corner.shape != (3,) or not (abs(corner) <= LARGEST_NUMBER).all():
            raise ValueRangeError(f"the origin of a rectangle must be three finite numbers, not {origin}")
        return GridCloth(
            rows=rows,
            columns=columns,
            pattern=pattern,
            positions=corner + pattern[:, :1] * across + pattern[:, 1:] * along,
            fabric=fabric or Fabric(),
            regions=tailoring.grid_regions(rows, columns),
        )

    @staticmethod
    def cape(
        *,
        length: float = 1.1,
        flare: float = 2.0,
        spacing: float = 0.024,
        shoulder_width: float = 0.36,
        hem_layers: float = 5.0,
        fabric: Fabric | None = None,
    ) -> "GridCloth":
        """Cut a cape: an annular sector whose inner edge lies around the back of the neck, from shoulder to shoulder.

        Args:
            length: from the neckline to the hem [m].
            flare: length of the hem divided by that of the neckline, more than 1.
            spacing: mean distance of neighbouring vertices [m].
            shoulder_width: distance of the wearer's shoulder joints [m], which the neckline's length follows.
            hem_layers: layers of fabric in the sewn edge, 2.4 cm wide; the collar, twice as wide, has twice as many: it
                holds the weight of a cape that hangs from its corners.
            fabric: what it is made of.

        It starts spread out flat behind the wearer, in the wearer's frame, and is put on before the first frame.

        Raises:
            ValueRangeError: a size is not positive, the flare is not above 1, or the spacing is too wide for the cape.
        """
        tailoring.require_positive(length=length, spacing=spacing, shoulder_width=shoulder_width)
        if not 1.0 < flare < 20.0:
            raise ValueRangeError(f"the flare of a cape must be above 1 and below 20, not {flare}")
        rows, columns, pattern, neckline = tailoring.annular_sector(length, flare, spacing, shoulder_width)
        return GridCloth(
            rows=rows,
            columns=columns,
            pattern=pattern,
            positions=tailoring.spread_out(pattern),
            frame="wearer",
            neckline=neckline,
            fabric=fabric or Fabric(),
            layers=tailoring.sewn_edges(pattern, rows, columns, hem_layers),
            regions=tailoring.grid_regions(rows, columns),
        )

    @staticmethod
    def skirt(
        *,
        waist: float = 1.2,
        length: float = 0.6,
        flare: float = 1.5,
        spacing: float = 0.04,
        fabric: Fabric | None = None,
    ) -> "MeshCloth":
        """Cut a skirt: a cone around the Z axis, closed, from its waist at z = 0 down, without tension as it starts.

        `moved` brings it to its wearer, `attach` by its region "waist" hangs it on a bone; "hem" is the other end.

        Args:
            waist: circumference of the waist [m]; it stays a circle, so it must clear the body where that is broadest.
            length: from the waist to the hem, along the cloth [m].
            flare: circumference of the hem divided by that of the waist; 1 for a tube.
            spacing: mean distance of neighbouring vertices [m].
            fabric: what it is made of.

        Raises:
            ValueRangeError: a size is not positive, the spacing is too wide for the skirt, or so wide a hem would not
                even lie flat.
        """
        tailoring.require_positive(waist=waist, length=length, flare=flare, spacing=spacing)
        places, triangles, folded, regions = tailoring.frustum(waist, length, flare, spacing)
        return replace(Cloth.from_mesh(places, triangles, fabric=fabric), pattern=folded, regions=regions)

    @staticmethod
    def from_mesh(
        positions: ArrayLike,
        triangles: ArrayLike,
        *,
        pattern: ArrayLike | None = None,
        fabric: Fabric | None = None,
        regions: Mapping[str, ArrayLike] | None = None,
    ) -> "MeshCloth":
        """Make a cloth of any triangle mesh.

        Args:
            positions: where the vertices start in the world [m], shape (V, 3).
            triangles: vertex indices, shape (T, 3).
            pattern: the flat pattern in which it has no tension, u along the weft and v along the warp [m], shape
                (V, 2); None for a cloth that has no tension where it starts, with warp threads as vertical as they go.
            fabric: what it is made of.
            regions: names for sets of vertices.

        Raises:
            ValueRangeError: a shape is wrong, a number is not finite, an index is outside, a triangle has no area, an
                edge belongs to more than two triangles, or a vertex to none.
        """
        from cape.cloth.triangle_mesh import check_mesh

        mesh = check_mesh(positions, triangles, pattern)
        cloth = MeshCloth(
            pattern=mesh.pattern,
            positions=mesh.positions,
            faces=mesh.triangles,
            corners=mesh.corners,
            fabric=fabric or Fabric(),
        )
        return replace(cloth, regions={name: cloth.region(np.asarray(r)) for name, r in (regions or {}).items()})

    @staticmethod
    def load(
        path: str | PathLike[str],
        *,
        up: str | None = None,
        scale: float = 1.0,
        spacing: float | None = None,
        visual: str | PathLike[str] | None = None,
        fabric: Fabric | None = None,
        textures: Textures | None = None,
    ) -> "MeshCloth":
        """Read a cloth from an OBJ, PLY or GLB file; `cape.read_cloth` tells the arguments, and what was cleaned.

        Raises:
            FileError: a file can't be read.
            ValueRangeError: the mesh is no cloth, for a reason that is told with its places.
            UnknownNameError: there is no such up axis.
        """
        from cape.meshes.reading import read_cloth

        read = read_cloth(
            path, up=up, scale=scale, spacing=spacing, visual=visual, fabric=fabric, textures=textures
        )  # fmt: skip
        return read[0]

    def __post_init__(self) -> None:
        """Make the arrays read-only; a ValueRangeError tells of what is none."""
        tailoring.arrays_in(self, "faces", "corners", "rest", "threads")
        for array in (*tailoring.arrays_in(self, "pattern", "positions", "neckline"), *self.regions.values()):
            array.flags.writeable = False

    def moved(self, position: ArrayLike, rotation_wxyz: ArrayLike = (1.0, 0.0, 0.0, 0.0)) -> Self:
        """The same cloth, started elsewhere: turned about the world's origin, then shifted.

        Given a bone's pose it brings a cloth that was laid out in the bone's frame to where the bone is.

        Args:
            position: the shift [m], shape (3,).
            rotation_wxyz: unit quaternion (w, x, y, z), shape (4,).

        Raises:
            ValueRangeError: a number is not finite, the quaternion is not of unit length, or the cloth starts in the
                wearer's frame, which places it.
        """
        if self.frame != "world":
            raise ValueRangeError("a cloth in the wearer's frame starts where the wearer is: it can't be moved")
        shift, turn = np.array(position, dtype=float), np.array(rotation_wxyz, dtype=float)
        if shift.shape != (3,) or not (abs(shift) <= LARGEST_NUMBER).all():
            raise ValueRangeError(f"position must be 3 finite numbers, not {position}")
        if turn.shape != (4,) or not abs(np.linalg.norm(turn) - 1.0) < UNIT_TOLERANCE:
            raise ValueRangeError(f"rotation_wxyz must be a quaternion of unit length, not {rotation_wxyz}")
        return replace(self, positions=shift + quaternions.rotate(turn, self.positions))

    @property
    def vertices(self) -> int:
        """Number of vertices."""
        return len(self.positions)

    @property
    @abstractmethod
    def triangles(self) -> NDArray[np.int32]:
        """Vertex indices of the T triangles, shape (T, 3)."""

    @property
    @abstractmethod
    def corners_at_rest(self) -> FloatArray:
        """Corners of each triangle where it has no tension [m], shape (T, 3, 2) or (T, 3, 3)."""

    @property
    @abstractmethod
    def lies_flat(self) -> bool:
        """Whether all of it lies flat at once without tension, as its pattern does."""

    @property
    @abstractmethod
    def has_threads(self) -> bool:
        """Whether it is known which of its edges lie along threads."""

    @property
    @abstractmethod
    def texcoords(self) -> NDArray[np.float32]:
        """Texture coordinates, 0 to 1 over the cloth, shape (V, 2)."""

    @abstractmethod
    def masses(self) -> FloatArray:
        """Mass of each vertex [kg], shape (V,): a third of its triangles' area in the pattern times the density."""

    def region(self, vertices: str | Sequence[int] | NDArray[np.integer]) -> IntArray:
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


@checked
@dataclass(frozen=True, eq=False, kw_only=True)
class GridCloth(Cloth):
    """A grid of rows x columns vertices, row after row from the top, the columns from the wearer's left to the right.

    Columns run down along the warp, rows across along the weft; of a cape the warp runs from the neckline to the hem.

    Attributes:
        rows: number of rows.
        columns: number of columns.
        darted: whether darts or gathers give it a shape that does not lie flat: it has no tension where it starts, and
            its pattern is a mere picture of it. Otherwise it has none as its pattern.
        gathers: for each cell the width of the cloth that is gathered into it, divided by its own, shape (rows - 1,
            columns - 1); None where nothing is gathered. Sewn down in its folds, that cloth has all of its weight and
            all of its warp threads, and is drawn across as a single layer is.
        seams: columns along which its panels are sewn together, as drawings show it.
    """

    rows: int
    columns: int
    darted: bool = False
    gathers: FloatArray | None = None
    seams: tuple[int, ...] = ()

    @property
    def has_threads(self) -> bool:
        """Whether it is known which of its edges lie along threads: its rows and columns do."""
        return True

    @property
    def places_at_rest(self) -> FloatArray:
        """Where the vertices are when nothing pulls at them [m], shape (V, 2) if they lie flat, otherwise (V, 3)."""
        return self.positions if self.darted else self.pattern

    @property
    def corners_at_rest(self) -> FloatArray:
        """Corners of each triangle where it has no tension [m], shape (T, 3, 2), (T, 3, 3) where it has darts."""
        return self.places_at_rest[self.triangles]

    @property
    def lies_flat(self) -> bool:
        """Whether all of it lies flat at once without tension, as its pattern does."""
        return not self.darted

    @property
    def cells(self) -> IntArray:
        """Vertex indices of the cells, row after row: left, right, right below, left below; shape (P, 4)."""
        corner = (np.arange(self.rows - 1)[:, None] * self.columns + np.arange(self.columns - 1)).ravel()
        return np.stack([corner, corner + 1, corner + self.columns + 1, corner + self.columns], axis=1)

    @property
    def cells_in_place(self) -> NDArray[np.bool_]:
        """Whether a cell starts from each vertex whose corners are this one and its neighbours, shape (V,)."""
        starts = np.zeros((self.rows, self.columns), bool)
        starts[:-1, :-1] = True
        return starts.ravel()

    @property
    def triangles(self) -> NDArray[np.int32]:
        """Vertex indices, two triangles a cell, shape (2 (rows - 1) (columns - 1), 3)."""
        corner, right, across, down = self.cells.T
        faces = np.concatenate([np.stack([corner, down, right], axis=1), np.stack([across, right, down], axis=1)])
        return faces.astype(np.int32)

    @property
    def texcoords(self) -> NDArray[np.float32]:
        """Texture coordinates, 0 to 1 along rows and down, shape (V, 2)."""
        u, v = np.meshgrid(np.linspace(0.0, 1.0, self.columns), np.linspace(0.0, 1.0, self.rows))
        return np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float32)

    def masses(self) -> FloatArray:
        """Mass of each vertex [kg], shape (V,): a third of its triangles' area in the pattern times the density."""
        sheets = np.ones((self.rows - 1, self.columns - 1))
        for thicker in (self.layers, self.gathers):
            sheets *= 1.0 if thicker is None else thicker
        weights = areas(self.corners_at_rest) * np.tile(sheets.ravel(), 2) * self.fabric.density
        return _thirds(self.triangles, weights, self.vertices)


@checked
@dataclass(frozen=True, eq=False, kw_only=True)
class MeshCloth(Cloth):
    """Any triangle mesh, whose threads lie along the axes of each triangle's corners: the weft first, then the warp.

    Attributes:
        faces: vertex indices of the triangles, shape (T, 3).
        corners: of each triangle where it has no tension, laid flat: along the weft and the warp [m], shape (T, 3, 2).
        rest: where its vertices are without tension, where it doesn't lie flat [m], (V, 3); None for where they start.
        threads: edges that lie along its threads, on which its stretch is measured, the lower vertex first, shape
            (n, 2); None for all edges, those on the bias with them, which get longer where the cloth is sheared.
        patchwork: its fabrics, `fabric` among them, where pieces are of different ones; None where all is of `fabric`.
    """

    faces: IntArray
    corners: FloatArray
    rest: FloatArray | None = None
    threads: IntArray | None = None
    patchwork: Patchwork | None = None

    @property
    def has_threads(self) -> bool:
        """Whether it is known which of its edges lie along threads."""
        return self.threads is not None

    @property
    def corners_at_rest(self) -> FloatArray:
        """Corners of each triangle where it has no tension [m], shape (T, 3, 2)."""
        return self.corners

    @property
    def lies_flat(self) -> bool:
        """Whether all of it lies flat at once without tension, as its pattern does."""
        return np.array_equal(self.corners, self.pattern[self.faces])

    @property
    def triangles(self) -> NDArray[np.int32]:
        """Vertex indices of the T triangles, shape (T, 3)."""
        return self.faces.astype(np.int32)

    @property
    def texcoords(self) -> NDArray[np.float32]:
        """The pattern, scaled to fit 0 to 1, shape (V, 2)."""
        low = self.pattern.min(axis=0)
        return ((self.pattern - low) / (self.pattern - low).max()).astype(np.float32)

    def masses(self) -> FloatArray:
        """Mass of each vertex [kg], shape (V,): a third of its triangles' area without tension times the density."""
        layers = np.ones(1) if self.layers is None else self.layers
        patches = self.patchwork
        density = self.fabric.density if patches is None else patches.of_triangles(lambda fabric: fabric.density)
        return _thirds(self.faces, areas(self.corners) * layers * density, self.vertices)


def areas(corners: FloatArray) -> FloatArray:
    """Areas of triangles with corners (T, 3, 2) or (T, 3, 3) [m], shape (T,) [m2]."""
    p, q = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    if corners.shape[2] == 3:
        return np.linalg.norm(np.cross(p, q), axis=1) / 2.0
    return np.abs(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]) / 2.0


def _thirds(triangles: NDArray[np.integer], masses: FloatArray, vertices: int) -> FloatArray:
    """Give each corner a third of its triangle's mass [kg]."""
    return np.bincount(triangles.ravel(), weights=np.repeat(masses / 3.0, 3), minlength=vertices).astype(float)
