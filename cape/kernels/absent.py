"""Values that a scene may lack: None stays None, and the code that they would serve is pruned."""

from cape.kernels.jit import inlined


@inlined
def typed(number, array):
    """A number in the precision of an array."""
    if number is None:
        return None
    return array.dtype.type(number)


@inlined
def row(values, index):
    """A row of an array."""
    if values is None:
        return None
    return values[index]


@inlined
def part(values, lo, hi):
    """A view of lo to hi."""
    if values is None:
        return None
    return values[lo:hi]
