"""Garments that lie on the shoulders: cut to a body, without tension as they are put on, and what they cover."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cape
import motions
from cape.assembly.springs import springs_of
from cape.cloth.cloth import GridCloth
from cape.garments.fitting import STRIDE, Fitted, _first
from cape.garments.registry import GARMENTS
from cape.kernels.contact.contact import EXIT
from cape.measure.self_crossings import self_crossings
from motions import quaternions
from motions.errors import UnknownNameError, ValueRangeError
from skeleton import Capsule, Skeleton
from skeleton.solid_measures import signed_distance
from skeleton.straight_limbs import AWAY, lower_arms
from tests.support.figures import figure

COLLARED = ["shoulder_cape", "cloak", "half_cape", "hooded_cloak"]


@pytest.fixture(scope="module")
def walker():
    clip = motions.load("walk").trim(0.0, 0.3)
    body = Skeleton.from_clip(clip)
    return body, body.track(clip)


def test_a_darted_grid_has_the_springs_and_the_mass_of_its_shape_at_the_start():
    flat = cape.Cloth.rectangle(width=0.4, height=0.3, spacing=0.05)
    assert isinstance(flat, GridCloth)
    # The same rectangle rolled onto a cylinder: as it is finer, its chords come near the flat one's lengths.
    angles = flat.pattern[:, 0] / 0.5
    rolled = np.stack([0.5 * np.sin(angles), 0.5 * np.cos(angles), -flat.pattern[:, 1]], axis=1)
    darted = GridCloth(rows=flat.rows, columns=flat.columns, pattern=2.0 * flat.pattern, positions=rolled, darted=True)
    chord = 2.0 * 0.5 * np.sin(0.05 / 0.5 / 2.0) / 0.05
    springs = springs_of(darted)
    ends = rolled[springs.second] - rolled[springs.first]
    np.testing.assert_allclose(springs.rest, np.linalg.norm(ends, axis=1), rtol=1e-12)
    assert darted.masses().sum() == pytest.approx(chord * 0.4 * 0.3 * darted.fabric.density, rel=1e-12)
    # Whatever the pattern says: it is twice as large.
    np.testing.assert_allclose(darted.masses(), chord * flat.masses(), rtol=1e-12)


@pytest.mark.parametrize("name", COLLARED)
def test_cloth_on_top_of_a_shoulder_stays_near_its_place(walker, name: str):
    """Of one on both shoulders, vertices to all sides of each joint are kept there by the shoulder's own bone."""
    body, track = walker
    scene = cape.dress(body, track, garment=name)
    kept = {c.animated.bone: c for c in scene.confinements}
    assert set(kept) == (set() if name == "half_cape" else {"left_shoulder", "right_shoulder"})
    for bone, confinement in kept.items():
        side = 1.0 if bone == "left_shoulder" else -1.0
        off = scene.cloth.positions[confinement.animated.vertices] - [0.0, side * body.shoulder_width() / 2.0, 0.0]
        assert np.hypot(off[:, 0], off[:, 1]).max() < 0.05 * body.height()
        assert off[:, :2].min(axis=0).max() < 0.0 < off[:, :2].max(axis=0).min()
        assert off[:, 2].min() > 0.0
        assert confinement.max_distance is not None
        most = np.asarray(confinement.max_distance)
        # As far off as covers, at most, and the firmer the nearer to the joint, where the cover is looked for.
        assert 0.0 < most.max() < 0.06
        assert (np.diff(most[np.argsort(np.hypot(off[:, 0], off[:, 1]))]) > 0.0).all()


@pytest.mark.parametrize("name", COLLARED)
def test_a_garment_starts_clear_of_the_body_and_without_tension(walker, name: str):
    body, track = walker
    scene = cape.dress(body, track, garment=name)
    assert scene.dressing is not None
    springs = springs_of(scene.cloth)
    ends = scene.cloth.positions[springs.second] - scene.cloth.positions[springs.first]
    np.testing.assert_allclose(springs.rest, np.linalg.norm(ends, axis=1), rtol=1e-9)
    for collider in scene.colliders:
        if collider.bone is None:
            continue
        origin, turn = scene.dressing[collider.bone]
        in_bone = quaternions.rotate(quaternions.conjugate(turn), scene.cloth.positions - origin)
        assert signed_distance(collider, in_bone).min() > scene.thickness, collider.name


@pytest.mark.parametrize("side", ["left", "right"])
def test_arms_hang_beside_the_trunk_and_keep_their_shape(walker, side: str):
    rest, lowered = walker[0].rest, lower_arms(walker[0].rest)
    start, elbow, hand = (rest.bone(f"{side}_{limb}") for limb in ("upper_arm", "forearm", "hand"))
    across = rest.left if side == "left" else -rest.left
    expected = np.sin(AWAY) * across - np.cos(AWAY) * rest.up
    for first, second in ((start, elbow), (elbow, hand)):
        way = lowered.positions[second] - lowered.positions[first]
        np.testing.assert_allclose(way / np.linalg.norm(way), expected, atol=1e-9)
    for before, after in ((start, elbow), (elbow, hand), (hand, elbow)):
        seen = [
            quaternions.rotate(
                quaternions.conjugate(r.rotations_wxyz[before]), r.positions[after] - r.positions[before]
            )
            for r in (rest, lowered)
        ]
        np.testing.assert_allclose(seen[0], seen[1], atol=1e-9)
    still = [rest.bone(role) for role in ("pelvis", "head", f"{side}_foot")]
    np.testing.assert_array_equal(lowered.positions[still], rest.positions[still])


def test_a_ring_is_let_down_onto_a_ball(walker):
    body, _ = walker
    ball = cape.Sphere(name="ball", bone="chest", radius=0.2)
    fitted = Fitted(body, [ball])
    origin = fitted.pose(["chest"])[0][0]
    angles, radius = np.linspace(-np.pi, np.pi, 40, endpoint=False), 0.05
    found = fitted.lie_on(radius, angles, 0.01, np.full(40, origin[2] + 0.25))
    # Heights are tried 2 mm apart, and the lowest clear one is taken.
    for heights, clear in ((found, True), (found - 0.002, False)):
        around = fitted.ring(radius, angles, heights)
        np.testing.assert_allclose(around[:, 2], heights)
        assert ((np.linalg.norm(around - origin, axis=1) >= 0.21 - 1e-12) == clear).all()


def test_a_collar_lies_around_the_neck_wherever_that_is(walker):
    """A neck of 5 cm, a little ahead of its joint and to the left, that begins between the shoulder blades."""
    body, _ = walker
    start, end = np.array([0.02, 0.03, -0.25]), np.array([0.02, 0.03, 0.25])
    fitted = Fitted(body, [Capsule("neck", "Neck", start, end, 0.05)])
    joint = fitted.pose(["Neck"])[0][0]
    places = [joint + quaternions.rotate(fitted.pose(["Neck"])[1][0], point) for point in (start, end)]
    height = 0.049 * fitted.height
    middle = places[0] + (height - places[0][2]) / (places[1][2] - places[0][2]) * (places[1] - places[0])
    # The neck leans by 1 in 25 against the trunk at most, and is as thick to all sides.
    np.testing.assert_allclose(fitted.neck, middle[:2], atol=1e-3)
    # Joints, which lean by 0.25, tell how a ring lies across the neck, and where it is above and below that height.
    assert fitted.collar(0.01).radius < (0.05 + 0.01) * (1.0 + 0.25**2) + 0.002 + 2e-3


@pytest.mark.parametrize("lean", [0.0, 0.4])
def test_a_collar_lies_across_a_neck_that_leans(walker, lean: float):
    """Around one as thick to all sides it is as steep as that leans, and each of its points around its own middle."""
    body, _ = walker
    plain = Fitted(body, [])
    joint, turn = plain.pose(["Neck"])[0][0], plain.pose(["Neck"])[1][0]
    middle = np.array([*plain.neck, 0.05 * plain.height])
    way = np.array([lean, 0.0, 1.0])
    start, end = (
        quaternions.rotate(quaternions.conjugate(turn), middle + share * way - joint) for share in (-0.2, 0.3)
    )
    fitted = Fitted(body, [Capsule("neck", "Neck", start, end, 0.05)])
    # The joints tell how the neck leans; this one is made to lean by more or less than the walker's.
    fitted.__dict__["_neck_line"] = (middle - 0.2 * way, middle + 0.3 * way, way[:2])
    found = fitted.collar(0.01)
    angles = np.linspace(-np.pi, np.pi, 96, endpoint=False)
    ring = fitted.ring(found.radius, angles, found.height + found.rises(angles))
    distances = fitted.distances(ring, only=["neck"])
    assert found.steepness == pytest.approx(lean)
    # Widths are tried 2 mm apart; seen along the neck the ring is shorter by 1 / cos of its lean to the front.
    assert distances.min() >= 0.01 - 1e-9
    assert distances.max() - distances.min() <= 0.06 * (1.0 - 1.0 / np.hypot(1.0, lean)) + 1e-3
    assert found.radius <= 0.06 * np.hypot(1.0, lean) + 0.002


def test_where_no_collar_clears_the_neck_what_needs_none_is_named(walker):
    """As around robots whose arms begin beside the head."""
    body, _ = walker
    fitted = Fitted(body, [Capsule("neck", "Neck", np.zeros(3), np.array([0.0, 0.0, 0.3]), 0.3)])
    with pytest.raises(ValueRangeError, match=r"^no collar of less than 0\.\d\d m clears the neck: .*back_cape.*$"):
        fitted.collar(0.01)


def test_a_collar_moves_half_with_the_neck(walker):
    """Which turns in nothing but the neck's joint."""
    body, track = walker
    scene = cape.dress(body, track, spacing=0.06)
    held = scene.attachments[0]
    assert held.bones == ("chest", "Neck")
    np.testing.assert_array_equal(held.weights, 0.5)
    clip = figure(frames=2, without=("Neck",))
    headless = Skeleton.from_clip(clip)
    assert cape.dress(headless, headless.track(clip)).attachments[0].bones == ("chest",)


def test_rings_are_the_narrowest_of_all_that_are_tried(walker, monkeypatch: pytest.MonkeyPatch):
    """Around the walker's neck, and around a thicker one."""
    body, _ = walker
    thick, solids_of = Capsule("neck", "Neck", np.zeros(3), np.array([0.0, 0.0, 0.3]), 0.07), body.capsules()
    for solids in (solids_of, [*solids_of, thick]):
        found = {}
        for stride in (1, STRIDE):
            monkeypatch.setattr("cape.garments.fitting.STRIDE", stride)
            fitted = Fitted(body, solids)
            found[stride] = fitted.collar(0.02), fitted.girth(0.02)
        assert found[1] == found[STRIDE]


@given(st.integers(1, 60), st.data())
def test_the_least_radius_that_is_clear_is_found_wherever_it_is(count: int, data: st.DataObject):
    radii = np.linspace(0.05, 0.3, count)
    first, width = data.draw(st.integers(0, count)), data.draw(st.integers(1, count))
    free = set(range(first, min(first + width, count)))
    index = {float(radius): k for k, radius in enumerate(radii)}
    found = _first(radii, lambda radius: np.zeros(3 if index[radius] in free else 2), least=3)
    assert found == (float(radii[first]) if free else None)


@pytest.mark.parametrize("name", COLLARED)
@pytest.mark.few("shoulder_cape")
def test_it_follows_the_body_from_the_pose_in_which_it_is_put_on_to_the_first(walker, name: str):
    body, track = walker
    scene = cape.dress(body, track, garment=name, spacing=0.06)
    simulation = cape.Simulation(scene)
    places = {bone: track.index(bone) for bone in simulation.bones}
    pose = {bone: (track.positions[0, k], track.rotations_wxyz[0, k]) for bone, k in places.items()}
    simulation.start(pose)
    held = scene.attachments[0]
    assert held.points is not None
    chest = track.index("chest")
    expected = track.positions[0, chest] + quaternions.rotate(track.rotations_wxyz[0, chest], held.points)
    np.testing.assert_allclose(simulation.positions[held.vertices], expected, atol=2e-3)
    assert np.isfinite(simulation.positions).all()


@pytest.mark.parametrize("settle", [0.0, 0.3])
def test_it_comes_along_where_there_is_little_time_to_put_it_on(walker, settle: float):
    body, track = walker
    scene = cape.dress(body, track, garment="shoulder_cape", spacing=0.06)
    simulation = cape.Simulation(scene)
    places = {bone: track.index(bone) for bone in simulation.bones}
    pose = {bone: (track.positions[0, k], track.rotations_wxyz[0, k]) for bone, k in places.items()}
    # The chest is turned against the shoulders, unlike in the pose in which the cape is put on.
    turn = quaternions.from_rotation_vector(np.array([0.0, 0.0, 0.6]))
    pose["chest"] = (pose["chest"][0], quaternions.multiply(turn, pose["chest"][1]))
    simulation.start(pose, settle=settle)
    # The bones stand still in this frame, so that what holds the cloth moves it no faster than out of colliders.
    before = simulation.positions
    simulation.step(pose, 1 / 60)
    held = scene.attachments[0].vertices
    assert np.linalg.norm(simulation.positions - before, axis=1)[held].max() <= EXIT / 60.0 + 1e-6


def test_both_shoulders_are_covered_and_the_chest_is_not(walker):
    """A ray up the trunk from each shoulder joint meets the cloth; one forwards from the breastbone meets none."""
    body, track = walker
    scene = cape.dress(body, track, garment="shoulder_cape", spacing=0.04)
    take = cape.simulate(scene, track)
    corners = take.positions[-1].astype(float)[scene.cloth.triangles]
    left, right = (track.positions[-1, track.index(f"{side}_upper_arm")] for side in ("left", "right"))
    up = (left + right) / 2.0 - track.positions[-1, track.index("pelvis")]
    up /= np.linalg.norm(up)
    for joint in (left, right):
        assert (distances_along(joint, up, corners) < 0.06 + 0.06).any()
    forward = np.cross(left - right, up)
    sternum = (left + right) / 2.0 - 0.15 * up
    assert not np.isfinite(distances_along(sternum, forward / np.linalg.norm(forward), corners)).any()


def distances_along(origin: np.ndarray, direction: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Where a ray meets each of triangles (T, 3, 3) [m], infinite where it misses (Moeller and Trumbore 1997)."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = np.cross(direction, b)
    size = np.sum(a * p, axis=1)
    t = origin - corners[:, 0]
    q = np.cross(t, a)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v, way = np.sum(t * p, axis=1) / size, q @ direction / size, np.sum(q * b, axis=1) / size
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (way > 0)
    return np.where(hit, way, np.inf)


def test_what_cannot_be_cut_is_told(walker):
    body, track = walker
    with pytest.raises(UnknownNameError, match="shoulder_cape"):
        cape.dress(body, track, garment="toga")
    with pytest.raises(ValueRangeError, match="ends on the shoulders"):
        cape.dress(body, track, garment="cloak", length=0.1)
    with pytest.raises(ValueRangeError, match="flare"):
        cape.dress(body, track, garment="cloak", flare=-1.0)
    assert set(COLLARED) < set(GARMENTS)


def test_layers_of_what_falls_in_folds_are_kept_apart_unless_it_is_said_otherwise(walker):
    body, track = walker
    assert cape.dress(body, track).self_contact == cape.SelfContact()
    assert cape.dress(body, track, self_contact=False).self_contact is None
    assert cape.dress(body, track, garment="back_cape").self_contact is None
    assert cape.dress(body, track, garment="back_cape", self_contact=True).self_contact == cape.SelfContact()
    own = cape.SelfContact(thickness=0.003)
    assert cape.dress(body, track, self_contact=own).self_contact == own


def test_layers_of_a_walker_s_cape_do_not_pass_through_each_other(walker):
    body, track = walker
    apart, through = (
        cape.simulate(cape.dress(body, track, self_contact=kept), track).positions[-1] for kept in (None, False)
    )
    triangles = cape.dress(body, track).cloth.triangles
    assert len(self_crossings(apart, triangles)) == 0
    assert len(self_crossings(through, triangles)) > 0
