"""What holds a cloth: vertices that move with a bone, or with several, or slide along a curve that a bone carries."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.cloth.cloth import Cloth
from motions.border import checked, checked_first
from motions.errors import ValueRangeError
from motions.limits import LARGEST_NUMBER

FloatArray = NDArray[np.float64]
Bones = str | Sequence[str] | Mapping[str, ArrayLike]


STIFFEST = 1e12  # N/m or N s/m, far beyond any step


@checked_first
@dataclass(frozen=True, eq=False)
class Attachment:
    """Vertices that a bone carries along, or several bones.

    Several hold a vertex at the weighted mean of where each would carry it, had it carried the vertex alone from where
    it was put on: linear blend skinning (Magnenat-Thalmann, Laperrière and Thalmann 1988, "Joint-dependent local
    deformations for hand animation and object grasping"). Between bones that turn by an angle a against each other it
    draws points nearer to their joint, halfway to cos(a / 2) of the distance: 3 % at 30 degrees, as between neck and
    chest. Dual quaternions (Kavan et al. 2007) would not; but they jump where such an angle passes 180 degrees, and a
    point's velocity, which implicit solvers need, would no longer be the mean of its velocities on the bones.

    Attributes:
        bone: name of the bone, or the role it plays, such as "left_shoulder"; of several the first.
        vertices: indices of the n vertices, shape (n,).
        points: where the bone holds them, in its frame [m], shape (n, 3); None for where they are when the cloth is
            put on: on the neckline for the top row of a cape, otherwise where they start. Several bones hold them
            where the first does as the cloth is put on.
        within: keep only those of the vertices that are within this distance of the bone's origin when the cloth is
            put on [m]; None for all.
        others: the other bones that hold the vertices, by name or role.
        weights: of all k bones, the first one's in front, shape (n, k), each row 1 in sum; None for one bone.
        stiffness: of a spring of no length between each vertex and where it would be held [N/m], shape (n,); None where
            it is held right there.
        damping: against the velocity of that place [N s/m], shape (n,); None for that which is critical for the vertex
            alone, 2 (k m)^1/2.
        cloth_vertices: how many vertices the cloth has that these belong to; None for any.
        along: points of a curve in the bone's frame [m], shape (m, 3), that the vertices slide along, like rings on a
            rail: free along it, as far as its ends, held across. It goes through the points, round where it bends by
            less than 30 degrees at one, with a corner where by more; closed if its last point is its first. None to
            hold them at a place.
    """

    bone: str
    vertices: NDArray[np.int64]
    points: FloatArray | None = None
    within: float | None = None
    others: tuple[str, ...] = field(default=(), kw_only=True)
    weights: FloatArray | None = field(default=None, kw_only=True)
    stiffness: FloatArray | None = field(default=None, kw_only=True)
    damping: FloatArray | None = field(default=None, kw_only=True)
    cloth_vertices: int | None = field(default=None, kw_only=True)
    along: FloatArray | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Copy the arrays and check them.

        Raises:
            ValueRangeError: a shape is another, or a value is out of range.
        """
        n, k = np.size(self.vertices), len(self.bones)
        far, stiff = LARGEST_NUMBER, STIFFEST
        for name, shape, least, most in (
            ("vertices", (n,), 0, 2**31),
            ("points", (n, 3), -far, far),
            ("weights", (n, k), 0.0, far),
            ("stiffness", (n,), 0.0, stiff),
            ("damping", (n,), 0.0, stiff),
        ):
            if (given := getattr(self, name)) is not None:
                array = np.array(given, dtype=np.int64 if name == "vertices" else float)
                if array.shape != shape or not ((array >= least) & (array <= most)).all():
                    raise ValueRangeError(f"what {self.bone!r} holds needs {name} in range and of shape {shape}")
                object.__setattr__(self, name, array)
        if self.within is not None and not self.within > 0.0:
            raise ValueRangeError(f"what {self.bone!r} holds must be within a positive distance, not {self.within}")

    @property
    def bones(self) -> tuple[str, ...]:
        """All the bones, by name or role."""
        return (self.bone, *self.others)

    @property
    def soft(self) -> bool:
        """Whether springs hold the vertices, which stay free."""
        return self.stiffness is not None

    @property
    def sliding(self) -> bool:
        """Whether the vertices slide along a curve."""
        return self.along is not None

    @property
    def hard(self) -> bool:
        """Whether the vertices are right where bones carry them."""
        return not self.soft and not self.sliding

    def of(self, values: FloatArray, vertices: NDArray[np.int64]) -> FloatArray:
        """Those rows of values (n, ...) that belong to some of the vertices, in the same order."""
        return values[np.isin(self.vertices, vertices)]


@checked
def attach(
    cloth: Cloth,
    bone: Bones,
    vertices: str | Sequence[int] | NDArray[np.integer] | None = None,
    *,
    points: ArrayLike | None = None,
    within: float | None = None,
    weights: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
    along: ArrayLike | None = None,
) -> Attachment:
    """Attach vertices of a cloth to a bone, or to several.

    Args:
        cloth: whose vertices.
        bone: a bone's name, or a role such as "left_shoulder"; which bones there are is known once a track is given.
            For several k of them their weights by name, each a number or an array (n,), or their names alone.
        vertices: a named region of the cloth, indices, or None for all vertices `within` a distance.
        points: where in the bone's frame, the first one's of several, to hold them [m], shape (n, 3), or None for where
            they are when put on.
        within: distance from the bone's origin, the first one's, [m] beyond which vertices are left out.
        weights: of bones that are given by their names alone, shape (n, k) or (k,); None for equal ones. Weights are
            scaled to a sum of 1.
        stiffness: of springs that hold the vertices softly [N/m], one or for each (n,); None to hold them hard.
        damping: of those springs [N s/m], one or for each (n,); None for critical damping of the vertex alone.
        along: points of a curve in the bone's frame [m], shape (m, 3), that the vertices slide along; None to hold them
            at a place. Vertices that are put on beside it come to it, at 3 m/s at most.

    Raises:
        UnknownNameError: the cloth has no such region.
        ValueRangeError: an index is outside of the cloth, points and vertices differ in number, nothing is selected, or
            weights are negative, all zero for some vertex, or not as many as bones and vertices; a stiffness is not
            positive, or a damping negative or without stiffness; a curve has fewer than two points or two alike in a
            row, or is given together with points, springs or several bones.
    """
    names, given = _bones_and_weights(bone, weights)
    label = " and ".join(repr(name) for name in names)
    if vertices is None and within is None:
        raise ValueRangeError(f"attach to {label}: name the vertices, or give a distance with within=")
    if within is not None and not within > 0.0:
        raise ValueRangeError(f"attach to {label}: the distance must be positive, not {within}")
    chosen = np.arange(cloth.vertices) if vertices is None else cloth.region(vertices)
    held = None if points is None else np.array(points, dtype=float)
    if held is not None and held.shape == (3,):
        held = held[None]
    if held is not None and (within is not None or held.shape != (len(chosen), 3) or not np.isfinite(held).all()):
        raise ValueRangeError(
            f"attach to {label}: points must be finite, one for each of the {len(chosen)} vertices, without within="
        )
    shares = None if given is None else _shares(given, len(chosen), label)
    if damping is not None and stiffness is None:
        raise ValueRangeError(f"attach to {label}: damping belongs to a stiffness; what is held hard has none")
    if along is not None and (shares is not None or stiffness is not None or points is not None):
        raise ValueRangeError(
            f"attach to {label}: vertices slide along a curve of one bone, without springs and without points"
        )
    return Attachment(
        names[0], chosen, held, within, others=names[1:], weights=shares,
        stiffness=_each(stiffness, "stiffness", len(chosen), label),
        damping=_each(damping, "damping", len(chosen), label),
        cloth_vertices=cloth.vertices,
        along=None if along is None else _curve(along, label),
    )  # fmt: skip


def _curve(given: ArrayLike, label: str) -> FloatArray:
    """Points of a curve, shape (m, 3).

    Raises:
        ValueRangeError: they are fewer than two, not finite, or two in a row are the same.
    """
    points = np.array(given, dtype=float)
    if points.ndim != 2 or points.shape[1:] != (3,) or len(points) < 2 or not np.isfinite(points).all():
        raise ValueRangeError(f"attach to {label}: along must be two finite points or more, shape (m, 3)")
    if not np.diff(points, axis=0).any(axis=1).all():
        raise ValueRangeError(f"attach to {label}: two points in a row of along are the same")
    return points


def _each(given: ArrayLike | None, what: str, count: int, label: str) -> FloatArray | None:
    """A value for each of so many vertices, shape (count,); None for None.

    Raises:
        ValueRangeError: they are neither one nor `count`, not finite, negative, or a stiffness of zero.
    """
    if given is None:
        return None
    values = np.asarray(given, dtype=float)
    if values.shape not in ((), (count,)) or not np.isfinite(values).all():
        raise ValueRangeError(f"attach to {label}: {what} must be finite, one or one for each of the {count} vertices")
    if (values < 0.0).any() or (what == "stiffness" and not (values > 0.0).all()):
        least = "positive" if what == "stiffness" else "zero or more"
        raise ValueRangeError(f"attach to {label}: {what} must be {least}, not {values.min()}")
    return np.broadcast_to(values, count).copy()


def _bones_and_weights(bone: Bones, weights: ArrayLike | None) -> tuple[tuple[str, ...], list[ArrayLike] | None]:
    """Names of bones, and the weights of each as they were given; None for a single bone.

    Raises:
        ValueRangeError: there is no bone, or one twice, or weights are given twice or do not fit.
    """
    if isinstance(bone, str):
        return (bone,), None
    columns: list[ArrayLike] = []
    if isinstance(bone, Mapping):
        if weights is not None:
            raise ValueRangeError("attach: give the weights by bone, or with weights=, not both")
        names = tuple(bone)
        columns += bone.values()
    else:
        names = tuple(bone)
        rows = np.ones(len(names)) if weights is None else np.asarray(weights, dtype=float)
        if rows.shape[-1:] != (len(names),):
            raise ValueRangeError(f"attach: weights must be of shape (n, {len(names)}), one for each of {names}")
        columns += [rows[..., k] for k in range(len(names))]
    if not names or len(set(names)) != len(names):
        raise ValueRangeError(f"attach: bones must be one or more, each named once, not {names}")
    return names, None if len(names) == 1 else columns


def _shares(given: list[ArrayLike], count: int, label: str) -> FloatArray:
    """Weights of bones for so many vertices, each row 1 in sum, shape (count, k).

    Raises:
        ValueRangeError: they are negative, all zero for some vertex, or neither one nor `count` of them.
    """
    columns = [np.asarray(column, dtype=float) for column in given]
    if any(column.shape not in ((), (count,)) for column in columns):
        raise ValueRangeError(f"attach to {label}: weights must be one, or one for each of the {count} vertices")
    shares = np.stack([np.broadcast_to(column, count) for column in columns], axis=1)
    total = shares.sum(axis=1, keepdims=True)
    if not np.isfinite(shares).all() or (shares < 0.0).any() or not (total > 0.0).all():
        raise ValueRangeError(f"attach to {label}: weights must be finite, not negative, and not all zero for a vertex")
    return shares / total
