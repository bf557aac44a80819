"""How far a cloth may get from where bones would carry it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.cloth.cloth import Cloth
from cape.scene.holding.attachments import Attachment, Bones, attach
from motions.border import checked
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]
Map = ArrayLike | Callable[[FloatArray], ArrayLike]


@checked
@dataclass(frozen=True, eq=False, kw_only=True)
class Confinement:
    """Vertices that stay near their animated positions, or on their outer side: what engines paint onto a cloth.

    The animated position of a vertex is where bones would carry it from where the cloth was put on, by linear blend
    skinning (see `Attachment`); its normal there points to the side from which the cloth's triangles are seen counter
    clockwise, which is a cape's outer side. Unity's Cloth and Unreal's clothing paint know the two as *max distance*,
    the radius of a sphere around the animated position that the vertex stays in, and as *backstop* (Unity: surface
    penetration), a sphere behind it that the vertex stays out of. Colliders, and bones that hold the vertex, have the
    last word.

    Each map is a number, one for each of the n vertices (n,), or a function that gives them for their distances along
    the cloth from the nearest vertex that an attachment holds [m], shape (n,); infinite where it does not bind.

    Attributes:
        animated: the vertices, and what bones carry them with what weights.
        max_distance: from the animated position at most [m]; None for no such bound.
        backstop: how far behind the animated position, against its normal, the sphere begins [m]; None for no sphere.
        backstop_radius: of the sphere [m].
    """

    animated: Attachment
    max_distance: Map | None = None
    backstop: Map | None = None
    backstop_radius: float = 1.0

    @property
    def needs_holds(self) -> bool:
        """Whether a map goes by the distance from what is held."""
        return callable(self.max_distance) or callable(self.backstop)

    def values(self, given: Map | None, distances: FloatArray) -> FloatArray:
        """A map's values for the vertices, whose distances from what is held are given [m], shape (n,) each.

        Raises:
            ValueRangeError: they are neither one nor n, or a value is negative or not a number.
        """
        if given is None:
            return np.full(distances.shape, np.inf)
        found = np.asarray(given(distances) if callable(given) else given, dtype=float)
        if found.shape not in ((), distances.shape) or np.isnan(found).any() or (found < 0.0).any():
            bones, count = " and ".join(map(repr, self.animated.bones)), len(distances)
            raise ValueRangeError(
                f"confine to {bones}: a map must be zero or more, one value or one for each of the {count} vertices"
            )
        return np.broadcast_to(found, distances.shape).copy()


@checked
def confine(
    cloth: Cloth,
    bone: Bones,
    vertices: str | Sequence[int] | NDArray[np.integer] | None = None,
    *,
    weights: ArrayLike | None = None,
    max_distance: Map | None = None,
    backstop: Map | None = None,
    backstop_radius: float = 1.0,
) -> Confinement:
    """Keep vertices of a cloth near where a bone, or several, would carry them, or on the outer side of that.

    Args:
        cloth: whose vertices.
        bone: a bone's name or role, or several with weights, as for `attach`.
        vertices: a named region of the cloth, indices, or None for all.
        weights: of bones that are given by their names alone, as for `attach`.
        max_distance: how far a vertex may get from there [m]: a number, one for each vertex (n,), or a function of the
            distance along the cloth from what is held [m]; infinite for as far as it likes.
        backstop: how far behind it the sphere begins that a vertex stays out of [m], in the same ways.
        backstop_radius: of that sphere [m].

    Raises:
        UnknownNameError: the cloth has no such region.
        ValueRangeError: an index is outside of the cloth, neither bound is given, or a value is out of range.
    """
    if max_distance is None and backstop is None:
        raise ValueRangeError("confine: give a max_distance, a backstop, or both")
    if not 0.0 < backstop_radius < np.inf:
        raise ValueRangeError(f"confine: the backstop_radius must be positive and finite, not {backstop_radius}")
    chosen = np.arange(cloth.vertices) if vertices is None else cloth.region(vertices)
    found = Confinement(
        animated=attach(cloth, bone, chosen, weights=weights),
        max_distance=max_distance,
        backstop=backstop,
        backstop_radius=float(backstop_radius),
    )
    # Maps that are given as numbers can be told wrong here; functions, once it is known what is held.
    for given in (max_distance, backstop):
        if not callable(given):
            found.values(given, np.zeros(len(chosen)))
    return found
