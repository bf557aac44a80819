"""Quaternions against matrices that are written out by hand, and their own inverses."""

from itertools import permutations

import numpy as np
import pytest

from motions import quaternions

# A few roundings of products of numbers up to 1.
ROUNDING = 1e-14
ORDERS = ["".join(order) for order in permutations("xyz")]


def axis_matrix(axis: str, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array(
        {
            "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
            "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        }[axis]
    )


def random_rotations(count: int, seed: int = 0) -> np.ndarray:
    return quaternions.normalize(np.random.default_rng(seed).normal(size=(count, 4)))


@pytest.mark.parametrize("axes", [*ORDERS, "xyx", "yz", "x", ""])
def test_euler_angles_are_products_of_axis_matrices(axes):
    angles = np.random.default_rng(1).uniform(-4, 4, size=(20, len(axes)))
    expected = np.array([np.linalg.multi_dot([np.eye(3), np.eye(3), *map(axis_matrix, axes, row)]) for row in angles])
    np.testing.assert_allclose(quaternions.to_matrix(quaternions.from_euler(angles, axes)), expected, atol=ROUNDING)


@pytest.mark.parametrize("order", ORDERS)
def test_euler_angles_of_a_rotation_make_that_rotation(order):
    rotations = random_rotations(200)
    angles = quaternions.to_euler(rotations, order)
    again = quaternions.from_euler(angles, order)
    assert np.abs(angles[:, 1]).max() <= np.pi / 2
    np.testing.assert_allclose(np.abs(np.sum(again * rotations, axis=-1)), 1, atol=ROUNDING)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("middle", [np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-9])
def test_euler_angles_survive_gimbal_lock(order, middle):
    rotation = quaternions.from_euler([0.7, middle, -1.1], order)
    again = quaternions.from_euler(quaternions.to_euler(rotation, order), order)
    np.testing.assert_allclose(quaternions.to_matrix(again), quaternions.to_matrix(rotation), atol=ROUNDING)


def test_multiply_rotate_and_conjugate_agree_with_matrices():
    a, b = random_rotations(50, 2), random_rotations(50, 3)
    vectors = np.random.default_rng(4).normal(size=(50, 3))
    matrices = quaternions.to_matrix(a)
    np.testing.assert_allclose(
        quaternions.to_matrix(quaternions.multiply(a, b)), matrices @ quaternions.to_matrix(b), atol=ROUNDING
    )
    np.testing.assert_allclose(
        quaternions.rotate(a, vectors), np.einsum("nij,nj->ni", matrices, vectors), atol=10 * ROUNDING
    )
    np.testing.assert_allclose(
        quaternions.to_matrix(quaternions.conjugate(a)), np.swapaxes(matrices, 1, 2), atol=ROUNDING
    )


def test_from_matrix_inverts_to_matrix_also_at_half_turns():
    half_turns = np.eye(4)  # w, and half turns about x, y and z: each is the largest component once
    rotations = np.concatenate([half_turns, random_rotations(100)])
    rotations = np.where(rotations[:, :1] < 0, -rotations, rotations)
    np.testing.assert_allclose(quaternions.from_matrix(quaternions.to_matrix(rotations)), rotations, atol=ROUNDING)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 1.0, 3.0])
def test_slerp_turns_at_constant_angular_velocity(angle):
    axis = np.array([1.0, 2.0, -2.0]) / 3
    fractions = np.linspace(0, 1, 7)
    expected = quaternions.from_rotation_vector(fractions[:, None] * angle * axis)
    start, end = quaternions.from_rotation_vector([0 * axis, angle * axis])
    np.testing.assert_allclose(quaternions.slerp(start, end, fractions), expected, atol=ROUNDING)
    np.testing.assert_allclose(quaternions.slerp(start, -end, fractions), expected, atol=ROUNDING)


def test_make_continuous_changes_signs_only():
    turning = quaternions.from_rotation_vector(
        np.linspace(0, 20, 300)[:, None, None] * np.array([[0, 0, 1], [1, 0, 0]])
    )
    signs = np.random.default_rng(5).choice([-1.0, 1.0], size=(300, 2, 1))
    continuous = quaternions.make_continuous(turning * signs)
    assert np.all(np.sum(continuous[1:] * continuous[:-1], axis=-1) > 0)
    np.testing.assert_array_equal(continuous, turning * signs[0])
