"""The lowest point of planes over a triangle against a linear programme that keeps them all."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from cape.kernels.contact import lowest
from cape.kernels.jit import routine
from tests.support.shapes import FloatArray

heights = st.one_of(st.integers(-8, 8).map(lambda k: k / 8), st.floats(-1, 1, allow_subnormal=False))
planes = st.lists(st.tuples(heights, heights, heights), min_size=1, max_size=7).map(np.array)


@routine
def of_one(a, b, c):
    (first, second, third), (u, v, t) = lowest.lowest_of_one(a, b, c)
    return *first, *second, *third, u, v, t


@routine
def row(r, k):
    return r[k, 0], r[k, 1], r[k, 2], r[k, 3]


@routine
def with_another(r, a, b, c):
    rows = row(r, 0), row(r, 1), row(r, 2)
    (first, second, third), (u, v, t) = lowest.lowest_of(lowest.entered(rows, a, b, c))
    return *first, *second, *third, u, v, t


def lowest_point(given: FloatArray) -> tuple[FloatArray, list[float]]:
    """Weights of the last lowest point when planes (P, 3) come in one after the other, and all heights on the way."""
    *rows, u, v, t = of_one(*map(float, given[0]))
    found = [t]
    for plane in given[1:]:
        if np.array([u, v, 1.0 - u - v]) @ plane > t + 1e-9:
            *rows, u, v, t = with_another(np.reshape(rows, (3, 4)), *map(float, plane))
            found.append(t)
    return np.array([u, v, 1.0 - u - v]), found


def reference(given: FloatArray) -> float:
    """The least over the triangle of the highest of planes (P, 3)."""
    solved = linprog(
        [0.0, 0.0, 0.0, 1.0],
        A_ub=np.column_stack([given, -np.ones(len(given))]),
        b_ub=np.zeros(len(given)),
        A_eq=[[1.0, 1.0, 1.0, 0.0]],
        b_eq=[1.0],
        bounds=[(0.0, None)] * 3 + [(None, None)],
    )
    return solved.fun


@given(planes)
def test_what_is_kept_is_a_bound_that_only_rises(planes):
    weights, found = lowest_point(planes)
    assert weights.min() >= 0.0
    assert weights.sum() == pytest.approx(1.0, abs=1e-15)
    assert found[-1] <= reference(planes) + 1e-9
    assert np.all(np.diff(found) >= -1e-9)


@given(planes)
def test_coming_back_with_what_is_forgotten_finds_the_lowest_point(planes):
    """As a search does: the highest plane at the point at hand comes in until none is above it."""
    order, above = [planes[0]], True
    weights, found = lowest_point(np.array(order))
    while above and len(order) < 30:
        order.append(planes[(planes @ weights).argmax()])
        weights, found = lowest_point(np.array(order))
        above = (planes @ weights).max() > found[-1] + 1e-9
    assert found[-1] == pytest.approx(reference(planes), abs=1e-8)
    assert (planes @ weights).max() == pytest.approx(found[-1], abs=1e-8)
