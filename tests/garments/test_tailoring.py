"""What garments are cut by: the outline of a body, and the ways out of it."""

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

import motions
from cape.cloth import tailoring
from cape.garments.fitting import NEAR, Fitted
from motions.errors import ValueRangeError
from skeleton import Skeleton


@given(st.integers(0, 2**32 - 1), st.integers(3, 60), st.sampled_from([1e-3, 1.0, 50.0]))
def test_a_hull_has_the_corners_that_another_program_finds(seed: int, count: int, wide: float):
    points = np.random.default_rng(seed).normal(size=(count, 2)) * [wide, 1.0]
    corners = tailoring.hull(points)
    expected = points[ConvexHull(points).vertices]  # against the clock, from anywhere
    (start,) = np.flatnonzero((expected == corners[0]).all(axis=1))
    np.testing.assert_array_equal(corners, np.roll(expected, -int(start), axis=0))


def test_a_hull_leaves_out_what_lies_on_its_sides(monkeypatch: pytest.MonkeyPatch):
    """And takes no scipy, whose import takes longer than a garment to be cut."""
    monkeypatch.setitem(sys.modules, "scipy.spatial", None)
    side = np.linspace(0.0, 1.0, 5)
    points = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    corners = tailoring.hull(np.concatenate([points, points]))
    np.testing.assert_array_equal(corners, [[0, 0], [1, 0], [1, 1], [0, 1]])
    with pytest.raises(ValueRangeError, match="no body"):
        tailoring.hull(points[:5])


def test_ways_out_end_where_all_beyond_is_clear_and_are_looked_for_no_longer(monkeypatch: pytest.MonkeyPatch):
    body = Skeleton.from_clip(motions.load("walk"))
    fitted = Fitted(body, body.capsules())
    angles = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    outwards = np.stack([np.cos(angles), np.sin(angles), np.zeros(40)], axis=1)
    asked, distances = [], fitted.distances

    def counted(points, **options):
        asked.append(len(points))
        return distances(points, **options)

    monkeypatch.setattr(fitted, "distances", counted)
    ways = fitted.way_out(fitted.hips, outwards, 0.02)
    assert ways.shape == (40,)
    np.testing.assert_allclose(distances(fitted.hips + ways[:, None] * outwards), 0.02, atol=NEAR)
    farther = fitted.hips + (ways + np.linspace(0.001, 0.5, 50)[:, None])[..., None] * outwards
    assert distances(farther).min() > 0.02 - NEAR
    assert asked[0] == 40
    assert 0 < asked[-1] < 10
