"""Real numbers as whole ones in the same order, of which vector units find the least at once."""

import numpy as np

from cape.kernels.jit import inlined

MAGNITUDE = np.int64(2**63 - 1)  # the bits of a number, but for its sign


@inlined
def to_order(number):
    """A whole number for each real one, in the same order."""
    bits = np.float64(number).view(np.int64)
    return bits ^ ((bits >> np.int64(63)) & MAGNITUDE)


@inlined
def from_order(order):
    """The number that `to_order` gave this one for."""
    return np.int64(order ^ ((order >> np.int64(63)) & MAGNITUDE)).view(np.float64)
