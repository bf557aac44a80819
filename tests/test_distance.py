"""Signed distances: every degenerate case by name, and what holds for any point and shape."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapes import box_distance, capsule_distance

from cape.kernels.distance import to_box, to_capsule, to_plane
from motions import quaternions

# Multiples of 1/64 put many points exactly on axes, faces, edges and diagonals.
numbers = st.one_of(st.integers(-128, 128).map(lambda k: k / 64), st.floats(-2, 2, allow_subnormal=False))
points = st.tuples(numbers, numbers, numbers).map(np.array)
radii = st.floats(0.01, 1.0)
sizes = st.one_of(st.integers(1, 64).map(lambda k: k / 64), st.floats(0.01, 1.0))
halves_of_boxes = st.tuples(sizes, sizes, sizes).map(np.array)
turns = st.tuples(*(st.floats(-1, 1),) * 4).filter(lambda q: np.linalg.norm(q) > 0.1)
rotations = turns.map(lambda q: quaternions.to_matrix(quaternions.normalize(np.array(q))))
# Lengths up to 10 m with a dozen roundings of 2^-53 each; the axis of a short capsule is known less well.
ROUNDING = 1e-13


def from_capsule(point, start, end, radius: float) -> tuple[float, np.ndarray]:
    distance, *normal = to_capsule(*map(float, point), *map(float, start), *map(float, end), float(radius))
    return distance, np.array(normal)


def from_box(point, halves) -> tuple[float, np.ndarray]:
    distance, *normal = to_box(*map(float, point), *map(float, halves))
    return distance, np.array(normal)


@pytest.mark.parametrize(
    ("point", "start", "end", "distance", "normal"),
    [
        ((0, 2, 0), (-1, 0, 0), (1, 0, 0), 1.5, (0, 1, 0)),
        ((3, 0, 0), (-1, 0, 0), (1, 0, 0), 1.5, (1, 0, 0)),
        ((-3, 0, 0), (-1, 0, 0), (1, 0, 0), 1.5, (-1, 0, 0)),
        ((1, 0, 0.25), (-1, 0, 0), (1, 0, 0), -0.25, (0, 0, 1)),
        ((0, 0, 0), (-1, 0, 0), (1, 0, 0), -0.5, (0, -1, 0)),
        ((0, 0, 0), (0, -1, 0), (0, 1, 0), -0.5, (1, 0, 0)),
        ((0, 0, 0), (0, 0, -1), (0, 0, 1), -0.5, (1, 0, 0)),
        ((1, 0, 0), (-1, 0, 0), (1, 0, 0), -0.5, (0, -1, 0)),
        ((0, 0, 2), (0, 0, 0), (0, 0, 0), 1.5, (0, 0, 1)),
        ((0, 0, 0), (0, 0, 0), (0, 0, 0), -0.5, (0, 0, 1)),
        ((0, 2, 0), (0, 0, 0), (0, 0, 1e-13), 1.5, (0, 1, 0)),
        ((1e-13, 0, 0), (0, 0, 0), (0, 0, 0), -0.5, (0, 0, 1)),
    ],
    ids=[
        "beside the axis", "beyond the end", "before the start", "inside, over the end",
        "on an axis along x", "on an axis along y", "on an axis along z", "on the end of the axis",
        "outside a sphere", "at a sphere's centre", "a segment of no length", "a hair from a sphere's centre",
    ],
)  # fmt: skip
def test_capsule_case_by_case(point, start, end, distance, normal):
    found, direction = from_capsule(point, start, end, 0.5)
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
    ],
    ids=[
        "before a face", "before another face", "before an edge", "before a corner", "inside below the top",
        "inside above the bottom", "inside at equal depth from three", "inside at equal depth from two", "the centre",
        "on a face", "on an edge", "on a corner",
    ],
)  # fmt: skip
def test_box_case_by_case(point, distance, normal):
    found, direction = from_box(point, (1, 2, 3))
    assert found == pytest.approx(distance, abs=1e-15)
    np.testing.assert_allclose(direction, np.array(normal) / np.linalg.norm(normal), atol=1e-15)


def test_plane():
    normal = np.array([0.48, 0.6, 0.64])
    distance, *direction = to_plane(1.0, 2.0, 3.0, 0.5, 0.5, 0.5, *normal)
    assert distance == pytest.approx(normal @ [0.5, 1.5, 2.5])
    np.testing.assert_array_equal(direction, normal)


@given(points, points, points, radii)
def test_capsule_equals_the_reference_and_its_normal_is_of_length_one(p, a, b, radius):
    distance, normal = from_capsule(p, a, b, radius)
    # Closer together than 1e-12 m both ends count as one.
    assert distance == pytest.approx(capsule_distance(p[None], a, b, radius)[0], abs=2e-12)
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=ROUNDING)


@given(points, halves_of_boxes)
def test_box_equals_the_reference_and_its_normal_is_of_length_one(p, halves):
    distance, normal = from_box(p, halves)
    assert distance == pytest.approx(box_distance(p[None], halves)[0], abs=ROUNDING)
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=ROUNDING)


@given(points, points, points, points, radii, halves_of_boxes)
def test_distances_change_no_faster_than_the_point_moves(p, q, a, b, radius, halves):
    moved = np.linalg.norm(q - p) + 2e-12
    assert abs(from_capsule(p, a, b, radius)[0] - from_capsule(q, a, b, radius)[0]) <= moved
    assert abs(from_box(p, halves)[0] - from_box(q, halves)[0]) <= moved


@given(points, points, points, radii, halves_of_boxes)
def test_a_step_along_the_normal_leads_to_the_surface(p, a, b, radius, halves):
    # What contact relies on: the point moved by -distance along the normal lies on the surface.
    distance, normal = from_capsule(p, a, b, radius)
    assert from_capsule(p - distance * normal, a, b, radius)[0] == pytest.approx(0.0, abs=1e-10)
    distance, normal = from_box(p, halves)
    assert from_box(p - distance * normal, halves)[0] == pytest.approx(0.0, abs=ROUNDING)


@given(points, points, points, radii)
def test_the_normal_is_the_gradient_of_the_distance(p, a, b, radius):
    distance, normal = from_capsule(p, a, b, radius)
    off_axis = distance + radius
    if off_axis < 0.05:
        return
    step = 1e-5
    gradient = [
        (from_capsule(p + e, a, b, radius)[0] - from_capsule(p - e, a, b, radius)[0]) / (2 * step)
        for e in step * np.eye(3)
    ]
    # Curvature is at most 1 / 0.05 m, and jumps where caps meet the side: first order in the step.
    np.testing.assert_allclose(gradient, normal, atol=2 * step / 0.05 + 1e-9)


@given(points, points, points, radii, rotations, points)
def test_the_distance_does_not_depend_on_where_the_world_is(p, a, b, radius, rotation, shift):
    def moved(x: np.ndarray) -> np.ndarray:
        return rotation @ x + shift

    before, normal = from_capsule(p, a, b, radius)
    after, turned = from_capsule(moved(p), moved(a), moved(b), radius)
    # Where a turn changes on which side of 1e-12 m the ends are, the distance changes by as much.
    assert after == pytest.approx(before, abs=3e-12)
    if before + radius > 1e-3:
        np.testing.assert_allclose(turned, rotation @ normal, atol=1e-8)


@given(points, halves_of_boxes, st.permutations([0, 1, 2]), st.tuples(*(st.sampled_from([-1.0, 1.0]),) * 3))
def test_a_box_looks_the_same_from_all_sides(p, halves, order, signs):
    before, _ = from_box(p, halves)
    after, _ = from_box((p * signs)[order], halves[order])
    assert after == pytest.approx(before, abs=ROUNDING)
