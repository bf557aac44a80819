"""XPBD's bend springs on a mesh: patches of vertices with three springs each, see `cape.assembly.mesh.curvature`.

A patch has about eleven vertices, of each of which a spring is linear in the position. To fetch the three coordinates
of a vertex as one vector of four numbers, from where it is packed, costs less than to turn vertices of many patches
into rows: nothing is copied, and patches need not be equally large.
"""

from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.absent import part, row
from cape.kernels.jit import inlined, intrinsic, kernel, routine
from cape.kernels.team import meet, share
from cape.kernels.xpbd.formulas import Constraints, change_of
from cape.kernels.xpbd.packed import SIDE

Array = NDArray[np.floating]

WIDE = 4  # numbers of a vector: three coordinates and one that does not matter
ROWS = 3  # springs of a patch


class BendConstraints(NamedTuple):
    """K patches sorted by colour, each colour from its place in `starts` to the next. The vertices of patch k stand in
    `members` from `first[k]` to `first[k + 1]`, and three times as far in `coefficients` those of its three springs, by
    vertex. `mixed` (K, 3) as in `bend_listed`; `bend` is flat, 3 K long."""

    first: NDArray[np.int64]
    members: NDArray[np.uint32]
    coefficients: Array
    mixed: Array
    starts: NDArray[np.int64]
    bend: Constraints


@routine
def count_members(coefficients, counts):
    """Count the vertices of patches that any of their springs leads to, (K,); `coefficients` (K, 3, M)."""
    for k in range(counts.size):
        counts[k] = 0
        for m in range(coefficients.shape[2]):
            counts[k] += is_member(coefficients, k, m)


@routine
def lay_bends(vertices, coefficients, weights, order, first, members, table, mixed, mobility):
    """Lay out patches in an order (K,), from their `vertices` (K, M), `coefficients` (K, 3, M), and the inverse masses
    of all vertices [1/kg], as `BendConstraints` has them; `mobility` is of shape (K, 3)."""
    n = 0
    for k in range(order.size):
        p = order[k]
        first[k] = n
        aa = bb = cc = ab = ac = bc = 0.0
        for m in range(vertices.shape[1]):
            if is_member(coefficients, p, m):
                a, b, c = coefficients[p, 0, m], coefficients[p, 1, m], coefficients[p, 2, m]
                w = weights[vertices[p, m]]
                aa, bb, cc = aa + w * a * a, bb + w * b * b, cc + w * c * c
                ab, ac, bc = ab + w * a * b, ac + w * a * c, bc + w * b * c
                members[n] = vertices[p, m]
                table[ROWS * n], table[ROWS * n + 1], table[ROWS * n + 2] = a, b, c
                n += 1
        mobility[k, 0], mobility[k, 1], mobility[k, 2] = aa, bb, cc
        mixed[k, 0], mixed[k, 1], mixed[k, 2] = ab, ac, bc
    first[order.size] = n


@inlined
def is_member(coefficients, k, m):
    """Whether any spring of patch k leads to its vertex m."""
    return (coefficients[k, 0, m] != 0.0) | (coefficients[k, 1, m] != 0.0) | (coefficients[k, 2, m] != 0.0)


@routine
def bend_patches(c, time, packed, team):
    """Go through all patches, if there are any, colour by colour."""
    if c is not None:
        bends = c.bend
        for colour in range(c.starts.size - 1):
            lo, hi = share(c.starts[colour], c.starts[colour + 1], team)
            a, e = ROWS * lo, ROWS * hi
            bend_listed(
                c.first[lo : hi + 1], c.members, c.coefficients, c.mixed[lo:hi], time, bends.gain[a:e],
                part(bends.slack, a, e), part(row(bends.impulse, 0), a, e), part(row(bends.impulse, 1), a, e),
                part(row(bends.impulse, 2), a, e), packed,
            )  # fmt: skip
            meet(team)


@kernel
def bend_listed(
    first, members, coefficients, mixed, time, gain, slack, impulse_x, impulse_y, impulse_z, packed
):  # fmt: skip
    """C(p) = sum c_a p_a for three springs of each patch, along all three coordinates; `time` is h + tau.

    The springs are solved one after the other as if each were by itself; but all are told before any vertex is changed,
    and what one changes of the next ones' C is known beforehand: `mixed` (K, 3), the sums w c c' of the springs 0 and
    1, 0 and 2, 1 and 2 [1/kg].
    """
    for k in range(mixed.shape[0]):
        lo, hi = first[k], first[k + 1]
        ax, ay, az, bx, by, bz, cx, cy, cz = bent(packed, members, coefficients, lo, hi, time)
        ax, bx, cx = three_changes(k, ax, bx, cx, mixed, time, gain, slack, impulse_x)
        ay, by, cy = three_changes(k, ay, by, cy, mixed, time, gain, slack, impulse_y)
        az, bz, cz = three_changes(k, az, bz, cz, mixed, time, gain, slack, impulse_z)
        straighten(packed, members, coefficients, lo, hi, ax, ay, az, bx, by, bz, cx, cy, cz)


@inlined
def three_changes(k, a, b, c, mixed, time, gain, slack, impulse):
    """What is added to the impulses of patch k along one coordinate, of whose bend springs C is given."""
    a = change_of(gain[3 * k] * a, 3 * k, slack, impulse)
    b = change_of(gain[3 * k + 1] * (b - time * mixed[k, 0] * a), 3 * k + 1, slack, impulse)
    c = change_of(gain[3 * k + 2] * (c - time * (mixed[k, 1] * a + mixed[k, 2] * b)), 3 * k + 2, slack, impulse)
    return a, b, c


def _bent(packed, members, coefficients, lo, hi, time):
    """What `bent` does, in numpy."""
    vertices = packed.reshape(-1, SIDE)[members[lo:hi]]
    moved = vertices[:, :3] + time * vertices[:, 4:7]
    return tuple((coefficients[ROWS * lo : ROWS * hi].reshape(-1, ROWS).T @ moved).ravel())


@intrinsic(_bent)
def bent(typingctx, packed, members, coefficients, lo, hi, time):
    """C of three springs, each along three coordinates, on the listed vertices from lo to hi, `time` later."""
    from llvmlite import ir
    from numba import types

    def generate(context, builder, signature, arguments):
        walk = _Walk(context, builder, signature, arguments)
        later = walk.spread(arguments[5])
        with walk.vertices() as (point, own):
            moved = walk.fused(later, walk.load(builder.gep(point, [walk.word(WIDE)])), walk.load(point))
            walk.sums = [walk.fused(c, moved, total) for c, total in zip(own, walk.sums, strict=True)]
        lane = ir.IntType(32)
        parts = [builder.extract_element(total, lane(axis)) for total in walk.sums for axis in range(3)]
        return context.make_tuple(builder, signature.return_type, parts)

    arguments = (packed, members, coefficients, types.int64, types.int64, time)
    return types.UniTuple(packed.dtype, 9)(*arguments), generate


def _straighten(packed, members, coefficients, lo, hi, *changes):
    """What `straighten` does, in numpy."""
    vertices = packed.reshape(-1, SIDE)
    own = coefficients[ROWS * lo : ROWS * hi].reshape(-1, ROWS)
    which = members[lo:hi]
    vertices[which, 4:7] -= vertices[which, 3, None] * (own @ np.reshape(changes, (ROWS, 3)))


@intrinsic(_straighten)
def straighten(typingctx, packed, members, coefficients, lo, hi, ax, ay, az, bx, by, bz, cx, cy, cz):
    """Take impulses a, b and c along the gradients of three springs from the listed vertices from lo to hi."""
    from llvmlite import ir
    from numba import types

    def generate(context, builder, signature, arguments):
        walk, lane = _Walk(context, builder, signature, arguments), ir.IntType(32)
        changes = []
        for k in range(ROWS):
            change = ir.Constant(walk.vector, [0.0] * WIDE)
            for axis in range(3):
                change = builder.insert_element(change, arguments[5 + 3 * k + axis], lane(axis))
            changes.append(change)
        with walk.vertices() as (point, own):
            weight = walk.spread(builder.fneg(builder.load(builder.gep(point, [walk.word(3)]))))
            taken = builder.fmul(own[0], changes[0])
            for c, change in zip(own[1:], changes[1:], strict=True):
                taken = walk.fused(c, change, taken)
            at = builder.gep(point, [walk.word(WIDE)])
            walk.store(walk.fused(weight, taken, walk.load(at)), at)
        return context.get_dummy_value()

    return types.void(
        packed, members, coefficients, types.int64, types.int64, ax, ay, az, bx, by, bz, cx, cy, cz
    ), generate


class _Walk:
    """Generates a loop over listed vertices, with three vectors that it may keep as sums."""

    def __init__(self, context, builder, signature, arguments):
        from llvmlite import ir

        self.builder, self.word = builder, ir.IntType(64)
        self.points, self.members, self.coefficients = (
            context.make_array(kind)(context, builder, value).data
            for kind, value in zip(signature.args[:3], arguments[:3], strict=True)
        )
        self.lo, self.hi = arguments[3:5]
        self.number = self.points.type.pointee
        self.vector = ir.VectorType(self.number, WIDE)
        self.sums = [ir.Constant(self.vector, [0.0] * WIDE)] * ROWS

    @contextmanager
    def vertices(self):
        """The body of the loop: where the vertex is, and its three coefficients as vectors."""

        builder, before = self.builder, self.builder.block
        head, body, after = (builder.append_basic_block(name) for name in ("patch", "vertex", "end"))
        builder.branch(head)
        builder.position_at_end(head)
        index = builder.phi(self.word)
        index.add_incoming(self.lo, before)
        totals = [builder.phi(self.vector) for _ in self.sums]
        for total, start in zip(totals, self.sums, strict=True):
            total.add_incoming(start, before)
        self.sums = totals
        builder.cbranch(builder.icmp_signed("<", index, self.hi), body, after)
        builder.position_at_end(body)
        vertex = builder.zext(builder.load(builder.gep(self.members, [index])), self.word)
        place = builder.mul(index, self.word(ROWS))
        own = [
            self.spread(builder.load(builder.gep(self.coefficients, [builder.add(place, self.word(k))])))
            for k in range(ROWS)
        ]
        yield builder.gep(self.points, [builder.shl(vertex, self.word(SIDE.bit_length() - 1))]), own
        for total, following in zip(totals, self.sums, strict=True):
            total.add_incoming(following, builder.block)
        index.add_incoming(builder.add(index, self.word(1)), builder.block)
        builder.branch(head)
        builder.position_at_end(after)
        self.sums = totals

    def spread(self, number):
        """A vector of equal numbers."""
        from llvmlite import ir

        lane = self.builder.insert_element(ir.Constant(self.vector, ir.Undefined), number, ir.IntType(32)(0))
        every = ir.Constant(ir.VectorType(ir.IntType(32), WIDE), [0] * WIDE)
        return self.builder.shuffle_vector(lane, ir.Constant(self.vector, ir.Undefined), every)

    def load(self, place):
        """The vector at a place."""
        return self.builder.load(self.builder.bitcast(place, self.vector.as_pointer()), align=4)

    def store(self, vector, place):
        """Store a vector."""
        self.builder.store(vector, self.builder.bitcast(place, self.vector.as_pointer()), align=4)

    def fused(self, a, b, c):
        """a b + c, as `kernels.fused` does."""
        from llvmlite import ir
        from numba.core import cgutils

        name = f"llvm.fmuladd.v{WIDE}{'f32' if isinstance(self.number, ir.FloatType) else 'f64'}"
        kind = ir.FunctionType(self.vector, (self.vector,) * 3)
        return self.builder.call(cgutils.get_or_insert_function(self.builder.module, kind, name), [a, b, c])
