"""Which link is the mirror image of another, and solids reflected from one to the other."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from motions.errors import UserError
from skeleton.model import Skeleton
from skeleton.robot.links import Link, in_neutral_pose
from skeleton.shapes import Capsule, TaperedCapsule

FloatArray = NDArray[np.float64]

_TOLERANCE = 0.001  # [m] that outlines and centres of mirrored links may be apart: a mesh's finish, not its shape
_AREA_TOLERANCE = 0.02  # of the area, in which faces inside of a link count, too
_OF_SKINS = 15.0  # times as much where weights part a mesh among bones, which are seldom alike on both sides
_DIRECTIONS = np.array([np.array(d) / np.linalg.norm(d) for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])


@dataclass(frozen=True, eq=False)
class _Outline:
    """How far a link reaches in each of 26 directions [m], its centre [m] and its area [m^2], in the neutral pose."""

    reaches: FloatArray
    center: FloatArray
    area: float

    def fits(self, other: "_Outline", slack: float) -> bool:
        return (
            bool(np.abs(self.reaches - other.reaches).max() < slack * _TOLERANCE)
            and bool(np.abs(self.center - other.center).max() < slack * _TOLERANCE)
            and abs(self.area - other.area) < slack * _AREA_TOLERANCE * self.area
        )


@dataclass(frozen=True, eq=False)
class Mirror:
    """The plane between the left and the right half of a body in its neutral pose.

    Attributes:
        body: the robot.
        middle: a point of the plane [m], shape (3,).
        left: unit vector square to it, shape (3,).
    """

    body: Skeleton
    middle: FloatArray
    left: FloatArray
    _outlines: dict[str, tuple[_Outline, _Outline]] = field(default_factory=dict)

    @staticmethod
    def of(body: Skeleton) -> "Mirror | None":
        """The plane of a body, None where its limbs aren't known."""
        try:
            return Mirror(body, body.rest.middle("thigh"), body.rest.left)
        except UserError:
            return None

    def original(self, link: Link, others: Iterable[Link]) -> Link | None:
        """The one of the other links whose reflection this link is, to within a millimetre of its outline.

        Of a mesh that bones move to within 15 mm.
        """
        own, _ = self._outlines_of(link)
        slack = 1.0 if self.body.skin is None else _OF_SKINS
        return next((other for other in others if own.fits(self._outlines_of(other)[1], slack)), None)

    def onto(self, link: Link, solid: Capsule | TaperedCapsule, original: Link) -> Capsule | TaperedCapsule:
        """A solid in the frame of the original's bone, reflected into the frame of the link's bone."""
        ends = in_neutral_pose(self.body, original.bone, np.stack([solid.start, solid.end]))
        ends = self._reflect(ends - self.middle) + self.middle
        if link.bone is not None:
            index = self.body.bones.index(link.bone)
            ends = np.stack([self.body.rest.into_bone(index, end) for end in ends])
        return replace(solid, bone=link.bone, start=ends[0], end=ends[1])

    def _reflect(self, vectors: FloatArray) -> FloatArray:
        return vectors - 2.0 * (vectors @ self.left)[:, None] * self.left

    def _outlines_of(self, link: Link) -> tuple[_Outline, _Outline]:
        """The link's outline and that of its reflection, seen from a point of the plane."""
        if link.name not in self._outlines:
            seen = in_neutral_pose(self.body, link.bone, link.points) - self.middle
            self._outlines[link.name] = (_outline(seen, link.areas), _outline(self._reflect(seen), link.areas))
        return self._outlines[link.name]


def _outline(points: FloatArray, areas: FloatArray) -> _Outline:
    area = float(areas.sum())
    return _Outline((points @ _DIRECTIONS.T).max(axis=0), areas @ points / area, area)
