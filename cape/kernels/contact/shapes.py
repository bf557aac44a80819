"""Colliders as arrays: one record each, where they are, and how far a point is from one.

What kind of shape a collider has is data: its record holds the addresses of the code that tells distances from that
shape. So all kinds are in one list, and a scene's code has the distances of its own shapes and no others.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.contact.order import from_order, to_order
from cape.kernels.jit import Function, inlined, intrinsic, loop, routine

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
        ("tip", np.float64, 3),
        ("placed", np.float64, 12),
        ("placed_at", np.int64),
        ("nearest", np.int64),
        ("gaps", np.int64),
        ("planes", np.int64),
    ],
    align=True,
)
"""A collider: `bone` carries it, `origin` [m] and `frame` shape_to_bone place its own frame, in which `sizes` say what
it is. `core` [m] is how far a point may go at once without passing the middle, `thickness` [m] the distance at which
the cloth is stopped; `tip` is the unit vector, in its own frame, along which the limb leads that it surrounds, zero
where it is none.

`placed` is shape_to_world as the rows of a rotation and an origin [m], as of the moment `placed_at`. `nearest`, `gaps`
and `planes` are the addresses of the shape's distances: from a point, from a tile of them, and from triangles' middles.
"""

MOMENT, DUE = 0, 1


class Points(NamedTuple):
    """Points in the frame of a shape [m], how far each is off it less a thickness [m], and the normals there, (n,)."""

    x: Array
    y: Array
    z: Array
    gaps: Array
    nx: Array
    ny: Array
    nz: Array


class Colliders(NamedTuple):
    """C colliders, and what is noted about them and the T tiles of vertices during a frame.

    `records` (C,) are records of `COLLIDER`; `active` (C + 1,), how many the cloth may meet in this frame, and which;
    `clock`, the present `MOMENT`, which changes as the bones move, and when the next tile is `DUE`. For each tile
    `wake` (T, C), the turn of contact at which it must look at an active one again, and `next` (T,), the first of them;
    `spreads` (T, 3), its size [m], inner speed [m/s] and whether they hold, and `alarm` (T + 1,), the last turn in
    which it was hit hard, at last of all tiles. `hot` (C + 1,), how many a tile is about to touch, and which; `points`,
    room for its vertices as seen from one of them; `touches`, how many have touched each, and `before` (6, tile), where
    it was then and how fast. `between` (T,), which tiles two touched last; `pinched` (V,), which vertices two pinched;
    `slips` (V,), the collider that each slips off, and `beyond` (C,), the one that goes on where a limb ends, -1 for
    none (see `contact.slip`).
    """

    records: Any  # a record array
    active: NDArray[np.int64]
    clock: NDArray[np.int64]
    wake: NDArray[np.int64]
    next: NDArray[np.int64]
    spreads: Array
    alarm: NDArray[np.int64]
    hot: NDArray[np.int64]
    points: Points
    touches: NDArray[np.int64]
    before: Array
    between: NDArray[np.bool_]
    pinched: NDArray[np.bool_]
    slips: NDArray[np.int64]
    beyond: NDArray[np.int64]


class Faces(NamedTuple):
    """Triangles that must be kept out of those colliders that are thin as against their size.

    `corners` (3, F) are vertices; those of group g of triangles, from `starts` (G + 1,) g to g + 1, hang on vertices of
    the same one of the `tiles` (G,), by edges of at most `longest` [m]; `exposed` (G, C) tells which colliders are thin
    as against any of them. Notes: for each group `wake` (G, C) and `next`
    (G,), as for the tiles of `Colliders`; `due`, the first of those of each chunk of groups; `middles`, of the group
    that is looked at, and `seen`, its triangles; `known` (F, 10), a bound from below of each triangle's distance [m]
    from the collider `known_of` (F,), and the corners in that collider's frame then; `haste`, how far a collider came
    past triangles in one step at most, as a share of what contact can follow; `pushed`, the last turn in which any of
    them touched.
    """

    corners: NDArray[np.uint32]
    starts: NDArray[np.int64]
    tiles: NDArray[np.int64]
    longest: float
    exposed: NDArray[np.bool_]
    wake: NDArray[np.int64]
    next: NDArray[np.int64]
    due: NDArray[np.int64]
    middles: Points
    seen: Array
    known: Array
    known_of: NDArray[np.int64]
    haste: Array
    pushed: NDArray[np.int64]


# -- a shape's own code --


@loop
def gaps(formula: Function) -> Any:
    """How far points are off a shape, less a thickness [m]; returns the least."""

    def gaps(points, count, thickness, a, b, c, d):
        x, y, z, out = points.x, points.y, points.z, points.gaps
        least = to_order(np.inf)
        for i in range(count):
            distance, _, _, _ = formula(x[i], y[i], z[i], a, b, c, d)
            gap = distance - thickness
            out[i] = gap
            least = min(least, to_order(gap))
        return from_order(least)

    return gaps


@loop
def planes(formula: Function) -> Any:
    """How far points are off a shape [m], with the normals there."""

    def planes(points, count, a, b, c, d):
        x, y, z, out, nx, ny, nz = points.x, points.y, points.z, points.gaps, points.nx, points.ny, points.nz
        for i in range(count):
            out[i], nx[i], ny[i], nz[i] = formula(x[i], y[i], z[i], a, b, c, d)

    return planes


numbered: list[Function] = []
"""Functions that stand behind their numbers where the compiler is off: they have no addresses then."""


@intrinsic(lambda code, *given: numbered[code].python(*given))
def nearest_by(typingctx, code, x, y, z, a, b, c, d):
    """Call the distance from a point that is at an address."""
    from numba import types

    number = types.float64
    return _caller(types.UniTuple(number, 4), (number,) * 7)


@intrinsic(lambda code, *given: numbered[code].python(*given))
def gaps_by(typingctx, code, points, count, thickness, a, b, c, d):
    """Call the `gaps` that are at an address."""
    from numba import types

    number = types.float64
    return _caller(number, (points, types.int64, number, number, number, number, number))


@intrinsic(lambda code, *given: numbered[code].python(*given))
def planes_by(typingctx, code, points, count, a, b, c, d):
    """Call the `planes` that are at an address."""
    from numba import types

    number = types.float64
    return _caller(types.none, (points, types.int64, number, number, number, number))


def _caller(result, given):
    """Signature and code of a call, by address, of what numba's conventions compile for these types."""
    from numba import types

    def generate(context, builder, signature, arguments):
        conventions = context.call_conv
        function = builder.inttoptr(arguments[0], conventions.get_function_type(result, given).as_pointer())
        _, value = conventions.call_function(builder, function, result, given, arguments[1:])
        return value

    return result(types.int64, *given), generate


# -- where colliders are --


@inlined
def nearest(colliders, c, x, y, z):
    """Signed distance [m] of a point in the frame of collider c, and the normal there."""
    record = colliders.records[c]
    sizes = record.sizes
    return nearest_by(record.nearest, x, y, z, sizes[0], sizes[1], sizes[2], sizes[3])


@inlined
def place(colliders, c, bones):
    """Set where collider c is, given where the `bones` are, a `MotionRoom`."""
    record = colliders.records[c]
    if record.placed_at != colliders.clock[MOMENT]:
        record.placed_at = colliders.clock[MOMENT]
        _place(record, bones.positions[record.bone], bones.matrices[record.bone])


@routine
def _place(record, position, m):
    origin, frame, out = record.origin, record.frame, record.placed
    for i in range(3):
        out[9 + i] = position[i] + m[i, 0] * origin[0] + m[i, 1] * origin[1] + m[i, 2] * origin[2]
        for j in range(3):
            out[3 * i + j] = m[i, 0] * frame[0, j] + m[i, 1] * frame[1, j] + m[i, 2] * frame[2, j]


@inlined
def numbers_of(placed):
    """Where a collider is, out of memory: loops over points then vectorise."""
    r = placed
    return r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9], r[10], r[11]


@routine
def forget_places(colliders):
    """Note that the bones have moved; nothing for None."""
    if colliders is not None:
        colliders.clock[MOMENT] += 1


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
def distance_to(colliders, c, x, y, z):
    """Signed distance [m] of a point of the world from collider c, which is placed, and the normal in the world."""
    r = colliders.records[c].placed
    lx, ly, lz = into_shape(r, x, y, z)
    distance, nx, ny, nz = nearest(colliders, c, lx, ly, lz)
    nx, ny, nz = direction_to_world(r, nx, ny, nz)
    return distance, nx, ny, nz
