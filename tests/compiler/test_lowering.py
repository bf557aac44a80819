"""What is lowered by short ways does what Python does. The functions run compiled, and as they are written."""

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from cape.kernels.fused import fused
from cape.kernels.jit import Function, inlined, kernel, routine
from tests.support.code import compiled_only

pytestmark = compiled_only

NUMBER = st.floats(width=64, allow_subnormal=False)  # those count as zero: `test_subnormals`
SINGLE = st.floats(width=32, allow_subnormal=False)
WHOLE = st.integers(-(2**31), 2**31 - 1)


@routine
def sums(a, b):
    return a + b, a - b, a * b


@routine
def quotient(a, b):
    return a / b


@routine
def bits(a, b):
    return a & b, a | b


@routine
def order(a, b):
    return a < b, a <= b, a > b, a >= b, a == b, a != b


@routine
def least_and_greatest(a, b, c):
    return min(a, b), max(a, b), min(a, b, c), max(a, b, c)


def flushed(numbers: Any) -> Any:
    """Numbers, with zeros of the same sign where they are subnormal."""
    several = np.atleast_1d(numbers)
    if several.dtype.kind != "f":
        return several
    return np.where(np.abs(several) < np.finfo(several.dtype).tiny, np.copysign(0, several), several)


def same(found: Any, expected: Any) -> bool:
    """Equal to the last bit, with any nan the same as any other, and what is too small for all its digits zero."""
    pairs = zip(*map(flushed, (found, expected)), strict=True)
    return all((f == e and math.copysign(1, f) == math.copysign(1, e)) or (f != f and e != e) for f, e in pairs)


def plain(function: Function, *arguments: Any) -> Any:
    with np.errstate(all="ignore"):
        return function.python(*arguments)


@given(NUMBER, NUMBER)
@example(math.nan, 0.0)
@example(0.0, -0.0)
@example(math.inf, -math.inf)
def test_real_numbers_are_reckoned_as_by_numpy(a: float, b: float):
    for function in (sums, quotient, order):
        assert same(function(a, b), plain(function, np.float64(a), np.float64(b)))


@given(SINGLE, SINGLE)
def test_single_ones_stay_single(a: float, b: float):
    one, other = np.float32(a), np.float32(b)
    for function in (sums, quotient, order):
        assert same(function(one, other), plain(function, one, other))


@routine
def one_fused(a, b, c):
    return fused(a, b, c)


@kernel
def many_fused(a, b, c, out):
    for i in range(out.size):
        out[i] = fused(a[i], b[i], c[i])


@given(st.lists(st.tuples(*[st.floats(-1e6, 1e6, width=32)] * 3), min_size=1, max_size=40), st.booleans())
@example([(1.0 + 2.0**-12, 1.0 + 2.0**-12, -1.0 - 2.0**-11)], True)
def test_a_product_and_a_sum_are_rounded_once_or_each_and_in_all_loops_alike(rows: list[Any], single: bool):
    columns = np.array(rows, np.float32 if single else np.float64).T.copy()
    out = np.zeros(columns.shape[1], columns.dtype)
    many_fused(*columns, out)
    for a, b, c, found in zip(*columns, out, strict=True):
        exact = Fraction(float(a)) * Fraction(float(b)) + Fraction(float(c))
        rounded_once = abs(exact - Fraction(float(found))) <= Fraction(float(np.spacing(abs(found)))) / 2
        assert rounded_once or found == a * b + c
        assert one_fused(a, b, c) == found


@given(WHOLE, WHOLE)
def test_whole_numbers_are_reckoned_as_by_python(a: int, b: int):
    for function in (sums, bits, order):
        assert same(function(a, b), function.python(a, b))


@routine
def order_in(pair):
    return order(pair[0], pair[1])


@given(st.integers(0, 2**64 - 1), st.integers(0, 2**64 - 1))
@example(2**63, 1)
def test_whole_numbers_without_a_sign_are_compared_as_such(a: int, b: int):
    assert order_in(np.array([a, b], np.uint64)) == order.python(a, b)


@given(WHOLE, NUMBER)
def test_mixed_ones_become_real(a: int, b: float):
    for function in (sums, order):
        assert same(function(a, b), plain(function, np.float64(a), np.float64(b)))


@given(NUMBER, NUMBER, NUMBER)
@example(math.nan, 1.0, 2.0)
@example(1.0, math.nan, 2.0)
@example(0.0, -0.0, 0.0)
def test_least_and_greatest_are_python_s_also_of_nan(a: float, b: float, c: float):
    assert same(least_and_greatest(a, b, c), least_and_greatest.python(a, b, c))


@given(WHOLE, NUMBER, SINGLE)
def test_least_and_greatest_of_several_kinds(a: int, b: float, c: float):
    found = least_and_greatest(a, b, np.float32(c))
    assert same(found, plain(least_and_greatest, float(a), b, float(np.float32(c))))


# -- arrays --


@routine
def element(values, i, j):
    return values[i, j]


@routine
def first_and_last(values):
    return values[0], values[-1]


@routine
def total(values):
    """A weighted sum, which tells one order from another, and the shape."""
    result = 0.0
    for k in range(values.size):
        result += (k + 1) * values[k]
    return result, values.shape[0], values.size


@routine
def total_of_stretch(values, start, stop):
    return total(values[start:stop])


@routine
def total_of_row(values, i):
    return total(values[i])


@routine
def total_of_column(values, start, stop, j):
    return total(values[start:stop, j])


@routine
def of_block(values, i, start, stop, j):
    block = values[i, start:stop]
    return total(block[:, j])


@routine
def of_open_stretches(values):
    return total(values[2:])[0], total(values[:-2])[0], total(values[:])[0]


@routine
def put(values, i, j, number):
    values[i, j] = number
    values[i, j] += 1


SIZES = st.integers(1, 5)
ANY = st.integers(-7, 7)


def numbers(*shape: int) -> Any:
    return np.arange(1.0, 1.0 + math.prod(shape)).reshape(shape)


def layouts(values: Any) -> list[Any]:
    """The same numbers without and with gaps, and in another order in memory."""
    wide = np.zeros([2 * n for n in values.shape])
    wide[tuple(slice(None, None, 2) for _ in values.shape)] = values
    return [values, wide[tuple(slice(None, None, 2) for _ in values.shape)], np.asfortranarray(values)]


@given(st.data(), SIZES, SIZES)
def test_elements_are_found_from_both_ends(data: st.DataObject, rows: int, columns: int):
    i, j = data.draw(st.integers(-rows, rows - 1)), data.draw(st.integers(-columns, columns - 1))
    for values in layouts(numbers(rows, columns)):
        assert element(values, i, j) == values[i, j]
    for kind in (np.uint32, np.uint64, np.int32):
        ways = kind(i % rows), kind(j % columns)
        assert element(numbers(rows, columns), *ways) == numbers(rows, columns)[ways]


@given(SIZES)
def test_known_places_are_found_from_both_ends(size: int):
    for values in (numbers(size), numbers(2 * size)[::2], numbers(size)[::-1]):
        assert first_and_last(values) == (values[0], values[-1])


@given(SIZES, ANY, ANY)
def test_stretches_are_cut_to_the_array(size: int, start: int, stop: int):
    for values in (numbers(size), numbers(2 * size)[::2], numbers(size)[::-1]):
        assert total_of_stretch(values, start, stop) == total.python(values[start:stop])


@given(SIZES)
def test_open_stretches_reach_the_ends(size: int):
    assert of_open_stretches(numbers(size)) == of_open_stretches.python(numbers(size))


@given(st.data(), SIZES, SIZES, ANY, ANY)
def test_rows_columns_and_blocks(data: st.DataObject, rows: int, columns: int, start: int, stop: int):
    i, j = data.draw(st.integers(-rows, rows - 1)), data.draw(st.integers(-columns, columns - 1))
    for values in layouts(numbers(rows, columns)):
        assert total_of_row(values, i) == total.python(values[i])
        assert total_of_column(values, start, stop, j) == total.python(values[start:stop, j])
    for values in layouts(numbers(rows, 3, columns)):
        assert of_block(values, i, start, stop, j) == total.python(values[i, start:stop][:, j])


@given(st.data(), SIZES, SIZES)
def test_what_is_written_is_there_and_nothing_else_changes(data: st.DataObject, rows: int, columns: int):
    i, j = data.draw(st.integers(-rows, rows - 1)), data.draw(st.integers(-columns, columns - 1))
    for values in layouts(numbers(rows, columns)):
        expected = values.copy()
        expected[i, j] = 8.0
        put(values, i, j, 7)
        np.testing.assert_array_equal(values, expected)


def test_truths_are_kept_as_bytes():
    @routine
    def turn_over(flags):
        for k in range(flags.size):
            flags[k] = not flags[k]

    flags = np.array([True, False, True])
    turn_over(flags)
    assert flags.tolist() == [False, True, False]
    assert flags.view(np.uint8).tolist() == [0, 1, 0]


# -- what is absent --


@inlined
def unless_none(value, other):
    if value is None:
        return other
    return value * 2


def test_branches_on_what_is_none_are_not_compiled_otherwise():
    @routine
    def chosen(value, other):
        # With a number the other side would give text, with None it would multiply it: neither compiles.
        if value is not None:
            return unless_none(value, other)
        return unless_none(None, other)

    assert chosen(3.0, 1.0) == 6.0
    assert chosen(None, 1.0) == 1.0


def test_what_can_t_be_compiled_tells_where():
    @routine
    def nonsense(values):
        return values.nothing_of_this_name

    with pytest.raises(Exception, match="nothing_of_this_name"):
        nonsense(np.zeros(3))


# -- loops, views and what lies between --


@routine
def numbers_counted(values, begin, end):
    total, last = 0.0, -100
    for i in range(begin, end):
        last = i
        if values[i] == 3.0:
            continue
        if values[i] == 5.0:
            break
        total = 2.0 * total + values[i]
    return total, last


@given(st.integers(-8, 8), st.integers(-8, 8))
def test_a_loop_counts_as_python_does_and_reads_from_the_end_below_zero(begin: int, end: int):
    values = np.array([1.0, 2.0, 3.0, 4.0, 7.0, 6.0, 5.0, 8.0])
    assert same(numbers_counted(values, begin, end), plain(numbers_counted, values, begin, end))


@routine
def triangle(n, out):
    count = 0
    for i in range(n):
        for j in range(i):
            for k in range(j, i, 2):
                out[i, j] += k
                count += 1
        i = 0 - i
        out[i, i] += 1.0
    return count


@given(st.integers(-2, 6))
def test_loops_within_loops_begin_anew(n: int):
    found, expected = np.zeros((6, 6)), np.zeros((6, 6))
    assert triangle(n, found) == plain(triangle, n, expected)
    assert np.array_equal(found, expected)


@routine
def in_one_branch(values, which):
    if which > 0:
        chosen, factor = values[1:], 2.0
    else:
        chosen, factor = values, 3.0
    for i in range(chosen.size):
        if chosen[i] > 2.0:
            factor += chosen[i]
    return chosen[0] * factor


@given(st.integers(-1, 1))
def test_what_branches_set_is_what_was_set_last(which: int):
    values = np.array([1.0, 2.0, 3.0])
    assert in_one_branch(values, which) == plain(in_one_branch, values, which)


@routine
def middle(values, lo, hi, out):
    inner, rest, head = values[lo:hi], values[lo:], values[:hi]
    out[0], out[1], out[2] = inner.shape[0], rest.size, head.shape[0]
    for i in range(inner.size):
        out[3] += inner[i]
    if inner.size > 0:
        inner[0] = -1.0


@given(st.integers(-8, 8), st.integers(-8, 8), st.booleans())
def test_views_are_those_of_numpy(lo: int, hi: int, gaps: bool):
    found, expected = (np.arange(12.0)[:: 2 if gaps else 1] for _ in range(2))
    results = np.zeros(4), np.zeros(4)
    middle(found, lo, hi, results[0])
    plain(middle, expected, lo, hi, results[1])
    assert np.array_equal(results[0], results[1])
    assert np.array_equal(found, expected)


@routine
def sum_of(part):
    total = 0.0
    for i in range(part.shape[0]):
        for j in range(part.shape[1]):
            total = 2.0 * total + part[i, j]
    return total + part.size


@routine
def sums_of_slices(values, lo, hi):
    return sum_of(values[1, lo:hi]), sum_of(values[:, lo:hi, 1])


@given(st.integers(0, 3), st.integers(0, 3), st.integers(0, 3))
def test_arrays_are_passed_whole_with_and_without_gaps(lo: int, hi: int, turned: int):
    values = np.arange(36.0).reshape(3, 3, 4).transpose([(0, 1, 2), (1, 0, 2), (2, 1, 0), (0, 2, 1)][turned])
    flat = values[:, :, 2]
    assert same(sum_of(flat), plain(sum_of, flat))
    expected = [plain(sum_of, part) for part in (values[1, lo:hi], values[:, lo:hi, 1])]
    assert same(sums_of_slices(values, lo, hi), expected)
