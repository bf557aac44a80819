"""Solids in the frame of a bone: capsules, tapered capsules, spheres, boxes, half-spaces."""

import math
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]

UNIT_TOLERANCE = 1e-6  # of a quaternion's length: beyond single precision's rounding it is a mistake


@dataclass(frozen=True, eq=False)
class Capsule:
    """All points within `radius` of a segment that moves with a bone.

    Attributes:
        name: unique name, the role where the bone plays one, otherwise the bone's own.
        bone: name of the bone that carries it, None for one that stands still in the world.
        start: one end of the segment in the bone's frame [m], shape (3,).
        end: the other end in the bone's frame [m], shape (3,).
        radius: [m].
        friction: Coulomb coefficient against cloth, None for the scene's default.
        thickness: distance from the surface at which cloth is stopped [m], None for the scene's default.
    """

    name: str
    bone: str | None
    start: NDArray[np.float64]
    end: NDArray[np.float64]
    radius: float
    friction: float | None = None
    thickness: float | None = None

    def __post_init__(self):
        """Copy, check and freeze the ends."""
        for label in ("start", "end"):
            point = np.array(getattr(self, label), dtype=float)
            if point.shape != (3,) or not np.isfinite(point).all():
                raise ValueRangeError(f"{label} of the capsule {self.name!r} must be three finite numbers, got {point}")
            point.setflags(write=False)
            object.__setattr__(self, label, point)
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise ValueRangeError(f"the radius of the capsule {self.name!r} must be positive, got {self.radius}")


@dataclass(frozen=True, eq=False, kw_only=True)
class Sphere:
    """All points within `radius` of a centre.

    Attributes:
        name: unique name.
        bone: name of the bone that carries it, None for one that stands still in the world.
        center: in the bone's frame [m], shape (3,).
        radius: [m].
        friction: Coulomb coefficient against cloth, None for the scene's default.
        thickness: distance from the surface at which cloth is stopped [m], None for the scene's default.

    Raises:
        ValueRangeError: a value is out of range.
    """

    name: str = "sphere"
    bone: str | None = None
    center: FloatArray = field(default_factory=lambda: np.zeros(3))
    radius: float = 0.5
    friction: float | None = None
    thickness: float | None = None

    def __post_init__(self) -> None:
        """Copy, check and freeze the centre."""
        _freeze(self, center=3)
        _require(self, 0.0 < self.radius < math.inf, "the radius must be positive", self.radius)


@dataclass(frozen=True, eq=False, kw_only=True)
class TaperedCapsule:
    """The convex hull of two spheres: a capsule that is thicker at one end.

    Where one sphere holds the other, the shape is the larger sphere.

    Attributes:
        name: unique name.
        bone: name of the bone that carries it, None for one that stands still in the world.
        start: centre of the first sphere in the bone's frame [m], shape (3,).
        end: centre of the second sphere in the bone's frame [m], shape (3,).
        start_radius: of the first sphere [m].
        end_radius: of the second sphere [m].
        friction: Coulomb coefficient against cloth, None for the scene's default.
        thickness: distance from the surface at which cloth is stopped [m], None for the scene's default.

    Raises:
        ValueRangeError: a value is out of range.
    """

    name: str = "tapered capsule"
    bone: str | None = None
    start: FloatArray = field(default_factory=lambda: np.zeros(3))
    end: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    start_radius: float = 0.2
    end_radius: float = 0.1
    friction: float | None = None
    thickness: float | None = None

    def __post_init__(self) -> None:
        """Copy, check and freeze the ends."""
        _freeze(self, start=3, end=3)
        for label in ("start_radius", "end_radius"):
            radius = getattr(self, label)
            _require(self, 0.0 < radius < math.inf, f"{label} must be positive", radius)


@dataclass(frozen=True, eq=False, kw_only=True)
class Box:
    """A solid cuboid.

    Attributes:
        name: unique name.
        bone: name of the bone that carries it, None for one that stands still in the world.
        center: in the bone's frame [m], shape (3,).
        half_sizes: half the edge lengths [m], shape (3,).
        rotation_wxyz: unit quaternion (w, x, y, z) box_to_bone, shape (4,).
        friction: Coulomb coefficient against cloth, None for the scene's default.
        thickness: distance from the surface at which cloth is stopped [m], None for the scene's default.

    Raises:
        ValueRangeError: a value is out of range.
    """

    name: str = "box"
    bone: str | None = None
    center: FloatArray = field(default_factory=lambda: np.zeros(3))
    half_sizes: FloatArray = field(default_factory=lambda: np.full(3, 0.5))
    rotation_wxyz: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    friction: float | None = None
    thickness: float | None = None

    def __post_init__(self) -> None:
        """Copy, check and freeze the arrays."""
        _freeze(self, center=3, half_sizes=3, rotation_wxyz=4)
        _require(self, (self.half_sizes > 0.0).all(), "half_sizes must be positive", self.half_sizes)
        unit = abs(np.linalg.norm(self.rotation_wxyz) - 1.0) < UNIT_TOLERANCE
        _require(self, unit, "rotation_wxyz must be of unit length", self.rotation_wxyz)


@dataclass(frozen=True, eq=False, kw_only=True)
class Plane:
    """The half-space behind a plane.

    Attributes:
        name: unique name.
        bone: name of the bone that carries it, None for one that stands still in the world.
        point: a point of the plane in the bone's frame [m], shape (3,).
        normal: out of the solid, in the bone's frame, of any length, shape (3,).
        friction: Coulomb coefficient against cloth, None for the scene's default.
        thickness: distance from the surface at which cloth is stopped [m], None for the scene's default.

    Raises:
        ValueRangeError: a value is out of range.
    """

    name: str = "plane"
    bone: str | None = None
    point: FloatArray = field(default_factory=lambda: np.zeros(3))
    normal: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    friction: float | None = None
    thickness: float | None = None

    def __post_init__(self) -> None:
        """Copy, check and freeze the arrays."""
        _freeze(self, point=3, normal=3)
        _require(self, np.linalg.norm(self.normal) > 0.0, "the normal must not be zero", self.normal)


Bounded = Capsule | TaperedCapsule | Sphere | Box
"""Any of the solids that end somewhere."""

Shape = Bounded | Plane
"""Any of the solids."""


def balls_of(solid: Bounded) -> tuple[FloatArray, FloatArray]:
    """Balls whose convex hull a solid is: centres in its bone's frame [m], shape (n, 3), and radii [m], shape (n,)."""
    if isinstance(solid, Capsule):
        return np.stack([solid.start, solid.end]), np.full(2, solid.radius)
    if isinstance(solid, TaperedCapsule):
        return np.stack([solid.start, solid.end]), np.array([solid.start_radius, solid.end_radius])
    if isinstance(solid, Sphere):
        return solid.center[None], np.array([solid.radius])
    corners = np.array(list(product((-1.0, 1.0), repeat=3))) * solid.half_sizes
    return solid.center + quaternions.rotate(solid.rotation_wxyz, corners), np.zeros(8)


_Checked = Sphere | TaperedCapsule | Box | Plane


def _freeze(shape: _Checked, **sizes: int) -> None:
    """Replace arrays by read-only copies of the given sizes, and check what all shapes have."""
    for label, size in sizes.items():
        array = np.array(getattr(shape, label), dtype=float)
        _require(
            shape, array.shape == (size,) and np.isfinite(array).all(), f"{label} must be {size} finite numbers", array
        )
        array.setflags(write=False)
        object.__setattr__(shape, label, array)
    for label in ("friction", "thickness"):
        value = getattr(shape, label)
        _require(shape, value is None or 0.0 <= value < math.inf, f"{label} must be zero or more", value)


def _require(shape: _Checked, holds: bool | np.bool_, text: str, value: object) -> None:
    if not holds:
        kind = "tapered capsule" if isinstance(shape, TaperedCapsule) else type(shape).__name__.lower()
        raise ValueRangeError(f"{kind} {shape.name!r}: {text}, not {value}")
