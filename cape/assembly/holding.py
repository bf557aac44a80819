"""What holds a cloth, as arrays: hard, by springs, on curves, by tethers, near where bones would carry it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.assembly.fabrics import longest_allowed, of_vertices
from cape.assembly.geodesics import geodesic_distances
from cape.assembly.springs import Springs
from cape.cloth.cloth import Cloth
from cape.kernels.solve.attachments import Attached, Blend
from cape.kernels.solve.confine import Confined
from cape.kernels.solve.lift import Ties
from cape.kernels.solve.slide import Rails
from cape.kernels.solve.soft import Pull
from cape.kernels.solve.tethers import Tethers
from cape.scene.holding.attachments import Attachment
from cape.scene.holding.tethers import Tethers as TethersAsked
from cape.scene.scene import Scene

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NOTHING = -1  # number of the vertex that a hand holds which holds none: no thread of a team has one of that number
SMOOTH = np.cos(np.radians(30.0))  # cosine of a bend of a curve, above which it is one of many that make it round

Hold = tuple[Attachment, NDArray[np.int64], NDArray[np.int64]]
"""An attachment, the vertices of the scene that it holds, and the same as the assembly numbers them, (n,) each."""


def by_kind(holds: list[Any]) -> tuple[list[Any], list[Any], list[Any]]:
    """Tuples that begin with an attachment, apart: those that hold hard, those with springs, those with a curve."""
    return (
        [hold for hold in holds if hold[0].hard],
        [hold for hold in holds if hold[0].soft],
        [hold for hold in holds if hold[0].sliding],
    )


def attached_of(scene: Scene, holds: list[Hold]) -> Attached | None:
    """Vertices that bones carry, with room for where; None for none."""
    indices = np.concatenate([np.empty(0, np.int64), *(place for _, _, place in holds)])
    if not len(indices):
        return None
    lift, drift = (np.zeros((len(indices), 3)) for _ in range(2))
    if all(attachment.weights is None for attachment, _, _ in holds):
        bones = np.concatenate([np.full(len(place), scene.bones.index(a.bone)) for a, _, place in holds])
        return Attached(indices, bones, np.zeros((len(indices), 3)), lift, drift)
    weights = np.zeros((len(indices), len(scene.bones)))
    first = 0
    for attachment, vertices, _ in holds:
        own = np.ones((len(vertices), 1))
        if attachment.weights is not None:
            own = attachment.of(attachment.weights, vertices)
        rows = slice(first, first + len(vertices))
        weights[rows, [scene.bones.index(bone) for bone in attachment.bones]] = own
        first += len(vertices)
    heavy = np.argsort(-weights, axis=1, kind="stable")
    weights = np.take_along_axis(weights, heavy, axis=1)
    starts = np.concatenate([[0], np.cumsum((weights > 0.0).sum(axis=1))])
    bones = heavy[weights > 0.0]
    return Attached(indices, bones, np.zeros((len(bones), 3)), lift, drift, Blend(starts, weights[weights > 0.0]))


def pull_of(scene: Scene, holds: list[Hold], mass: FloatArray) -> Pull | None:
    """The springs that hold vertices of some mass [kg] (N,); None for none."""
    attached = attached_of(scene, holds)
    if attached is None:
        return None
    stiffness, damping = [], []
    for attachment, vertices, place in holds:
        assert attachment.stiffness is not None
        own = attachment.of(attachment.stiffness, vertices)
        critical = 2.0 * np.sqrt(own * mass[place])
        stiffness.append(own)
        damping.append(critical if attachment.damping is None else attachment.of(attachment.damping, vertices))
    goals, speeds = (np.zeros((3, len(attached.vertices))) for _ in range(2))
    return Pull(attached, np.concatenate(stiffness), np.concatenate(damping), goals, speeds)


def hands_of(scene: Scene, count: int) -> Pull | None:
    """So many hands in the world, which hold nothing as yet; None for none."""
    if not count:
        return None
    points, lift, drift = np.zeros((3, count, 3))
    attached = Attached(np.full(count, NOTHING), np.full(count, len(scene.bones)), points, lift, drift)
    return Pull(attached, *np.zeros((2, count)), *np.zeros((2, 3, count)))


def tethers_of(scene: Scene, cloth: Cloth, springs: Springs, attached: Attached | None) -> Tethers | None:
    """The tethers to what is held hard; None for none."""
    if scene.tethers is None or attached is None:
        return None
    distances, nearest = geodesic_distances(cloth, attached.vertices, springs=springs)
    return tethers_along(scene.tethers, distances, nearest, attached.vertices)


def tethers_along(tethers: TethersAsked, distances: FloatArray, nearest: IntArray, held: IntArray) -> Tethers:
    """The tethers of vertices at some distances [m] (N,) from the nearest (N,) of those that are held (h,)."""
    anchor = nearest.copy()
    anchor[held] = -1
    return Tethers(anchor, (1.0 + tethers.slack) * distances)


def ties_of(cloth: Cloth, springs: Springs, attached: Attached) -> Ties:
    """The threads, or edges of a mesh, between vertices that are held hard: no longer than the fabric lets them get."""
    count = len(attached.vertices)
    places = np.full(cloth.vertices, -1)
    places[attached.vertices] = np.arange(count)
    first, second = places[springs.first], places[springs.second]
    chosen = springs.measured & (first >= 0) & (second >= 0)
    limit = of_vertices(cloth, lambda f: min(f.limit_warp, f.limit_weft), springs.first[chosen])
    room = (np.zeros((count, 3)) for _ in range(2))
    return Ties(first[chosen], second[chosen], longest_allowed(springs.rest[chosen], limit), *room)


def rails_of(scene: Scene, holds: list[Hold]) -> Rails | None:
    """The curves that vertices slide along; None for none."""
    attached = attached_of(scene, holds)
    if attached is None:
        return None
    curves = [_pieces(attachment) for attachment, _, _ in holds]
    ends = np.cumsum([0, *(len(curve) for curve in curves)])
    count = [len(vertices) for _, vertices, _ in holds]
    return Rails(
        attached=attached,
        pieces=np.concatenate(curves),
        first=np.repeat(ends[:-1], count),
        last=np.repeat(ends[1:], count),
        closed=np.repeat([_is_closed(attachment) for attachment, _, _ in holds], count),
    )


def _is_closed(attachment: Attachment) -> bool:
    assert attachment.along is not None
    return bool((attachment.along[0] == attachment.along[-1]).all())


def _pieces(attachment: Attachment) -> FloatArray:
    """The rows of a curve's pieces, shape (m - 1, 12): see `Rails`."""
    points = attachment.along
    assert points is not None
    ways = np.diff(points, axis=0)
    lengths = np.linalg.norm(ways, axis=1, keepdims=True)
    straight = ways / lengths
    begin, end = (_bends(straight, np.roll(straight, by, axis=0)) for by in (1, -1))
    if not _is_closed(attachment):
        begin[0] = end[-1] = 0.0
    return np.concatenate([points[:-1], ways, lengths * begin, lengths * end], axis=1)


def _bends(straight: FloatArray, beside: FloatArray) -> FloatArray:
    """How unit tangents where pieces meet those beside them differ from their own directions, shape (S, 3)."""
    middle = straight + beside
    cornered = np.sum(straight * beside, axis=1) < SMOOTH
    middle[cornered] = straight[cornered]
    return middle / np.linalg.norm(middle, axis=1, keepdims=True) - straight


def confined_of(scene: Scene, cloth: Cloth, held: list[IntArray], places: IntArray) -> Confined | None:
    """How far vertices may get from where bones would carry them; None for anywhere.

    Args:
        scene: what was assembled.
        cloth: its cloth as the assembly numbers the vertices.
        held: vertices of each attachment, as the scene numbers them.
        places: the scene's vertices as the assembly numbers them, shape (V,).

    Raises:
        ValueRangeError: a map gives values out of range.
    """
    holds: list[Hold] = []
    most, behind, radius = (np.empty(0) for _ in range(3))
    distances = np.zeros(cloth.vertices)
    if any(confinement.needs_holds for confinement in scene.confinements):
        distances, _ = geodesic_distances(cloth, places[np.concatenate(held)])
    for confinement in scene.confinements:
        vertices = confinement.animated.vertices
        off = distances[places[vertices]]
        holds.append((confinement.animated, vertices, places[vertices]))
        most = np.append(most, confinement.values(confinement.max_distance, off))
        behind = np.append(behind, confinement.values(confinement.backstop, off))
        radius = np.append(radius, np.full(len(vertices), confinement.backstop_radius))
    animated = attached_of(scene, holds)
    if animated is None:
        return None
    return Confined(animated, np.zeros((len(animated.bones), 3)), most, behind, radius)
