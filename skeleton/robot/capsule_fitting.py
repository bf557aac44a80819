"""The smallest capsule, plain or tapered, around the points of a surface, and one to three of them side by side.

For a given axis and taper the radius is that quantile of the points' distances which the solid has to hold, so every
trial holds it, and what is left is to find the axis and the taper of least volume: six or seven numbers, by the
downhill simplex of Nelder and Mead (1965, "A simplex method for function minimization") from several starts. All of it
happens in the points' own principal axes and in units of their size, so that neither place, direction and scale nor a
reflection of the points changes the outcome.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motions.errors import ValueRangeError
from skeleton.shapes import Capsule, TaperedCapsule
from skeleton.shapes.hulls import hull_of_spheres_volume
from skeleton.solid_measures import signed_distance, union_volume, volume

FloatArray = NDArray[np.float64]

QUANTILE = 0.98
"""Share of a surface that its solids hold by default."""
TAPER_SAVING = 0.05
"""A tapered capsule is taken where it is smaller than the plain one by this share of its volume."""
SPLIT_SAVING = 0.2
"""One more solid is taken where the union is smaller by this share of its volume."""

_WELL_FILLED = 1.6  # times the hull's volume: a ball in its cube is 1.9, a cylinder as high as wide 1.5
_THINNEST = 1e-3  # of the points' size: least radius of a solid around points on a line
_ONE_PLACE = 1e-9  # of the points' coordinates: less is rounding
_STEEPEST = 0.8  # sine of the taper's angle; beyond it a sphere does as well
_COARSE, _FINE = 0.05, 0.02  # of the points' size: points of one cell of a grid count as one during the search
_SPACING = 0.06  # of a mesh's size: longest edge between the points that stand for its surface


def fit_capsule(points: ArrayLike, *, weights: ArrayLike | None = None, quantile: float = QUANTILE) -> Capsule:
    """The smallest capsule that holds a share of the points.

    Args:
        points: of a surface [m], shape (N, 3).
        weights: what each point counts, such as its part of the area, shape (N,); all alike by default.
        quantile: share of the weights that lies inside, above 0 and up to 1.

    Returns:
        The capsule in the frame of the points. Points on a line get a radius of a thousandth of their size.

    Raises:
        ValueRangeError: points or weights that make no sense, or all points in one place.
    """
    return _plain(_Cloud.of(points, weights, quantile))


def fit_tapered_capsule(
    points: ArrayLike, *, weights: ArrayLike | None = None, quantile: float = QUANTILE
) -> TaperedCapsule:
    """The smallest convex hull of two spheres that holds a share of the points; see `fit_capsule`."""
    return _tapered(_Cloud.of(points, weights, quantile))


def fit_solids(
    points: ArrayLike,
    *,
    weights: ArrayLike | None = None,
    quantile: float = QUANTILE,
    kinds: Sequence[type[Capsule] | type[TaperedCapsule]] = (Capsule, TaperedCapsule),
    most: int = 3,
    least_saving: float = 0.0,
) -> tuple[Capsule | TaperedCapsule, ...]:
    """A capsule or a few of them, each tapered where that pays, which together hold a share of the points.

    Args:
        points: of a surface [m], shape (N, 3).
        weights: what each point counts, shape (N,); all alike by default.
        quantile: share of the weights that lies inside, above 0 and up to 1.
        kinds: what to choose from.
        most: solids at most; a further one is taken where it saves a fifth of the volume (`SPLIT_SAVING`).
        least_saving: volume [m^3] that a further one has to save besides.

    Raises:
        ValueRangeError: points or weights that make no sense, or all points in one place.
    """
    cloud = _Cloud.of(points, weights, quantile)
    best: tuple[Capsule | TaperedCapsule, ...] = (_best(cloud, kinds),)
    size, hull = volume(best[0]), hull_volume(cloud.points)
    if size <= _WELL_FILLED * hull:
        return best
    for count in range(2, most + 1):
        enough = size - max(SPLIT_SAVING * size, least_saving)
        # Few solids together are smaller than the convex hull.
        if enough < hull or (parts := _split(cloud, count, _PROMISING * size)) is None:
            break
        solids = tuple(_best(part, kinds) for part in parts)
        if (union := union_volume(solids)) <= enough:
            best, size = solids, union
    return best


def surface_points(vertices: FloatArray, triangles: NDArray[np.integer]) -> tuple[FloatArray, FloatArray]:
    """Points [m], shape (N, 3), that stand for the surface of a mesh, and the area of each [m^2], shape (N,).

    They are the vertices, after edges longer than 6 % of the mesh's size have been halved; each has a third of its
    triangles' areas. Nothing is drawn by lot, so mirrored meshes have mirrored points.

    Raises:
        ValueRangeError: the mesh has no area.
    """
    import trimesh

    size = float(np.linalg.norm(np.ptp(vertices, axis=0))) if len(vertices) else 0.0
    if not size > 0.0 or not len(triangles):
        raise ValueRangeError("the mesh has no area")
    points, faces = trimesh.remesh.subdivide_to_size(vertices, triangles, _SPACING * size, max_iter=30)[:2]
    areas = trimesh.triangles.area(points[faces])
    weights = np.zeros(len(points))
    np.add.at(weights, faces.ravel(), np.repeat(areas / 3.0, 3))
    if not weights.sum() > 0.0:
        raise ValueRangeError("the mesh has no area")
    on_surface = weights > 0.0
    return points[on_surface], weights[on_surface]


def weighted_quantile(values: FloatArray, weights: FloatArray, quantile: float) -> float:
    """The least of the values (N,) up to which lies at least that share of the weights (N,)."""
    order = values.argsort()
    reached = weights[order].cumsum()
    # A sum is rounded in its last digits; a share of 1 would else ask for more than there is.
    place = int(reached.searchsorted(quantile * reached[-1] * (1.0 - 1e-12)))
    return float(values[order[min(place, len(values) - 1)]])


def hull_volume(points: FloatArray) -> float:
    """Volume of the convex hull of points (N, 3) [m^3]; 0 where they lie in a plane."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0


@dataclass(frozen=True, eq=False)
class _Cloud:
    """Points to be held, as they are and in their own axes.

    Attributes:
        points: as given [m], shape (N, 3).
        weights: shape (N,).
        quantile: share of the weights to hold.
        center: weighted mean [m], shape (3,).
        axes: principal axes as columns, the longest first, shape (3, 3); a reflection of the points reflects them.
        size: diagonal of the box around the points but for outliers [m].
        scaled: points in the principal axes, in units of the size, shape (N, 3).
    """

    points: FloatArray
    weights: FloatArray
    quantile: float
    center: FloatArray
    axes: FloatArray
    size: float
    scaled: FloatArray

    @staticmethod
    def of(points: ArrayLike, weights: ArrayLike | None, quantile: float) -> "_Cloud":
        """Check what was given and turn it into its own axes."""
        points = np.array(points, dtype=float)
        if points.ndim != 2 or points.shape[1] != 3 or not len(points) or not np.isfinite(points).all():
            raise ValueRangeError(f"points to fit to have the shape (N, 3) and are finite, got {points.shape}")
        weights = np.ones(len(points)) if weights is None else np.array(weights, dtype=float)
        if weights.shape != (len(points),) or not (weights >= 0.0).all() or not 0.0 < weights.sum() < np.inf:
            raise ValueRangeError(f"the {len(points)} points need a weight each, zero or more and not all zero")
        if not 0.0 < quantile <= 1.0:
            raise ValueRangeError(f"the share of the points to hold is above 0 and up to 1, got {quantile}")
        if not np.ptp(points, axis=0).max() > _ONE_PLACE * np.abs(points).max():
            raise ValueRangeError("all points to fit to are in one place: no capsule is the smallest")
        inner = _inner(points, weights, quantile)
        center = weights[inner] @ points[inner] / weights[inner].sum()
        spread = points[inner] - center
        _, axes = np.linalg.eigh((spread * weights[inner, None]).T @ spread)
        axes = axes[:, ::-1]
        # Along each axis the longer tail lies on the positive side.
        axes = axes * np.where((weights[inner] @ (spread @ axes) ** 3) < 0.0, -1.0, 1.0)
        size = float(np.linalg.norm(np.ptp(spread @ axes, axis=0)))
        return _Cloud(points, weights, quantile, center, axes, size, (points - center) @ axes / size)

    def part(self, chosen: NDArray[np.bool_]) -> "_Cloud":
        """Some of the points as a cloud of their own."""
        return _Cloud.of(self.points[chosen], self.weights[chosen], self.quantile)

    def merged(self, cell: float) -> "_Cloud":
        """One point, the mean, for all in a cell of a grid, whose edges are this part of the size.

        Where points lie far off, the outermost cells go on without end.
        """
        reach = int(np.ceil(2.0 / cell))
        steps = np.clip(np.round(self.scaled / cell), -reach, reach).astype(int) + reach
        numbers = steps @ np.array([1, 2 * reach + 1, (2 * reach + 1) ** 2])
        cells = np.unique(numbers, return_inverse=True)[1]
        weights = np.bincount(cells, self.weights)
        inside = weights > 0.0

        def means(values: FloatArray) -> FloatArray:
            sums = [np.bincount(cells, self.weights * column)[inside] for column in values.T]
            return np.stack(sums, axis=1) / weights[inside, None]

        return replace(self, points=means(self.points), weights=weights[inside], scaled=means(self.scaled))

    def outside(self, point: FloatArray) -> FloatArray:
        """A point given in the principal axes in units of the size, in the frame of the points [m], shape (3,)."""
        return self.center + self.size * (self.axes @ point)


def _inner(points: FloatArray, weights: FloatArray, quantile: float) -> NDArray[np.bool_]:
    """Which points are nearest to their middle and make up the share: outliers would spoil axes and size."""
    inner = weights > 0.0
    for _ in range(2):
        distances = np.linalg.norm(points - weights[inner] @ points[inner] / weights[inner].sum(), axis=1)
        inner = (distances <= weighted_quantile(distances, weights, quantile)) & (weights > 0.0)
    has_extent = np.ptp(points[inner], axis=0).max() > _ONE_PLACE * np.abs(points).max()
    return inner if has_extent else np.ones(len(points), bool)


def _reaches(points: FloatArray, start: FloatArray, end: FloatArray, sine: float) -> tuple[FloatArray, float]:
    """First radius that a hull of two spheres needs to reach each point, and the length of its axis.

    The second sphere is smaller by sine * length. Follows `measures.signed_distance`, solved for the radius.
    """
    axis = end - start
    length = max(math.sqrt(axis @ axis), 1e-12)
    from_start = points - start
    along = from_start @ (axis / length)
    squares = np.maximum(np.einsum("ij,ij->i", from_start, from_start) - along * along, 0.0)
    if not sine:
        beside = along - np.minimum(np.maximum(along, 0.0), length)
        return np.sqrt(beside * beside + squares), length
    off_axis = np.sqrt(squares)
    place = along - off_axis * (sine / math.sqrt(1.0 - sine * sine))
    beside = along - np.minimum(np.maximum(place, 0.0), length)
    return np.sqrt(beside * beside + squares) + sine * (along - beside), length


def _least(cloud: _Cloud, starts: Sequence[FloatArray], search: "_Search") -> FloatArray:
    """Ends of the axis, six numbers, and the taper's sine, if there is a seventh, of the least volume found."""
    coarse = _volume_around(cloud.merged(_COARSE))
    best = sorted(starts, key=coarse)[: search.starts]
    found = [_downhill(coarse, start, _FIRST_STEP, search.trials) for start in best]
    _, least = min(found, key=lambda one: one[0])
    if not search.polish:
        return least
    return _downhill(_volume_around(cloud.merged(_FINE)), least, _LAST_STEP, search.polish)[1]


@dataclass(frozen=True)
class _Search:
    """How much is tried: best starts that are followed up, most trials from each, most trials with finer cells."""

    starts: int
    trials: int
    polish: int


_THOROUGH = _Search(starts=2, trials=300, polish=150)
"""Three starts and 1500 trials with all points find volumes that are smaller by 1 % (most of 20 links: 4.5 %)."""
_QUICK = _Search(starts=1, trials=100, polish=0)
"""To choose among divisions."""
_FIRST_STEP, _LAST_STEP = 0.06, 0.015
"""Edges of the first simplex, of the points' size."""


def _volume_around(cloud: _Cloud) -> Callable[[FloatArray], float]:
    """Volume of the solid with a given axis and taper that holds the cloud's share, in units of the cloud's size."""

    def volume_of(x: FloatArray) -> float:
        sine = min(max(float(x[6]), -_STEEPEST), _STEEPEST) if len(x) > 6 else 0.0
        reaches, length = _reaches(cloud.scaled, x[:3], x[3:6], sine)
        first = max(weighted_quantile(reaches, cloud.weights, cloud.quantile), _THINNEST)
        last = first - sine * length
        # Without a second sphere: the worse the farther from one.
        return hull_of_spheres_volume(length, first, last) if last >= _THINNEST else 10.0 - last

    return volume_of


def _downhill(
    function: Callable[[FloatArray], float], start: FloatArray, step: float, trials: int
) -> tuple[float, FloatArray]:
    """Least value of a function that the simplex method finds, and where."""
    from scipy.optimize import minimize

    simplex = np.vstack([start, start + step * np.eye(len(start))])
    options = {"initial_simplex": simplex, "maxfev": trials, "xatol": 1e-4, "fatol": 1e-6, "adaptive": True}
    result = minimize(function, start, method="Nelder-Mead", options=options)
    return float(result.fun), result.x


def _axes_to_try(cloud: _Cloud) -> list[FloatArray]:
    """Ends of axes along the principal axes, through the middle of the points."""
    columns = cloud.scaled.T
    high = np.array([weighted_quantile(column, cloud.weights, cloud.quantile) for column in columns])
    low = -np.array([weighted_quantile(-column, cloud.weights, cloud.quantile) for column in columns])
    starts = []
    for axis in range(3):
        half_width = (high - low)[np.arange(3) != axis].mean() / 2.0
        for share in (0.2, 0.6, 1.0):
            reach = np.zeros(3)
            reach[axis] = max((high - low)[axis] / 2.0 - share * half_width, 0.02)
            starts.append(np.concatenate([(low + high) / 2.0 - reach, (low + high) / 2.0 + reach]))
    return starts


def _plain(cloud: _Cloud, search: _Search = _THOROUGH) -> Capsule:
    x = _least(cloud, _axes_to_try(cloud), search)
    start, end = cloud.outside(x[:3]), cloud.outside(x[3:])
    reaches, _ = _reaches(cloud.points, start, end, 0.0)
    radius = weighted_quantile(reaches, cloud.weights, cloud.quantile)
    return Capsule("capsule", None, start, end, max(radius, _THINNEST * cloud.size))


def _tapered(cloud: _Cloud, search: _Search = _THOROUGH) -> TaperedCapsule:
    starts = [np.append(axis, sine) for axis in _axes_to_try(cloud) for sine in (-0.25, 0.0, 0.25)]
    x = _least(cloud, starts, search)
    start, end, sine = cloud.outside(x[:3]), cloud.outside(x[3:6]), float(np.clip(x[6], -_STEEPEST, _STEEPEST))
    reaches, length = _reaches(cloud.points, start, end, sine)
    first = weighted_quantile(reaches, cloud.weights, cloud.quantile)
    # Where the cells were a little off, a sphere of no size gets one; the larger hull holds what the smaller held.
    first = max(first, _THINNEST * cloud.size + max(sine * length, 0.0))
    return TaperedCapsule(start=start, end=end, start_radius=first, end_radius=first - sine * length)


def _best(
    cloud: _Cloud, kinds: Sequence[type[Capsule] | type[TaperedCapsule]], search: _Search = _THOROUGH
) -> Capsule | TaperedCapsule:
    """The smallest of the kinds; the plain one unless the tapered one saves enough."""
    if Capsule not in kinds:
        return _tapered(cloud, search)
    plain = _plain(cloud, search)
    if TaperedCapsule not in kinds:
        return plain
    tapered = _tapered(cloud, search)
    return tapered if volume(tapered) < (1.0 - TAPER_SAVING) * volume(plain) else plain


def _split(cloud: _Cloud, count: int, limit: float) -> list[_Cloud] | None:
    """So many parts of the points with solids of small union; None where no union of quick fits is below a limit [m^3].

    The parts are slices of the same area across a principal axis; then points go to the solid that they stick out of
    least, as in Lloyd's algorithm (1982, "Least squares quantization in PCM"), and the solids are fitted again.
    """
    coarse = cloud.merged(_COARSE)
    least, best = limit, None
    for axis in range(3):
        along = coarse.scaled[:, axis]
        cuts = [weighted_quantile(along, coarse.weights, k / count) for k in range(1, count)]
        owners = np.searchsorted(cuts, along)
        for _ in range(_ROUNDS):
            parts = _parts(coarse, owners, count)
            if parts is None:
                break
            solids = [_plain(part, _QUICK) for part in parts]
            if (union := union_volume(solids, across=16)) < least:
                least, best = union, solids
            owners = _owners(solids, coarse.points)
    return None if best is None else _parts(cloud, _owners(best, cloud.points), count)


_PROMISING = 0.9
"""Of the volume so far: a union of quick fits above that is not worth thorough ones."""
_ROUNDS = 2
"""How often solids are fitted to parts and points given to solids."""


def _owners(solids: Sequence[Capsule], points: FloatArray) -> NDArray[np.int64]:
    """Number of the solid that each point sticks out of least."""
    return np.argmin([signed_distance(solid, points) for solid in solids], axis=0)


def _parts(cloud: _Cloud, owners: NDArray[np.int64], count: int) -> list[_Cloud] | None:
    """The points of each owner, None where one has too few to fit to."""
    parts = [owners == k for k in range(count)]
    enough = all(cloud.weights[p].any() and np.ptp(cloud.points[p], axis=0).max() > _FINE * cloud.size for p in parts)
    return [cloud.part(p) for p in parts] if enough else None
