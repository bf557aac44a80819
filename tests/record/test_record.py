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
from cape.cloth.normals import vertex_normals
from cape.measure.contact_points import ContactPoints
from cape.record.contacts import INSIDE_COLOR, TOUCHING_COLOR
from cape.record.frames import Frames
from cape.record.layers import drawn_links
from cape.record.solids import LEFT_COLOR, LEFT_OUT_COLOR, MIDDLE_COLOR
from cape.record.stage import heading, skeleton_height, smoothed_path
from cape.results.penetration import signed_distance
from cape.results.take import Take
from cape.scene.colliders import Box, Cylinder, Ellipsoid, Plane, Sphere, TaperedCapsule
from motions import quaternions
from motions.errors import FileError, UnknownNameError, ValueRangeError
from skeleton.shapes import Capsule
from skeleton.shapes.tapered_capsule import tapered_hull
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
        TaperedCapsule(
            name="club",
            bone="RightArm",
            start=np.array([0.1, 0.0, 0.0]),
            end=np.array([0.1, -0.3, 0.4]),
            start_radius=0.05,
            end_radius=0.15,
            thickness=0.02,
        ),
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
        thickness=0.01,
        left_out={"post": "far away", "club": "far away"},
        contacts=make_contacts(frames, len(colliders)),
    )


def make_contacts(frames: int, colliders: int) -> ContactPoints:
    """A number of contacts that differs from frame to frame, with none in every third."""
    rng = np.random.default_rng(3)
    counts = np.where(np.arange(frames) % 3 == 2, 0, rng.integers(1, 9, frames))
    n = int(counts.sum())
    normals = rng.standard_normal((n, 3))
    return ContactPoints(
        starts=np.concatenate([[0], np.cumsum(counts)]),
        points=rng.standard_normal((n, 3)).astype(np.float32),
        normals=(normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
        depths=rng.uniform(-1e-4, 0.03, n).astype(np.float32),
        colliders=rng.integers(0, colliders, n).astype(np.int32),
        vertices=rng.integers(0, ROWS * COLUMNS, n).astype(np.int32),
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
    assert labels.as_py() == ["spine", "left_upper_arm", "ball", "post (left out)"]
    (colors,) = saved.array("/world/hitboxes", "Capsules3D:colors", static=True)
    assert colors.tolist() == [_rgba(c) for c in (MIDDLE_COLOR, LEFT_COLOR, MIDDLE_COLOR, LEFT_OUT_COLOR)]
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
    ball = next(entity for entity in saved.entities if "colliders" in entity and "ball" in entity)
    assert ball == r"/world/colliders/held\/ball"
    arm = take.bones.names.index("RightArm")
    turn = quaternions.to_matrix(take.bones.rotations_wxyz[:, arm])
    centers = saved.array(ball, "Ellipsoids3D:centers")[:, 0]
    np.testing.assert_allclose(centers, take.bones.positions[:, arm] + turn @ [0.0, 0.1, 0.0], atol=1e-6)
    # What stands still is there once.
    assert all(chunk.is_static for chunk in saved.of("/world/colliders/bench"))
    centers = saved.array("/world/colliders/bench", "Boxes3D:centers", static=True)
    np.testing.assert_allclose(centers, [[[1.0, 2.0, 0.2]]], rtol=1e-7)


def _rgba(color: tuple[int, ...]) -> int:
    red, green, blue, alpha = (*color, 255)[:4]
    return red << 24 | green << 16 | blue << 8 | alpha


def transformed(saved: Recording, entity: str) -> np.ndarray:
    """Vertices of a mesh in the world in each frame [m], shape (F, N, 3)."""
    (vertices,) = saved.array(entity, "Mesh3D:vertex_positions", static=True)
    (turns,) = np.roll(saved.array(entity, "Transform3D:quaternion"), 1, axis=-1).swapaxes(0, 1)
    return quaternions.rotate(turns[:, None], vertices) + saved.array(entity, "Transform3D:translation")


def test_a_tapered_capsule_is_a_mesh_on_its_surface(saved: Recording, take: Take):
    club = take.colliders[-1]
    arm = take.bones.names.index("RightArm")
    to_bone = quaternions.conjugate(take.bones.rotations_wxyz[:, None, arm])
    for entity, distance in (("/world/colliders/club", 0.0), ("/world/shells/club", 0.02)):
        in_bone = quaternions.rotate(to_bone, transformed(saved, entity) - take.bones.positions[:, None, arm])
        # Single precision, twice, of places up to 5 m away.
        np.testing.assert_allclose(signed_distance(club, in_bone.reshape(-1, 3)), distance, atol=3e-6)
    (label,) = saved.column("/world/colliders/club", "Points3D:labels", static=True)
    assert label.as_py() == ["club (left out)"]


@pytest.mark.parametrize(
    ("length", "start", "end"), [(0.5, 0.2, 0.1), (0.5, 0.1, 0.2), (0.5, 0.1, 0.1), (0.1, 0.3, 0.1), (0.1, 0.1, 0.3)]
)
def test_a_hull_is_closed_and_faces_outwards(length: float, start: float, end: float):
    vertices, normals, triangles = tapered_hull(length, start, end)
    solid = TaperedCapsule(start=np.zeros(3), end=np.array([0.0, 0.0, length]), start_radius=start, end_radius=end)
    np.testing.assert_allclose(signed_distance(solid, vertices.astype(float)), 0.0, atol=1e-7)
    # A normal leads away from the surface at full speed.
    np.testing.assert_allclose(signed_distance(solid, vertices + 0.01 * normals.astype(float)), 0.01, atol=1e-7)
    a, b, c = np.moveaxis(vertices[triangles].astype(float), 1, 0)
    volume = float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6.0
    # Two spheres' caps and the frustum of a cone between them; a mesh that is inscribed has a few percent less.
    heights = np.linspace(-1.0, 1.5, 25_001)
    radii = np.maximum.reduce(
        [
            np.sqrt(np.maximum(0.0, (start + share * (end - start)) ** 2 - (heights - share * length) ** 2))
            for share in np.linspace(0.0, 1.0, 401)
        ]
    )
    assert 0.95 < volume / (np.pi * np.trapezoid(radii**2, heights)) < 1.0


def test_shells_are_as_thick_as_the_colliders_say(saved: Recording, take: Take):
    (radii,) = saved.array("/world/shells", "Capsules3D:radii", static=True)
    np.testing.assert_allclose(radii, [0.13, 0.06, 0.08, 0.11], rtol=1e-6)
    for column in ("Capsules3D:translations", "Capsules3D:quaternions"):
        np.testing.assert_array_equal(saved.array("/world/shells", column), saved.array("/world/hitboxes", column))
    (ball,) = saved.array(r"/world/shells/held\/ball", "Ellipsoids3D:half_sizes", static=True)
    np.testing.assert_allclose(ball, [[0.21, 0.21, 0.21]], rtol=1e-6)
    (bench,) = saved.array("/world/shells/bench", "Boxes3D:half_sizes", static=True)
    np.testing.assert_allclose(bench, [[0.51, 0.21, 0.21]], rtol=1e-6)
    (ground,) = saved.array("/world/shells/ground", "Boxes3D:centers", static=True)
    assert ground[0, 2] == pytest.approx(0.26)
    names = [name for entity in saved.entities if "shells" in entity for name in schema(saved, entity)]
    assert not any("labels" in name and "show" not in name for name in names)


def test_a_cylinder_and_an_ellipsoid_are_drawn_where_they_are(tmp_path: Path, take: Take):
    drum = Cylinder(
        name="drum",
        bone="LeftArm",
        start=np.array([0.1, 0.0, 0.0]),
        end=np.array([0.1, 0.4, 0.0]),
        radius=0.15,
        thickness=0.02,
    )
    turn = np.array([0.8, 0.0, 0.6, 0.0])
    egg = Ellipsoid(
        name="egg", bone="Spine", center=np.full(3, 0.1), radii=np.array([0.1, 0.2, 0.3]), rotation_wxyz=turn
    )
    replace(take, colliders=(drum, egg), contacts=None, left_out={"drum": "far away"}).save(tmp_path / "two.rrd")
    saved = Recording(tmp_path / "two.rrd")
    arm, spine = (take.bones.names.index(name) for name in ("LeftArm", "Spine"))

    to_bone = quaternions.conjugate(take.bones.rotations_wxyz[:, None, arm])
    for entity, solid in (("/world/colliders/drum", drum), ("/world/shells/drum", drum.grown(0.02))):
        in_bone = quaternions.rotate(to_bone, transformed(saved, entity) - take.bones.positions[:, None, arm])
        # Single precision, twice, of places up to 5 m away.
        np.testing.assert_allclose(signed_distance(solid, in_bone.reshape(-1, 3)), 0.0, atol=3e-6)
    (label,) = saved.column("/world/colliders/drum", "Points3D:labels", static=True)
    assert label.as_py() == ["drum (left out)"]

    rotations = take.bones.rotations_wxyz[:, spine]
    centers = saved.array("/world/colliders/egg", "Ellipsoids3D:centers")[:, 0]
    expected = take.bones.positions[:, spine] + quaternions.rotate(rotations, egg.center)
    np.testing.assert_allclose(centers, expected, atol=1e-6)
    turns = np.roll(saved.array("/world/colliders/egg", "Ellipsoids3D:quaternions")[:, 0], 1, axis=-1)
    np.testing.assert_allclose(turns, quaternions.multiply(rotations, turn), atol=1e-6)
    for entity, grown in (("/world/colliders/egg", 0.0), ("/world/shells/egg", take.thickness)):
        (half,) = saved.array(entity, "Ellipsoids3D:half_sizes", static=True)
        np.testing.assert_allclose(half, [egg.radii + grown], rtol=1e-6)
    assert saved.column("/world/colliders/egg", "Ellipsoids3D:labels", static=True)[0].as_py() == ["egg"]


def test_the_mesh_of_a_cylinder_is_closed_and_faces_outwards():
    solid = Cylinder(start=np.zeros(3), end=np.array([0.0, 0.0, 0.5]), radius=0.2)
    mesh = solid.outline()
    vertices, normals = mesh.vertices.astype(float), mesh.normals.astype(float)
    np.testing.assert_allclose(signed_distance(solid, vertices), 0.0, atol=1e-7)
    # A normal leads away from the surface at full speed; from an edge those of both sides do.
    np.testing.assert_allclose(signed_distance(solid, vertices + 0.01 * normals), 0.01, atol=1e-7)
    a, b, c = np.moveaxis(vertices[mesh.triangles], 1, 0)
    volume = float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6.0
    # A prism on a regular polygon.
    corners = len(vertices) // 6
    assert volume == pytest.approx(0.5 * 0.2**2 * corners / 2 * np.sin(2 * np.pi / corners), rel=1e-6)


def schema(saved: Recording, entity: str) -> list[str]:
    return [name for chunk in saved.of(entity) for name in chunk.to_record_batch().schema.names]


def test_a_plane_is_drawn_under_all_bones(saved: Recording, take: Take):
    (center,) = saved.array("/world/colliders/ground", "Boxes3D:centers", static=True)
    (half,) = saved.array("/world/colliders/ground", "Boxes3D:half_sizes", static=True)
    assert (center[0, 2], half[0, 2]) == (pytest.approx(0.25), 0.0)
    off = np.abs(take.bones.positions[..., :2] - center[0, :2]).reshape(-1, 2).max(axis=0)
    np.testing.assert_allclose(half[0, :2], off + 0.5, atol=1e-6)


def test_contacts_are_those_of_each_frame(saved: Recording, take: Take):
    contacts = take.contacts
    assert contacts is not None
    points = saved.column("/world/contacts/points", "Points3D:positions")
    assert [len(row) for row in points] == contacts.counts.tolist()
    for entity, column, expected in [
        ("points", "Points3D:positions", contacts.points),
        ("points", "Points3D:class_ids", contacts.colliders),
        ("normals", "Arrows3D:origins", contacts.points),
        ("normals", "Arrows3D:vectors", 0.05 * contacts.normals),
    ]:
        rows = saved.column(f"/world/contacts/{entity}", column)
        found = np.array([value for row in rows for value in row.as_py()], dtype=np.float32)
        np.testing.assert_allclose(found, expected, rtol=1e-6)
    # What a class is called, and which colour a depth has: green, yellow, red.
    (names,) = saved.column("/world/contacts", "AnnotationContext:context", static=True)
    (context,) = names.as_py()
    assert [entry["class_description"]["info"]["label"] for entry in context] == [
        collider.name for collider in take.colliders
    ]
    colors = np.array([v for r in saved.column("/world/contacts/points", "Points3D:colors") for v in r.as_py()])
    thickness = take.thicknesses[contacts.colliders]
    assert sorted(set(take.thicknesses)) == [0.01, 0.02]
    inside = contacts.depths > thickness
    assert (colors[inside] == _rgba(INSIDE_COLOR)).all()
    assert not (colors[~inside] == _rgba(INSIDE_COLOR)).any()
    assert (colors[contacts.depths <= 0] == _rgba(TOUCHING_COLOR)).all()


def test_colliders_beyond_the_last_class_share_it(tmp_path: Path, take: Take, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("cape.record.contacts.OTHERS", 2)
    take.save(tmp_path / "few.rrd")
    contacts = take.contacts
    assert contacts is not None
    saved = Recording(tmp_path / "few.rrd")
    ids = [v for row in saved.column("/world/contacts/points", "Points3D:class_ids") for v in row.as_py()]
    assert ids == np.minimum(contacts.colliders, 2).tolist()
    assert max(contacts.colliders) > 2
    (names,) = saved.column("/world/contacts", "AnnotationContext:context", static=True)
    (context,) = names.as_py()
    labels = [entry["class_description"]["info"]["label"] for entry in context]
    assert labels == [*(collider.name for collider in take.colliders[:2]), "another collider"]


def test_a_take_without_contacts_has_none_to_record(tmp_path: Path, take: Take):
    replace(take, contacts=None).save(tmp_path / "none.rrd")
    assert not any("contacts" in entity for entity in Recording(tmp_path / "none.rrd").entities)
    replace(take, contacts=ContactPoints.none(FRAMES)).save(tmp_path / "empty.rrd")
    points = Recording(tmp_path / "empty.rrd").column("/world/contacts/points", "Points3D:positions")
    assert [len(row) for row in points] == [0] * FRAMES


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


OTHERS = ("bench", r"held\/ball", "ground", "club")
BODY_PARTS = ("Spine", "Spine/spine", "LeftArm", "LeftArm/left_upper_arm", "RightArm", "RightArm/ball")
EVERY_LAYER = {
    "cape": {"/world/cape"},
    "body": {f"/world/body/{part}" for part in BODY_PARTS},
    "skeleton": {"/world/skeleton"},
    "hitboxes": {"/world/hitboxes", *(f"/world/colliders/{name}" for name in OTHERS)},
    "shells": {"/world/shells", *(f"/world/shells/{name}" for name in OTHERS)},
    "contacts": {"/world/contacts", "/world/contacts/points", "/world/contacts/normals"},
    "floor": {"/world/floor"},
    "plots": {"/plots/stretch", "/plots/penetration", "/plots/kinetic_energy"},
}
STAGE = {"/world", "/world/character"}


@pytest.mark.parametrize(
    "layers",
    [["cape"], ["body"], ["skeleton", "plots"], ["hitboxes"], ["shells"], ["contacts"], ["floor"], ["plots"], []],
)
def test_only_the_asked_layers_are_written(tmp_path: Path, take: Take, layers: list[str]):
    take.save(tmp_path / "take.rrd", layers=layers)
    expected = STAGE.union(*(EVERY_LAYER[layer] for layer in layers))
    assert Recording(tmp_path / "take.rrd").entities == expected


def test_all_layers_by_default(saved: Recording):
    assert saved.entities == STAGE.union(*EVERY_LAYER.values())


def test_an_unknown_layer_lists_the_known(tmp_path: Path, take: Take):
    with pytest.raises(
        UnknownNameError,
        match="no layer named 'hat'; available: cape, robot, body, skeleton, hitboxes, shells, contacts, floor",
    ):
        take.save(tmp_path / "take.rrd", layers=["cape", "hat"])
    with pytest.raises(
        UnknownNameError, match="no layer named 'cape'; available: robot, skeleton, hitboxes, shells, f"
    ):
        record.save_hitboxes(take.bones, take.colliders, tmp_path / "take.rrd", layers=["cape"])
    assert list(tmp_path.iterdir()) == []


def test_hitboxes_alone(tmp_path: Path, take: Take):
    record.save_hitboxes(take.bones, take.colliders, tmp_path / "body.rrd")
    layers = ("skeleton", "hitboxes", "shells", "floor")
    assert Recording(tmp_path / "body.rrd").entities == STAGE.union(*(EVERY_LAYER[layer] for layer in layers))


def test_a_blueprint_and_a_name_come_along(saved: Recording):
    (recording,) = saved.reader.recordings()
    (blueprint,) = saved.reader.blueprints()
    assert blueprint.application_id == recording.application_id == "cape"
    assert saved.array("/__properties", "RecordingInfo:name", static=True).tolist() == [["test take"]]


def overrides_of_hitboxes(saved: Recording, name: str) -> list:
    """What the views of a recording's blueprint override of a component of the hitboxes."""
    overrides = [
        chunk.to_record_batch()
        for chunk in saved.reader.stream(store=saved.reader.blueprints()[0])
        if "overrides/world/hitboxes" in chunk.entity_path
    ]
    return [row.as_py() for batch in overrides if name in batch.schema.names for row in batch.column(name)]


def test_the_layout_draws_a_body_and_hitboxes_with_names(saved: Recording):
    assert overrides_of_hitboxes(saved, "Capsules3D:fill_mode") == []
    assert overrides_of_hitboxes(saved, "Capsules3D:show_labels") == [[True]]
    assert overrides_of_hitboxes(saved, "EntityBehavior:visible") == [[False]]


def test_without_a_body_the_layout_draws_hitboxes_as_one(tmp_path: Path, take: Take):
    take.save(tmp_path / "take.rrd", layers=["cape", "hitboxes"])
    saved = Recording(tmp_path / "take.rrd")
    assert overrides_of_hitboxes(saved, "Capsules3D:fill_mode") == [[rr.components.FillMode.Solid.value]]
    assert sorted(overrides_of_hitboxes(saved, "Capsules3D:show_labels")) == [[False], [True]]


class Layout:
    """The blueprint of a recording: what each tab shows by its name, and which is in front."""

    def __init__(self, saved: Recording):
        (store,) = saved.reader.blueprints()
        self.application = store.application_id
        queries, names, active = {}, {}, ""
        for chunk in saved.reader.stream(store=store):
            batch, path = chunk.to_record_batch(), chunk.entity_path.split("/")
            for column, values in zip(batch.schema.names, batch.columns, strict=True):
                if column == "ViewContents:query":
                    queries[path[2]] = values[0].as_py()
                elif column == "ViewBlueprint:display_name":
                    names[path[2]] = values[0].as_py()[0]
                elif column == "ContainerBlueprint:active_tab":
                    active = values[0].as_py()[0]
        self.contents = {names[view]: query for view, query in queries.items()}
        self.front = names[active.removeprefix("view/")]


def test_shells_and_contacts_are_a_tab_away(saved: Recording):
    contents = Layout(saved).contents
    assert contents["hitboxes"] == ["+ /world/**", "- /world/body/**"]
    assert contents["cape"] == [
        "+ /world/**",
        "- /world/shells/**",
        "- /world/contacts/**",
        "- /world/colliders/ground/**",
    ]


def test_the_tab_asked_for_is_in_front(tmp_path: Path, take: Take, saved: Recording):
    record.save(take, tmp_path / "boxes.rrd", tab="hitboxes")
    layout = Layout(Recording(tmp_path / "boxes.rrd"))
    # A layout of its own, which the viewer keeps apart from that of replays.
    assert (layout.front, layout.application) == ("hitboxes", "cape hitboxes")
    assert (Layout(saved).front, Layout(saved).application) == ("cape", "cape")


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

    def fail(*_, **__):
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
        (tmp_path / "a\0b", "embedded null"),
        (Path("/dev/null"), "it is no regular file"),
    ]:
        with pytest.raises(FileError, match=reason) as raised:
            take.save(target)
        assert "\n" not in str(raised.value)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_full_disk_is_an_error_beforehand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, take: Take):
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=1_000_000))
    with pytest.raises(FileError, match=r"it takes about [\d.]+ MB and 1 MB are free"):
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
    code = "import sys, cape, cape.results.take, cape.record; print('rerun' in sys.modules)"
    run = subprocess.run(
        [sys.executable, "-P", "-c", code], cwd=HERE.parent, capture_output=True, text=True, check=True
    )
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
    turned = quaternions.rotate(quaternions.from_z_axis(direction), np.array([0.0, 0.0, np.linalg.norm(direction)]))
    np.testing.assert_allclose(turned, direction, atol=1e-15)
