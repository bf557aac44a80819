"""One spring as the matrix of a Newton step has it; see `stiffness`."""

import math

from cape.kernels.jit import inlined


@inlined
def linearised(dx, dy, dz, stiffness, rest, stretched, tiny):
    """w and c of one spring along d [m]; `stretched` is 1 + tau/b and `tiny` [m2] keeps its length from being zero."""
    squared = dx * dx + dy * dy + dz * dz + tiny
    length = math.sqrt(squared)
    # Exactly 0 where the spring is compressed.
    c = stiffness * (max(length, rest) - rest) / length
    w = math.sqrt(stretched * stiffness - c) / length
    return w * dx, w * dy, w * dz, c
