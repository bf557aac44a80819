"""Real numbers as whole ones in the same order, of which vector units find the least at once."""

import numpy as np

from cape.kernels.jit import inlined, intrinsic

MAGNITUDE = np.int64(2**63 - 1)  # the bits of a number, but for its sign


@inlined
def to_order(number):
    """A whole number for each real one, in the same order."""
    bits = bits_of(np.float64(number))  # pyright: ignore[reportCallIssue]
    return bits ^ ((bits >> np.int64(63)) & MAGNITUDE)


@inlined
def from_order(order):
    """The number that `to_order` gave this one for."""
    return number_of(np.int64(order ^ ((order >> np.int64(63)) & MAGNITUDE)))  # pyright: ignore[reportCallIssue]


@intrinsic(lambda number: number.view(np.int64))
def bits_of(typingctx, number):
    """The bits of a float64, as an int64."""
    from llvmlite import ir
    from numba import types

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], ir.IntType(64))

    return types.int64(types.float64), generate


@intrinsic(lambda bits: bits.view(np.float64))
def number_of(typingctx, bits):
    """The float64 of which these are the bits, an int64."""
    from llvmlite import ir
    from numba import types

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], ir.DoubleType())

    return types.float64(types.int64), generate
