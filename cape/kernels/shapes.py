"""Colliders as arrays: a record for each kind of shape, where they are, and how far a point is from one."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll
from numba.extending import overload
from numpy.typing import NDArray

from cape.kernels.distance import to_box, to_capsule, to_cylinder, to_ellipsoid, to_plane, to_tapered_capsule
from cape.kernels.jit import INLINED, driver, inlined

Array = NDArray[np.float64]


COLLIDER = np.dtype(
    [
        ("bone", np.int64),
        ("origin", np.float64, 3),
        ("frame", np.float64, (3, 3)),
        ("sizes", np.float64, 4),
        ("core", np.float64),
        ("thickness", np.float64),
        ("friction", np.float64),
        ("thin", np.int64),
        ("placed", np.float64, 12),
        ("placed_at", np.int64),
    ],
    align=True,
)
"""A collider: `bone` carries it, `origin` [m] and `frame` shape_to_bone place its own frame, in which `sizes` say what
it is (`kernels.distance`). `core` [m] is how far a point may go at once without passing the middle, `thickness` [m] the
distance at which the cloth is stopped; triangles must be kept out of it where it is `thin` as against them.

`placed` is shape_to_world as the rows of a rotation and an origin [m], as of the moment `placed_at`.
"""

MOMENT, DUE = 0, 1


class Shapes(NamedTuple):
    """C colliders of one kind, and what is noted about them and the T tiles of vertices during a frame.

    `colliders` (C,) are records of `COLLIDER`; `active` (C + 1,), how many the cloth may meet in this frame, and which;
    `clock`, the present `MOMENT`, which changes as the bones move, and when the next tile is `DUE`. For each tile
    `wake` (T, C), the turn of contact at which it must look at an active one again, and `next` (T,), the first of them.
    Shared by all kinds, for each tile `spreads` (T, 3), its size [m], inner speed [m/s] and whether they hold,
    and `alarm` (T + 1,), the last turn in which it was hit hard, at last of all tiles. `hot` (C + 1,), how many a tile
    is about to touch, and which; `gaps` [m], how far its vertices are off one of them; `touches`, how many have touched
    each, and `before` (6, tile), where it was then and how fast. `between` (T,), which tiles two touched last;
    `pinched` (V,), which vertices two pinched.
    """

    colliders: Any  # a record array
    active: NDArray[np.int64]
    clock: NDArray[np.int64]
    wake: NDArray[np.int64]
    next: NDArray[np.int64]
    spreads: Array
    alarm: NDArray[np.int64]
    hot: NDArray[np.int64]
    gaps: Array
    touches: NDArray[np.int64]
    before: Array
    between: NDArray[np.bool_]
    pinched: NDArray[np.bool_]


class Capsules(Shapes):
    """Capsules and spheres."""


class TaperedCapsules(Shapes):
    """Capsules whose ends differ."""


class Boxes(Shapes):
    """Cuboids."""


class Planes(Shapes):
    """Half-spaces."""


class Cylinders(Shapes):
    """Cylinders with flat ends."""


class Ellipsoids(Shapes):
    """Ellipsoids."""


class Faces(NamedTuple):
    """Triangles that must be kept out of those `shapes` of a kind that are thin as against their size.

    `corners` (3, F) are vertices; those of group g of triangles, from `starts` (G + 1,) g to g + 1, hang on vertices of
    the same one of the `tiles` (G,), by edges of at most `longest` [m]. Notes: for each group `wake` (G, C) and `next`
    (G,), as for the tiles in Shapes; `due`, the first of those of each chunk of groups; `seen`, of the group
    that is looked at, how far each triangle is off [m], and scratch; `haste`, how far a collider came past triangles
    in one step at most, as a share of what contact can follow; `pushed`, the last turn in which any of them touched.
    """

    shapes: Shapes
    corners: NDArray[np.uint32]
    starts: NDArray[np.int64]
    tiles: NDArray[np.int64]
    longest: float
    wake: NDArray[np.int64]
    next: NDArray[np.int64]
    due: NDArray[np.int64]
    seen: Array
    haste: Array
    pushed: NDArray[np.int64]


DISTANCES: dict[type[Shapes], Callable[..., Any]] = {
    Capsules: to_capsule,
    TaperedCapsules: to_tapered_capsule,
    Boxes: to_box,
    Planes: to_plane,
    Cylinders: to_cylinder,
    Ellipsoids: to_ellipsoid,
}
"""The signed distance of each kind."""


def signed_distance(shapes, x, y, z, a, b, c, d):
    """Signed distance [m] of a point from a shape of the record's kind with sizes a to d, and the normal there."""
    return DISTANCES[type(shapes)](x, y, z, a, b, c, d)


@overload(signed_distance, jit_options=INLINED)  # pyright: ignore[reportArgumentType]
def _signed_distance_of_kind(shapes, x, y, z, a, b, c, d):
    """Compile the distance of the record's kind in, and no other."""
    distance = DISTANCES[shapes.instance_class]

    def implementation(shapes, x, y, z, a, b, c, d):
        return distance(x, y, z, a, b, c, d)

    return implementation


@inlined
def nearest(shapes, c, x, y, z):
    """Signed distance [m] of a point in the frame of collider c, and the normal there."""
    sizes = shapes.colliders[c].sizes
    return signed_distance(shapes, x, y, z, sizes[0], sizes[1], sizes[2], sizes[3])


@inlined
def place(shapes, c, positions, matrices):
    """Set where collider c is, given the bones' `positions` [m] (B, 3) and `matrices` bone_to_world (B, 3, 3)."""
    collider = shapes.colliders[c]
    if collider.placed_at != shapes.clock[MOMENT]:
        collider.placed_at = shapes.clock[MOMENT]
        _place(collider, positions[collider.bone], matrices[collider.bone])


@driver
def _place(collider, position, m):
    origin, frame, out = collider.origin, collider.frame, collider.placed
    for i in range(3):
        out[9 + i] = position[i] + m[i, 0] * origin[0] + m[i, 1] * origin[1] + m[i, 2] * origin[2]
        for j in range(3):
            out[3 * i + j] = m[i, 0] * frame[0, j] + m[i, 1] * frame[1, j] + m[i, 2] * frame[2, j]


@inlined
def numbers_of(shapes, c):
    """Where collider c is placed, as `placed`, and its sizes, both out of memory: loops over points then vectorise."""
    r, sizes = shapes.colliders[c].placed, shapes.colliders[c].sizes
    placed = r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9], r[10], r[11]
    return placed, (sizes[0], sizes[1], sizes[2], sizes[3])


@driver
def forget_places(groups):
    """Note that the bones have moved."""
    if groups is not None:
        for shapes in literal_unroll(groups):
            shapes.clock[MOMENT] += 1


@inlined
def into_shape(r, x, y, z):
    """A point of the world in the frame of a shape; `r` is its row of `placed`."""
    x, y, z = x - r[9], y - r[10], z - r[11]
    return r[0] * x + r[3] * y + r[6] * z, r[1] * x + r[4] * y + r[7] * z, r[2] * x + r[5] * y + r[8] * z


@inlined
def direction_to_world(r, x, y, z):
    """A direction of a shape's frame in the world."""
    return r[0] * x + r[1] * y + r[2] * z, r[3] * x + r[4] * y + r[5] * z, r[6] * x + r[7] * y + r[8] * z


@inlined
def distance_to(shapes, c, x, y, z):
    """Signed distance [m] of a point of the world from collider c, which is placed, and the normal in the world."""
    r = shapes.colliders[c].placed
    lx, ly, lz = into_shape(r, x, y, z)
    distance, nx, ny, nz = nearest(shapes, c, lx, ly, lz)
    nx, ny, nz = direction_to_world(r, nx, ny, nz)
    return distance, nx, ny, nz
