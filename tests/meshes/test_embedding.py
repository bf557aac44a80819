"""A fine mesh on a coarse one, and a mesh of even edges over another."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cape.cloth.cloth import areas
from cape.cloth.triangle_mesh import edges_of
from cape.meshes.cleaning.clean import clean
from cape.meshes.edges import borders
from cape.meshes.embedding import embedded
from cape.meshes.nearest import nearest_on
from cape.meshes.remeshing import LONG, remeshed
from cape.meshes.source import Source
from motions import quaternions
from motions.errors import ValueRangeError
from tests.meshes.mesh_files import sheet, tube

COARSE, FINE = tube(10, 4, 0.2, 0.5), tube(40, 13, 0.21, 0.5)


def test_the_nearest_place_is_that_of_a_search_over_all_triangles():
    points, faces = COARSE
    # A triangle whose middle is far from much of it, among small ones.
    points = np.concatenate([points, [[-0.4, -0.4, -2.0], [-0.4, 0.4, -2.0], [-0.4, 0.0, 1.0]]])
    faces = np.concatenate([faces, [[len(points) - 3, len(points) - 2, len(points) - 1]]])
    rng = np.random.default_rng(3)
    asked = rng.uniform(-0.6, 0.6, (40, 3))
    found = nearest_on(asked, points, faces)
    # Places on a triangle: all shares that are multiples of 1/60. Two neighbours are a 60th of a side apart.
    shares = np.array([(i, j, 60 - i - j) for i in range(61) for j in range(61 - i)]) / 60.0
    places = np.einsum("sc,tck->tsk", shares, points[faces]).reshape(-1, 3)
    tried = np.array([np.linalg.norm(places - point, axis=1).min() for point in asked])
    side = np.linalg.norm(points[faces] - np.roll(points[faces], 1, axis=1), axis=2).max()
    assert (found.distances <= tried + 1e-12).all()
    assert (found.distances >= tried - side / 60.0).all()
    at = np.einsum("nc,nck->nk", found.shares, points[faces[found.triangles]])
    assert np.linalg.norm(asked - at, axis=1) == pytest.approx(found.distances)
    assert (found.shares >= 0.0).all()


def test_a_fine_mesh_starts_where_it_was_modelled():
    visual = embedded(*FINE, None, *COARSE)
    assert visual.places(COARSE[0]) == pytest.approx(FINE[0], abs=1e-6)
    assert np.abs(visual.heights).max() > 0.005  # it does not lie in the coarse one's faces


@settings(max_examples=10, deadline=None)
@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3), st.tuples(*[st.floats(-5.0, 5.0)] * 3))
def test_a_rigid_motion_takes_the_fine_mesh_along_exactly(turn, shift):
    rotation = quaternions.from_rotation_vector(np.array(turn))
    visual = embedded(*FINE, None, *COARSE)
    frames = np.stack([quaternions.rotate(rotation, COARSE[0]) + shift, COARSE[0]])
    expected = quaternions.rotate(rotation, FINE[0]) + shift
    places = visual.places(frames)
    assert places[0] == pytest.approx(expected, abs=2e-6)  # single precision some metres from the origin
    assert places[1] == pytest.approx(FINE[0], abs=1e-6)


def test_vertices_of_a_texture_seam_share_their_normals():
    points = np.concatenate([FINE[0], FINE[0][:5]])
    visual = embedded(points, FINE[1], None, *COARSE)
    assert visual.whole.tolist() == [*range(len(FINE[0])), *range(5)]


@pytest.mark.parametrize("spacing", [0.03, 0.05, 0.2])
def test_edges_are_of_the_spacing_that_was_asked_for(spacing):
    points, faces = sheet(7, 11)
    hem = (points[:, 2] < -0.55).astype(float)
    source = remeshed(clean(Source(points, faces, weights={"hem": hem})), spacing)
    edges = edges_of(source.triangles)
    lengths = np.linalg.norm(np.diff(source.positions[edges.vertices], axis=1)[:, 0], axis=1)
    assert np.median(lengths) == pytest.approx(spacing, rel=0.15)
    assert np.percentile(lengths, 98) < LONG * spacing * 1.1
    # A flat sheet stays the same sheet, border and all.
    assert areas(source.positions[source.triangles]).sum() == pytest.approx(0.6, rel=1e-9)
    assert np.abs(source.positions[:, 0]).max() < 1e-12
    (border,) = borders(source.triangles)
    assert {(round(y, 9), round(z, 9)) for _, y, z in source.positions} >= {
        (0.0, 0.0),
        (1.0, 0.0),
        (0.0, -0.6),
        (1.0, -0.6),
    }
    assert len(border) == pytest.approx(3.2 / spacing, rel=0.3)
    # The map is 1 along the lowest row of the sheet and goes down to 0 a tenth of a metre above it.
    assert source.weights["hem"] == pytest.approx(
        np.clip(1.0 - (source.positions[:, 2] + 0.6) / 0.1, 0.0, 1.0), abs=1e-9
    )


def test_a_remeshed_tube_stays_on_its_surface_and_open_at_both_ends():
    source = remeshed(clean(Source(*FINE)), 0.05)
    assert nearest_on(source.positions, *FINE).distances.max() < 1e-12
    assert len(borders(source.triangles)) == 2
    # Chords across a 40-gon: each edge of 5 cm spans 0.24 rad, so that a facet loses (1 - cos 0.12) of the radius.
    assert areas(source.positions[source.triangles]).sum() == pytest.approx(2.0 * np.pi * 0.21 * 0.5, rel=0.03)


def test_a_spacing_out_of_range_is_told():
    for spacing in (0.0, -1.0, 5.0, np.nan):
        with pytest.raises(ValueRangeError, match="spacing"):
            remeshed(Source(*FINE), spacing)
