"""Signed distances from shapes, many points at once, sharing nothing with the package's own, and records by hand."""

import numpy as np
from cape.kernels.records import MotionRoom, State
from numpy.typing import ArrayLike, NDArray

from cape.kernels.contact import contact
from cape.kernels.contact.shapes import COLLIDER, MOMENT, Boxes, Capsules, Planes, Shapes, TaperedCapsules
from cape.kernels.contact.watch import TILE, measure_tiles

FloatArray = NDArray[np.float64]


def capsule_distance(points: FloatArray, start: ArrayLike, end: ArrayLike, radius: float) -> FloatArray:
    """Distance of points (N, 3) from a capsule's surface [m], negative inside, shape (N,).

    The least of the distances from both ends and, between them, from the axis as a line.
    """
    a, b = np.asarray(start, float), np.asarray(end, float)
    nearest = np.minimum(np.linalg.norm(points - a, axis=1), np.linalg.norm(points - b, axis=1))
    length = float(np.linalg.norm(b - a))
    if length > 0:
        axis = (b - a) / length
        along = (points - a) @ axis
        off_axis = np.linalg.norm(np.cross(points - a, axis), axis=1)
        nearest = np.where((along >= 0) & (along <= length), off_axis, nearest)
    return nearest - radius


def tapered_distance(points: FloatArray, start: ArrayLike, end: ArrayLike, radii: tuple[float, float]) -> FloatArray:
    """Distance of points (N, 3) from the hull of two spheres [m], negative inside, shape (N,).

    The hull is all spheres in between: the least of |p - c(t)| - r(t), a convex function of t, on ever finer grids.
    """
    a, b, shares = np.asarray(start, float), np.asarray(end, float), np.linspace(0.0, 1.0, 33)
    low, width, every = np.zeros(len(points)), 1.0, np.arange(len(points))
    least = np.full(len(points), np.inf)
    for _ in range(10):
        t = low[:, None] + width * shares
        off = (
            np.linalg.norm(points[:, None] - a - t[:, :, None] * (b - a), axis=2) - radii[0] - t * (radii[1] - radii[0])
        )
        best = off.argmin(axis=1)
        least = np.minimum(least, off[every, best])
        low = np.clip(t[every, best] - width / 32.0, 0.0, 1.0)
        width *= 2.0 / 32.0
        low = np.minimum(low, 1.0 - width)
    return least


def box_distance(points: FloatArray, halves: ArrayLike) -> FloatArray:
    """Distance of points (N, 3), in the box's own frame, from its surface [m], negative inside, shape (N,)."""
    beyond = np.abs(points) - np.asarray(halves, float)
    outside = np.linalg.norm(np.clip(beyond, 0, None), axis=1)
    return np.where((beyond <= 0).all(axis=1), beyond.max(axis=1), outside)


def tapered_sizes(length: float, start_radius: float, end_radius: float) -> tuple[float, float, float, float]:
    """What the kernels know of a tapered capsule: the angle between axis and surface by its sine and tangent."""
    angle = np.arcsin((start_radius - end_radius) / length)
    return length, start_radius, float(np.sin(angle)), float(np.tan(angle))


def reference_distance(kind: type[Shapes], sizes: ArrayLike, points: FloatArray) -> FloatArray:
    """Distance of points (N, 3) in a shape's own frame by the functions of this module, shape (N,)."""
    a, b, c, _ = np.asarray(sizes, float)
    if kind is Capsules:
        return capsule_distance(points, (0, 0, 0), (0, 0, a), b)
    if kind is TaperedCapsules:
        return tapered_distance(points, (0, 0, 0), (0, 0, a), (b, b - c * a))
    if kind is Boxes:
        return box_distance(points, (a, b, c))
    return points[:, 2]


def record(
    kind: type[Shapes],
    sizes: ArrayLike,
    *,
    thickness: float,
    friction: float = 0.0,
    bones: ArrayLike | None = None,
    origins: ArrayLike = (0.0, 0.0, 0.0),
    frames: ArrayLike | None = None,
    vertices: int = 1,
) -> Shapes:
    """Colliders of one kind, sizes (C, 4), for so many vertices; bone 0 carries them, in its own frame, unless told."""
    sizes = np.asarray(sizes, float).reshape(-1, 4)
    count, tiles = len(sizes), -(-vertices // TILE)
    core = {
        Capsules: sizes[:, 1],
        TaperedCapsules: np.minimum(sizes[:, 1], sizes[:, 1] - sizes[:, 2] * sizes[:, 0]),
        Boxes: sizes[:, :3].min(axis=1),
        Planes: np.full(count, np.inf),
    }
    turned = np.tile(np.eye(3), (count, 1, 1)) if frames is None else np.asarray(frames, float)
    rows = np.zeros(count, COLLIDER).view(np.recarray)
    rows.bone = 0 if bones is None else bones
    rows.origin, rows.frame, rows.sizes, rows.core = origins, turned, sizes, core[kind]
    rows.thickness, rows.friction = thickness, friction
    return kind(
        colliders=rows,
        active=np.array([count, *range(count)]),
        clock=np.zeros(2, np.int64),
        wake=np.zeros((tiles, count), np.int64),
        next=np.zeros(tiles, np.int64),
        spreads=np.zeros((tiles, 3)),
        alarm=np.full(tiles + 1, -1),
        hot=np.zeros(count + 1, np.int64),
        gaps=np.zeros(TILE),
        touches=np.zeros(TILE, np.int64),
        before=np.zeros((6, TILE)),
        between=np.ones(tiles, bool),
        pinched=np.zeros(TILE * tiles, bool),
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


def collide(
    lo: int, hi: int, free, s: State, earlier, shapes: Shapes, m: MotionRoom, share: float, turn: int, step: float
) -> None:
    """Contact of vertices with one kind of colliders, whose bones have moved, as in a frame."""
    shapes.clock[MOMENT] += 1
    measure_tiles(lo, hi, s, shapes.spreads, turn, step)
    contact.collide(lo, hi, free, s, earlier, shapes, m, share, turn, step)
