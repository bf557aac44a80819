"""Hooded cloak, tabard, skirt and sash: cut to a body, and worn as their kind is."""

from dataclasses import replace

import numpy as np
import pytest

import cape
import motions
from cape.assembly.springs import springs_of
from cape.cloth.cloth import areas
from cape.garments.fitting import CLEARANCE, Fitted
from cape.garments.sash import WIDTH
from cape.garments.skirt import BAND, STEEPEST
from cape.measure.self_crossings import self_crossings
from cape.measure.wearing import ray_hits
from motions import quaternions
from motions.errors import UnknownNameError, ValueRangeError
from skeleton import Skeleton
from skeleton.solid_measures import signed_distance

PATTERNS = ["hooded_cloak", "tabard", "skirt", "sash"]
SEWN = PATTERNS[1:]


@pytest.fixture(scope="module")
def walker():
    clip = motions.load("walk").trim(0.0, 0.1)
    body = Skeleton.from_clip(clip)
    return body, body.track(clip)


@pytest.fixture(scope="module")
def scenes(walker):
    """Each of them as it is put on."""
    body, track = walker
    return {name: cape.dress(body, track, garment=name) for name in PATTERNS}


def meets(scene: cape.Scene, origin, direction) -> bool:
    """Whether a ray of the wearer's frame meets the garment as it is put on."""
    corners = scene.cloth.positions[scene.cloth.triangles]
    unit = np.array(direction) / np.linalg.norm(direction)
    return bool(np.isfinite(ray_hits(np.array([origin]), unit[None], corners[None])).any())


@pytest.fixture(scope="module")
def at(walker):
    """Where a role's bone is as a garment is put on, in the wearer's frame [m]."""
    fitted = Fitted(walker[0], ()).with_raised_arms()
    return lambda role: fitted.pose([role])[0][0]


@pytest.mark.parametrize("name", PATTERNS)
@pytest.mark.few("sash", "skirt", "tabard")
def test_it_starts_clear_of_the_body_and_of_itself(scenes, name: str):
    scene = scenes[name]
    for collider in scene.colliders:
        if collider.bone is None:
            continue
        origin, turn = scene.dressing[collider.bone]
        in_bone = quaternions.rotate(quaternions.conjugate(turn), scene.cloth.positions - origin)
        assert signed_distance(collider, in_bone).min() > scene.thickness, collider.name
    assert len(self_crossings(scene.cloth.positions, scene.cloth.triangles)) == 0


@pytest.mark.parametrize("name", SEWN)
def test_what_is_sewn_is_one_piece_that_has_no_tension_as_it_is_put_on(scenes, name: str):
    cloth = scenes[name].cloth
    places = cloth.positions[cloth.faces]
    sides, flat = (np.linalg.norm(np.roll(c, -1, axis=1) - c, axis=2) for c in (places, cloth.corners))
    np.testing.assert_allclose(flat, sides, rtol=1e-9)
    springs = springs_of(cloth)
    assert (springs.rest > 0.0).all()


def test_a_hood_lies_over_the_head_and_is_open_at_the_face(walker, scenes, at):
    scene, rest = scenes["hooded_cloak"], walker[0].rest
    middle = at("head") + 0.5 * np.linalg.norm(rest.vertex - rest.origin("head")) * np.array([0.0, 0.0, 1.0])
    for direction in ([0, 0, 1], [-1, 0, 0], [0, 1, 0], [0, -1, 0]):
        assert meets(scene, middle, direction)
    assert not meets(scene, middle, [1, 0, 0])
    brow = scene.cloth.positions[scene.cloth.region("brow")]
    assert brow[:, 2].min() > middle[2]
    # It comes down to the neckline without a gap: its rows are those of the cloak.
    cloth, neckline = scene.cloth, scene.cloth.region("top")
    steps = np.linalg.norm(np.diff(cloth.positions.reshape(cloth.rows, cloth.columns, 3), axis=0), axis=2)
    above = steps[: neckline[0] // cloth.columns]
    assert above.max() < 2.0 * np.median(steps)
    # Where its rows come together they stay a quarter as far apart: shorter threads would make all steps shorter.
    assert above.min() > 0.25 * np.median(steps)


def test_a_hood_follows_head_and_chest(scenes):
    held = {attachment.bone: attachment for attachment in scenes["hooded_cloak"].attachments}
    assert set(held) == {"chest", "head"}
    assert held["head"].soft
    assert not held["chest"].soft


def test_a_tabard_has_a_front_and_a_back_open_sides_and_a_hole_for_the_head(scenes, at):
    scene = scenes["tabard"]
    waist = (at("pelvis") + at("chest")) / 2.0
    for side in (1, -1):
        assert meets(scene, waist, [side, 0, 0])
        assert not meets(scene, waist, [0, side, 0])
    assert not meets(scene, at("neck"), [0, 0, 1])
    neck, arm = at("neck"), at("left_upper_arm")
    for side in (1.0, -1.0):
        assert meets(scene, [neck[0], side * 0.6 * arm[1], arm[2]], [0, 0, 1])
    # Level hems of both panels, at the same height.
    hem = scene.cloth.positions[scene.cloth.region("bottom")]
    assert np.ptp(hem[:, 2]) < 0.01


def test_the_hole_of_a_tabard_is_round(scenes):
    """Its edge turns by less than 60 degrees at each vertex: a rectangle's corners would turn by 90."""
    edge = scenes["tabard"].cloth.positions[scenes["tabard"].cloth.region("neckline")]
    around = edge[np.argsort(np.arctan2(edge[:, 1], edge[:, 0] - edge[:, 0].mean()))][:, :2]
    sides = np.roll(around, -1, axis=0) - around
    along = sides / np.linalg.norm(sides, axis=1, keepdims=True)
    turns = np.sum(along * np.roll(along, 1, axis=0), axis=1)
    assert turns.min() > np.cos(np.radians(60.0))


@pytest.mark.parametrize(("length", "flare"), [(0.5, 2.0), (0.7, 3.0), (0.4, 1.0), (0.4, None)])
def test_a_skirt_around_a_cylinder_has_its_measures(walker, length: float, flare: float | None):
    """The waist is a circle at the cylinder's radius and the clearance; the hem's length and the way down are asked.
    Where no flare is, 3 would be wider than what lies flat.

    Columns are 1 / n of the way round: chords are shorter than arcs by (pi / n)^2 / 6, 0.1 % for the 40 there are at
    least; the outline is found within a millimetre of 0.2 m.
    """
    body, track = walker
    up = body.rest.into_bone(body.rest.bone("pelvis"), body.rest.origin("pelvis") + 2.0 * body.rest.up)
    cylinder = cape.Cylinder(name="trunk", bone=body.role("pelvis"), start=-up, end=up, radius=0.2)
    scene = cape.dress(body, track, garment="skirt", length=length, flare=flare, colliders=[cylinder])
    cloth = scene.cloth
    hem, waist = (cloth.positions[cloth.region(name)] for name in ("hem", "waist"))
    girths = []
    for ring in (waist[waist[:, 2] > waist[:, 2].max() - 1e-6], hem):
        angle = np.argsort(np.arctan2(ring[:, 1], ring[:, 0]))
        girths.append(np.linalg.norm(ring[angle] - np.roll(ring[angle], 1, axis=0), axis=1).sum())
    assert girths[0] == pytest.approx(2.0 * np.pi * (0.2 + scene.thickness + CLEARANCE), rel=0.008)
    band = BAND * body.height()
    flare = flare or STEEPEST * (1.0 + 2.0 * np.pi * (length - band) / girths[0])
    assert girths[1] == pytest.approx(flare * girths[0], rel=0.01)
    # From the waist straight down over the band, and slanting to the hem.
    wider = (flare - 1.0) * girths[0] / (2.0 * np.pi)
    down = band + np.sqrt((length - band) ** 2 - wider**2)
    assert waist[:, 2].max() - hem[:, 2].max() == pytest.approx(down, rel=0.01)


def test_a_skirt_is_held_at_the_waist_and_clears_the_hips(scenes, at):
    scene = scenes["skirt"]
    (held,) = scene.attachments
    assert held.bone == "pelvis"
    assert not held.soft
    waist = scene.cloth.positions[scene.cloth.region("waist")][:, 2]
    assert at("left_thigh")[2] < waist.min() < waist.max() < at("chest")[2]


def test_a_sash_goes_from_the_left_shoulder_to_the_right_hip(walker, scenes, at):
    scene = scenes["sash"]
    places = scene.cloth.positions
    highest, lowest = places[places[:, 2].argmax()], places[places[:, 2].argmin()]
    shoulder, hip = at("left_upper_arm"), at("right_thigh")
    assert 0.0 < highest[1] < shoulder[1]
    assert highest[2] > shoulder[2]
    assert lowest[1] < hip[1]
    assert abs(lowest[2] - hip[2]) < 0.1
    # Over chest and back alike, and nothing around the left hip.
    for direction in ([1, 0, 0], [-1, 0, 0]):
        assert meets(scene, places.mean(axis=0), direction)
    for direction in ([1, 0, 0], [-1, 0, 0], [0, 1, 0]):
        assert not meets(scene, at("left_thigh"), direction)
    # A strip as wide everywhere, whose warp coordinate tells half of its length from where it is sewn.
    strip = WIDTH * walker[0].height() * 2.0 * np.ptp(scene.cloth.pattern[:, 1])
    assert areas(scene.cloth.corners).sum() == pytest.approx(strip, rel=1e-3)


@pytest.mark.parametrize(("name", "role"), [("hooded_cloak", "head"), ("skirt", "pelvis"), ("tabard", "chest")])
def test_a_role_that_a_body_lacks_is_told_by_name(walker, name: str, role: str):
    body, track = walker
    colliders = body.capsules()
    roles = {known: bone for known, bone in body.roles.items() if known != role}
    lacking = replace(body, roles=roles, rest=replace(body.rest, roles=roles))
    with pytest.raises(UnknownNameError, match=f"'{role}'") as told:
        cape.dress(lacking, track, garment=name, colliders=colliders)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("asked", "text"),
    [
        ({"garment": "skirt", "flare": 30.0}, "lies flat"),
        ({"garment": "skirt", "length": 0.05}, "too wide for a skirt"),
        ({"garment": "skirt", "spacing": 0.3}, "too wide"),
        ({"garment": "skirt", "colliders": ()}, "no body"),
        ({"garment": "sash", "length": 1.0}, "takes no length"),
        ({"garment": "sash", "spacing": 0.5}, "too wide"),
        ({"garment": "tabard", "length": 0.2}, "too wide for a tabard"),
        ({"garment": "tabard", "spacing": -1.0}, "spacing must be positive"),
    ],
)
def test_what_cannot_be_cut_is_told(walker, asked: dict, text: str):
    body, track = walker
    with pytest.raises(ValueRangeError, match=text):
        cape.dress(body, track, **asked)
