"""Signed distances in the shapes' own frames: every degenerate case by name, and what holds for any point and shape."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cape.kernels.contact.distance import TINY, to_box, to_capsule, to_plane, to_tapered_capsule
from cape.kernels.jit import formula_of
from tests.support.shapes import FloatArray, Kind, reference_distance, tapered_sizes

# Multiples of 1/64 put many points exactly on axes, faces, edges and diagonals.
numbers = st.one_of(st.integers(-128, 128).map(lambda k: k / 64), st.floats(-2, 2, allow_subnormal=False))
points = st.tuples(numbers, numbers, numbers).map(np.array)
radii = st.floats(0.01, 1.0)
lengths = st.one_of(st.integers(0, 128).map(lambda k: k / 64), st.floats(0, 2, allow_subnormal=False))
halves = st.one_of(st.integers(1, 64).map(lambda k: k / 64), st.floats(0.01, 1.0))


@st.composite
def tapered(draw: st.DrawFn) -> tuple[float, float, float, float]:
    """A tapered capsule neither of whose spheres holds the other."""
    length, radius = draw(st.floats(0.05, 2)), draw(radii)
    sine = draw(st.one_of(st.sampled_from([0.0, 0.5, -0.5]), st.floats(-0.98, 0.98)))
    other = radius - sine * length
    assume(0.005 < other < 2.0)
    return tapered_sizes(length, radius, other)


SIZES = {
    to_capsule: st.tuples(lengths, radii, st.just(0.0), st.just(0.0)),
    to_tapered_capsule: tapered(),
    to_box: st.tuples(halves, halves, halves, st.just(0.0)),
    to_plane: st.just((0.0, 0.0, 0.0, 0.0)),
}
shapes = st.one_of(*(st.tuples(st.just(kind), sizes) for kind, sizes in SIZES.items()))
# Lengths up to 5 m with a dozen roundings of 2^-53 each; a slope up to 5 multiplies them.
ROUNDING = 1e-13
compiling = settings(deadline=None)


def distance_from(kind: Kind, sizes, point) -> tuple[float, FloatArray]:
    distance, *normal = formula_of(kind)(*map(float, point), *map(float, sizes))
    return distance, np.array(normal)


@pytest.mark.parametrize(
    ("point", "length", "distance", "normal"),
    [
        ((0, 2, 1), 2, 1.5, (0, 1, 0)),
        ((0, 0, 4), 2, 1.5, (0, 0, 1)),
        ((0, 0, -2), 2, 1.5, (0, 0, -1)),
        ((0, -0.25, 2), 2, -0.25, (0, -1, 0)),
        ((0, 0, 1), 2, -0.5, (1, 0, 0)),
        ((0, 0, 2), 2, -0.5, (1, 0, 0)),
        ((0, 0, 0), 2, -0.5, (1, 0, 0)),
        ((0, 0, 2), 0, 1.5, (0, 0, 1)),
        ((0, 0, 0), 0, -0.5, (1, 0, 0)),
        ((0, 2, 0), 1e-13, 1.5, (0, 1, 0)),
        ((0, 1e-13, 0), 0, -0.5, (1, 0, 0)),
        ((0, 0, 2.25), 2, -0.25, (0, 0, 1)),
    ],
    ids=[
        "beside the axis", "beyond the end", "before the start", "inside, over the end", "on the axis",
        "on the end of the axis", "on the start of the axis", "outside a sphere", "at a sphere's centre",
        "an axis of hardly any length", "a hair from a sphere's centre", "inside, beyond the end",
    ],
)  # fmt: skip
def test_capsule_case_by_case(point, length, distance, normal):
    found, direction = distance_from(to_capsule, (length, 0.5, 0, 0), point)
    assert found == pytest.approx(distance, abs=1e-12)
    np.testing.assert_allclose(direction, normal, atol=1e-12)


@pytest.mark.parametrize(
    ("point", "radii", "distance", "normal"),
    [
        # The surface leans by 30 degrees: sine 1/2, radii 2 and 1 over a length of 2.
        ((0, 0, -3), (2, 1), 1.0, (0, 0, -1)),
        ((0, 0, 4), (2, 1), 1.0, (0, 0, 1)),
        ((np.sqrt(3), 0, 2), (2, 1), 0.5, (np.sqrt(3) / 2, 0, 0.5)),
        ((0, 0.3, -0.4), (2, 1), -1.5, (0, 0.6, -0.8)),
        ((0, 0, 1), (2, 1), -1.5, (np.sqrt(3) / 2, 0, 0.5)),
        ((0, 0, 2), (2, 1), -1.0, (np.sqrt(3) / 2, 0, 0.5)),
        ((0, 0, 0), (2, 1), -2.0, (np.sqrt(3) / 2, 0, 0.5)),
        ((0, 0, 1), (1, 2), -1.5, (np.sqrt(3) / 2, 0, -0.5)),
        ((0, 0, 5), (1, 2), 1.0, (0, 0, 1)),
        ((0, 3, 1), (1, 1), 2.0, (0, 1, 0)),
        ((0, 0, 1), (1, 1), -1.0, (1, 0, 0)),
    ],
    ids=[
        "behind the larger end", "beyond the smaller end", "beside the slope", "inside, behind the start",
        "on the axis", "on the end of the axis", "on the start of the axis", "on the axis, the end being larger",
        "beyond the larger end", "beside equal radii", "on the axis with equal radii",
    ],
)  # fmt: skip
def test_tapered_capsule_case_by_case(point, radii, distance, normal):
    found, direction = distance_from(to_tapered_capsule, tapered_sizes(2, *radii), point)
    assert found == pytest.approx(distance, abs=1e-12)
    np.testing.assert_allclose(direction, normal, atol=1e-12)


@pytest.mark.parametrize(
    ("point", "distance", "normal"),
    [
        ((2, 0, 0), 1.0, (1, 0, 0)),
        ((0, -3, 0), 1.0, (0, -1, 0)),
        ((4, 6, 0), 5.0, (0.6, 0.8, 0)),
        ((-3, -4, 6), np.sqrt(17), (-2, -2, 3)),
        ((0, 0, 2.5), -0.5, (0, 0, 1)),
        ((0, 0, -2.5), -0.5, (0, 0, -1)),
        ((0.5, 1.5, 2.5), -0.5, (1, 0, 0)),
        ((0, -1.5, 2.5), -0.5, (0, -1, 0)),
        ((0, 0, 0), -1.0, (1, 0, 0)),
        ((1, 0, 0), 0.0, (1, 0, 0)),
        ((1, 2, 0), 0.0, (1, 0, 0)),
        ((-1, -2, -3), 0.0, (-1, 0, 0)),
        ((0, 0, 3 + 4e-16), 0.0, (0, 0, 1)),
        ((0, 2 + 4.5e-16, 3 + 9e-16), 0.0, (0, 0, 1)),
    ],
    ids=[
        "before a face", "before another face", "before an edge", "before a corner", "inside below the top",
        "inside above the bottom", "inside at equal depth from three", "inside at equal depth from two", "the centre",
        "on a face", "on an edge", "on a corner", "a rounding before a face", "a rounding before an edge",
    ],
)  # fmt: skip
def test_box_case_by_case(point, distance, normal):
    found, direction = distance_from(to_box, (1, 2, 3, 0), point)
    assert found == pytest.approx(distance, abs=1e-15)
    np.testing.assert_allclose(direction, np.array(normal) / np.linalg.norm(normal), atol=1e-15)


def test_plane():
    distance, normal = distance_from(to_plane, (0, 0, 0, 0), (1.0, 2.0, -3.0))
    assert distance == -3.0
    np.testing.assert_array_equal(normal, (0, 0, 1))


@compiling
@given(shapes, points)
def test_the_distance_equals_the_reference_and_the_normal_is_of_length_one(shape, p):
    kind, sizes = shape
    distance, normal = distance_from(kind, sizes, p)
    # The reference finds the place on an axis of up to 2 m to 1e-12, along which the distance changes at most as much.
    tolerance = 1e-11 if kind is to_tapered_capsule else ROUNDING
    assert distance == pytest.approx(reference_distance(kind, sizes, p[None])[0], abs=tolerance)
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=ROUNDING)


@compiling
@given(shapes, points, points)
def test_distances_change_no_faster_than_the_point_moves(shape, p, q):
    moved = np.linalg.norm(q - p) + ROUNDING
    assert abs(distance_from(shape[0], shape[1], p)[0] - distance_from(shape[0], shape[1], q)[0]) <= moved


@compiling
@given(shapes, points, points, st.floats(0, 1))
def test_distances_are_convex(shape, p, q, share):
    # What conservative advancement and the search for a triangle's deepest point rely on.
    between = distance_from(shape[0], shape[1], (1 - share) * p + share * q)[0]
    assert (
        between
        <= (1 - share) * distance_from(shape[0], shape[1], p)[0]
        + share * distance_from(shape[0], shape[1], q)[0]
        + ROUNDING
    )


@compiling
@given(shapes, points)
def test_a_step_along_the_normal_leads_to_the_surface(shape, p):
    # What contact relies on: the point moved by -distance along the normal lies on the surface.
    distance, normal = distance_from(shape[0], shape[1], p)
    # Points nearer than this to an axis count as on it.
    assert distance_from(shape[0], shape[1], p - distance * normal)[0] == pytest.approx(0.0, abs=2 * TINY)


@compiling
@given(shapes, points)
def test_the_normal_is_the_gradient_of_the_distance(shape, p):
    kind, sizes = shape
    distance, normal = distance_from(kind, sizes, p)
    step = 1e-6
    forward, backward = (
        np.array([distance_from(kind, sizes, p + e)[0] for e in side * step * np.eye(3)]) - distance for side in (1, -1)
    )
    # A convex function lies above its tangent everywhere, also at a kink; the tangent taken is the nearest axis point's
    # for a point that counts as on the axis, which lies up to TINY below this one's.
    slack = ROUNDING + 2 * TINY
    assert (forward >= step * normal - slack).all()
    assert (backward >= -step * normal - slack).all()
    # Where it has no kink within a step, its slope is the normal; curvature is then at most 1 / 0.05 m.
    kinked = forward + backward > step * step / 0.05
    np.testing.assert_allclose(((forward - backward) / (2 * step))[~kinked], normal[~kinked], atol=step / 0.05 + 1e-7)


@compiling
@given(radii, st.floats(0.05, 2), points)
def test_equal_radii_make_a_capsule(radius, length, p):
    tapered, normal = distance_from(to_tapered_capsule, tapered_sizes(length, radius, radius), p)
    capsule, expected = distance_from(to_capsule, (length, radius, 0, 0), p)
    assert tapered == capsule
    np.testing.assert_array_equal(normal, expected)


@compiling
@given(tapered(), points)
def test_a_tapered_capsule_looks_the_same_from_its_other_end(sizes, p):
    length, radius, sine, _ = sizes
    turned = p * (1, 1, -1) + (0, 0, length)
    other = distance_from(to_tapered_capsule, tapered_sizes(length, radius - sine * length, radius), turned)[0]
    assert distance_from(to_tapered_capsule, sizes, p)[0] == pytest.approx(other, abs=2 * ROUNDING)


@compiling
@given(points, st.tuples(halves, halves, halves).map(np.array), st.permutations([0, 1, 2]),
       st.tuples(*(st.sampled_from([-1.0, 1.0]),) * 3))  # fmt: skip
def test_a_box_looks_the_same_from_all_sides(p, half, order, signs):
    before, _ = distance_from(to_box, (*half, 0), p)
    after, _ = distance_from(to_box, (*half[order], 0), (p * signs)[order])
    assert after == pytest.approx(before, abs=ROUNDING)
