"""What all solids share, and what the rest of the project asks of each of them."""

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.border import checked
from motions.errors import ValueRangeError
from motions.limits import LARGEST_NUMBER
from skeleton.shapes.outlines import Outline

if TYPE_CHECKING:
    from skeleton.shapes.capsule import Capsule

FloatArray = NDArray[np.float64]

UNIT_TOLERANCE = 1e-6  # of a quaternion's length: beyond single precision's rounding it is a mistake
TINY = 1e-12
"""[m] from where a normal has no direction, such as an axis: what is nearer counts as being on it."""


@dataclass(frozen=True)
class Layout:
    """A shape as the contact of cloth sees it.

    Attributes:
        origin: of the shape's own frame in that of its bone [m], shape (3,).
        rotation: shape_to_bone, shape (3, 3).
        sizes: what `Shape.nearest` takes after the point, at most four; those that are left out are 0.
        core: how far a point on the surface may go at once without passing the shape's middle [m].
        curvature: smallest radius of curvature of the surface [m], 0 where it has an edge.
    """

    origin: FloatArray
    rotation: FloatArray
    sizes: tuple[float, ...]
    core: float
    curvature: float


@checked
@dataclass(frozen=True, eq=False, kw_only=True)
class Shape(ABC):
    """A solid in the frame of a bone. Every solid is convex.

    A shape is a frozen dataclass that derives from this class or, where it ends somewhere, from `Bounded`, in a file of
    its own with a line in `skeleton.shapes.registry`. Nothing else lists shapes but the kinds of records of
    `cape.contact`.

    Attributes:
        name: unique name.
        bone: name of the bone that carries it, None for one that stands still in the world.
        friction: Coulomb coefficient against cloth, None for the scene's default.
        thickness: distance from the surface at which cloth is stopped [m], None for the scene's default.

    Raises:
        ValueRangeError: a value is out of range.
    """

    name: str = "solid"
    bone: str | None = None
    friction: float | None = None
    thickness: float | None = None

    numbers: ClassVar[Mapping[str, int]]
    """The fields that a shape has besides the common ones, as text forms hold them: for each the length of its list, 0
    for a single number."""

    optional: ClassVar[tuple[str, ...]] = ()
    """Those of `numbers` that a text form may leave out."""

    nearest: ClassVar[Callable[..., tuple[float, float, float, float]]]
    """Signed distance of a point from the surface, and the unit normal there, for the solvers.

    `nearest(x, y, z, e, f, g, h)` gives (distance, normal x, y, z): the distance [m], negative inside, and the
    direction in which it grows. Point [m] and normal are in the shape's own frame; e to h are its layout's `sizes`.
    It is a plain function of numbers that Numba can compile as it stands: of `math`, `min`, `max` and `abs` alone, it
    never raises, and as far as it can it has no branches but choices of a value, so that loops over points vectorise.
    """

    def __post_init__(self) -> None:
        """Copy, check and freeze the arrays, and check what all shapes have."""
        for label, text in (("name", self.name), ("bone", "" if self.bone is None else self.bone)):
            self._require(isinstance(text, str), f"the {label} must be a text", text)
        for label, size in self.numbers.items():
            if size:
                array = np.array(getattr(self, label), dtype=float)
                good = array.shape == (size,) and bool((abs(array) <= LARGEST_NUMBER).all())
                self._require(good, f"{label} must be {size} finite numbers", array)
                array.setflags(write=False)
                object.__setattr__(self, label, array)
        for label in ("friction", "thickness"):
            value = getattr(self, label)
            self._require(value is None or 0.0 <= value <= LARGEST_NUMBER, f"{label} must be zero or more", value)
        self._check()
        for label in (label for label, size in self.numbers.items() if not size):
            value = getattr(self, label)
            self._require(abs(value) <= LARGEST_NUMBER, f"{label.replace('_', ' ')} must be finite", value)

    plain: ClassVar[tuple[str, ...]] = ("nearest",)
    """Functions that are compiled as they stand."""

    @abstractmethod
    def _check(self) -> None:
        """Check what is the shape's own, by `_require`."""

    def _require(self, holds: bool | np.bool_, text: str, value: object) -> None:
        if not holds:
            raise ValueRangeError(f"{self.kind()} {self.name!r}: {text}, not {value}")

    @classmethod
    def kind(cls) -> str:
        """What such a shape is called in a sentence, such as "tapered capsule"."""
        return re.sub(r"(?<!^)(?=[A-Z])", " ", cls.__name__).lower()

    @abstractmethod
    def describe(self) -> str:
        """Kind and size in a few words, such as "sphere of 50 mm"."""

    @abstractmethod
    def layout(self) -> Layout:
        """The shape's own frame and its sizes there, for `nearest`."""

    @abstractmethod
    def distances(self, points: FloatArray) -> FloatArray:
        """Distances of points (N, 3) in the bone's frame from the surface [m], negative inside, shape (N,).

        For measuring: it shares nothing with `nearest`, by which the solvers go.
        """

    @abstractmethod
    def volume(self) -> float:
        """Volume [m^3], infinite for a half-space."""

    @abstractmethod
    def grown(self, thickness: float) -> Self:
        """The same with its surface so much further out [m]; sharp edges stay sharp."""

    @abstractmethod
    def core(self, share: float) -> Self | None:
        """What lies deepest inside, within a `share` of the inner radius around the middle; None for a half-space."""

    @abstractmethod
    def outline(self) -> Outline:
        """The surface as a recording draws it, in the bone's frame."""

    @abstractmethod
    def collision_geometry(self) -> tuple[Any, FloatArray, FloatArray]:
        """Coal's geometry, its unit quaternion geometry_to_bone (w, x, y, z), and its place in the bone's frame [m]."""

    def as_capsule(self) -> "Capsule | None":
        """The capsule that comes nearest to a limb of this shape; None for what is no limb, as a box."""
        return None


@dataclass(frozen=True, eq=False, kw_only=True)
class Bounded(Shape):
    """A solid that ends somewhere."""

    @abstractmethod
    def balls(self) -> tuple[FloatArray, FloatArray]:
        """Balls whose convex hull holds the solid: centres in the bone's frame [m], (n, 3), and radii [m], (n,)."""

    @abstractmethod
    def support(self, directions: FloatArray) -> FloatArray:
        """How far the solid extends along unit vectors (N, 3) in the bone's frame, from its origin [m], shape (N,)."""

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest corner of the box around it that is upright in the bone's frame [m], each (3,)."""
        return -self.support(-np.eye(3)), self.support(np.eye(3))

    def ball(self) -> tuple[FloatArray, float]:
        """A ball that holds it: its centre in the bone's frame [m], shape (3,), and its radius [m]."""
        centers, radii = self.balls()
        middle = 0.5 * (centers.min(axis=0) + centers.max(axis=0))
        return middle, float((lengths(centers - middle) + radii).max())

    def lowest(self, positions: FloatArray, rotations_wxyz: FloatArray) -> FloatArray:
        """Height of the lowest point with the bone at positions (F, 3) [m] and bone_to_world (F, 4) [m], shape (F,)."""
        down = quaternions.rotate(quaternions.conjugate(rotations_wxyz), np.array([0.0, 0.0, -1.0]))
        return positions[:, 2] - self.support(down)


def lengths(vectors: FloatArray) -> FloatArray:
    """Lengths of vectors (N, 3), shape (N,)."""
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))


def along(direction: FloatArray) -> tuple[FloatArray, float]:
    """A rotation that turns +Z along a direction, shape (3, 3), and the direction's length."""
    return quaternions.to_matrix(quaternions.from_z_axis(direction)), float(np.linalg.norm(direction))


def upright() -> FloatArray:
    """The unit quaternion that turns nothing, as a default of a field."""
    return np.array([1.0, 0.0, 0.0, 0.0])
