"""Scenes that tear, from a simulation to a take, a recording and a command."""

import numpy as np
import pytest

import cape
from cape.results.take import Take
from cape.results.verdict import loose_warnings
from cape.scene.standard_scenes import standard_scene
from cape.scene.tearing_scenes import TEARING_SCENES, caught, torn
from tests.tearing.to_tear import fans


@pytest.fixture(scope="module")
def fallen_through() -> Take:
    """What is left of the sheet that a heavy ball has fallen on."""
    standard = torn(spacing=0.05, seconds=0.6)
    return cape.simulate(standard.scene, standard.track, name="torn")


def test_a_heavy_ball_falls_through_a_sheet_which_keeps_its_mass(fallen_through):
    take = fallen_through
    assert take.tears > 0
    assert take.mass[1] == pytest.approx(take.mass[0], rel=1e-12)
    # The ball is below all of the sheet in the end, and was not let through by contact.
    ball = take.bones.positions[-1, take.bones.names.index("ball"), 2]
    assert take.positions[-1, :, 2].min() > ball
    assert take.penetration.max() < 1e-3


def test_a_take_knows_its_triangles_in_each_frame(fallen_through):
    take = fallen_through
    frames = [topology.frame for topology in take.topologies]
    assert frames[0] == 0
    assert frames == sorted(set(frames))
    assert np.array_equal(take.triangles_at(0), take.triangles)
    assert np.array_equal(take.triangles_at(frames[-1]), take.topologies[-1].triangles)
    assert np.array_equal(take.triangles_at(frames[1] - 1), take.triangles)
    for topology in take.topologies:
        assert fans(topology.triangles).max() == 1
    whole, parents = len(take.topologies[0].parents), take.topologies[-1].parents
    assert take.positions.shape[1] == len(take.texcoords) == len(parents) > whole
    assert np.array_equal(take.texcoords, take.texcoords[parents])
    # Until they split off, vertices are where those are that they split off from.
    assert np.array_equal(take.positions[: frames[1]], take.positions[: frames[1]][:, parents])
    assert not np.array_equal(take.positions[-1], take.positions[-1][parents])


def test_a_recording_has_the_triangles_from_the_frame_on_in_which_they_change(fallen_through, tmp_path):
    import rerun as rr

    take = fallen_through
    take.save(tmp_path / "torn.rrd", layers="cape")
    found = {}
    for chunk in rr.chunk.RrdReader(tmp_path / "torn.rrd").stream().filter(content="/world/cape"):
        batch = chunk.to_record_batch()
        if "Mesh3D:triangle_indices" in batch.schema.names:
            frames, column = batch.column("frame").to_pylist(), batch.column("Mesh3D:triangle_indices")
            found |= {frame: np.array(rows) for frame, rows in zip(frames, column.to_pylist(), strict=True) if rows}
    assert sorted(found) == [topology.frame for topology in take.topologies]
    for topology in take.topologies:
        assert np.array_equal(found[topology.frame], topology.triangles)


def test_a_cape_that_is_caught_leaves_a_piece_behind():
    standard = caught(spacing=0.06, seconds=1.2)
    take = cape.simulate(standard.scene, standard.track, name="caught")
    assert take.tears > 0
    last = take.topologies[-1].triangles
    corners = take.positions[-1][last].mean(axis=1)
    left = corners[:, 0] < 0.3
    assert 0.0 < left.mean() < 0.05
    # What the spike holds hangs on it, and the cape on its shoulders.
    assert loose_warnings(take) == []


def test_what_hangs_on_nothing_is_told():
    track = torn(seconds=0.5).track
    cloth = cape.Cloth.rectangle(width=0.3, height=0.4, spacing=0.05)
    # It weighs 0.2 kg/m2 x 9.81 m/s2 x 0.4 m = 0.8 N/m.
    weak = cape.Scene(cloth, [cape.attach(cloth, "bars", "top")], tearing=cape.Tearing(force=0.3))
    take = cape.simulate(weak, track, name="weak")
    assert any("the cape comes off at frame" in warning for warning in take.warnings)
    assert take.positions[-1, :, 2].min() < -0.8
    assert np.array_equal(take.positions[-1, cloth.regions["top"]], cloth.positions[cloth.regions["top"]].astype("f4"))


@pytest.mark.parametrize("name", TEARING_SCENES)
def test_scenes_are_found_by_name(name):
    standard = standard_scene(name)
    assert standard.name == name
    assert standard.scene.tearing is not None
