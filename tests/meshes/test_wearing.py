"""A mesh on a body: placed, let out, held, and taken along to where the motion begins."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import cape
import motions
from cape.assembly.putting_on import carried_points, dressing_pose, placed, wearer_to_world
from cape.cloth.looks.registry import LOOKS
from cape.garments.fitting import Fitted
from cape.meshes.nearest import nearest_on
from cape.meshes.posing import ARMS, modelled_arms
from cape.meshes.wearing import wear
from cape.record.surfaces.drawn import drawn_of, texture_drawn
from cape.run.attempts import bring_to_rest
from cape.run.hanging import Hanging
from cape.scene.poses import read_pose
from motions import quaternions
from motions.errors import UnknownNameError, UserError, ValueRangeError
from skeleton import BoneTrack, Skeleton
from skeleton.proportions import ANKLE_HEIGHT
from tests.meshes.mesh_files import obj, sheet, tube

LOOK = LOOKS["cape"]


def cone(
    *, top: float = 1.5, neck: float = 0.12, wide: float = 0.42, length: float = 0.9
) -> tuple[np.ndarray, np.ndarray]:
    """A poncho around the Z axis, its outside outwards: down from the neck, over the shoulders and around the arms."""
    points, faces = tube(32, 16, 1.0, 1.0)
    share = -points[:, 2]
    radii = neck + (wide - neck) * np.minimum(3.0 * share, 1.0)
    heights = top - 0.08 * np.minimum(3.0 * share, 1.0) - length * np.maximum(share - 1.0 / 3.0, 0.0)
    return np.stack([radii * points[:, 0], radii * points[:, 1], heights], axis=1), faces


@pytest.fixture(scope="module")
def walker():
    clip = motions.load("walk").trim(0.0, 0.1)
    body = Skeleton.from_clip(clip)
    return body, body.track(clip)


def modelled_places(scene: cape.Scene) -> np.ndarray:
    """The cloth's vertices in the frame of `Scene.dressing` [m], (V, 3)."""
    assert scene.dressing is not None
    frame, middle = wearer_to_world(*(scene.dressing[role][0] for role in scene.wearer))
    return middle + scene.cloth.positions @ frame.T


def poncho(**regions: np.ndarray) -> cape.MeshCloth:
    points, faces = cone()
    return cape.Cloth.from_mesh(points, faces, regions=regions or None)


def test_a_mesh_stands_on_the_ground_below_the_hips(walker):
    body, track = walker
    scene = wear(poncho(), body, track)
    assert scene.dressing is not None
    fitted = Fitted(body, body.capsules(), standing=True)
    ankles = fitted.pose(["left_foot", "right_foot"])[0][:, 2].mean()
    # Nothing is near the hem: what is let out at the shoulders has faded there.
    hem = slice(-32, None)
    from_modelled = modelled_places(scene)[hem] - poncho().positions[hem]
    expected = [fitted.hips[0], fitted.hips[1], ankles - ANKLE_HEIGHT * body.height()]
    assert from_modelled == pytest.approx(np.tile(expected, (32, 1)), abs=1e-6)


def test_the_cloth_goes_along_with_the_body_wherever_that_begins(walker):
    body, track = walker
    scene = wear(poncho(), body, track)
    turn, shift = quaternions.from_rotation_vector(np.array([0.3, -1.1, 2.0])), np.array([3.0, -2.0, 0.7])
    assert scene.dressing is not None
    bones = {
        name: (shift + quaternions.rotate(turn, origin), quaternions.multiply(turn, rotation))
        for name, (origin, rotation) in scene.dressing.items()
    }
    pose = dressing_pose(scene, read_pose(bones, scene.bones))
    points = placed(scene, pose)
    # As it was modelled, seen from each bone. It is said in the frame that the bones give.
    worn = modelled_places(scene)
    for number, (origin, rotation) in enumerate(scene.dressing.values()):
        back, modelled = (quaternions.conjugate(each) for each in (pose.rotations_wxyz[number], rotation))
        seen = quaternions.rotate(back, points - pose.positions[number])
        assert seen == pytest.approx(quaternions.rotate(modelled, worn - origin), abs=1e-9)


def test_what_a_bone_holds_is_carried_to_the_first_frame(walker):
    body, track = walker
    scene = wear(poncho(collar=np.arange(32)), body, track, hold={"collar": "chest"})
    chest = track.index("chest")
    first = {
        name: (track.positions[0, track.index(name)], track.rotations_wxyz[0, track.index(name)])
        for name in scene.bones
    }
    cloth = Hanging(scene, cape.solver("euler"), read_pose(first, scene.bones), threads=1)
    bring_to_rest(cloth, 1.6, np.zeros(3))
    assert scene.dressing is not None
    origin, rotation = scene.dressing["chest"]
    in_bone = quaternions.rotate(quaternions.conjugate(rotation), modelled_places(scene)[:32] - origin)
    expected = track.positions[0, chest] + quaternions.rotate(track.rotations_wxyz[0, chest], in_bone)
    (carried,) = cloth.assembly.carried
    found = carried_points(carried, cloth.pose) + cloth.origin
    nearest = np.linalg.norm(found - expected[:, None], axis=2).argmin(axis=1)  # the assembly has an order of its own
    assert sorted(nearest) == list(range(32))
    assert found[nearest] == pytest.approx(expected, abs=1e-6)


def test_no_vertex_starts_in_the_body_and_the_cloth_that_was_let_out_has_no_tension(walker):
    body, track = walker
    tight, faces = cone(neck=0.05, wide=0.2)
    cloth = cape.Cloth.from_mesh(tight, faces)
    scene = wear(cloth, body, track, arms=3.0)
    fitted = Fitted(body, body.capsules(), arms=np.radians(3.0), standing=True)
    places = modelled_places(scene)
    assert fitted.distances(places).min() > scene.thickness - 1e-9
    assert np.abs(places - (cloth.positions + (places - cloth.positions)[-1])).max() > 0.03
    worn = scene.cloth
    assert isinstance(worn, cape.MeshCloth)
    sides = np.linalg.norm(worn.corners - np.roll(worn.corners, 1, axis=1), axis=2)
    corners = worn.positions[worn.faces]
    assert sides == pytest.approx(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2), abs=1e-12)


def test_the_arms_are_those_that_the_cloth_leaves_room_for(walker):
    body, _ = walker
    fitted = Fitted(body, body.capsules(), standing=True)
    ground = fitted.pose(["left_foot"])[0][0, 2] - ANKLE_HEIGHT * body.height()
    points, faces = cone()
    # A poncho goes around arms that hang down; those of a T pose pass through it.
    assert modelled_arms(points + np.array([0.0, 0.0, ground]), faces, fitted) < 30.0
    # A skirt leaves the arms all the room there is.
    skirt, faces = tube(24, 5, 0.35, 0.6)
    assert modelled_arms(skirt + fitted.hips, faces, fitted) == ARMS[0]


def test_without_a_hold_the_shoulders_share_the_neckline(walker):
    body, track = walker
    scene = wear(poncho(), body, track)
    (attachment,) = scene.attachments
    assert attachment.bones == ("left_shoulder", "right_shoulder")
    y = poncho().positions[attachment.vertices, 1]
    assert attachment.weights is not None
    assert attachment.weights[:, 0] == pytest.approx(np.clip(0.5 + y / body.shoulder_width(), 0.0, 1.0), abs=1e-9)
    assert sorted(attachment.vertices.tolist()) == list(range(32))


def test_a_distance_and_an_image_choose_what_is_held(walker, tmp_path):
    body, track = walker
    points, faces = cone()
    uv = np.stack([np.arange(len(points)) % 32 / 32.0, np.arange(len(points)) // 32 / 15.0], axis=1)
    y_up = points[:, [1, 2, 0]]
    (tmp_path / "poncho.obj").write_text(obj(y_up, faces, uv=np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1)))
    mask = np.zeros((64, 64, 3), dtype=np.uint8)
    mask[:2] = 255  # the topmost of sixteen rings, at v = 0
    Image.fromarray(mask).save(tmp_path / "mask.png")
    cloth = cape.Cloth.load(tmp_path / "poncho.obj")
    assert cloth.positions == pytest.approx(points)
    scene = wear(cloth, body, track, hold={str(tmp_path / "mask.png"): "chest"})
    assert scene.attachments[0].vertices.tolist() == list(range(32))
    near = wear(cloth, body, track, hold={"0.08": "left_shoulder"}).attachments[0].vertices
    capsules = [c for c in body.capsules() if body.bone(c.bone) == body.bone("left_shoulder")]
    fitted = Fitted(body, capsules, arms=np.radians(modelled_arms_of(scene, body)), standing=True)
    modelled = cloth.positions + (modelled_places(scene) - cloth.positions)[-1]  # nothing is let out at the hem
    off = fitted.distances(modelled)
    assert np.array_equal(near, np.flatnonzero(off <= 0.08))
    with pytest.raises(ValueRangeError, match="no texture coordinates"):
        wear(poncho(), body, track, hold={str(tmp_path / "mask.png"): "chest"})


def modelled_arms_of(scene: cape.Scene, body: Skeleton) -> float:
    """Angle of the left arm from the direction down, where the cloth is put on [degrees]."""
    assert scene.dressing is not None
    way = scene.dressing[body.roles["left_forearm"]][0] - scene.dressing[body.roles["left_upper_arm"]][0]
    return float(np.degrees(np.arccos(-way[2] / np.linalg.norm(way))))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"hold": {"collar": "chest"}}, "no cloth region named 'collar'"),
        ({"hold": {"top": "tail"}}, "no bone named 'tail'"),
        ({"place": "tail"}, "no bone named 'tail'"),
        ({"hold": {"0.001": "left_foot"}}, "no vertex is within 0.001 m of 'left_foot'"),
        ({"arms": 200.0}, "0 to 180 degrees"),
    ],
)
def test_what_can_not_be_worn_is_told(walker, change, told):
    body, track = walker
    with pytest.raises(UserError) as caught:
        wear(poncho(top=np.arange(32)), body, track, **change)
    assert told in str(caught.value)


def test_a_cloth_out_of_proportion_closed_or_without_a_hold_is_refused(walker):
    body, track = walker
    points, faces = cone()
    with pytest.raises(ValueRangeError, match="positions are in metres"):
        wear(cape.Cloth.from_mesh(100.0 * points, faces), body, track)
    with pytest.raises(ValueRangeError, match=r"edges of 0\.5 m are too long .* remesh it"):
        wear(cape.Cloth.from_mesh(*sheet(3, 3, 0.5)), body, track)
    closed = np.concatenate([faces, [[0, k, k + 1] for k in range(1, 31)], [[480, k + 1, k] for k in range(481, 511)]])
    with pytest.raises(ValueRangeError, match="closed, without an edge"):
        wear(cape.Cloth.from_mesh(points, closed), body, track)
    both = cape.Cloth.from_mesh(
        np.concatenate([points, points + np.array([0.0, 0.0, 1.5])]), np.concatenate([faces, faces + len(points)]),
        regions={"top": np.arange(32)},
    )  # fmt: skip
    with pytest.raises(ValueRangeError, match=r"a part of 512 vertices around .* is held by nothing"):
        wear(both, body, track, hold={"top": "chest"})
    with pytest.raises(UnknownNameError):
        wear(poncho(), body, replace_without_shoulders(track))


def replace_without_shoulders(track: BoneTrack) -> BoneTrack:
    kept = [name for name in track.names if name not in (track.roles["left_shoulder"], track.roles["right_shoulder"])]
    return track.select(kept)


def test_a_fine_mesh_with_an_image_is_drawn_in_place_of_the_coarse_one(walker, tmp_path):
    body, track = walker
    points, faces = cone()
    (tmp_path / "poncho.obj").write_text(obj(points[:, [1, 2, 0]], faces, uv=points[:, :2]))
    picture = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    Image.fromarray(picture).save(tmp_path / "image.png")
    cloth = cape.Cloth.load(tmp_path / "poncho.obj", spacing=0.09, textures=cape.read_textures(tmp_path / "image.png"))
    assert cloth.vertices < len(points)
    take = cape.simulate(wear(cloth, body, track), track)
    assert take.stretch_max.max() < 0.1
    assert take.cloth is not None
    assert cloth.visual is not None
    drawn = drawn_of(take)
    assert np.array_equal(texture_drawn(take, LOOK), picture)
    assert drawn.vertices == len(points)
    places, normals = drawn.at(take.positions)
    assert places.shape == normals.shape == (len(take.positions), len(points), 3)
    off = [nearest_on(p.astype(float), t.astype(float), cloth.faces).distances.max() for p, t in (
        (places[-1], take.positions[-1]), (cloth.visual.places(cloth.positions), cloth.positions))]  # fmt: skip
    assert off[0] < 2.0 * off[1] < 0.1
    take.save(tmp_path / "poncho.rrd", layers=["cape"])
    assert (tmp_path / "poncho.rrd").stat().st_size > places.nbytes / 4
    plain = replace(take, cloth=replace(take.cloth, textures=None))
    assert texture_drawn(plain, LOOK).shape != picture.shape
