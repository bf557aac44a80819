"""Pieces on all triangulations: they cover what they should, with the triangles that their names tell of."""

import math

import numpy as np
import pytest

from cape.cloth.triangle_mesh import edges_of
from cape.report.measured.world import triangulations
from cape.report.measured.world.triangulations import DISC_KINDS, KINDS, Piece, ring, strip

LENGTH, WIDTH, SPACING = 0.4, 0.15, 0.025


def areas(piece: Piece) -> np.ndarray:
    """Signed."""
    p, q, r = piece.points[piece.triangles].transpose(1, 0, 2)
    return ((q - p)[:, 0] * (r - p)[:, 1] - (q - p)[:, 1] * (r - p)[:, 0]) / 2.0


@pytest.mark.parametrize("kind", KINDS)
def test_a_strip_is_covered_once_and_has_vertices_across_its_middle(kind: str):
    piece = strip(kind, LENGTH, WIDTH, SPACING)
    assert (areas(piece) > 0.0).all()
    assert areas(piece).sum() == pytest.approx(LENGTH * WIDTH, rel=1e-9)
    assert set(piece.triangles.ravel()) == set(range(len(piece.points)))
    for place in (0.0, LENGTH / 2.0, LENGTH):
        assert np.isclose(piece.points[:, 0], place, atol=1e-12).sum() == round(WIDTH / SPACING) + 1
    # Two triangles for each vertex, up to those of the border.
    assert len(piece.triangles) == 2 * len(piece.points) - 2 - _border(piece)


@pytest.mark.parametrize("kind", DISC_KINDS)
def test_a_ring_is_covered_once_between_its_circles(kind: str):
    piece = ring(kind, 0.09, 0.15, 0.01)
    outside, inside = round(2.0 * math.pi * 0.15 / 0.01), round(2.0 * math.pi * 0.085 / 0.01)
    assert (areas(piece) > 0.0).all()
    assert areas(piece).sum() == pytest.approx(_polygon(outside, 0.15) - _polygon(inside, 0.085), rel=1e-9)
    held = triangulations.held_by_ring(piece, 0.09, 0.01)
    np.testing.assert_allclose(np.unique(np.hypot(*piece.points[held].T).round(9)), [0.085, 0.095])
    assert _border(piece) == outside + inside


@pytest.mark.parametrize(("kind", "diagonals"), [("one-way", {45.0}), ("alternating", {45.0, 135.0})])
def test_square_cells_are_split_as_their_name_tells(kind: str, diagonals: set[float]):
    piece = strip(kind, LENGTH, WIDTH, SPACING)
    p, q = piece.points[edges_of(piece.triangles).vertices].transpose(1, 0, 2)
    ways = np.rad2deg(np.arctan2(*(q - p).T[::-1])).round(6) % 180.0
    assert set(np.unique(ways)) == {0.0, 90.0} | diagonals
    if kind == "alternating":
        assert np.isclose(ways, 45.0).sum() == np.isclose(ways, 135.0).sum()


def test_equilateral_triangles_are():
    piece = strip("equilateral", 20.0 * math.sqrt(0.75) * SPACING, WIDTH, SPACING)
    p, q = piece.points[edges_of(piece.triangles).vertices].transpose(1, 0, 2)
    lengths = np.hypot(*(q - p).T)
    ends = piece.points[edges_of(piece.triangles).vertices][:, :, 1]
    inside = ((ends > 1e-9) & (ends < WIDTH - 1e-9)).all(axis=1)
    np.testing.assert_allclose(lengths[inside], SPACING, rtol=1e-9)


def test_random_ones_are_the_same_each_time_and_all_unlike():
    one, other = strip("random", LENGTH, WIDTH, SPACING), strip("random", LENGTH, WIDTH, SPACING)
    np.testing.assert_array_equal(one.points, other.points)
    np.testing.assert_array_equal(one.triangles, other.triangles)
    assert np.std(areas(one)) > 0.15 * np.mean(areas(one))


def _border(piece: Piece) -> int:
    """Edges of one triangle alone."""
    return int((edges_of(piece.triangles).triangles == 1).sum())


def _polygon(corners: int, radius: float) -> float:
    return 0.5 * corners * radius**2 * math.sin(2.0 * math.pi / corners)
