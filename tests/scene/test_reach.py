"""Which colliders a cloth can reach: never too few, not many more, and none whose absence changes a run."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import cape
import motions
from cape.reach import STRETCH, geodesic_distances, reach_of
from cape.results.penetration import signed_distance
from motions import quaternions
from skeleton import BoneTrack, Capsule, Skeleton
from tests.support.scenes import grid_cloth, mesh_cloth

FloatArray = NDArray[np.float64]

LENGTH, CELLS = 0.9, 6
THICKNESS = 0.005


def chain(**where) -> cape.Cloth:
    """A narrow strip that hangs from its top row, 0.9 m long."""
    return grid_cloth(np.linspace(0.0, 0.1, 2), np.linspace(0.0, LENGTH, CELLS + 1), cape.Fabric(), **where)


def tumbling(rng: np.random.Generator, frames: int = 8) -> BoneTrack:
    """Two bones that leap by up to 0.4 m and 1.5 rad a frame."""
    turns = quaternions.from_rotation_vector(rng.uniform(-0.85, 0.85, (frames, 2, 3)))
    rotations = np.empty((frames, 2, 4))
    rotations[0] = turns[0]
    for f in range(1, frames):
        rotations[f] = quaternions.multiply(turns[f], rotations[f - 1])
    positions = np.cumsum(rng.uniform(-0.23, 0.23, (frames, 2, 3)), axis=0)
    positions[:, 1, 0] += 1.2
    return BoneTrack(("hand", "foe"), np.arange(frames) / 30.0, positions, rotations)


def any_collider(rng: np.random.Generator, name: str, bone: str | None) -> cape.Collider:
    """One of any kind, about 1.5 m off."""
    place = 1.5 * rng.standard_normal(3)
    axis, size = rng.standard_normal(3), rng.uniform(0.05, 0.3)
    own = 0.02 if rng.random() < 0.5 else None
    return [
        Capsule(name, bone, place, place + axis, size, thickness=own),
        cape.TaperedCapsule(
            name=name, bone=bone, start=place, end=place + axis, start_radius=size, end_radius=0.3 * size, thickness=own
        ),
        cape.Sphere(name=name, bone=bone, center=place, radius=size, thickness=own),
        cape.Box(name=name, bone=bone, center=place, half_sizes=rng.uniform(0.05, 0.3, 3), thickness=own),
        cape.Plane(name=name, bone=bone, point=place, normal=-place + 0.5 * axis, thickness=own),
        cape.Cylinder(name=name, bone=bone, start=place, end=place + axis, radius=size, thickness=own),
        cape.Ellipsoid(name=name, bone=bone, center=place, radii=rng.uniform(0.05, 0.3, 3), thickness=own),
    ][rng.integers(7)]


def distances_over_time(
    scene: cape.Scene, track: BoneTrack, collider: cape.Collider, points: FloatArray, times: FloatArray
) -> FloatArray:
    """Of points in the first bone's frame (n, 3) from a collider at any times [m], shape (T, n)."""
    positions, rotations = track.sample(times)
    places = positions[:, :1] + quaternions.rotate(rotations[:, :1], points[None])
    if collider.bone is not None:
        bone = track.index(collider.bone)
        away = places - positions[:, bone : bone + 1]
        places = quaternions.rotate(quaternions.conjugate(rotations[:, bone : bone + 1]), away)
    return signed_distance(collider, places.reshape(-1, 3)).reshape(places.shape[:2])


@pytest.mark.parametrize("seed", range(20))
def test_chains_never_get_to_what_is_left_out(seed):
    rng = np.random.default_rng(seed)
    track = tumbling(rng)
    cloth = chain(origin=track.positions[0, 0] + 0.1 * rng.standard_normal(3), down=rng.standard_normal(3))
    # Crumpled, as a direction may have any length.
    start = cloth.positions[0]
    cloth = replace(cloth, positions=start + (cloth.positions - start) / 10.0)
    colliders = [any_collider(rng, f"c{k}", [None, "hand", "foe"][k % 3]) for k in range(9)]
    scene = cape.Scene(cloth, [cape.attach(cloth, "hand", [0, 1])], colliders)
    reach = reach_of(scene, track)
    assert set(reach.left_out) | set(reach.kept) == {c.name for c in colliders}

    rotation = quaternions.to_matrix(track.rotations_wxyz[0, 0])
    held = (cloth.positions[:2] - track.positions[0, 0]) @ rotation
    times = np.linspace(track.times[0], track.times[-1], 20 * (track.frames - 1) + 1)
    for collider in colliders:
        thickness = THICKNESS if collider.thickness is None else collider.thickness
        true = distances_over_time(scene, track, collider, held, times).min() - thickness - (1.0 + STRETCH) * LENGTH
        assert reach.gaps[collider.name] <= true + 1e-9
        if collider.name in reach.left_out:
            # Any chain: each edge at most as long as its rest length and the stretch that is allowed for.
            links = rng.standard_normal((50, CELLS, 3))
            links *= (1.0 + STRETCH) * LENGTH / CELLS / np.linalg.norm(links, axis=2, keepdims=True)
            straight = np.repeat(links[:, :1], CELLS, axis=1)
            for way in (links, straight):
                vertices = (held[0] + np.cumsum(way, axis=1)).reshape(-1, 3)
                assert distances_over_time(scene, track, collider, vertices, times).min() > thickness


def test_a_way_straight_away_costs_no_room():
    """Towards a sphere the bound is exact; past one, half the leap is allowed for."""
    positions = np.zeros((4, 1, 3))
    positions[:, 0, 0] = [-0.9, -0.3, 0.3, 0.9]
    track = BoneTrack(("rod",), np.arange(4) / 60.0, positions, np.tile([1.0, 0.0, 0.0, 0.0], (4, 1, 1)))
    cloth = chain(origin=(-0.9, 0.0, 0.0))
    still = {"ahead": [4.0, 0.0, 0.0], "beside": [0.0, 4.0, 0.0]}
    colliders = [cape.Sphere(name=name, center=np.array(center), radius=1.0) for name, center in still.items()]
    held = [cape.attach(cloth, "rod", [0, 1], points=np.zeros((2, 3)))]
    reach = reach_of(cape.Scene(cloth, held, colliders), track)
    assert reach.gaps["ahead"] == pytest.approx(2.1 - THICKNESS - reach.radius, abs=1e-12)
    assert reach.gaps["beside"] == pytest.approx(np.hypot(4.0, 0.3) - 1.0 - 0.3 - THICKNESS - reach.radius, abs=1e-12)


def test_a_way_around_a_turn_is_bounded():
    """A bone swings a ball by 1.5 rad; half way the held point, 1 m from the axis, is right in its middle."""
    turns = np.zeros((2, 2, 4))
    turns[..., 0] = 1.0
    turns[1, 1] = [np.cos(0.75), 0.0, 0.0, np.sin(0.75)]
    track = BoneTrack(("rod", "arm"), np.arange(2) / 60.0, np.array([[[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]] * 2), turns)
    cloth = chain(origin=(1.0, 0.0, 0.0))
    held = [cape.attach(cloth, "rod", [0, 1], points=np.zeros((2, 3)))]
    ball = cape.Sphere(name="ball", bone="arm", center=np.array([np.cos(0.75), -np.sin(0.75), 0.0]), radius=0.1)
    reach = reach_of(cape.Scene(cloth, held, [ball]), track)
    assert reach.gaps["ball"] <= -ball.radius - THICKNESS - reach.radius


def test_gaps_at_rest_are_what_geometry_says():
    cloth = chain(origin=(0.0, 0.0, 2.0))
    still = BoneTrack(("rod",), np.arange(3) / 60.0, np.zeros((3, 1, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (3, 1, 1)))
    colliders = [
        cape.Plane(name="floor"),
        cape.Plane(name="stage", point=np.array([0.0, 0.0, 1.0])),
        cape.Sphere(name="ball", center=np.array([0.0, 2.0, 2.0]), radius=0.51, thickness=0.1),
        Capsule("post", None, np.array([0.1, -3.0, 2.0]), np.array([0.1, -2.0, 2.0]), 0.25),
    ]
    reach = reach_of(cape.Scene(cloth, [cape.attach(cloth, "rod", [0, 1])], colliders), still)
    assert reach.radius == pytest.approx(1.15 * LENGTH)
    expected = {
        "floor": 2.0 - THICKNESS - 1.15 * LENGTH,
        "stage": 1.0 - THICKNESS - 1.15 * LENGTH,
        "ball": 1.49 - 0.1 - 1.15 * LENGTH,
        "post": 1.75 - THICKNESS - 1.15 * LENGTH,
    }
    assert reach.gaps == pytest.approx(expected, abs=1e-12)
    assert reach.left_out == {
        "floor": "at least 0.96 m beyond the cloth's reach of 1.03 m",
        "ball": "at least 0.36 m beyond the cloth's reach of 1.03 m",
        "post": "at least 0.71 m beyond the cloth's reach of 1.03 m",
    }
    assert reach.kept == {"stage": "within the cloth's reach of 1.03 m, by 0.04 m at frame 0"}


def test_what_is_held_inside_a_collider_is_led_out_and_reaches_further():
    """The held points at the centre of a ball are held at its skin, on whichever side."""
    cloth = chain()
    held = [cape.attach(cloth, "rod", [0, 1], points=np.zeros((2, 3)))]
    still = BoneTrack(("rod",), np.arange(2) / 60.0, np.zeros((2, 1, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (2, 1, 1)))
    colliders = [
        cape.Sphere(name="fist", bone="rod", radius=0.2),
        cape.Sphere(name="moon", center=np.array([0.0, 3.0, 0.0]), radius=1.0),
    ]
    reach = reach_of(cape.Scene(cloth, held, colliders), still)
    assert reach.gaps["moon"] == pytest.approx(2.0 - THICKNESS - (1.15 * LENGTH + 0.2 + THICKNESS), abs=1e-12)


def test_a_cloth_that_starts_drawn_out_reaches_as_far_as_it_starts():
    cloth = chain(origin=(0.0, 0.0, 2.0))
    far = replace(cloth, positions=cloth.positions * [1.0, 1.0, 3.0] - [0.0, 0.0, 4.0])
    still = BoneTrack(("rod",), np.arange(2) / 60.0, np.zeros((2, 1, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (2, 1, 1)))
    reach = reach_of(cape.Scene(far, [cape.attach(far, "rod", [0, 1])], [cape.Plane(name="floor")]), still)
    assert reach.radius == pytest.approx(3.0 * LENGTH)
    assert not reach.left_out


@pytest.mark.parametrize("held", [[], [0]])
def test_nothing_is_left_out_where_a_part_hangs_on_nothing(held):
    """No attachment at all, and a mesh of two pieces of which one is held."""
    piece = mesh_cloth(np.linspace(0.0, 0.2, 3), np.linspace(0.0, 0.3, 4), cape.Fabric())
    count = piece.vertices
    cloth = cape.Cloth.from_mesh(
        np.concatenate([piece.positions, piece.positions + np.array([1.0, 0.0, 0.0])]),
        np.concatenate([piece.triangles, piece.triangles + count]),
    )
    still = BoneTrack(("rod",), np.arange(2) / 60.0, np.zeros((2, 1, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (2, 1, 1)))
    attachments = [cape.attach(cloth, "rod", held)] if held else []
    scene = cape.Scene(cloth, attachments, [cape.Sphere(name="moon", center=np.array([0.0, 0.0, 1e5]))])
    reach = reach_of(scene, still)
    assert reach.left_out == {}
    assert reach.kept == {"moon": "nothing holds the cloth, which may get anywhere"}
    assert reach.cull(scene).colliders == tuple(scene.colliders)


@pytest.mark.parametrize("make", [grid_cloth, mesh_cloth])
def test_geodesic_distances_are_the_shortest_paths(make):
    cloth = make(np.cumsum([0.0, 0.1, 0.15, 0.1]), np.cumsum([0.0, 0.1, 0.12, 0.08, 0.1]), cape.Fabric())
    sources = np.array([13, 2])
    distances, nearest = geodesic_distances(cloth, sources)
    from cape.assembly.springs import springs_of

    springs = springs_of(cloth)
    lengths = np.full((cloth.vertices, cloth.vertices), np.inf)
    np.fill_diagonal(lengths, 0.0)
    lengths[springs.first, springs.second] = lengths[springs.second, springs.first] = springs.rest
    for k in range(cloth.vertices):  # Floyd 1962
        lengths = np.minimum(lengths, lengths[:, k, None] + lengths[None, k])
    np.testing.assert_allclose(distances, lengths[sources].min(axis=0), rtol=1e-12)
    np.testing.assert_allclose(lengths[sources[nearest], np.arange(cloth.vertices)], distances, rtol=1e-12)
    # No shorter than the straight way in the pattern.
    away = np.linalg.norm(cloth.pattern[:, None] - cloth.pattern[sources], axis=2).min(axis=1)
    assert (distances >= away - 1e-12).all()


@pytest.mark.parametrize("seed", range(5))
def test_places_that_stand_for_many_reach_as_far_as_all(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    track = tumbling(rng)
    cloth = grid_cloth(np.linspace(0.0, 0.3, 7), np.linspace(0.0, 0.6, 10), cape.Fabric(), origin=track.positions[0, 0])
    colliders = [any_collider(rng, f"c{k}", [None, "hand", "foe"][k % 3]) for k in range(9)]
    held = [cape.attach(cloth, "hand", np.arange(40)), cape.attach(cloth, "foe", [66, 67, 68, 69])]
    scene = cape.Scene(cloth, held, colliders)
    gaps = {}
    for most in (1, 100):
        monkeypatch.setattr("cape.reach.MOST_PLACES", most)
        gaps[most] = reach_of(scene, track).gaps
    for collider in colliders:
        assert gaps[100][collider.name] - 0.7 < gaps[1][collider.name] <= gaps[100][collider.name] + 1e-12


@pytest.mark.parametrize("seed", range(5))
def test_many_colliders_are_left_out_by_balls_around_them(seed, monkeypatch):
    """In fields of them on both bones and in the world; the strip is held inside of some, and so reaches farther."""
    rng = np.random.default_rng(seed)
    track = tumbling(rng)
    cloth = chain(origin=track.positions[0, 0])
    colliders = [any_collider(rng, f"c{k}", [None, "hand", "foe"][k % 3]) for k in range(90)]
    colliders += [
        cape.Sphere(name=f"far {k}", bone=[None, "hand", "foe"][k % 3], center=rng.uniform(-30.0, 30.0, 3), radius=0.1)
        for k in range(90)
    ]
    scene = cape.Scene(cloth, [cape.attach(cloth, "hand", [0, 1])], colliders)
    found = {}
    for many in (1, 1000):
        monkeypatch.setattr("cape.reach.MANY", many)
        found[many] = reach_of(scene, track)
    by_balls, by_all = found[1], found[1000]
    assert by_balls.radius == pytest.approx(by_all.radius, abs=1e-12)
    for collider in colliders:
        name = collider.name
        assert by_balls.gaps[name] <= by_all.gaps[name] + 1e-9
        if name in by_balls.kept:
            assert by_balls.gaps[name] == pytest.approx(by_all.gaps[name], abs=1e-9)
            assert by_balls.frames[name] == by_all.frames[name]
    assert sum(name.startswith("far") for name in by_balls.left_out) > 70


def test_a_jump_that_parts_what_holds_a_cloth_lets_it_reach_further():
    """Two bones leap a metre up and 0.4 m apart; the cloth comes along as it is, 0.2 m off where each holds it."""
    cloth = grid_cloth(np.linspace(0.0, 1.0, 5), np.linspace(0.0, 0.5, 5), cape.Fabric())
    positions = np.zeros((4, 2, 3))
    positions[:, 1, 0] = 1.0
    positions[2:] += [0.0, 0.0, 2.0]
    positions[2:, 1, 0] += 0.4
    track = BoneTrack(("left", "right"), np.arange(4) / 60.0, positions, np.tile([1.0, 0.0, 0.0, 0.0], (4, 2, 1)))
    scene = cape.Scene(cloth, [cape.attach(cloth, "left", [0]), cape.attach(cloth, "right", [4])])
    slow = BoneTrack(track.names, 60.0 * track.times, track.positions, track.rotations_wxyz)
    assert reach_of(scene, track).radius == pytest.approx(reach_of(scene, slow).radius + 0.2, abs=1e-9)


@pytest.fixture(scope="module")
def swing() -> tuple[cape.Scene, BoneTrack]:
    """A sheet that swings into a sphere, with colliders of every kind far away."""
    cloth = cape.Cloth.rectangle(width=0.4, height=0.6, spacing=0.05, origin=(0.0, 0.2, 1.5))
    frames = 25
    positions = np.zeros((frames, 1, 3))
    positions[:, 0, 0] = 0.3 * np.sin(np.linspace(0.0, 4.0, frames))
    track = BoneTrack(("rod",), np.arange(frames) / 60.0, positions, np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1, 1)))
    far = np.array([0.0, 4.0, 0.0])
    colliders = [
        cape.Plane(name="floor"),
        cape.Sphere(name="ball", center=np.array([0.1, 0.0, 1.1]), radius=0.15),
        cape.Sphere(name="far ball", center=far, radius=0.3),
        cape.Box(name="far box", center=far, half_sizes=np.full(3, 0.2)),
        Capsule("far capsule", "rod", far, far + np.array([0.0, 0.0, 1.0]), 0.1),
    ]
    return cape.Scene(cloth, [cape.attach(cloth, "rod", "top")], colliders), track


def test_what_is_left_out_does_not_change_a_bit(swing):
    scene, track = swing
    culled, whole = cape.simulate(scene, track), cape.simulate(scene, track, cull=False)
    assert sorted(culled.left_out) == ["far ball", "far box", "far capsule", "floor"]
    assert whole.left_out == {}
    np.testing.assert_array_equal(culled.positions, whole.positions)
    assert culled.contacts is not None
    assert whole.contacts is not None
    assert culled.contacts.counts.any()
    np.testing.assert_array_equal(culled.contacts.points, whole.contacts.points)
    np.testing.assert_array_equal(culled.contacts.colliders, whole.contacts.colliders)
    assert [c.name for c in culled.colliders] == [c.name for c in scene.colliders]


def test_penetration_is_measured_in_what_is_left_out_too(swing, monkeypatch):
    scene, track = swing
    wall = cape.Box(name="wall", center=np.array([0.0, 0.0, 1.2]), half_sizes=np.array([0.5, 0.5, 0.02]))
    scene = replace(scene, colliders=[wall])
    # As if the cloth had stretched far beyond what is allowed for.
    monkeypatch.setattr("cape.run.simulate.reach_of", lambda *_: replace(reach_of(scene, track), gaps={"wall": 0.1}))
    take = cape.simulate(scene, track)
    assert list(take.left_out) == ["wall"]
    assert take.penetration.max() > 0.01
    assert any("wall at frame 0, which was left out" in text for text in take.warnings)


def test_a_walker_cannot_reach_the_floor_unless_the_cape_is_long():
    clip = motions.load("walk")
    body = Skeleton.from_clip(clip)
    track = body.track(clip)
    assert "floor" in reach_of(cape.dress(body, track), track).left_out
    assert "floor" in reach_of(cape.dress(body, track, length=1.8), track).kept
