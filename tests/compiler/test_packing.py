"""Groups of arrays and numbers as compiled code sees them, and as Python does.

They also run with the compiler off: NUMBA_DISABLE_JIT=1.
"""

from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from cape.kernels import store
from cape.kernels.calling import Entry
from cape.kernels.jit import Function, inlined, kernel, routine
from cape.kernels.packing import ArrayKind, GroupKind, Packed, dtype_of, dtype_text, words_of
from tests.support.code import compiled_only

compiling = settings(deadline=None)


# -- dtypes --

plain = st.sampled_from(["f4", "f8", "i4", "i8", "u4", "u8", "?", "c8", "c16"]).map(np.dtype)


def records(of: st.SearchStrategy[np.dtype[Any]]) -> st.SearchStrategy[np.dtype[Any]]:
    """Records of some dtypes, and of arrays of them, with room between the fields or without."""
    shapes = st.sampled_from([(), (3,), (2, 3), (1, 1, 2)])
    fields = st.lists(st.tuples(of, shapes), min_size=1, max_size=5)
    return st.builds(
        lambda parts, align: np.dtype([(f"f{k}", d, shape) for k, (d, shape) in enumerate(parts)], align=align),
        fields,
        st.booleans(),
    )


@given(st.one_of(plain, records(plain), records(records(plain))))
def test_a_dtype_told_as_text_is_the_same_dtype(dtype: np.dtype[Any]):
    text = dtype_text(dtype)
    again = dtype_of(text)
    assert again == dtype
    assert again.isalignedstruct == dtype.isalignedstruct
    assert again.itemsize == dtype.itemsize
    assert {name: field[1] for name, field in (again.fields or {}).items()} == {
        name: field[1] for name, field in (dtype.fields or {}).items()
    }
    # So that it can be part of what code is known by, in this process and on disk.
    assert hash(text) == hash(dtype_text(again))
    assert repr(text) == repr(dtype_text(again))


@given(records(plain), records(plain))
def test_dtypes_that_differ_have_texts_that_differ(one: np.dtype[Any], two: np.dtype[Any]):
    same = one == two and one.isalignedstruct == two.isalignedstruct
    assert (dtype_text(one) == dtype_text(two)) == same


# -- arrays --


@kernel
def raise_1(values, out):
    for i in range(values.shape[0]):
        out[i] = values[i]
        values[i] += 1


@kernel
def raise_2(values, out):
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            out[i, j] = values[i, j]
            values[i, j] += 1


@kernel
def raise_3(values, out):
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            for k in range(values.shape[2]):
                out[i, j, k] = values[i, j, k]
                values[i, j, k] += 1


RAISE: dict[int, Function] = {1: raise_1, 2: raise_2, 3: raise_3}
slices = st.builds(
    slice,
    st.one_of(st.none(), st.integers(0, 3)),
    st.none(),
    st.sampled_from([None, 1, 2, 3, -1, -2]),
)


@st.composite
def views(draw: st.DrawFn) -> tuple[NDArray[Any], NDArray[Any]]:
    """An array of one to three dimensions, and any view of it, with the same dimensions in any order."""
    dtype = draw(st.sampled_from([np.float32, np.float64, np.uint32]))
    dimensions = draw(st.integers(1, 3))
    shape = draw(st.tuples(*(st.integers(0, 6),) * dimensions))
    whole = np.arange(np.prod(shape), dtype=dtype).reshape(shape)
    order = draw(st.permutations(range(dimensions)))
    return whole, whole[draw(st.tuples(*(slices,) * dimensions))].transpose(order)


@compiling
@given(views())
def test_any_view_of_an_array_is_read_and_written_in_place(both: tuple[NDArray[Any], NDArray[Any]]):
    whole, view = both
    before, marks = view.copy(), np.zeros(whole.shape, bool)
    out = np.full(view.shape, 99, view.dtype)
    _like(view, whole, marks)[...] = True
    kept = whole.copy()
    RAISE[view.ndim](view, out)
    np.testing.assert_array_equal(out, before)
    np.testing.assert_array_equal(view, before + 1)
    np.testing.assert_array_equal(whole, kept + marks.astype(kept.dtype))


def _like(view: NDArray[Any], whole: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
    """The view of another array of the same shape."""
    share = other.itemsize / whole.itemsize
    start = view.__array_interface__["data"][0] - whole.__array_interface__["data"][0]
    strides = tuple(int(stride * share) for stride in view.strides)
    if view.size == 0:
        return other[:0]
    return np.ndarray(view.shape, other.dtype, other.data, int(start * share), strides)


@pytest.mark.parametrize(
    ("array", "kind", "words"),
    [
        (np.zeros(3), ArrayKind("<f8", 1, True), 2),
        (np.zeros((2, 3), np.float32), ArrayKind("<f4", 2, True), 3),
        (np.zeros((2, 3)).T, ArrayKind("<f8", 2, False), 5),
        (np.zeros(6, np.uint32)[::2], ArrayKind("<u4", 1, False), 3),
        (np.zeros((0, 3)), ArrayKind("<f8", 2, True), 3),
    ],
    ids=["in a row", "single", "turned", "every second", "nothing"],
)
def test_the_kind_of_an_array(array: NDArray[Any], kind: ArrayKind, words: int):
    packed = Packed(Pair(array, None))
    assert packed.kind == GroupKind("Pair", (("first", kind), ("second", "none")))
    assert words_of(kind) == words
    assert words_of("none") == 0


# -- records --

ROW = np.dtype(
    [("number", np.int64), ("place", np.float64, 3), ("turn", np.float32, (2, 2)), ("on", np.bool_)], align=True
)


@routine
def turn_over(rows):
    for k in range(rows.size):
        row = rows[k]
        row.number = -row.number
        for i in range(3):
            row.place[i] = 2.0 * row.place[i] + row.number
        row.turn[0, 1], row.turn[1, 0] = row.turn[1, 0], row.turn[0, 1]
        row.on = not row.on


@pytest.mark.parametrize("step", [1, 3, -2])
def test_records_with_arrays_within_are_read_and_written_in_place(step: int):
    rng = np.random.default_rng(1)
    rows = np.zeros(12, ROW).view(np.recarray)
    rows.number, rows.place, rows.on = np.arange(12), rng.standard_normal((12, 3)), rng.random(12) < 0.5
    rows.turn = rng.standard_normal((12, 2, 2))
    before, chosen = rows.copy(), np.zeros(12, bool)
    chosen[::step] = True
    turn_over(rows[::step])
    np.testing.assert_array_equal(rows[~chosen], before[~chosen])
    after: Any = rows[chosen]
    was: Any = before[chosen]
    np.testing.assert_array_equal(after.number, -was.number)
    np.testing.assert_array_equal(after.place, 2.0 * was.place - was.number[:, None])
    np.testing.assert_array_equal(after.turn, was.turn.swapaxes(1, 2))
    np.testing.assert_array_equal(after.on, ~was.on)


# -- numbers --


@routine
def give_back(flag, whole, real, half):
    return flag, whole, real, half


whole_numbers = st.one_of(st.integers(-(2**63), 2**63 - 1), st.integers(-(2**31), 2**31 - 1).map(np.int32))
flags = st.one_of(st.booleans(), st.booleans().map(np.bool_))


@compiling
@given(flags, whole_numbers, st.floats(allow_nan=False), st.floats(allow_nan=False, width=32).map(np.float32))
def test_numbers_of_each_kind_arrive_to_the_last_bit(flag, whole, real, half):
    back = give_back(flag, whole, real, half)
    assert back == (bool(flag), int(whole), real, float(half))
    assert [np.signbit(number) for number in back[2:]] == [np.signbit(real), np.signbit(half)]


def test_no_number_is_still_none():
    assert np.isnan(give_back(True, 1, np.nan, np.float32(np.nan))[2:]).all()


def test_a_number_that_needs_more_than_a_word_is_refused():
    for number in (2**63, np.uint64(2**63), -(2**63) - 1):
        with pytest.raises(OverflowError):
            Packed(Pair(number, None))


# -- groups --


class Pair(NamedTuple):
    first: Any
    second: Any


class Nested(NamedTuple):
    one: Pair
    other: Pair
    factor: float | None
    values: NDArray[np.float64]


@inlined
def scaled(value, factor):
    if factor is None:
        return value
    return value * factor


@routine
def move_over(g):
    """Move what is in a group's pairs, times its factor, to its values."""
    for i in range(g.values.size):
        g.values[i] += scaled(g.one.first[i] + g.other.first[i], g.factor)
        g.one.first[i] = 0.0


@pytest.mark.parametrize("factor", [None, 3.0])
@pytest.mark.parametrize("same", [False, True])
def test_groups_within_groups_and_one_that_is_there_twice(factor: float | None, same: bool):
    one = Pair(np.arange(4.0), None)
    other = one if same else Pair(np.arange(4.0) + 10.0, 7)
    before = one.first + other.first
    group = Nested(one, other, factor, np.ones(4))
    move_over(group)
    np.testing.assert_array_equal(group.values, 1.0 + (factor or 1.0) * before)
    np.testing.assert_array_equal(one.first, 0.0)
    assert (other.first != 0.0).any() != same


def test_a_group_that_several_share_is_packed_once():
    shared = Pair(np.zeros(3), 1.0)
    known: dict[int, Packed] = {}
    first, second = (Packed(Nested(shared, shared, None, np.zeros(3)), known) for _ in range(2))
    assert list(known.values()) == [known[id(shared)]]
    address = known[id(shared)].address
    for packed in (first, second):
        np.testing.assert_array_equal(packed._words[:2], address)
    assert first.kind == second.kind
    assert Packed(shared).address != address


@compiled_only
def test_arrays_stay_where_they_are_and_numbers_are_copied():
    class_of = Nested(Pair(np.ones(2), None), Pair(np.ones(2), None), 2.0, np.zeros(2))
    packed = Packed(class_of)
    entry = Entry(store.code_of(store.Request(move_over, (packed.kind,))))
    entry(packed.address)
    np.testing.assert_array_equal(class_of.values, 4.0)
    class_of.one.first[:] = 5.0
    entry(packed.address)
    np.testing.assert_array_equal(class_of.values, 4.0 + 2.0 * 6.0)


@pytest.mark.parametrize("value", [[1.0], "text", (1.0, 2.0), {"a": 1}, object()], ids=lambda v: type(v).__name__)
def test_what_cannot_be_packed_is_named(value: object):
    with pytest.raises(TypeError, match=rf"Pair.second can't be packed: {type(value).__name__}"):
        Packed(Pair(np.zeros(1), value))


def test_kinds_tell_apart_what_needs_code_of_its_own():
    arrays = np.zeros(3), np.zeros(3, np.float32), np.zeros((3, 1)), np.zeros(6)[::2]
    kinds = {Packed(Pair(value, None)).kind for value in (*arrays, 1, 1.0, True, np.float32(1.0), None)}
    assert len(kinds) == 9
    # But not how long an array is, or how large a number.
    assert Packed(Pair(np.zeros(3), 1)).kind == Packed(Pair(np.ones(5), -7)).kind
    assert Packed(Pair(np.zeros(3), 1)).kind in {Packed(Pair(np.zeros(0), 2)).kind}
    assert str(Packed(Pair(np.zeros((2, 2)).T, Pair(1, None))).kind) == (
        "Pair(first: <f8[2 with gaps], second: Pair(first: int, second: none))"
    )
