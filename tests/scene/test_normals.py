"""Vertex normals against a plain loop and against surfaces whose normals are known."""

import numpy as np
import pytest

from cape.cloth.normals import vertex_normals

# A division by zero is a warning to numpy.
pytestmark = pytest.mark.filterwarnings("error")


def grid_triangles(rows: int, columns: int) -> np.ndarray:
    corner = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    lower = np.stack([a, b, c], axis=-1).reshape(-1, 3)
    return np.concatenate([lower, np.stack([a, c, d], axis=-1).reshape(-1, 3)])


def reference_normals(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """One triangle at a time, in double precision."""
    normals = np.zeros(positions.shape)
    for frame, points in enumerate(positions.astype(float)):
        for a, b, c in triangles:
            area = np.cross(points[b] - points[a], points[c] - points[a])
            for vertex in (a, b, c):
                normals[frame, vertex] += area
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def test_equals_a_loop_over_triangles():
    rng = np.random.default_rng(3)
    triangles = grid_triangles(5, 7)
    flat = np.stack(np.meshgrid(np.arange(7.0), np.arange(5.0), indexing="xy"), axis=-1).reshape(-1, 2)
    # 70 frames reach over the edge of a block of frames.
    positions = np.zeros((70, 35, 3), np.float32)
    positions[..., :2] = flat
    positions += 0.3 * rng.standard_normal(positions.shape).astype(np.float32)
    # Six area vectors of about one square unit in single precision: some 10 roundings of 6e-8.
    np.testing.assert_allclose(vertex_normals(positions, triangles), reference_normals(positions, triangles), atol=5e-6)


def test_are_of_length_one():
    rng = np.random.default_rng(4)
    positions = rng.standard_normal((3, 50, 3)).astype(np.float32)
    triangles = rng.integers(0, 50, (200, 3))
    lengths = np.linalg.norm(vertex_normals(positions, triangles), axis=-1)
    np.testing.assert_allclose(lengths, 1.0, atol=4 * 2**-23)


def test_point_out_of_a_sphere():
    longitude, latitude = np.meshgrid(np.linspace(0, 1.0, 40), np.linspace(-0.5, 0.5, 40))
    sphere = np.stack(
        [np.cos(longitude) * np.cos(latitude), np.sin(longitude) * np.cos(latitude), np.sin(latitude)], axis=-1
    ).reshape(1, -1, 3)
    inner = np.arange(1600).reshape(40, 40)[1:-1, 1:-1].ravel()
    normals = vertex_normals(sphere, grid_triangles(40, 40))
    # Six triangles around a vertex of a regular grid cancel the error of first order in the spacing of 1/39.
    np.testing.assert_allclose(normals[0, inner], sphere[0, inner], atol=(1 / 39) ** 2)


def test_weights_triangles_by_area():
    positions = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 3]]], np.float32)
    # Area vectors: (0, 0, 1/2) and, over the edge to (0, 0, 3), (3/2, 0, 0).
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    expected = np.array([3, 0, 1]) / np.sqrt(10)
    np.testing.assert_allclose(vertex_normals(positions, triangles)[0, 0], expected, atol=1e-6)


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((3, 3)),
        np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]),
        np.array([[0.0, 0, 0], [1e-30, 0, 0], [0, 1e-30, 0]]),
    ],
    ids=["one point", "a line", "below single precision"],
)
def test_without_area_is_up(points):
    normals = vertex_normals(points[None], np.array([[0, 1, 2]]))
    np.testing.assert_array_equal(normals[0], np.tile([0.0, 0.0, 1.0], (3, 1)))


def test_small_triangles_keep_their_normal():
    points = 1e-6 * np.array([[[0.0, 0, 0], [0, 1, 0], [0, 0, 1]]])
    np.testing.assert_allclose(vertex_normals(points, np.array([[0, 1, 2]]))[0], np.tile([1.0, 0, 0], (3, 1)))


def test_degenerate_neighbour_changes_nothing():
    positions = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]]], np.float32)
    normals = vertex_normals(positions, np.array([[0, 1, 2], [0, 1, 3]]))
    np.testing.assert_array_equal(normals[0, 0], [0.0, 0.0, 1.0])
    assert np.isfinite(normals).all()


def test_vertex_of_no_triangle_and_no_triangles_at_all():
    positions = np.ones((2, 4, 3), np.float32)
    np.testing.assert_array_equal(vertex_normals(positions, np.array([[0, 1, 2]]))[:, 3], np.tile([0.0, 0, 1], (2, 1)))
    none = np.empty((0, 3), np.int32)
    np.testing.assert_array_equal(vertex_normals(positions, none), np.broadcast_to([0.0, 0, 1], (2, 4, 3)))
