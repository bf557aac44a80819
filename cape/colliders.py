"""Shapes that cloth can't enter. A capsule is `skeleton.Capsule`; the other shapes are defined here."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skeleton.capsules import Capsule

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Sphere:
    """All points within `radius` of a centre.

    Attributes:
        name: unique name.
        bone: name of the bone that carries it, None for one that stands still in the world.
        center: in the bone's frame [m], shape (3,).
        radius: [m].
        friction: Coulomb coefficient against cloth, None for the scene's default.
    """

    name: str = "sphere"
    bone: str | None = None
    center: FloatArray = field(default_factory=lambda: np.zeros(3))
    radius: float = 0.5
    friction: float | None = None


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
    """

    name: str = "box"
    bone: str | None = None
    center: FloatArray = field(default_factory=lambda: np.zeros(3))
    half_sizes: FloatArray = field(default_factory=lambda: np.full(3, 0.5))
    rotation_wxyz: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    friction: float | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Plane:
    """The half-space behind a plane.

    Attributes:
        name: unique name.
        bone: name of the bone that carries it, None for one that stands still in the world.
        point: a point of the plane in the bone's frame [m], shape (3,).
        normal: unit normal, out of the solid, in the bone's frame, shape (3,).
        friction: Coulomb coefficient against cloth, None for the scene's default.
    """

    name: str = "plane"
    bone: str | None = None
    point: FloatArray = field(default_factory=lambda: np.zeros(3))
    normal: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    friction: float | None = None


Collider = Capsule | Sphere | Box | Plane
