"""What a garment is: a way to cut cloth to a body, and to hold it there."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.cloth import tailoring
from cape.cloth.cloth import Cloth
from cape.cloth.fabric import Fabric
from cape.garments.fitting import Fitted


@dataclass(frozen=True, kw_only=True)
class Measures:
    """What may be asked of any garment; None for the garment's own.

    Attributes:
        length: from where it is held to the hem [m].
        flare: length of the hem divided by that around the neckline, or around the shoulders where it lies on them.
        spacing: mean distance of neighbouring vertices [m].
        fabric: what it is made of.
        room: length [m] that a garment's own does not exceed.
    """

    length: float | None = None
    flare: float | None = None
    spacing: float | None = None
    fabric: Fabric | None = None
    room: float | None = None

    def length_of(self, own: float) -> float:
        """Length [m] as asked, or a garment's own as far as there is room."""
        if self.length is not None:
            return self.length
        return own if self.room is None else min(own, self.room)

    def sizes(self, height: float, *, length: float, flare: float, spacing: float) -> tuple[float, float, float]:
        """Length [m], flare and spacing [m] as asked, or a garment's own; lengths of these are shares of a height [m].

        Raises:
            ValueRangeError: one is not positive.
        """
        length = self.length_of(length * height)
        flare = flare if self.flare is None else self.flare
        spacing = spacing * height if self.spacing is None else self.spacing
        tailoring.require_positive(length=length, flare=flare, spacing=spacing)
        return length, flare, spacing


class Hold(NamedTuple):
    """A bone, by its role, that holds a region of a garment: at points in its frame [m] (n, 3), None for where it is
    put on; by springs of a stiffness [N/m] each, None for hard; half together with another bone, by its name, if any.
    """

    bone: str
    region: str
    points: NDArray[np.float64] | None = None
    stiffness: float | None = None
    half: str | None = None


class Kept(NamedTuple):
    """A bone, by its role, and vertices (n,) that get no farther than `most` [m], (n,), from where it carries them."""

    bone: str
    vertices: NDArray[np.int64]
    most: NDArray[np.float64]


class Worn(NamedTuple):
    """A garment cut for a body.

    Its cloth, what holds it, the body as it stands where it is put on, None for as the motion begins; whether it falls
    in folds whose layers meet, the distance at which colliders stop it [m], None for that of any scene, and what is
    kept near its place.
    """

    cloth: Cloth
    holds: tuple[Hold, ...]
    put_on: Fitted | None = None
    layered: bool = False
    thickness: float | None = None
    kept: tuple[Kept, ...] = ()


@dataclass(frozen=True)
class Garment:
    """A kind of garment.

    Attributes:
        name: as it is asked for.
        title: what it is, in a line.
        fit: cuts it for a body.
        under_arms: arms hang over it, and not it over them.
    """

    name: str
    title: str
    fit: Callable[[Fitted, Measures], Worn]
    under_arms: bool = False
