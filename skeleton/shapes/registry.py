"""All shapes there are: a line for each, with the word that text forms use for it."""

from collections.abc import Iterable

from motions.errors import UnknownNameError
from skeleton.shapes.base import Shape
from skeleton.shapes.box import Box
from skeleton.shapes.capsule import Capsule
from skeleton.shapes.cylinder import Cylinder
from skeleton.shapes.ellipsoid import Ellipsoid
from skeleton.shapes.plane import Plane
from skeleton.shapes.sphere import Sphere
from skeleton.shapes.tapered_capsule import TaperedCapsule

SHAPES: dict[str, type[Shape]] = {
    "capsule": Capsule,
    "tapered_capsule": TaperedCapsule,
    "sphere": Sphere,
    "box": Box,
    "plane": Plane,
    "cylinder": Cylinder,
    "ellipsoid": Ellipsoid,
}
"""The classes by their words."""


def shape_named(word: str) -> type[Shape]:
    """The class of shapes that a word means.

    Raises:
        UnknownNameError: there is none; lists those that there are.
    """
    if word not in SHAPES:
        raise UnknownNameError("shape", word, SHAPES)
    return SHAPES[word]


def word_of(solid: object) -> str:
    """The word for a solid's class.

    Raises:
        UnknownNameError: it is of no class in `SHAPES`; lists the words of those that are.
    """
    for word, shape in SHAPES.items():
        if type(solid) is shape:
            return word
    raise UnknownNameError("shape", type(solid).__name__, SHAPES)


def require_known(solids: Iterable[object]) -> None:
    """Check that all solids are of classes in `SHAPES`.

    Raises:
        UnknownNameError: one isn't.
    """
    for solid in solids:
        word_of(solid)
