"""Ellipsoids.

The nearest point x of the surface to a point p satisfies p - x = t (x / r^2), axis by axis, with the radii r, so that

    x_i = r_i^2 p_i / (t + r_i^2)   and   sum (r_i p_i / (t + r_i^2))^2 = 1,   t > -m^2, m the smallest radius

of which Eberly, "Distance from a Point to an Ellipse, an Ellipsoid, or a Hyperellipsoid" (2013, rev. 2020), section 3,
shows that there is exactly one such t, but for points on the plane across the smallest radius that are near enough to
the middle (section 3.7): for these t = -m^2, and what is lacking from 1 is the term of that axis. `nearest` counts with
u = t / m^2 + 1 > 0 in place of t, which doesn't cancel near those points; then the distance is (u - 1) times the length
of w, and the normal is w's direction, where w_i = p_i / (u + (r_i^2 - m^2) / m^2).

The equation is the one of trust region methods: the inverse of the sum's root is a concave function of u, nearly a
straight line, so that Newton's method for it converges fast and from one side (Moré and Sorensen 1983, "Computing a
trust region step", section 3; Conn, Gould and Toint 2000, "Trust-region methods", section 7.3).
"""

# Coal lies in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.border import checked
from skeleton.shapes.base import UNIT_TOLERANCE, Bounded, Layout, lengths, upright
from skeleton.shapes.capsule import Capsule
from skeleton.shapes.outlines import EllipsoidOutline

FloatArray = NDArray[np.float64]

FLAT = 1e-16
"""Distance from the plane across the smallest radius, in smallest radii, up to which a point counts as on it."""
STEPS = 64
"""Most of Newton's method; 5 for nearly all points, 40 near the edge of the flat region of section 3.7."""
ARRIVED = 1e-9
"""Relative change in a step of it below which it has converged: what is then left is about the square of it."""
LEAST = 1e-300
"""Stands in for a divisor of 0 below a dividend of 0."""
NARROW = 1e-6
"""Divisors below it have lost digits: the foot on the shortest axis is then what the others leave of 1."""
HALVINGS = 64
"""Of the interval in the logarithm of u that `Ellipsoid.distances` searches."""


def nearest(x, y, z, radius_x, radius_y, radius_z, _h):
    """Ellipsoid of the given radii around the origin; see the module for the method.

    On the plane across the smallest radius, as far as it is a tie between both sides (the centre is there), the normal
    leads to the positive one. Of equal smallest radii the first in the order x, y, z counts: at the centre of a sphere
    the normal is +X.
    """
    m = min(radius_x, min(radius_y, radius_z))
    inverse = 1.0 / (m * m)
    kx = (radius_x - m) * (radius_x + m) * inverse
    ky = (radius_y - m) * (radius_y + m) * inverse
    kz = (radius_z - m) * (radius_z + m) * inverse
    ax, ay, az = abs(x) * radius_x * inverse, abs(y) * radius_y * inverse, abs(z) * radius_z * inverse
    ax, ay, az = (ax if ax > FLAT else 0.0), (ay if ay > FLAT else 0.0), (az if az > FLAT else 0.0)
    # Here one of the terms is 1 and the others are at most that, or, at 0, all of them are at most 1.
    u = max(max(ax - kx, 0.0), max(ay - ky, az - kz))
    lack = 0.0
    for _ in range(STEPS):
        ix, iy, iz = 1.0 / max(u + kx, LEAST), 1.0 / max(u + ky, LEAST), 1.0 / max(u + kz, LEAST)
        px, py, pz = ax * ix, ay * iy, az * iz
        px, py, pz = px * px, py * py, pz * pz
        total = px + py + pz
        if total <= 1.0:  # at the start, where the region is flat, or as good as there
            lack = 1.0 - total
            break
        change = total * (math.sqrt(total) - 1.0) / (px * ix + py * iy + pz * iz)
        u += change
        if change <= ARRIVED * u:
            break
    wx, wy, wz = x / max(u + kx, LEAST), y / max(u + ky, LEAST), z / max(u + kz, LEAST)
    if u == 0.0:
        short = m * math.sqrt(lack)
        first, second = kx == 0.0, ky == 0.0
        wx = math.copysign(short, x) if first else wx
        wy = (0.0 if first else math.copysign(short, y)) if second else wy
        wz = (0.0 if first | second else math.copysign(short, z)) if kz == 0.0 else wz
    length = math.sqrt(wx * wx + wy * wy + wz * wz)
    scale = 1.0 / max(length, LEAST)
    return (u - 1.0) * length, wx * scale, wy * scale, wz * scale


@checked
@dataclass(frozen=True, eq=False, kw_only=True)
class Ellipsoid(Bounded):
    """A solid ellipsoid.

    Attributes:
        name: unique name.
        bone: name of the bone that carries it, None for one that stands still in the world.
        center: in the bone's frame [m], shape (3,).
        radii: half its lengths along its own axes [m], shape (3,).
        rotation_wxyz: unit quaternion (w, x, y, z) ellipsoid_to_bone, shape (4,).
        friction: Coulomb coefficient against cloth, None for the scene's default.
        thickness: distance from the surface at which cloth is stopped [m], None for the scene's default.

    Raises:
        ValueRangeError: a value is out of range.
    """

    name: str = "ellipsoid"
    center: FloatArray = field(default_factory=lambda: np.zeros(3))
    radii: FloatArray = field(default_factory=lambda: np.array([0.2, 0.2, 0.3]))
    rotation_wxyz: FloatArray = field(default_factory=upright)

    numbers: ClassVar[Mapping[str, int]] = {"center": 3, "radii": 3, "rotation_wxyz": 4}
    optional: ClassVar[tuple[str, ...]] = ("rotation_wxyz",)
    nearest = staticmethod(nearest)

    def _check(self) -> None:
        self._require((self.radii > 0.0).all(), "radii must be positive", self.radii)
        unit = abs(np.linalg.norm(self.rotation_wxyz) - 1.0) < UNIT_TOLERANCE
        self._require(unit, "rotation_wxyz must be of unit length", self.rotation_wxyz)

    def describe(self) -> str:
        """Kind and radii."""
        return f"{self.kind()} of " + " x ".join(f"{1000 * radius:.0f}" for radius in self.radii) + " mm"

    def layout(self) -> Layout:
        """From the centre, along the axes; sizes are the radii [m].

        Curvature is highest at the ends of the longest axis, where the surface is curved by the square of the smallest
        radius over the largest.
        """
        radii = tuple(float(radius) for radius in self.radii)
        curved = min(radii) ** 2 / max(radii)
        return Layout(self.center, quaternions.to_matrix(self.rotation_wxyz), radii, min(radii), curved)

    def distances(self, points: FloatArray) -> FloatArray:
        """Distances of points (N, 3) in the bone's frame from the surface [m], negative inside, shape (N,).

        After Eberly as `nearest` is, but by bisection (section 3.10), in the logarithm, and as the way to the point of
        the surface that is found.
        """
        own = np.abs((points - self.center) @ quaternions.to_matrix(self.rotation_wxyz))
        order = np.argsort(self.radii)
        own, radii = own[:, order], self.radii[order]
        ratios = radii / radii[0]
        past = (ratios - 1.0) * (ratios + 1.0)
        scaled = own * ratios / radii[0]
        low = np.maximum((scaled - past).max(axis=1), LEAST)
        high = np.maximum(lengths(scaled), low)
        # Coordinate by coordinate: sums over rows of three take several times as long.
        (x, y, z), (_, past_y, past_z) = np.ascontiguousarray(scaled.T), past.tolist()
        # On the plane across the smallest radius, the sum is less than 1 throughout: the lower bound is what is found.
        for _ in range(HALVINGS):
            middle = np.sqrt(low) * np.sqrt(high)
            short = (x / middle) ** 2 + (y / (middle + past_y)) ** 2 + (z / (middle + past_z)) ** 2 < 1.0
            low, high = np.where(short, low, middle), np.where(short, middle, high)
        foot = scaled / (low[:, None] + past)
        foot[:, 0] = np.where(low <= LEAST, 0.0, foot[:, 0])
        others = (foot[:, 1:] ** 2).sum(axis=1)
        # Close to that plane from within, where the quotient has lost its digits; beside it the root would lose them.
        lost = (low < NARROW) & (others < 1.0)
        foot[:, 0] = np.where(lost, np.sqrt(np.maximum(1.0 - others, 0.0)), foot[:, 0])
        inside = ((own / radii) ** 2).sum(axis=1) < 1.0
        return np.where(inside, -1.0, 1.0) * lengths(own - foot * radii)

    def volume(self) -> float:
        """Volume [m^3]."""
        return float(4.0 / 3.0 * math.pi * np.prod(self.radii))

    def grown(self, thickness: float) -> Self:
        """The ellipsoid whose axes end so much further out [m]: all around it, the surface is at most that far out."""
        return replace(self, radii=self.radii + thickness)

    def core(self, share: float) -> Self:
        """The same so many times as large, every point of which is deeper than all but a share of the least radius."""
        return replace(self, radii=share * self.radii)

    def outline(self) -> EllipsoidOutline:
        """The ellipsoid itself."""
        return EllipsoidOutline(self.center, self.radii, self.rotation_wxyz)

    def collision_geometry(self) -> tuple[Any, FloatArray, FloatArray]:
        """`coal.Ellipsoid`; turn and place in the bone's frame."""
        import coal

        return coal.Ellipsoid(*self.radii.tolist()), self.rotation_wxyz, self.center

    def balls(self) -> tuple[FloatArray, FloatArray]:
        """Balls that hold it in their hull: centres in the bone's frame [m], (2, 3), and radii [m], (2,).

        They are as large as the second largest radius, and touch it at the ends of its longest axis: where x = a cos(s)
        and its distance from that axis is at most b sin(s), (x - (a - b))^2 + (b sin(s))^2 <= b^2 for x > a - b.
        """
        second = float(np.sort(self.radii)[1])
        ends = self._ends(float(self.radii.max()) - second)
        return ends, np.full(2, second)

    def support(self, directions: FloatArray) -> FloatArray:
        """How far the solid extends along unit vectors (N, 3) in the bone's frame, from its origin [m], shape (N,)."""
        own = directions @ quaternions.to_matrix(self.rotation_wxyz)
        return directions @ self.center + lengths(own * self.radii)

    def as_capsule(self) -> Capsule:
        """The capsule as long as it, with the mean of its other two radii."""
        least, second, most = np.sort(self.radii).tolist()
        radius = (least + second) / 2.0
        start, end = self._ends(most - radius)
        return Capsule(self.name, self.bone, start, end, radius)

    def _ends(self, way: float) -> FloatArray:
        """The points so far from the centre on the longest axis [m], in the bone's frame, shape (2, 3)."""
        axis = np.eye(3)[int(self.radii.argmax())]
        return self.center + quaternions.rotate(self.rotation_wxyz, np.array([-way, way])[:, None] * axis)
