"""A body that a garment is fitted to: its surface in the wearer's frame, arms lowered, and where a collar lies."""

from collections.abc import Callable, Sequence
from functools import cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.errors import ValueRangeError
from skeleton.rest import RestPose, missing_roles
from skeleton.shapes import Bounded, Shape
from skeleton.solid_measures import signed_distance
from skeleton.straight_limbs import AWAY, lower_arms, straighten_legs

if TYPE_CHECKING:
    from skeleton.model import Skeleton

FloatArray = NDArray[np.float64]

FINE = 0.002  # m between heights and widths that are tried
STRIDE = 6  # of these widths, at first: what is clear is so over more
NEAR = 0.0002  # m from the way out of a body, at which it is found
HIGHEST, LOWEST = 0.09, -0.04  # of the body's height above the shoulder joints: where a collar may lie
TALLEST = 0.16  # the same on a trunk that goes on above the shoulders, as a robot's
STEEPER = (0.0, 0.1, 0.2, 0.3)  # per way ahead: by how much more a collar may fall than one across the neck
WIDEST = 0.12  # of the body's height: radius of a collar, at most
NARROWEST = 0.03  # the same, at least
BROADEST = 0.35  # the same of a ring around the shoulders, at most
SIDES = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])  # ahead, behind, left, right
UPPER_ARM = 0.15  # of the body's height: how far below the shoulder joints such a ring must be clear
COLLARED = 0.049  # of the body's height above the shoulder joints: where a collar lies, lower in front than behind
AROUND = 96  # directions in which a collar is fitted
RAISED = np.radians(75.0)  # arms from the direction down the trunk, where a garment is put on under them
CLEARANCE = 0.0015  # m between a garment as it is cut and what stops it
LIMB = 0.02  # of the body's height: radius of the thinnest limb that cloth hangs on, the forearm
COARSEST = 0.06  # of the body's height: spacing at most
STRAINED = 1.05  # length of a thread over that at rest, at most
LEAST = 0.005  # m that colliders stop cloth at in any case: of thick cloth half of its own thickness
WIDER = 1.3  # width of a cell over the mean spacing


class Ring(NamedTuple):
    """A ring around the neck: its radius and its height beside the neck above the shoulder joints [m], and how much
    higher it is per way back."""

    radius: float
    height: float
    steepness: float

    def rises(self, angles: FloatArray) -> FloatArray:
        """How much higher than beside the neck it is at angles from the middle of the back [m], shape (n,)."""
        return self.steepness * self.radius * np.cos(angles)


class Fitted:
    """A body in the wearer's frame: origin between its shoulder joints, x forward, y left, z up.

    Attributes:
        height: of the body [m].
        shoulder_width: distance of its shoulder joints [m].
    """

    def __init__(
        self, body: "Skeleton", colliders: Sequence[Shape], *, arms: float = AWAY, standing: bool = False
    ) -> None:
        """Measure the body; its surface is looked at when a garment needs it.

        Args:
            body: whom.
            colliders: its surface.
            arms: angle of the arms from the direction down the trunk [rad].
            standing: whether its legs are straight, or as they are in its typical pose.

        Raises:
            UnknownNameError: the body lacks a leg's or an arm's role.
        """
        self.height, self.shoulder_width = body.height(), body.shoulder_width()
        self._body, self._colliders, self._arms, self._standing = body, colliders, arms, standing
        self._solids = [(c, c.bone) for c in colliders if c.bone is not None]

    def with_raised_arms(self) -> "Fitted":
        """The same body as it stands where a garment is put on under its arms."""
        return self.with_arms(RAISED)

    def with_arms(self, angle: float) -> "Fitted":
        """The same body standing with straight legs, its arms at an angle from the direction down the trunk [rad]."""
        return Fitted(self._body, self._colliders, arms=angle, standing=True)

    def segments(self, *roles: str) -> list[tuple[FloatArray, FloatArray]]:
        """The straight pieces between the joints of a limb's roles, those there are: both ends of each [m]."""
        known = [role for role in roles if role in self._rest.roles]
        joints = [(self._rest.joint(role) - self._origin) @ self._axes for role in known]
        return list(pairwise(joints))

    @cached_property
    def _rest(self) -> RestPose:
        rest = lower_arms(self._body.rest, self._arms)
        return straighten_legs(rest) if self._standing else rest

    @cached_property
    def _axes(self) -> FloatArray:
        return np.stack([self._rest.forward, self._rest.left, self._rest.up], axis=1)

    @cached_property
    def _origin(self) -> FloatArray:
        return self._rest.middle("upper_arm")

    def bone(self, bone: str) -> int:
        """Index of a bone given by its name or its role; a name wins over a role."""
        return self._rest.bones.index(bone) if bone in self._rest.bones else self._rest.bone(bone)

    @cached_property
    def neck(self) -> FloatArray:
        """Where the neck is as high as a collar lies, as seen from above: x and y [m], shape (2,)."""
        return self.neck_at(np.array(COLLARED * self.height))

    def neck_at(self, heights: FloatArray) -> FloatArray:
        """Where the middle of the neck is at heights above the shoulder joints [m], shape (...): x and y [m], (..., 2).

        Below its lower joint, which is often between the shoulder blades, it is as there.
        """
        start, end, slope = self._neck_line
        return start[:2] + (np.clip(heights, start[2], max(end[2], start[2])) - start[2])[..., None] * slope

    @property
    def neck_bone(self) -> str | None:
        """The bone that carries the neck, the longest up to the head's; None for a body that has no neck of its own."""
        rest = self._rest
        if not {"neck", "head"} <= set(rest.roles):
            return None
        way = rest.chain(rest.bone("neck"), rest.bone("head"))
        if len(way) < 2:
            return None
        return rest.bones[way[int(np.argmax(np.linalg.norm(np.diff(rest.positions[way], axis=0), axis=1)))]]

    @cached_property
    def _neck_line(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The lower and the upper end of the neck's middle line [m], (3,), and its ways ahead and left per way up."""
        if "neck" not in self._rest.roles:
            return np.zeros(3), np.zeros(3), np.zeros(2)
        start, end = ((self._rest.origin(role) - self._origin) @ self._axes for role in ("neck", "head"))
        way = end - start
        slope = way[:2] / max(way[2], float(np.linalg.norm(way[:2])), NEAR)
        # Joints tell where the neck is, but not where on it they are.
        collared = np.clip(COLLARED * self.height, start[2], max(end[2], start[2]))
        inside = np.append(start[:2] + (collared - start[2]) * slope, collared)
        ways = self.way_out(inside, SIDES, 0.0, only=("neck",), without=("head",))
        aside = (ways @ SIDES) / 2.0
        return start + aside, end + aside, slope

    @property
    def has_feet(self) -> bool:
        """Whether it is known where its feet are."""
        return not missing_roles(self._rest, ("left_foot", "right_foot"))

    def carrier(self, side: str) -> str:
        """The role of the bone that carries the "left" or "right" shoulder: the chest where it has none of its own."""
        shoulder = f"{side}_shoulder"
        return shoulder if shoulder in self._rest.roles else "chest"

    @property
    def hips(self) -> FloatArray:
        """Half way between the hip joints [m], shape (3,)."""
        return (self._rest.middle("thigh") - self._origin) @ self._axes

    @property
    def crown(self) -> FloatArray:
        """The top of the head [m], shape (3,).

        Raises:
            UnknownNameError: no bone plays the head.
        """
        return (self._rest.vertex - self._origin) @ self._axes

    def pose(self, bones: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Origins [m] (n, 3) and rotations bone_to_wearer wxyz (n, 4) of bones by name or role.

        Raises:
            UnknownNameError: no bone plays one of the roles.
        """
        chosen = [self.bone(bone) for bone in bones]
        to_wearer = quaternions.conjugate(quaternions.from_matrix(self._axes))
        return (
            (self._rest.positions[chosen] - self._origin) @ self._axes,
            quaternions.multiply(to_wearer, self._rest.rotations_wxyz[chosen]),
        )

    def into_bone(self, bone: str, points: FloatArray) -> FloatArray:
        """Points of the wearer's frame [m], shape (n, 3), in a bone's."""
        origins, rotations = self.pose([bone])
        return quaternions.rotate(quaternions.conjugate(rotations[0]), points - origins[0])

    @cached_property
    def _bone_axes(self) -> FloatArray:
        """Rotations bone_to_world as matrices, shape (B, 3, 3)."""
        return quaternions.to_matrix(self._rest.rotations_wxyz)

    @cached_property
    def _balls(self) -> tuple[FloatArray, FloatArray]:
        """A ball around each collider: its middle [m], shape (C, 3), and its radius [m], shape (C,)."""
        middles, radii = np.zeros((len(self._solids), 3)), np.full(len(self._solids), np.inf)
        for k, (collider, name) in enumerate(self._solids):
            bone = self.bone(name)
            if isinstance(collider, Bounded):
                middle, radii[k] = collider.ball()
                middles[k] = quaternions.rotate(self._rest.rotations_wxyz[bone], middle)
            middles[k] += self._rest.positions[bone]
        return middles, radii

    def distances(
        self,
        points: FloatArray,
        *,
        within: float = np.inf,
        only: Sequence[str] | None = None,
        without: Sequence[str] = (),
    ) -> FloatArray:
        """How far points of the wearer's frame [m], shape (..., 3), are from the nearest collider [m].

        Args:
            points: in the wearer's frame [m].
            within: what is further [m] may be told to be infinitely far.
            only: roles whose bones' colliders count, and those of the bones below, None for all.
            without: roles whose bones' do not, nor those of the bones below.
        """
        places = points.reshape(-1, 3) @ self._axes.T + self._origin
        least = np.full(len(places), np.inf)
        if not len(places):
            return least.reshape(points.shape[:-1])
        counted, skipped = (None if roles is None else self._bones(roles) for roles in (only, without))
        middles, radii = self._balls
        outside = middles - np.clip(middles, places.min(axis=0), places.max(axis=0))
        for k in np.flatnonzero(np.linalg.norm(outside, axis=1) <= radii + within):
            collider, name = self._solids[k]
            bone = self.bone(name)
            if (counted is not None and bone not in counted) or (skipped is not None and bone in skipped):
                continue
            in_bone = (places - self._rest.positions[bone]) @ self._bone_axes[bone]
            least = np.minimum(least, signed_distance(collider, in_bone))
        return least.reshape(points.shape[:-1])

    def _bones(self, roles: Sequence[str]) -> set[int]:
        """The bones of roles, where there are any, and all below them."""
        starts = [self._rest.segment_start(role) for role in roles if role in self._rest.roles]
        return {k for k in range(len(self._rest.bones)) for start in starts if self._rest.chain(start, k)[0] == start}

    def way_out(
        self,
        origins: FloatArray,
        directions: FloatArray,
        clearance: float,
        *,
        only: Sequence[str] | None = None,
        without: Sequence[str] = (),
    ) -> FloatArray:
        """How far one has to go along rays until the rest of the way is clear of the body [m], shape (...).

        Args:
            origins: where the rays begin [m], shape (..., 3), and
            directions: where they go, of unit length, of a shape that fits.
            clearance: least distance from the colliders [m].
            only: as of `distances`.
            without: as of `distances`.
        """
        origins, directions = np.broadcast_arrays(origins, directions)
        shape = origins.shape[:-1]
        origins, directions = origins.reshape(-1, 3), directions.reshape(-1, 3)
        ways = np.full(len(origins), BROADEST * self.height)
        nearing = np.arange(len(ways))
        while len(nearing):
            # From outside inwards, each time by as much as is surely clear.
            places = origins[nearing] + ways[nearing, None] * directions[nearing]
            spare = self.distances(places, only=only, without=without) - clearance
            goes_on = (spare > NEAR) & (ways[nearing] > 0.0)
            nearing, spare = nearing[goes_on], spare[goes_on]
            ways[nearing] = np.maximum(ways[nearing] - spare, 0.0)
        return ways.reshape(shape)

    def ring(self, radius: float | FloatArray, angles: FloatArray, heights: FloatArray) -> FloatArray:
        """Points around the neck [m], shape (..., 3).

        Args:
            radius: their distance from its middle, seen from above [m].
            angles: from the middle of the back to the left [rad].
            heights: above the shoulder joints [m].
        """
        middle = self.neck_at(heights)
        x, y = middle[..., 0] - radius * np.cos(angles), middle[..., 1] + radius * np.sin(angles)
        return np.stack(np.broadcast_arrays(x, y, heights), axis=-1)

    def collar(self, clearance: float) -> Ring:
        """The narrowest ring around the neck that is clear of it, the least steep of several.

        It lies across the neck, or is lower in front: as from the nape to the throat.

        Raises:
            ValueRangeError: what surrounds the neck is too thick.
        """
        radii = np.arange(NARROWEST * self.height, WIDEST * self.height, FINE)
        for highest in (HIGHEST, TALLEST):
            heights = np.arange(0.0, highest, FINE / self.height) * self.height
            found = []
            for steeper in STEEPER:
                steepness = float(self._neck_line[2][0]) + steeper
                clear = partial(self._clear_heights, heights=heights, clearance=clearance, steepness=steepness)
                radius = _first(radii, clear)
                if radius is not None:
                    found.append(Ring(radius, float(clear(radius)[0]), steepness))
            if found:
                return min(found, key=lambda ring: ring.radius)
        raise ValueRangeError(
            f"no collar of less than {WIDEST * self.height:.2f} m clears the neck: a back_cape needs none"
        )

    def girth(self, clearance: float) -> float:
        """Radius of the narrowest ring around the neck that could slip down over the shoulders and upper arms [m].

        Raises:
            ValueRangeError: the arms stand too far off.
        """
        heights = np.linspace(-UPPER_ARM * self.height, 0.0, 24)
        radii = np.arange(WIDEST * self.height, BROADEST * self.height, FINE)
        radius = _first(radii, partial(self._clear_heights, heights=heights, clearance=clearance), least=len(heights))
        if radius is not None:
            return radius
        raise ValueRangeError(f"no ring of less than {BROADEST * self.height:.2f} m slips over the shoulders")

    def lie_on(self, radius: float, angles: FloatArray, clearance: float, start: FloatArray) -> FloatArray:
        """Heights at which a ring around the neck lies that is let down onto the body [m], shape (n,).

        Args:
            radius: of the ring [m].
            angles: from the middle of the back to the left [rad], shape (n,).
            clearance: least distance from all colliders [m].
            start: where it is let down from [m], shape (n,); where it is not clear there, from the next place above.
        """
        heights = np.arange(LOWEST, TALLEST, FINE / self.height) * self.height
        free = self._is_clear(radius, angles, heights, clearance)
        above = heights >= start[:, None] - FINE
        first = np.argmax(free & above, axis=1)
        blocked = ~free & (np.arange(len(heights)) < first[:, None])
        lowest = np.where(blocked, np.arange(len(heights)) + 1, 0).max(axis=1)
        return np.where((free & above).any(axis=1), heights[lowest], TALLEST * self.height)

    def _clear_heights(
        self, radius: float, heights: FloatArray, clearance: float, *, steepness: float = 0.0
    ) -> FloatArray:
        """Those of some heights [m] at which a whole ring around the neck, so steep, is clear of all colliders."""
        angles = np.linspace(-np.pi, np.pi, AROUND, endpoint=False)
        for directions in (angles[::8], angles):  # a few tell of most that are not
            tilted = heights + Ring(radius, 0.0, steepness).rises(directions)[:, None]
            heights = heights[self._is_clear(radius, directions, tilted, clearance).all(axis=0)]
        return heights

    def _is_clear(self, radius: float, angles: FloatArray, heights: FloatArray, clearance: float) -> NDArray[np.bool_]:
        """Where a ring around the neck is clear of all colliders, at n angles and m heights (m,) or (n, m), (n, m)."""
        return self.distances(self.ring(radius, angles[:, None], heights), within=clearance) >= clearance


def _first(radii: FloatArray, clear: Callable[[float], FloatArray], *, least: int = 1) -> float | None:
    """The least of some growing radii that is clear at so many heights, None where none is.

    One in `STRIDE` is tried, and those before the first that is; all others only where none of these is.
    """

    def is_clear(k: int) -> bool:
        return len(clear(float(radii[k]))) >= least

    tried = np.arange(0, len(radii), STRIDE)
    found = next((k for k in tried.tolist() if is_clear(k)), None)
    near = np.setdiff1d(np.arange(len(radii)), tried) if found is None else np.arange(max(found - STRIDE + 1, 0), found)
    closer = next((k for k in near.tolist() if is_clear(k)), found)
    return None if closer is None else float(radii[closer])


def room_between(spacing: float, height: float) -> float:
    """Distance from a limb at which the vertices of cloth hold all of it off the limb [m].

    The middle of a cell, at p from its corners, is as far from the axis of a cylinder of radius r as
    sqrt((r + t)^2 - p^2) when these are at t from its surface.

    Args:
        spacing: mean distance of neighbouring vertices [m].
        height: of the body [m].

    Raises:
        ValueRangeError: the spacing is too wide to go around a neck.
    """
    if spacing > COARSEST * height:
        raise ValueRangeError(f"a spacing of {spacing:g} m is too wide to go around a body {height:.2f} m tall")
    from_corners = STRAINED * spacing * float(np.hypot(1.0, WIDER)) / 2.0
    return max(float(np.hypot(LIMB * height, from_corners)) - LIMB * height, LEAST)
