"""Vectors of three numbers that lie side by side, SIDE numbers apart, fetched and kept LANES at a time.

To fetch one from anywhere takes a single load then, instead of three, and to keep LANES of them, which were computed
coordinate by coordinate, four stores: what is between is shuffled within registers. Places count pairs of numbers, as
an address of that is one the processor can make by itself.
"""

from typing import Any

import numpy as np

from cape.kernels.cloth.mesh import BLOCK
from cape.kernels.cloth.mesh_bending import SIDE
from cape.kernels.jit import inlined, intrinsic

LANES = 16  # points that are fetched or kept at a time
PAIRS = SIDE // 2  # of numbers, from one point's place to the next


@inlined
def fetch_row(places, points, to):
    """Copy the points at BLOCK places behind one another, coordinate by coordinate."""
    for first in range(0, BLOCK, LANES):
        fetch_points(places, points, to, first)


@inlined
def keep_row(values, points, at):
    """Copy BLOCK points, given coordinate by coordinate, side by side from a number on."""
    for first in range(0, BLOCK, LANES):
        keep_points(values, points, first, at)


def order_kept(count):
    """Where points are that are kept LANES at a time: as rows and columns of a square, turned over."""
    number = np.arange(count)
    return number // LANES * LANES + number % LANES % SIDE * (LANES // SIDE) + number % LANES // SIDE


def _fetch_points(places, points, to, first):
    """What `fetch_points` does, in numpy."""
    found = points.reshape(-1, SIDE)[places[first : first + LANES] // PAIRS]
    for axis in range(3):
        to[axis * BLOCK + first : axis * BLOCK + first + LANES] = found[:, axis]


def _keep_points(values, points, first, at):
    """What `keep_points` does, in numpy."""
    kept = points[at + SIDE * first : at + SIDE * (first + LANES)].reshape(LANES, SIDE)
    kept[order_kept(LANES), :3] = values[: 3 * BLOCK].reshape(3, BLOCK)[:, first : first + LANES].T


def _sum_points(places, points, start, end):
    """What `sum_points` does, in numpy."""
    total = points.reshape(-1, SIDE)[places[start:end] // PAIRS].sum(axis=0)
    return total[0], total[1], total[2]


@intrinsic(_fetch_points)
def fetch_points(typingctx, places, points, to, first):
    """Copy the points at places `first` to `first` + LANES of BLOCK."""
    from llvmlite import ir
    from numba import types

    def generate(context, builder, signature, arguments):
        number = context.get_value_type(points.dtype)
        rows, given, out = (_data(context, builder, signature, arguments, k) for k in range(3))

        def joined(parts):
            while len(parts) > 1:
                both = range(2 * parts[0].type.count)
                parts = [
                    _shuffle(builder, one, other, both) for one, other in zip(parts[::2], parts[1::2], strict=True)
                ]
            return parts[0]

        found = []
        for lane in range(LANES):
            place = builder.load(builder.gep(rows, [builder.add(arguments[3], ir.IntType(64)(lane))]))
            index = builder.shl(builder.zext(place, ir.IntType(64)), ir.IntType(64)(1))
            found.append(_load(builder, given, index, number, SIDE))
        # A square of four points in each quarter of the registers, turned over: x, y and z in order.
        a, b, c, d = (joined(found[k::SIDE]) for k in range(SIDE))
        one, other = _mixed(builder, a, b, False), _mixed(builder, c, d, False)
        z = _paired(builder, _mixed(builder, a, b, True), _mixed(builder, c, d, True), False)
        coordinates = [_paired(builder, one, other, False), _paired(builder, one, other, True), z]
        for axis, value in enumerate(coordinates):
            _store(builder, value, out, builder.add(arguments[3], ir.IntType(64)(axis * BLOCK)), number)
        return context.get_dummy_value()

    return types.void(places, points, to, types.int64), generate


@intrinsic(_keep_points)
def keep_points(typingctx, values, points, first, at):
    """Copy points `first` to `first` + LANES of BLOCK, given coordinate by coordinate, to where the BLOCK begin."""
    from llvmlite import ir
    from numba import types

    def generate(context, builder, signature, arguments):
        number, word = context.get_value_type(points.dtype), ir.IntType(64)
        given, out = (_data(context, builder, signature, arguments, k) for k in range(2))
        x, y, z = (
            _load(builder, given, builder.add(arguments[2], word(axis * BLOCK)), number, LANES) for axis in range(3)
        )
        begin = builder.add(arguments[3], builder.mul(arguments[2], word(SIDE)))
        for turn in range(SIDE):
            high = turn >= SIDE // 2
            two, three = _mixed(builder, x, y, high), _mixed(builder, z, z, high)
            value = _paired(builder, two, three, turn % 2 == 1)
            _store(builder, value, out, builder.add(begin, word(turn * LANES)), number)
        return context.get_dummy_value()

    return types.void(values, points, types.int64, types.int64), generate


@intrinsic(_sum_points)
def sum_points(typingctx, places, points, start, end):
    """Sum of the points at some places."""
    from llvmlite import ir
    from numba import types

    def generate(context, builder, signature, arguments):
        number, word = context.get_value_type(points.dtype), ir.IntType(64)
        rows, given = (_data(context, builder, signature, arguments, k) for k in range(2))
        before = builder.block
        head, body, after = (builder.append_basic_block(name) for name in ("list", "point", "sum"))
        builder.branch(head)
        builder.position_at_end(head)
        index, total = builder.phi(word), builder.phi(ir.VectorType(number, SIDE))
        builder.cbranch(builder.icmp_signed("<", index, arguments[3]), body, after)
        builder.position_at_end(body)
        place = builder.zext(builder.load(builder.gep(rows, [index])), word)
        added = builder.fadd(total, _load(builder, given, builder.shl(place, word(1)), number, SIDE))
        following = builder.add(index, word(1))
        builder.branch(head)
        index.add_incoming(arguments[2], before)
        index.add_incoming(following, body)
        total.add_incoming(ir.Constant(ir.VectorType(number, SIDE), [0.0] * SIDE), before)
        total.add_incoming(added, body)
        builder.position_at_end(after)
        parts = [builder.extract_element(total, ir.IntType(32)(axis)) for axis in range(3)]
        return context.make_tuple(builder, signature.return_type, parts)

    return types.UniTuple(points.dtype, 3)(places, points, types.int64, types.int64), generate


def _mixed(builder: Any, one: Any, other: Any, high: bool) -> Any:
    """Numbers of two vectors in turns, of the lower or the higher half of each quarter."""
    lanes = [SIDE * quarter + 2 * high + k for quarter in range(LANES // SIDE) for k in range(2)]
    return _shuffle(builder, one, other, [lane + LANES * of for lane in lanes for of in range(2)])


def _paired(builder: Any, one: Any, other: Any, high: bool) -> Any:
    """The lower or the higher halves of each quarter of two vectors."""
    halves = [SIDE * quarter + 2 * high for quarter in range(LANES // SIDE)]
    return _shuffle(
        builder, one, other, [half + LANES * of + k for half in halves for of in range(2) for k in range(2)]
    )


def _data(context: Any, builder: Any, signature: Any, arguments: Any, place: int) -> Any:
    """Where the array begins that is an argument."""
    return context.make_array(signature.args[place])(context, builder, arguments[place]).data


def _pointer(builder: Any, data: Any, index: Any, number: Any, lanes: int) -> Any:
    from llvmlite import ir

    return builder.bitcast(builder.gep(data, [index]), ir.VectorType(number, lanes).as_pointer())


def _load(builder: Any, data: Any, index: Any, number: Any, lanes: int) -> Any:
    return builder.load(_pointer(builder, data, index, number, lanes), align=4)


def _store(builder: Any, value: Any, data: Any, index: Any, number: Any) -> None:
    builder.store(value, _pointer(builder, data, index, number, value.type.count), align=4)


def _shuffle(builder: Any, one: Any, other: Any, lanes: Any) -> Any:
    """Lanes of two vectors that stand behind one another."""
    from llvmlite import ir

    mask = ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), list(lanes))
    return builder.shuffle_vector(one, other, mask)
