"""Where a cloth passes through itself: found as by trying every edge on every triangle."""

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cape import Cloth
from cape.measure.self_crossings import _near, self_crossings, share_crossed
from tests.support.crossing import crossings as edges_through_triangles

SHEET = Cloth.rectangle(width=0.4, height=0.4, spacing=0.1)


def crumpled(seed: int, by: float) -> np.ndarray:
    return SHEET.positions + np.random.default_rng(seed).normal(scale=by, size=SHEET.positions.shape)


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.02, 0.05, 0.1, 0.3]))
def test_there_are_crossings_where_an_edge_passes_through_a_triangle(seed: int, by: float):
    positions = crumpled(seed, by)
    found = self_crossings(positions, SHEET.triangles)
    assert (len(found) > 0) == (edges_through_triangles(positions, SHEET.triangles) > 0)
    assert len(np.unique(np.sort(found, axis=1), axis=0)) == len(found)


@given(
    st.integers(0, 2**32 - 1), st.sampled_from([0.1, 0.3, 3.0]), st.sampled_from([0.0, 1.0]), st.sampled_from([0, 1e12])
)
def test_no_pair_is_missed_however_large_or_far_apart_triangles_are(seed: int, size: float, flat: float, far: float):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(60, 1, 3)) + size * rng.uniform(-1.0, 1.0, (60, 3, 3))
    corners[:, :, 2] *= flat
    corners[0] += far
    low, high = corners.min(axis=1), corners.max(axis=1)
    overlap = ((low[:, None] <= high) & (low <= high[:, None])).all(axis=2)
    found = np.stack(_near(corners), axis=1)
    assert sorted(found.tolist()) == np.argwhere(np.triu(overlap, 1)).tolist()


def test_a_run_is_looked_through_without_scipy(monkeypatch: pytest.MonkeyPatch):
    """Importing it takes as long as the frames of a short run."""
    monkeypatch.setitem(sys.modules, "scipy.spatial", None)
    assert share_crossed(SHEET.positions[None], SHEET.triangles, most=1) == 0.0


def test_a_fold_is_no_crossing_until_it_goes_through():
    # The sheet hangs in the plane x = 0; its halves are laid 2 cm apart, the fold along z.
    across = SHEET.positions[:, 1] - SHEET.positions[:, 1].mean()
    folded = np.stack([np.where(across > 0.0, 0.02, 0.0), np.abs(across), SHEET.positions[:, 2]], axis=1)
    assert len(self_crossings(folded, SHEET.triangles)) == 0
    corner = np.argmax(across - folded[:, 2])
    folded[corner] += [-0.05, -0.03, 0.03]  # through the other half
    assert len(self_crossings(folded, SHEET.triangles)) > 0


def test_two_triangles_cross_in_one_pair():
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.3, 0.2, 1], [3, 3, 3]], dtype=float)
    triangles = np.array([[0, 1, 2], [3, 4, 5]])
    assert self_crossings(positions, triangles).tolist() == [[0, 1]]
    apart = positions.copy()
    apart[3:] += [2.0, 0.0, 0.0]
    assert len(self_crossings(apart, triangles)) == 0


def test_the_share_is_of_the_frames_that_are_looked_at():
    crossed = next(p for p in (crumpled(k, 0.3) for k in range(9)) if len(self_crossings(p, SHEET.triangles)))
    takes = np.stack([SHEET.positions, crossed, SHEET.positions, crossed, crossed])
    assert share_crossed(takes, SHEET.triangles, most=100) == pytest.approx(3 / 5)
    assert share_crossed(takes, SHEET.triangles, most=3) == pytest.approx(1 / 3)  # frames 0, 2, 4
    assert share_crossed(takes[:1], SHEET.triangles, most=3) == 0.0
