"""Solids in the frame of a bone: a file for each shape, found through one base and one registry."""

from skeleton.shapes.base import UNIT_TOLERANCE, Bounded, FloatArray, Layout, Shape
from skeleton.shapes.box import Box
from skeleton.shapes.capsule import Capsule
from skeleton.shapes.cylinder import Cylinder
from skeleton.shapes.ellipsoid import Ellipsoid
from skeleton.shapes.plane import Plane
from skeleton.shapes.registry import SHAPES, require_known, shape_named, word_of
from skeleton.shapes.sphere import Sphere
from skeleton.shapes.tapered_capsule import TaperedCapsule

__all__ = [
    "SHAPES",
    "UNIT_TOLERANCE",
    "Bounded",
    "Box",
    "Capsule",
    "Cylinder",
    "Ellipsoid",
    "FloatArray",
    "Layout",
    "Plane",
    "Shape",
    "Sphere",
    "TaperedCapsule",
    "balls_of",
    "require_known",
    "shape_named",
    "word_of",
]


def balls_of(solid: Bounded) -> tuple[FloatArray, FloatArray]:
    """Balls whose convex hull holds a solid, and is one that is the hull of balls, such as a capsule or a box.

    Centres in its bone's frame [m], shape (n, 3), and radii [m], shape (n,).
    """
    return solid.balls()
