"""Signed distances in the shapes' own frames: every degenerate case by name, and what holds for any point and shape."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cape.kernels.jit import formula_of
from skeleton.shapes import Box, Capsule, Cylinder, Ellipsoid, Plane, TaperedCapsule, ellipsoid
from skeleton.shapes.base import TINY
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


@st.composite
def ellipsoids(draw: st.DrawFn) -> tuple[float, float, float, float]:
    """Radii, of which some may be equal."""
    first, second, third = draw(halves), draw(halves), draw(halves)
    second, third = draw(st.sampled_from([(second, third), (first, third), (second, first), (first, first)]))
    return first, second, third, 0.0


SIZES = {
    Capsule: st.tuples(lengths, radii, st.just(0.0), st.just(0.0)),
    TaperedCapsule: tapered(),
    Box: st.tuples(halves, halves, halves, st.just(0.0)),
    Plane: st.just((0.0, 0.0, 0.0, 0.0)),
    Cylinder: st.tuples(halves, halves, st.just(0.0), st.just(0.0)),
    Ellipsoid: ellipsoids(),
}
shapes = st.one_of(*(st.tuples(st.just(kind), sizes) for kind, sizes in SIZES.items()))
# Lengths up to 5 m with a dozen roundings of 2^-53 each; a slope up to 5 multiplies them.
ROUNDING = 1e-13
compiling = settings(deadline=None)


def distance_from(kind: Kind, sizes, point) -> tuple[float, FloatArray]:
    distance, *normal = formula_of(kind.nearest)(*map(float, point), *map(float, sizes))
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
    found, direction = distance_from(Capsule, (length, 0.5, 0, 0), point)
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
    found, direction = distance_from(TaperedCapsule, tapered_sizes(2, *radii), point)
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
    found, direction = distance_from(Box, (1, 2, 3, 0), point)
    assert found == pytest.approx(distance, abs=1e-15)
    np.testing.assert_allclose(direction, np.array(normal) / np.linalg.norm(normal), atol=1e-15)


@pytest.mark.parametrize(
    ("point", "distance", "normal"),
    [
        ((3, 0, 1), 2.0, (1, 0, 0)),
        ((0, -3, -1), 2.0, (0, -1, 0)),
        ((0.5, 0, 5), 3.0, (0, 0, 1)),
        ((0, 0, -5), 3.0, (0, 0, -1)),
        ((4, 0, 6), 5.0, (0.6, 0, 0.8)),
        ((0, -4, -6), 5.0, (0, -0.6, -0.8)),
        ((0.75, 0, 0), -0.25, (1, 0, 0)),
        ((0, 0.5, 1.75), -0.25, (0, 0, 1)),
        ((0, 0.5, -1.75), -0.25, (0, 0, -1)),
        ((0, 0.5, 1.5), -0.5, (0, 1, 0)),
        ((0, 0, 0), -1.0, (1, 0, 0)),
        ((0, 0, 1), -1.0, (1, 0, 0)),
        ((0, 0, 1.5), -0.5, (0, 0, 1)),
        ((0, 1e-13, 0.5), -1.0, (1, 0, 0)),
        ((0, 0, 2), 0.0, (0, 0, 1)),
        ((0, -1, 0), 0.0, (0, -1, 0)),
        ((0, -1, 2), 0.0, (0, -1, 0)),
        ((0, 1 + 4e-16, 2 + 9e-16), 0.0, (0, 0, 1)),
    ],
    ids=[
        "beside", "beside, on another side", "over an end", "on the axis, below an end", "before the edge",
        "before the other edge", "inside, at the side", "inside, below the top", "inside, above the bottom",
        "inside, at equal depth from side and top", "the middle", "on the axis at equal depth from side and top",
        "on the axis, below the top", "a hair from the axis", "on the middle of an end", "on the side", "on an edge",
        "a rounding before an edge",
    ],
)  # fmt: skip
def test_cylinder_case_by_case(point, distance, normal):
    found, direction = distance_from(Cylinder, (2, 1, 0, 0), point)
    assert found == pytest.approx(distance, abs=1e-12)
    np.testing.assert_allclose(direction, normal, atol=1e-12)


@pytest.mark.parametrize("radius", [1.0, 3.0], ids=["as wide as high", "a disc"])
def test_the_middle_of_a_flat_cylinder_is_nearest_to_its_ends(radius):
    found, direction = distance_from(Cylinder, (0.5, radius, 0, 0), (0.0, 0.0, 0.0))
    assert found == -0.5
    np.testing.assert_array_equal(direction, (0, 0, 1))


# Of radii 4, 3 and 2. Across the shortest axis, x is nearest to the surface at (16 x / (16 - 4)) on the axis of x.
TIP = np.sqrt(1.0 - (4.0 / 3.0 * 1.5) ** 2 / 16.0)  # share of the smallest radius at which (1.5, 0, 0) is nearest


@pytest.mark.parametrize(
    ("point", "radii", "distance", "normal"),
    [
        ((5, 0, 0), (4, 3, 2), 1.0, (1, 0, 0)),
        ((0, -5, 0), (4, 3, 2), 2.0, (0, -1, 0)),
        ((0, 0, -1.5), (4, 3, 2), -0.5, (0, 0, -1)),
        ((0, 0, 0), (4, 3, 2), -2.0, (0, 0, 1)),
        ((0, 0, 0), (2, 3, 4), -2.0, (1, 0, 0)),
        ((0, 0, 0), (3, 2, 4), -2.0, (0, 1, 0)),
        ((0, 0, 0), (3, 2, 2), -2.0, (0, 1, 0)),
        ((1.5, 0, 0), (4, 3, 2), -np.hypot(0.5, 2 * TIP), (2 / 16, 0, TIP / 2)),
        ((1.5, 0, -1e-17), (4, 3, 2), -np.hypot(0.5, 2 * TIP), (2 / 16, 0, -TIP / 2)),
        ((3, 0, 0), (4, 3, 2), -1.0, (1, 0, 0)),
        ((3.5, 0, 0), (4, 3, 2), -0.5, (1, 0, 0)),
        ((4, 0, 0), (4, 3, 2), 0.0, (1, 0, 0)),
        ((0, 0, 2), (4, 3, 2), 0.0, (0, 0, 1)),
        ((3, 4, 12), (2, 2, 2), 11.0, (3, 4, 12)),
        ((0, 0.6, -0.8), (2, 2, 2), -1.0, (0, 3, -4)),
        ((0, 0, 0), (2, 2, 2), -2.0, (1, 0, 0)),
        ((3, 4, 0), (2, 2, 1), 3.0, (3, 4, 0)),
        ((0.3, 0.4, 0), (1, 1, 2), -0.5, (3, 4, 0)),
        ((1, 1, 0.5), (3, 4, 1e-9), 0.5 - 1e-9 * np.sqrt(1 - 1 / 9 - 1 / 16), (0, 0, 1)),
        ((0, 0, 0), (3, 4, 1e-9), -1e-9, (0, 0, 1)),
        ((7, 0, 0), (3, 4, 1e-9), 4.0, (1, 0, 0)),
    ],
    ids=[
        "beyond the longest axis", "beyond another axis", "inside on the shortest axis", "the centre",
        "the centre, x the shortest axis", "the centre, y the shortest axis", "the centre, y and z as short",
        "inside, a tie between both sides", "inside, hardly below the tie", "inside, at the end of the ties",
        "inside, nearest to the tip", "on the tip", "on the flat side", "outside a sphere", "inside a sphere",
        "at a sphere's centre", "in the plane of an oblate one", "in the plane of a prolate one", "over a flat one",
        "the centre of a flat one", "in the plane of a flat one",
    ],
)  # fmt: skip
def test_ellipsoid_case_by_case(point, radii, distance, normal):
    found, direction = distance_from(Ellipsoid, (*radii, 0), point)
    assert found == pytest.approx(distance, rel=1e-10, abs=1e-14)
    np.testing.assert_allclose(direction, np.array(normal) / np.linalg.norm(normal), atol=1e-7)


def test_the_distance_from_an_ellipsoid_is_exact_to_ten_digits_for_all_sizes():
    random = np.random.default_rng(4)
    for k in range(300):
        radii = np.exp(random.uniform(-6.0, 2.0, 3))
        if k % 3 == 0:
            radii[1] = radii[0]
        p = random.standard_normal(3) * radii * np.exp(random.uniform(-4.0, 3.0))
        if k % 2 == 0:  # as near to where both sides are as near as can be
            p[radii.argmin()] *= 10.0 ** random.uniform(-20.0, -2.0)
        found, direction = distance_from(Ellipsoid, (*radii, 0), p)
        assert found == pytest.approx(Ellipsoid(radii=radii).distances(p[None])[0], rel=1e-10, abs=1e-15)
        # And the way there leads to the surface, across it.
        at = p - found * direction
        across = at / radii**2
        np.testing.assert_allclose(((at / radii) ** 2).sum(), 1.0, rtol=1e-9)
        np.testing.assert_allclose(across / np.linalg.norm(across), direction, atol=1e-7)


def test_the_normal_of_an_ellipsoid_turns_steadily_where_both_sides_begin_to_be_as_near():
    # At x = (16 - 4) / 4 = 3 on the longest axis the centre of curvature of the tip; ties are at less than that.
    radii = (4.0, 3.0, 2.0, 0.0)
    ways = np.linspace(2.99, 3.01, 2001)
    for height in (0.0, 1e-17, 1e-12, 1e-6):
        normals = np.array([distance_from(Ellipsoid, radii, (x, 0.0, height))[1] for x in ways])
        # The height of the nearest point goes with the root of the way, 1e-5 a step: by 0.3 % of the unit normal.
        assert np.linalg.norm(np.diff(normals, axis=0), axis=1).max() < 0.01


def test_newton_arrives_long_before_its_last_step(monkeypatch: pytest.MonkeyPatch):
    random = np.random.default_rng(5)
    cases = [(random.standard_normal(3) * 0.3, np.exp(random.uniform(-3.0, 0.0, 3))) for _ in range(200)]
    exact = [ellipsoid.nearest(*(*p.tolist(), *radii.tolist(), 0.0))[0] for p, radii in cases]
    monkeypatch.setattr(ellipsoid, "STEPS", 12)
    twelve = [ellipsoid.nearest(*(*p.tolist(), *radii.tolist(), 0.0))[0] for p, radii in cases]
    np.testing.assert_allclose(twelve, exact, rtol=1e-10)


def test_plane():
    distance, normal = distance_from(Plane, (0, 0, 0, 0), (1.0, 2.0, -3.0))
    assert distance == -3.0
    np.testing.assert_array_equal(normal, (0, 0, 1))


@compiling
@given(shapes, points)
def test_the_distance_equals_the_reference_and_the_normal_is_of_length_one(shape, p):
    kind, sizes = shape
    distance, normal = distance_from(kind, sizes, p)
    # The reference finds the place on an axis of up to 2 m to 1e-12, along which the distance changes at most as much.
    # That of an ellipsoid finds angles to 1e-8, across which the distance doesn't change to first order.
    tolerance = 1e-11 if kind in (TaperedCapsule, Ellipsoid) else ROUNDING
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
    tapered, normal = distance_from(TaperedCapsule, tapered_sizes(length, radius, radius), p)
    capsule, expected = distance_from(Capsule, (length, radius, 0, 0), p)
    assert tapered == capsule
    np.testing.assert_array_equal(normal, expected)


@compiling
@given(tapered(), points)
def test_a_tapered_capsule_looks_the_same_from_its_other_end(sizes, p):
    length, radius, sine, _ = sizes
    turned = p * (1, 1, -1) + (0, 0, length)
    other = distance_from(TaperedCapsule, tapered_sizes(length, radius - sine * length, radius), turned)[0]
    assert distance_from(TaperedCapsule, sizes, p)[0] == pytest.approx(other, abs=2 * ROUNDING)


@compiling
@given(points, st.tuples(halves, halves, halves).map(np.array), st.permutations([0, 1, 2]),
       st.tuples(*(st.sampled_from([-1.0, 1.0]),) * 3))  # fmt: skip
def test_a_box_looks_the_same_from_all_sides(p, half, order, signs):
    before, _ = distance_from(Box, (*half, 0), p)
    after, _ = distance_from(Box, (*half[order], 0), (p * signs)[order])
    assert after == pytest.approx(before, abs=ROUNDING)
