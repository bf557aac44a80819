"""Signed distances from shapes, many points at once, sharing nothing with the package's own, and records by hand."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.kernels import store
from cape.kernels.bones import MotionRoom
from cape.kernels.contact import contact, shapes, units
from cape.kernels.contact.drawn import Drawn
from cape.kernels.contact.faces import GROUP, SEEN, FaceContact
from cape.kernels.contact.shapes import COLLIDER, MOMENT, Colliders, Faces, Points
from cape.kernels.contact.slip import NOT
from cape.kernels.contact.watch import NEVER, TILE, measure_tiles
from cape.kernels.jit import COMPILER_OFF, formula_of
from cape.kernels.linking import Linker
from cape.kernels.packing import Packed
from cape.kernels.state import State
from cape.kernels.team import Team
from skeleton.shapes import Box, Capsule, Cylinder, Ellipsoid, Plane, Shape, TaperedCapsule

FloatArray = NDArray[np.float64]
Kind = type[Shape]
KINDS: tuple[Kind, ...] = (Capsule, TaperedCapsule, Box, Plane, Cylinder, Ellipsoid)  # a sphere is a short capsule


def lengths(vectors: FloatArray) -> FloatArray:
    """Lengths of vectors (N, 3), shape (N,)."""
    return np.sqrt(np.einsum("nk,nk->n", vectors, vectors))


def capsule_distance(points: FloatArray, start: ArrayLike, end: ArrayLike, radius: float) -> FloatArray:
    """Distance of points (N, 3) from a capsule's surface [m], negative inside, shape (N,).

    The least of the distances from both ends and, between them, from the axis as a line.
    """
    a, b = np.asarray(start, float), np.asarray(end, float)
    from_start = points - a
    nearest = np.minimum(lengths(from_start), lengths(points - b))
    length = float(np.linalg.norm(b - a))
    if length > 0:
        axis = (b - a) / length
        along = from_start @ axis
        off_axis = lengths(from_start - along[:, None] * axis)
        nearest = np.where((along >= 0) & (along <= length), off_axis, nearest)
    return nearest - radius


def tapered_distance(points: FloatArray, start: ArrayLike, end: ArrayLike, radii: tuple[float, float]) -> FloatArray:
    """Distance of points (N, 3) from the hull of two spheres [m], negative inside, shape (N,).

    The hull is all spheres in between: the least of |p - c(s)| - r(s), a convex function of the way s along the axis,
    on ever finer grids.
    """
    a, b, shares = np.asarray(start, float), np.asarray(end, float), np.linspace(0.0, 1.0, 33)
    length, every = float(np.linalg.norm(b - a)), np.arange(len(points))
    if length == 0.0:
        return lengths(points - a) - max(radii)
    axis, grows = (b - a) / length, (radii[1] - radii[0]) / length
    along = (points - a) @ axis
    aside = (lengths(points - a - along[:, None] * axis) ** 2)[:, None]
    low, width = np.zeros(len(points)), length
    least = np.full(len(points), np.inf)
    for _ in range(10):
        steps = width * shares
        ahead = (low - along)[:, None] + steps
        off = np.sqrt(ahead * ahead + aside) - grows * steps
        best = off.argmin(axis=1)
        least = np.minimum(least, off[every, best] - grows * low)
        low = low + steps[best] - width / 32.0
        width *= 2.0 / 32.0
        low = np.minimum(np.maximum(low, 0.0), length - width)
    return least - radii[0]


def grid_of_weights(n: int) -> FloatArray:
    """Barycentric weights of a regular grid over a triangle, corners and edges with it, (W, 3)."""
    u, v = np.meshgrid(np.arange(n + 1), np.arange(n + 1))
    kept = u + v <= n
    return np.stack([u[kept], v[kept], n - u[kept] - v[kept]], axis=1) / n


def least_on_triangle(distances: Callable[[FloatArray], FloatArray], corners: FloatArray) -> float:
    """Least of some convex function of points (N, 3) on a triangle: of a grid, then of finer ones around the best."""
    coarse = grid_of_weights(20)
    weights, size, found = coarse, 1.0, []
    for _ in range(5):
        values = distances(weights @ corners)
        best = weights[values.argmin()]
        found.append(values.min())
        size *= 0.2
        weights = np.clip(best + size * (coarse - 1 / 3), 0, None)
        weights /= weights.sum(axis=1, keepdims=True)
    return float(min(found))


def box_distance(points: FloatArray, halves: ArrayLike) -> FloatArray:
    """Distance of points (N, 3), in the box's own frame, from its surface [m], negative inside, shape (N,)."""
    beyond = np.abs(points) - np.asarray(halves, float)
    deepest = beyond.max(axis=1)
    return np.where(deepest <= 0, deepest, lengths(np.maximum(beyond, 0.0)))


def cylinder_distance(points: FloatArray, half_length: float, radius: float) -> FloatArray:
    """Distance of points (N, 3) from a cylinder around the z axis, its middle at the origin [m], shape (N,).

    The least of the distances from the lines that its surface shows in the plane through the axis and the point.
    """
    at = np.stack([np.linalg.norm(points[:, :2], axis=1), np.abs(points[:, 2])], axis=1)
    on_side = np.stack([np.full(len(at), radius), np.clip(at[:, 1], 0.0, half_length)], axis=1)
    on_end = np.stack([np.clip(at[:, 0], 0.0, radius), np.full(len(at), half_length)], axis=1)
    least = np.minimum(np.linalg.norm(at - on_side, axis=1), np.linalg.norm(at - on_end, axis=1))
    return np.where((at[:, 0] < radius) & (at[:, 1] < half_length), -least, least)


def ellipsoid_distance(points: FloatArray, radii: ArrayLike) -> FloatArray:
    """Distance of points (N, 3), in the ellipsoid's own frame, from its surface [m], negative inside, shape (N,).

    The nearest of points on its surface, (r_x cos a cos b, r_y cos a sin b, r_z sin a), on ever finer grids. By
    symmetry an eighth of it will do, in which there is no other local minimum: the others are on other sides.
    """
    radii = np.asarray(radii, float)
    px, py, pz = np.abs(points).T[:, :, None, None]
    low, width, every = np.zeros((len(points), 2)), np.pi / 2.0, np.arange(len(points))
    least, shares = np.full(len(points), np.inf), np.linspace(0.0, 1.0, 17)
    for _ in range(53):  # down to angles of 1e-8, to which the distance answers with their square
        a, b = low[:, :1, None] + width * shares[:, None], low[:, 1:, None] + width * shares
        x, y, z = (
            radii[0] * np.cos(a) * np.cos(b) - px,
            radii[1] * np.cos(a) * np.sin(b) - py,
            radii[2] * np.sin(a) - pz,
        )
        off = (x * x + y * y + z * z).reshape(len(points), -1)
        best = off.argmin(axis=1)
        least = np.minimum(least, np.sqrt(off[every, best]))
        middle = low + width * shares[np.stack(np.divmod(best, len(shares)), axis=1)]
        width *= 0.7  # in the narrow valley of a flat ellipsoid the best of a grid is some cells off
        low = np.clip(middle - width / 2.0, 0.0, np.pi / 2.0 - width)
    return np.where(((points / radii) ** 2).sum(axis=1) < 1.0, -least, least)


def tapered_sizes(length: float, start_radius: float, end_radius: float) -> tuple[float, float, float, float]:
    """What the kernels know of a tapered capsule: the angle between axis and surface by its sine and tangent."""
    angle = np.arcsin((start_radius - end_radius) / length)
    return length, start_radius, float(np.sin(angle)), float(np.tan(angle))


def reference_distance(kind: Kind, sizes: ArrayLike, points: FloatArray) -> FloatArray:
    """Distance of points (N, 3) in a shape's own frame by the functions of this module, shape (N,)."""
    a, b, c, _ = np.asarray(sizes, float)
    if kind is Capsule:
        return capsule_distance(points, (0, 0, 0), (0, 0, a), b)
    if kind is TaperedCapsule:
        return tapered_distance(points, (0, 0, 0), (0, 0, a), (b, b - c * a))
    if kind is Box:
        return box_distance(points, (a, b, c))
    if kind is Cylinder:
        return cylinder_distance(points, a, b)
    if kind is Ellipsoid:
        return ellipsoid_distance(points, (a, b, c))
    return points[:, 2]


def room(count: int) -> Points:
    """Room for so many points as seen from a shape."""
    return Points(*np.zeros((7, count)))


@cache
def addresses(kind: Kind) -> tuple[int, int, int]:
    """Where the distances from a kind of shape are: `nearest`, `gaps` and `planes` of a record."""
    formula, numbers, points = formula_of(kind.nearest), ("float",) * 4, Packed(room(1)).kind
    wanted = (
        (formula, ("float",) * 7),
        (shapes.gaps.around(formula), (points, "int", "float", *numbers)),
        (shapes.planes.around(formula), (points, "int", *numbers)),
    )
    if COMPILER_OFF:
        shapes.numbered.extend(function for function, _ in wanted)
        first = len(shapes.numbered) - len(wanted)
        return first, first + 1, first + 2
    found, linker = [0, 0, 0], Linker()
    for k, (function, kinds) in enumerate(wanted):
        linker.want(store.Request(function, kinds), lambda address, k=k: found.__setitem__(k, address))
    linker.link()
    return found[0], found[1], found[2]


def record(
    kind: Kind,
    sizes: ArrayLike,
    *,
    thickness: float,
    friction: float = 0.0,
    bones: ArrayLike | None = None,
    origins: ArrayLike = (0.0, 0.0, 0.0),
    frames: ArrayLike | None = None,
    vertices: int = 1,
) -> Colliders:
    """Colliders of one kind, sizes (C, 4), for so many vertices; bone 0 carries them, in its own frame, unless told."""
    sizes = np.asarray(sizes, float).reshape(-1, 4)
    core = {
        Capsule: sizes[:, 1],
        TaperedCapsule: np.minimum(sizes[:, 1], sizes[:, 1] - sizes[:, 2] * sizes[:, 0]),
        Box: sizes[:, :3].min(axis=1),
        Plane: np.full(len(sizes), np.inf),
        Cylinder: sizes[:, :2].min(axis=1),
        Ellipsoid: sizes[:, :3].min(axis=1),
    }
    turned = np.tile(np.eye(3), (len(sizes), 1, 1)) if frames is None else np.asarray(frames, float)
    rows = np.zeros(len(sizes), COLLIDER).view(np.recarray)
    rows.bone = 0 if bones is None else bones
    rows.origin, rows.frame, rows.sizes, rows.core = origins, turned, sizes, core[kind]
    rows.thickness, rows.friction = thickness, friction
    rows.nearest, rows.gaps, rows.planes = addresses(kind)
    return _noted(rows, -(-vertices // TILE))


def together(*parts: Colliders) -> Colliders:
    """One list of the colliders of several, with notes of its own."""
    rows = np.concatenate([part.records for part in parts]).view(np.recarray)
    return _noted(rows, max(len(part.next) for part in parts))


def _noted(rows: Any, tiles: int) -> Colliders:
    count = len(rows)
    return Colliders(
        records=rows,
        active=np.array([count, *range(count)]),
        clock=np.zeros(2, np.int64),
        wake=np.zeros((tiles, count), np.int64),
        next=np.zeros(tiles, np.int64),
        spreads=np.zeros((tiles, 3)),
        alarm=np.full(tiles + 1, -1),
        hot=np.zeros(count + 1, np.int64),
        points=room(TILE),
        touches=np.zeros(TILE, np.int64),
        before=np.zeros((6, TILE)),
        between=np.ones(tiles, bool),
        pinched=np.zeros(TILE * tiles, bool),
        slips=np.full(TILE * tiles, NOT),
        beyond=np.full(count, NOT),
    )


def kind_of(colliders: Colliders, c: int = 0) -> Kind:
    """The kind of shape that one of some colliders has."""
    code = colliders.records.nearest[c]
    if COMPILER_OFF:
        return next(kind for kind in KINDS if formula_of(kind.nearest) is shapes.numbered[code])
    return next(kind for kind in KINDS if addresses(kind)[0] == code)


def faces_record(corners: NDArray[np.integer], starts: ArrayLike, tiles: ArrayLike, colliders: Colliders) -> Faces:
    """Triangles (3, F) in groups that are to be kept out of colliders, none of them longer than 20 cm."""
    groups = len(np.asarray(tiles))
    return Faces(
        corners=np.ascontiguousarray(corners.astype(np.uint32)),
        starts=np.array(starts, np.int64),
        tiles=np.array(tiles, np.int64),
        longest=0.2,
        exposed=np.ones((groups, len(colliders.records)), np.bool_),
        wake=np.zeros((groups, len(colliders.records)), np.int64),
        next=np.zeros(groups, np.int64),
        due=np.zeros(1, np.int64),
        middles=room(GROUP),
        seen=np.zeros((SEEN, GROUP)),
        known=np.zeros((corners.shape[1], 10)),
        known_of=np.full(corners.shape[1], -1),
        haste=np.zeros(1),
        pushed=np.zeros(1, np.int64),
    )


def still(count: int = 1) -> MotionRoom:
    """So many bones that stand still at the origin, unturned."""
    return moving(np.zeros((count, 3)))


def moving(
    velocity: ArrayLike,
    *,
    spin: ArrayLike | None = None,
    place: ArrayLike | None = None,
    matrix: ArrayLike | None = None,
) -> MotionRoom:
    """Bones with velocities [m/s] and spins [rad/s] (B, 3), now at places [m] (B, 3) and bone_to_world (B, 3, 3)."""
    v = np.array(velocity, float)
    return MotionRoom(
        matrices=np.tile(np.eye(3), (len(v), 1, 1)) if matrix is None else np.array(matrix, float),
        turns=np.tile(np.eye(3), (len(v), 1, 1)),
        velocity=v,
        spin=np.zeros_like(v) if spin is None else np.array(spin, float),
        positions=np.zeros_like(v) if place is None else np.array(place, float),
    )


def touching(
    s: State, colliders: Colliders, m: MotionRoom, *, free: ArrayLike | None = None, earlier=None, share: float = 1.0
) -> contact.Contact:
    """The contact of vertices, all of them free and of 1 kg unless told, with colliders."""
    loose = np.ones(s.x.size, bool) if free is None else np.asarray(free, bool)
    straight = earlier is None
    start = np.zeros((1, 1)) if earlier is None else earlier
    settled, drawn = np.full(1, NEVER), Drawn.blank(1, acts=False)
    return contact.Contact(s, loose.astype(float), loose, start, straight, colliders, m, share, settled, drawn)


def collide(
    lo: int, hi: int, free, s: State, earlier, colliders: Colliders, m: MotionRoom, share: float, turn: int, step: float
) -> None:
    """Contact of vertices with colliders, whose bones have moved, as in a frame."""
    colliders.clock[MOMENT] += 1
    measure_tiles(lo, hi, s, colliders.spreads, turn, step)
    contact.collide(touching(s, colliders, m, free=free, earlier=earlier, share=share), lo, hi, turn, step)


def keep_out(touch: contact.Contact, faces: Faces | None, turn: int, step: float) -> None:
    """All that a single thread does about colliders in a substep, whose bones have moved, in a frame's order."""
    team, duration = Team.alone(touch.state.x.size), np.ones(1)
    units.watch_tiles(units.Nearby(touch.state, touch.colliders, touch.bones, duration), team, turn, turn + 1, step)
    if faces is not None:
        units.keep_out(units.FirstLook(touch, True), team, turn, turn + 1, step)
        units.keep_faces_out(FaceContact(touch, faces), team, turn, turn + 1, step)
    units.keep_out(units.FirstLook(touch, False), team, turn, turn + 1, step)
