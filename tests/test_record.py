"""Recordings, read back: what was sent is what is there, and a file appears whole or not at all."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import rerun as rr

from cape import record
from cape.colliders import Box, Plane, Sphere
from cape.normals import vertex_normals
from cape.record.frames import Frames
from cape.record.layers import drawn_links
from cape.record.poses import from_z_axis
from cape.record.stage import heading, skeleton_height, smoothed_path
from cape.take import Take
from motions import quaternions
from motions.errors import FileError, UnknownNameError, ValueRangeError
from skeleton.capsules import Capsule
from skeleton.track import BoneTrack

HERE = Path(__file__).parent
FRAMES, ROWS, COLUMNS = 50, 9, 8


def make_bones(frames: int = FRAMES) -> BoneTrack:
    """A root at the origin, 4 m behind a pelvis that walks along +Y; two arms, and a bone of no length."""
    rng = np.random.default_rng(1)
    names = ("root", "Hips", "Spine", "LeftArm", "RightArm", "Nub")
    times = np.arange(frames) / 120
    positions = np.zeros((frames, len(names), 3))
    pelvis = np.stack([0 * times, 4 + 1.2 * times, 0.9 + 0 * times], axis=-1)
    for bone, offset in enumerate([[0, 0, 0], [0, 0, 0.4], [-0.2, 0, 0.4], [0.2, 0, 0.4], [0.2, 0, 0.4]]):
        positions[:, bone + 1] = pelvis + offset
    rotations = quaternions.normalize(rng.standard_normal((frames, len(names), 4)))
    roles = {"pelvis": "Hips", "left_upper_arm": "LeftArm", "right_upper_arm": "RightArm"}
    return BoneTrack(names, times, positions, rotations, np.array([-1, 0, 1, 2, 2, 4]), roles)


def make_take(frames: int = FRAMES) -> Take:
    rng = np.random.default_rng(2)
    corner = np.arange(ROWS * COLUMNS).reshape(ROWS, COLUMNS)
    lower = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:]], axis=-1).reshape(-1, 3)
    upper = np.stack([corner[:-1, :-1], corner[1:, 1:], corner[1:, :-1]], axis=-1).reshape(-1, 3)
    colliders = (
        Capsule("spine", "Spine", np.array([0.0, 0.1, 0.0]), np.array([0.1, 0.2, 0.5]), 0.12),
        Capsule("left_upper_arm", "LeftArm", np.zeros(3), np.array([0.0, 0.0, -0.3]), 0.05),
        Capsule("ball", "RightArm", np.full(3, 0.1), np.full(3, 0.1), 0.07),
        Capsule("post", None, np.array([1.0, 0.0, 0.0]), np.array([1.0, 0.0, 1.0]), 0.1),
        Sphere(name="held/ball", bone="RightArm", center=np.array([0.0, 0.1, 0.0]), radius=0.2),
        Box(name="bench", center=np.array([1.0, 2.0, 0.2]), half_sizes=np.array([0.5, 0.2, 0.2])),
        Plane(name="ground", point=np.array([0.0, 0.0, 0.25])),
    )
    return Take(
        name="test take",
        bones=make_bones(frames),
        colliders=colliders,
        triangles=np.concatenate([lower, upper]).astype(np.int32),
        texcoords=rng.random((ROWS * COLUMNS, 2)).astype(np.float32),
        positions=rng.standard_normal((frames, ROWS * COLUMNS, 3)).astype(np.float32),
        stretch_max=rng.random(frames) / 10,
        stretch_p99=0.01,
        penetration=rng.random(frames) / 100,
        penetrated=np.zeros(frames, np.int64),
        kinetic_energy=rng.random(frames),
        solver="symplectic",
        substeps=10,
        compile_s=0.0,
        settle_s=0.0,
        solve_s=0.1,
    )


# Rerun warns instead of raising where a value has the wrong type.
pytestmark = pytest.mark.filterwarnings("error::rerun.error_utils.RerunWarning")


class Recording:
    """A recording file read back, by entity and component."""

    def __init__(self, path: Path):
        self.reader = rr.chunk.RrdReader(path)
        self.chunks = list(self.reader.stream())
        self.entities = {chunk.entity_path for chunk in self.chunks if not chunk.entity_path.startswith("/__")}

    def column(self, entity: str, name: str, *, static: bool = False) -> list:
        """The rows of a column of an entity, over all chunks in order of time."""
        batches = [chunk.to_record_batch() for chunk in self.of(entity) if chunk.is_static == static]
        batches = [batch for batch in batches if name in batch.schema.names]
        assert batches, f"no column {name} on {entity}"
        if not static:
            batches.sort(key=lambda batch: batch.column("frame")[0].as_py())
        return [row for batch in batches for row in batch.column(name)]

    def array(self, entity: str, name: str, *, static: bool = False) -> np.ndarray:
        """The same as an array with a row each."""
        return np.array([row.as_py() for row in self.column(entity, name, static=static)])

    def of(self, entity: str) -> list:
        return [chunk for chunk in self.chunks if chunk.entity_path == entity]


@pytest.fixture(scope="module")
def take() -> Take:
    return make_take()


@pytest.fixture(scope="module")
def saved(take: Take, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    path = tmp_path_factory.mktemp("record") / "take.rrd"
    take.save(path)
    return Recording(path)


def test_positions_are_the_take_bit_for_bit(saved: Recording, take: Take):
    positions = saved.array("/world/cape", "Mesh3D:vertex_positions").astype(np.float32)
    np.testing.assert_array_equal(positions, take.positions)
    normals = saved.array("/world/cape", "Mesh3D:vertex_normals").astype(np.float32)
    np.testing.assert_array_equal(normals, vertex_normals(take.positions, take.triangles))


@pytest.mark.parametrize(
    ("entity", "column"),
    [
        ("/world/cape", "Mesh3D:vertex_positions"),
        ("/world/skeleton", "LineStrips3D:strips"),
        ("/world/hitboxes", "Capsules3D:translations"),
        ("/world/hitboxes", "Capsules3D:quaternions"),
        ("/world/character", "Transform3D:translation"),
        # With the translation in every row: a row of a transform replaces the one before as a whole.
        ("/world/character", "Transform3D:quaternion"),
        ("/plots/stretch", "Scalars:scalars"),
        ("/plots/penetration", "Scalars:scalars"),
        ("/plots/kinetic_energy", "Scalars:scalars"),
    ],
)
def test_one_row_a_frame_on_both_timelines(saved: Recording, take: Take, entity: str, column: str):
    assert len(saved.column(entity, column)) == FRAMES
    frames = saved.array(entity, "frame").tolist()
    assert frames == list(range(FRAMES))
    seconds = [row.value / 1e9 for row in saved.column(entity, "time")]
    # Nanoseconds are what a timeline counts.
    np.testing.assert_allclose(seconds, take.bones.times, rtol=0, atol=0.5e-9)


def test_topology_is_there_once(saved: Recording, take: Take):
    (triangles,) = saved.array("/world/cape", "Mesh3D:triangle_indices", static=True)
    np.testing.assert_array_equal(triangles, take.triangles)
    (texcoords,) = saved.array("/world/cape", "Mesh3D:vertex_texcoords", static=True)
    np.testing.assert_array_equal(texcoords.astype(np.float32), take.texcoords)
    moving = [chunk.to_record_batch().schema.names for chunk in saved.of("/world/cape") if not chunk.is_static]
    assert not any(name.startswith("Mesh3D:t") or "texture" in name for names in moving for name in names)
    # Static positions would hide the moving ones for ever.
    still = [chunk.to_record_batch().schema.names for chunk in saved.of("/world/cape") if chunk.is_static]
    assert not any("positions" in name or "normals" in name for names in still for name in names)


def test_a_long_take_is_cut_into_chunks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, take: Take):
    monkeypatch.setattr("cape.record.frames.BYTES_PER_CHUNK", 24 * take.positions.shape[1] * 7)
    take.save(tmp_path / "take.rrd", layers=["cape"])
    recording = Recording(tmp_path / "take.rrd")
    rows = [chunk.num_rows for chunk in recording.of("/world/cape") if not chunk.is_static]
    assert sorted(rows) == [1, 7, 7, 7, 7, 7, 7, 7]
    positions = recording.array("/world/cape", "Mesh3D:vertex_positions").astype(np.float32)
    np.testing.assert_array_equal(positions, take.positions)


def test_capsules_end_where_their_bones_take_them(saved: Recording, take: Take):
    capsules = [collider for collider in take.colliders if isinstance(collider, Capsule)]
    (labels,) = saved.column("/world/hitboxes", "Capsules3D:labels", static=True)
    assert labels.as_py() == [capsule.name for capsule in capsules]
    (radii,) = saved.array("/world/hitboxes", "Capsules3D:radii", static=True)
    np.testing.assert_allclose(radii, [capsule.radius for capsule in capsules], rtol=1e-7)
    (lengths,) = saved.array("/world/hitboxes", "Capsules3D:lengths", static=True)
    starts = saved.array("/world/hitboxes", "Capsules3D:translations")
    xyzw = saved.array("/world/hitboxes", "Capsules3D:quaternions")
    axes = quaternions.rotate(np.roll(xyzw, 1, axis=-1), np.array([0.0, 0.0, 1.0]))
    ends = starts + axes * lengths[:, None]
    for number, capsule in enumerate(capsules):
        for recorded, in_bone in ((starts, capsule.start), (ends, capsule.end)):
            expected = in_bone
            if capsule.bone is not None:
                bone = take.bones.names.index(capsule.bone)
                turn = quaternions.to_matrix(take.bones.rotations_wxyz[:, bone])
                expected = take.bones.positions[:, bone] + turn @ in_bone
            # Positions of up to 5 m in single precision.
            np.testing.assert_allclose(recorded[:, number], np.broadcast_to(expected, (FRAMES, 3)), atol=1e-6)


def test_other_colliders(saved: Recording, take: Take):
    ball = next(entity for entity in saved.entities if "ball" in entity)
    assert ball == r"/world/colliders/held\/ball"
    arm = take.bones.names.index("RightArm")
    turn = quaternions.to_matrix(take.bones.rotations_wxyz[:, arm])
    centers = saved.array(ball, "Ellipsoids3D:centers")[:, 0]
    np.testing.assert_allclose(centers, take.bones.positions[:, arm] + turn @ [0.0, 0.1, 0.0], atol=1e-6)
    # What stands still is there once.
    assert all(chunk.is_static for chunk in saved.of("/world/colliders/bench"))
    centers = saved.array("/world/colliders/bench", "Boxes3D:centers", static=True)
    np.testing.assert_allclose(centers, [[[1.0, 2.0, 0.2]]], rtol=1e-7)


def test_skeleton_has_a_strip_for_each_bone_with_a_length(saved: Recording, take: Take):
    strips = saved.array("/world/skeleton", "LineStrips3D:strips")
    hips, spine, left, right = (take.bones.names.index(name) for name in ("Hips", "Spine", "LeftArm", "RightArm"))
    expected = take.bones.positions[:, [[hips, spine], [spine, left], [spine, right]]]
    np.testing.assert_array_equal(strips.astype(np.float32), expected.astype(np.float32))


def test_tracks_without_parents_or_pelvis_draw_what_they_can():
    bones = make_bones()
    assert len(drawn_links(BoneTrack(bones.names, bones.times, bones.positions, bones.rotations_wxyz))) == 0
    without = BoneTrack(bones.names, bones.times, bones.positions, bones.rotations_wxyz, bones.parents)
    assert drawn_links(without).tolist() == [[0, 1], [1, 2], [2, 3], [2, 4]]


def test_plots_have_their_units(saved: Recording, take: Take):
    for entity, expected in [
        ("stretch", take.stretch_max * 100),
        ("penetration", take.penetration * 1000),
        ("kinetic_energy", take.kinetic_energy),
    ]:
        np.testing.assert_array_equal(saved.array(f"/plots/{entity}", "Scalars:scalars")[:, 0], expected)
        assert len(saved.column(f"/plots/{entity}", "SeriesLines:names", static=True)) == 1


def test_floor_lies_on_the_plane_and_under_the_path(saved: Recording, take: Take):
    (floor,) = saved.array("/world/floor", "Mesh3D:vertex_positions", static=True)
    np.testing.assert_allclose(floor[:, 2], 0.25, atol=1e-6)
    assert (floor.min(axis=0)[:2] < take.bones.positions.min(axis=(0, 1))[:2]).all()
    assert (floor.max(axis=0)[:2] > take.bones.positions.max(axis=(0, 1))[:2]).all()
    (triangles,) = saved.array("/world/floor", "Mesh3D:triangle_indices", static=True)
    a, b, c = np.moveaxis(floor[triangles], 1, 0)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


EVERY_LAYER = {
    "cape": {"/world/cape"},
    "skeleton": {"/world/skeleton"},
    "hitboxes": {"/world/hitboxes", "/world/colliders/bench", r"/world/colliders/held\/ball"},
    "floor": {"/world/floor"},
    "plots": {"/plots/stretch", "/plots/penetration", "/plots/kinetic_energy"},
}
STAGE = {"/world", "/world/character"}


@pytest.mark.parametrize("layers", [["cape"], ["skeleton", "plots"], ["hitboxes"], ["floor"], ["plots"], []])
def test_only_the_asked_layers_are_written(tmp_path: Path, take: Take, layers: list[str]):
    take.save(tmp_path / "take.rrd", layers=layers)
    expected = STAGE.union(*(EVERY_LAYER[layer] for layer in layers))
    assert Recording(tmp_path / "take.rrd").entities == expected


def test_all_layers_by_default(saved: Recording):
    assert saved.entities == STAGE.union(*EVERY_LAYER.values())


def test_an_unknown_layer_lists_the_known(tmp_path: Path, take: Take):
    with pytest.raises(UnknownNameError, match="no layer named 'hat'; available: cape, skeleton, hitboxes, floor"):
        take.save(tmp_path / "take.rrd", layers=["cape", "hat"])
    with pytest.raises(UnknownNameError, match="no layer named 'cape'; available: skeleton, hitboxes, floor"):
        record.save_hitboxes(take.bones, take.colliders, tmp_path / "take.rrd", layers=["cape"])
    assert list(tmp_path.iterdir()) == []


def test_hitboxes_alone(tmp_path: Path, take: Take):
    record.save_hitboxes(take.bones, take.colliders, tmp_path / "body.rrd")
    layers = ("skeleton", "hitboxes", "floor")
    assert Recording(tmp_path / "body.rrd").entities == STAGE.union(*(EVERY_LAYER[layer] for layer in layers))


def test_a_blueprint_and_a_name_come_along(saved: Recording):
    (recording,) = saved.reader.recordings()
    (blueprint,) = saved.reader.blueprints()
    assert blueprint.application_id == recording.application_id == "cape"
    assert saved.array("/__properties", "RecordingInfo:name", static=True).tolist() == [["test take"]]


def test_the_layout_draws_hitboxes_as_a_body_and_with_names(saved: Recording):
    overrides = [
        chunk.to_record_batch()
        for chunk in saved.reader.stream(store=saved.reader.blueprints()[0])
        if "overrides/world/hitboxes/visualizers" in chunk.entity_path
    ]
    drawn = {
        name: [row.as_py() for batch in overrides if name in batch.schema.names for row in batch.column(name)]
        for name in ("Capsules3D:fill_mode", "Capsules3D:show_labels")
    }
    assert drawn["Capsules3D:fill_mode"] == [[rr.components.FillMode.Solid.value]]
    assert sorted(drawn["Capsules3D:show_labels"]) == [[False], [True]]


def test_a_figure_fills_the_view_whatever_its_size():
    bones = make_bones()
    frames = Frames(np.arange(FRAMES), bones.times)
    # From the pelvis to the arms; the root on the ground is no part of the figure.
    assert skeleton_height(bones, frames) == pytest.approx(0.4)
    giant = replace(bones, positions=50 * bones.positions)
    assert skeleton_height(giant, frames) == pytest.approx(20)
    assert skeleton_height(replace(bones, positions=0 * bones.positions), frames) == 1.0


def test_about_24_bytes_a_vertex_and_frame(tmp_path: Path):
    # The difference of two lengths leaves out what is there once, the texture above all.
    sizes = []
    for frames in (50, 250):
        make_take(frames).save(tmp_path / "take.rrd", layers=["cape"])
        sizes.append((tmp_path / "take.rrd").stat().st_size)
    assert (sizes[1] - sizes[0]) / (200 * ROWS * COLUMNS) < 26


def test_frames_that_are_not_finite_are_left_out(tmp_path: Path, take: Take):
    broken = make_take()
    broken.positions[40:, 3, 1] = np.nan
    with pytest.warns(UserWarning, match="left 10 of 50 frames out .* from frame 40"):
        broken.save(tmp_path / "take.rrd")
    recording = Recording(tmp_path / "take.rrd")
    for entity, column in [("/world/cape", "Mesh3D:vertex_positions"), ("/plots/stretch", "Scalars:scalars")]:
        assert recording.array(entity, "frame").tolist() == list(range(40))
        assert np.isfinite(recording.array(entity, column)).all()
    broken.positions[:] = np.inf
    with pytest.raises(ValueRangeError, match="none of the 50 frames"):
        broken.save(tmp_path / "take.rrd")


def test_a_single_frame_is_recorded(tmp_path: Path):
    make_take(1).save(tmp_path / "take.rrd")
    assert len(Recording(tmp_path / "take.rrd").column("/world/cape", "Mesh3D:vertex_positions")) == 1


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, RuntimeError])
def test_a_failure_half_way_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, take: Take, interruption: type[BaseException]
):
    target = tmp_path / "take.rrd"
    target.write_bytes(b"what was there")

    def fail(*_):
        assert len(list(tmp_path.iterdir())) == 2, "the recording was under way"
        raise interruption

    monkeypatch.setattr("cape.record.write.log_plots", fail)
    with pytest.raises(interruption):
        take.save(target)
    assert [path.name for path in tmp_path.iterdir()] == ["take.rrd"]
    assert target.read_bytes() == b"what was there"


def test_an_existing_file_is_replaced(tmp_path: Path, take: Take):
    target = tmp_path / "take.rrd"
    target.write_bytes(b"what was there")
    take.save(target, layers=["floor"])
    assert "/world/floor" in Recording(target).entities
    assert [path.name for path in tmp_path.iterdir()] == ["take.rrd"]


def test_columns_of_different_lengths_raise():
    frames = Frames(np.arange(4), np.arange(4) / 60)
    with pytest.raises(ValueError, match="same length"):
        frames.send(rr.RecordingStream("test"), "/x", rr.Scalars, {"scalars": np.ones((3, 1))}, block=slice(3, 4))


def test_a_target_that_cannot_be_written(tmp_path: Path, take: Take):
    (tmp_path / "file").touch()
    for target, reason in [
        (tmp_path, "it is a directory"),
        (tmp_path / "nowhere" / "take.rrd", "No such file or directory"),
        (tmp_path / "file" / "take.rrd", "Not a directory"),
        (tmp_path / ("x" * 300), "File name too long"),
        (Path("/dev/null"), "it is no regular file"),
    ]:
        with pytest.raises(FileError, match=reason) as raised:
            take.save(target)
        assert "\n" not in str(raised.value)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_full_disk_is_an_error_beforehand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, take: Take):
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=1_000_000))
    with pytest.raises(FileError, match=r"it takes about \d+ MB and 1 MB are free"):
        take.save(tmp_path / "take.rrd")
    assert list(tmp_path.iterdir()) == []


def test_a_recording_cut_short_does_not_take_the_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, take: Take):
    def cut_short(stream: rr.RecordingStream):
        disconnect(stream)
        (partial,) = tmp_path.iterdir()
        os.truncate(partial, partial.stat().st_size - 100)

    disconnect = rr.RecordingStream.disconnect
    monkeypatch.setattr(rr.RecordingStream, "disconnect", cut_short)
    with pytest.raises(FileError, match="cut short"):
        take.save(tmp_path / "take.rrd")
    assert list(tmp_path.iterdir()) == []


def test_importing_cape_loads_no_viewer():
    code = "import sys, cape, cape.take, cape.record; print('rerun' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], cwd=HERE.parent, capture_output=True, text=True, check=True)
    assert run.stdout == "False\n"


def test_camera_glides_with_a_steady_walk_and_faces_where_it_goes():
    bones = make_bones(240)
    frames = Frames(np.arange(240), bones.times)
    # A walk at constant speed is its own average, also at its ends.
    np.testing.assert_allclose(smoothed_path(bones, frames), bones.positions[:, 1], atol=1e-9)
    # Arms at -X and +X on the left and right: it faces +Y.
    assert heading(bones, frames) == pytest.approx(np.pi / 2)


@pytest.mark.parametrize("direction", [[0, 0, 2], [0, 0, -2], [1, 0, 0], [0.1, -0.7, -0.3], [1e-9, 0, -1], [0, 0, 0]])
def test_shortest_rotation_from_z(direction):
    direction = np.array(direction, float)
    turned = quaternions.rotate(from_z_axis(direction), np.array([0.0, 0.0, np.linalg.norm(direction)]))
    np.testing.assert_allclose(turned, direction, atol=1e-15)
