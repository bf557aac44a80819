"""Outfits that tear: which part does, its take, and its recording."""

import numpy as np
import pytest

import cape
from cape.cloth.triangle_mesh import edges_of
from cape.outfits.apart import takes_apart
from cape.results.take import Take
from cape.scene.tearing_scenes import torn
from tests.support.scenes import walking
from tests.tearing.to_tear import fans, with_another_aside


@pytest.fixture(scope="module")
def beside() -> Take:
    """A sheet that a heavy ball has fallen on, behind another one that is held likewise and bears nothing."""
    standard = torn(spacing=0.06, seconds=0.5)
    return cape.simulate(with_another_aside(standard.scene), standard.track, name="both")


def test_a_part_that_tears_has_its_own_vertices_and_triangles(beside):
    under, aside = takes_apart(beside)
    assert len(beside.topologies) > 2
    assert len(under.topologies) > 1
    assert under.cloth is not None
    assert aside.cloth is not None
    assert len(aside.topologies) == 1
    assert np.array_equal(aside.triangles, aside.cloth.triangles)
    assert aside.positions.shape[1] == aside.cloth.vertices
    parents = under.topologies[-1].parents
    assert under.positions.shape[1] == len(under.texcoords) == len(parents) > under.cloth.vertices
    assert np.array_equal(under.texcoords, under.cloth.texcoords[parents])
    for topology in under.topologies:
        assert fans(topology.triangles).max() == 1
    # As many triangles and places as of both, edge by edge.
    whole, last = under.cloth.vertices, beside.triangles_at(len(beside.positions) - 1)
    split = [beside.positions[-1][last[: len(last) // 2]], beside.positions[-1][last[len(last) // 2 :]]]
    for part, places in zip((aside, under), split, strict=True):
        assert np.array_equal(part.positions[-1][part.triangles_at(len(part.positions) - 1)], places)
    assert len(edges_of(under.triangles_at(len(under.positions) - 1)).vertices) > len(
        edges_of(under.triangles).vertices
    )
    assert np.array_equal(np.sort(np.concatenate([aside.held, under.held + whole])), np.sort(beside.held))


def test_stretch_of_parts_is_that_of_what_is_left(beside):
    under, aside = takes_apart(beside)
    assert np.maximum(under.stretch_max, aside.stretch_max) == pytest.approx(beside.stretch_max, abs=1e-5)
    assert aside.stretch_max.max() < under.stretch_max.max()


def test_a_recording_has_each_part_as_it_has_torn(beside, tmp_path):
    import rerun as rr

    beside.save(tmp_path / "both.rrd", layers="cape")
    for part in takes_apart(beside):
        found = []
        for chunk in rr.chunk.RrdReader(tmp_path / "both.rrd").stream().filter(content=f"/world/cloths/{part.name}"):
            batch = chunk.to_record_batch()
            if "Mesh3D:triangle_indices" in batch.schema.names and "frame" in batch.schema.names:
                frames, column = batch.column("frame").to_pylist(), batch.column("Mesh3D:triangle_indices")
                found += [frame for frame, rows in zip(frames, column.to_pylist(), strict=True) if rows]
        assert sorted(found) == [topology.frame for topology in part.topologies] or len(part.topologies) == 1


def test_garments_may_tear_whatever_they_are_of():
    walker = walking(0.1)
    names, tearing = ["back_cape", "skirt"], cape.Tearing(strain=0.2)
    scene = cape.dress(*walker, garments=names, spacing=0.1, tearing=tearing)
    assert scene.tearing is tearing
    assert not scene.strain_limit
    assert cape.dress(*walker, garments=names, spacing=0.1, tearing=tearing, strain_limit=True).strain_limit
    scene = cape.dress(*walker, garments=names, spacing=0.1, tearing=tearing, fabric={"skirt": cape.FABRICS["denim"]})
    assert scene.tearing is tearing
