"""Vertices of a mesh packed for XPBD: all that a constraint reads of one, or changes, in a single cache line.

A vertex has `SIDE` numbers: x, y, z [m], its inverse mass [1/kg], vx, vy, vz [m/s] and a zero. Behind the last one is
nobody, all zeros: constraints that fill up a list, or lack a vertex, are on it.

Constraints of one colour share no vertex, so that `LANES` of them may be solved side by side: `fetch` turns the numbers
of a vertex of each into rows of `LANES`, loops over these vectorise, and `put_back` returns the velocities.
"""

from cape.kernels.jit import intrinsic, kernel

SIDE = 8  # numbers of a vertex
LANES = 16  # constraints side by side
HALF, QUARTER = LANES // 2, 4  # what is turned at once: so many vertices, so many numbers of each
# Where the rows of a fetched vertex start, and that of the next one.
X, Y, Z, W, VX, VY, VZ, NEXT = (LANES * k for k in range(8))


@kernel
def pack(lo, hi, w, x, y, z, vx, vy, vz, packed):
    """Pack vertices lo to hi, and nobody."""
    for i in range(lo, hi):
        at = SIDE * i
        packed[at], packed[at + 1], packed[at + 2], packed[at + 3] = x[i], y[i], z[i], w[i]
        packed[at + 4], packed[at + 5], packed[at + 6], packed[at + 7] = vx[i], vy[i], vz[i], 0
    if lo == 0:
        packed[SIDE * x.size :] = 0


@kernel
def unpack(lo, hi, packed, vx, vy, vz):
    """Take the velocities of vertices lo to hi back."""
    for i in range(lo, hi):
        at = SIDE * i
        vx[i], vy[i], vz[i] = packed[at + 4], packed[at + 5], packed[at + 6]


def _fetch(packed, vertices, start, rows, place):
    """What `fetch` does, in numpy."""
    numbers = packed.reshape(-1, SIDE)[vertices[start : start + HALF]]
    for k in range(SIDE - 1):
        rows[place + LANES * k : place + LANES * k + HALF] = numbers[:, k]


@intrinsic(_fetch)
def fetch(typingctx, packed, vertices, start, rows, place):
    """Copy the numbers of `HALF` vertices from `start` on to rows that begin at `place`, x first and vz last."""
    from llvmlite import ir
    from numba import types

    def generate(context, builder, signature, arguments):
        points, listed, to = _data(context, builder, signature, arguments, (0, 1, 3))
        vector = ir.VectorType(points.type.pointee, QUARTER)
        for half in range(2):
            loaded = []
            for lane in range(HALF):
                at = _vertex(builder, points, listed, arguments[2], lane, QUARTER * half)
                loaded.append(builder.load(builder.bitcast(at, vector.as_pointer()), align=4))
            for k, turned in enumerate(_turned(builder, loaded)[: QUARTER - half]):
                row = ir.IntType(64)((QUARTER * half + k) * LANES)
                _store(builder, turned, builder.gep(to, [builder.add(arguments[4], row)]))
        return context.get_dummy_value()

    return types.void(packed, vertices, types.int64, rows, types.int64), generate


def _put_back(packed, vertices, start, rows, place):
    """What `put_back` does, in numpy."""
    numbers = packed.reshape(-1, SIDE)
    for k in range(3):
        numbers[vertices[start : start + HALF], 4 + k] = rows[place + VX + LANES * k : place + VX + LANES * k + HALF]


@intrinsic(_put_back)
def put_back(typingctx, packed, vertices, start, rows, place):
    """Copy the velocities of `HALF` vertices from `start` on back from their rows."""
    from llvmlite import ir
    from numba import types

    def generate(context, builder, signature, arguments):
        points, listed, given = _data(context, builder, signature, arguments, (0, 1, 3))
        number = points.type.pointee
        vector, zeros = ir.VectorType(number, HALF), ir.Constant(ir.VectorType(number, HALF), [0.0] * HALF)
        velocities = []
        for k in range(3):
            at = builder.gep(given, [builder.add(arguments[4], ir.IntType(64)(VX + LANES * k))])
            velocities.append(builder.load(builder.bitcast(at, vector.as_pointer()), align=4))
        for k, turned in enumerate(_network(builder, [*velocities, zeros])):
            for upper in range(2):
                part = _shuffle(builder, turned, turned, range(QUARTER * upper, QUARTER * (upper + 1)))
                lane = k + QUARTER * upper
                _store(builder, part, _vertex(builder, points, listed, arguments[2], lane, QUARTER))
        return context.get_dummy_value()

    return types.void(packed, vertices, types.int64, rows, types.int64), generate


def _data(context, builder, signature, arguments, which):
    """Where the numbers of some arrays begin."""
    return [context.make_array(signature.args[k])(context, builder, arguments[k]).data for k in which]


def _vertex(builder, points, listed, start, lane, number):
    """Where a number of the vertex of a lane is."""
    from llvmlite import ir

    word = ir.IntType(64)
    vertex = builder.zext(builder.load(builder.gep(listed, [builder.add(start, word(lane))])), word)
    return builder.gep(points, [builder.add(builder.shl(vertex, word(SIDE.bit_length() - 1)), word(number))])


def _turned(builder, vertices):
    """Four rows of `HALF` numbers from as many vertices' four."""
    whole = [_shuffle(builder, vertices[k], vertices[k + QUARTER], range(HALF)) for k in range(QUARTER)]
    return _network(builder, whole)


def _network(builder, rows):
    """Both halves of four rows of `HALF` numbers turned, each for itself: four by four numbers."""

    def pairs(a, b, first):
        return _shuffle(builder, a, b, [k + j for j in (first, first + QUARTER) for k in (0, 8, 1, 9)])

    def fours(a, b, first):
        return _shuffle(builder, a, b, [k + j for j in (first, first + QUARTER) for k in (0, 1, 8, 9)])

    first, second, third, fourth = rows
    turned = []
    for number in (0, 2):
        upper, lower = pairs(first, second, number), pairs(third, fourth, number)
        turned += [fours(upper, lower, 0), fours(upper, lower, 2)]
    return turned


def _shuffle(builder, a, b, order):
    """Numbers of two vectors in another order."""
    from llvmlite import ir

    kind = ir.IntType(32)
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(kind, len(order)), [kind(k) for k in order]))


def _store(builder, vector, at):
    """Store a vector."""
    builder.store(vector, builder.bitcast(at, vector.type.as_pointer()), align=4)
