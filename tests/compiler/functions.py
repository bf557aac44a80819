"""Small functions that processes of their own compile, which need nothing else of the tests for it."""

from cape.kernels.jit import routine
from cape.kernels.store import Request


@routine
def add(a, b):
    return a + b


@routine
def multiply(a, b):
    return a * b


@routine
def power(a, b):
    return float(a) ** b


@routine
def summed(values):
    result = 0.0
    for value in values:
        result += value
    return result


@routine
def scaled(values, factor):
    for i in range(values.size):
        values[i] *= factor


KINDS = ("int", "float")
REQUESTS = [Request(f, (a, b)) for f in (add, multiply, power) for a, b in zip(KINDS, KINDS, strict=True)]
