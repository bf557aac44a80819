"""Meshes of very many triangles: thinned within bounds, told, and fitted like the mesh itself."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from skeleton import Skeleton, hitboxes_of, link_surfaces, missing_meshes
from skeleton.robot.meshes.large_meshes import CELL, clustered
from skeleton.solid_measures import volume


def test_a_mesh_of_many_triangles_is_thinned_and_told_and_one_that_is_damaged_is_left_out(tmp_path, monkeypatch):
    """A ball of 20,480 triangles, half a metre above its link and twice as wide as in its file."""
    monkeypatch.setattr("skeleton.robot.meshes.missing_meshes.LARGE", 2**16)
    monkeypatch.setattr("skeleton.robot.meshes.large_meshes.CELL", coarse := 0.02)
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.1)
    ball.export(tmp_path / "ball.stl")
    shape = '<origin xyz="0 0 0.5"/><geometry><mesh filename="{}" scale="2 2 2"/></geometry>'
    both = f"<visual>{shape}</visual><collision>{shape}</collision>".replace("{}", "ball.stl")
    path = tmp_path / "one.urdf"
    path.write_text(f'<robot name="one"><link name="base">{both}</link></robot>')
    body = Skeleton.from_urdf(path)
    (surface,) = link_surfaces(body, "visual")
    (told,) = missing_meshes(body, "visual")
    assert told == f"the mesh ball.stl has {len(ball.faces)} triangles, and is thinned to {len(surface.triangles)}"
    assert 1000 < len(surface.triangles) < 0.5 * len(ball.faces)
    thin = trimesh.Trimesh(surface.vertices, surface.triangles)
    # A mean of places within a cell's diagonal d of each other lies d^2 / (8 r) inside of a sphere at most, as a chord.
    width = coarse * 0.4 * np.sqrt(3.0)
    assert thin.volume == pytest.approx(8.0 * ball.volume, rel=2.0 * 3.0 * 2.0 * width**2 / (8.0 * 0.2**2))
    radii = np.linalg.norm(surface.vertices - [0.0, 0.0, 0.5], axis=1)
    assert np.abs(radii - 0.2).max() < 2.0 * 2.0 * width**2 / (8.0 * 0.2)
    (fitted,) = hitboxes_of(body, which="all").solids
    assert volume(fitted) == pytest.approx(8.0 * ball.volume, rel=0.02)
    (tmp_path / "torn.stl").write_bytes(bytes(2**16 + 1))
    torn = f"<visual>{shape}</visual>".replace("{}", "torn.stl")
    path.write_text(f'<robot name="one"><link name="base">{both}{torn}</link></robot>')
    told = missing_meshes(Skeleton.from_urdf(path), "visual")
    assert told[0] == "the mesh torn.stl of base can't be read: its collision shape stands in for it"


@given(st.integers(0, 2**32 - 1), st.integers(4, 300))
def test_clustered_corners_stay_within_a_cell_and_a_mirrored_mesh_is_clustered_to_the_mirror_image(seed, count):
    rng = np.random.default_rng(seed)
    vertices = rng.standard_normal((count, 3)) * rng.uniform(1e-3, 1e3, 3)
    triangles = rng.integers(0, count, (2 * count, 3))
    found, corners = clustered(vertices, triangles)
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    nearest = np.linalg.norm(vertices[:, None] - found[None], axis=2).min(axis=1)
    assert (nearest <= np.sqrt(3.0) * CELL * size * (1.0 + 1e-9)).all()
    assert (corners != np.roll(corners, 1, axis=1)).all()
    mirror = np.array([-1.0, 1.0, 1.0])
    mirrored, _ = clustered(vertices * mirror, triangles)
    assert len(mirrored) == len(found)
    order, other = (np.lexsort(np.round(places / size, 9).T) for places in (found, mirrored * mirror))
    np.testing.assert_allclose(found[order], (mirrored * mirror)[other], atol=1e-8 * size)
