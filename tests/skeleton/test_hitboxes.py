"""Hitboxes of robots: what they hold, what is left out, both sides alike, to a file and back, and in Pinocchio."""

# Pinocchio and coal lie in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false

import tomllib
from functools import cache
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motions import quaternions
from motions.errors import FileError, UnknownNameError, ValueRangeError
from skeleton import ROBOTS, Capsule, Hitboxes, Skeleton, add_to_geometry_model, hitboxes_of, load_hitboxes
from skeleton.robot.hitboxes import INSIDE
from skeleton.robot.links import in_neutral_pose
from skeleton.robot.meshes.link_surfaces import Kind, LinkSurface, geometry_model, link_surfaces
from skeleton.robot.solid_files import read_solids
from skeleton.shapes import Box, Cylinder, Ellipsoid, Plane, Shape, Sphere, TaperedCapsule
from skeleton.solid_measures import signed_distance, volume
from tests.skeleton.robots import fitted_hitboxes, urdf_of

QUANTILE = 0.98
ROUNDING = 1e-9  # m

robots = pytest.mark.parametrize("robot", ROBOTS)
meshed = pytest.mark.parametrize("robot", [robot for robot in ROBOTS if robot != "simple_humanoid"])


@cache
def body_of(robot: str) -> Skeleton:
    return Skeleton.from_urdf(robot)


@cache
def surfaces_of(robot: str, kind: Kind) -> tuple[LinkSurface, ...]:
    return link_surfaces(body_of(robot), kind)


@cache
def fitted(robot: str) -> Hitboxes:
    """Plain capsules, but for romeo, which has tapered ones, too."""
    return fitted_hitboxes(body_of(robot), kind=None if robot == "romeo" else "capsule")


def named(hitboxes: Hitboxes) -> dict[str, Shape]:
    return {solid.name: solid for solid in hitboxes.solids}


def seen(body: Skeleton, solid: Shape, point: str) -> np.ndarray:
    """A point of a solid in the world, the robot in its neutral pose [m], shape (3,)."""
    return in_neutral_pose(body, solid.bone, getattr(solid, point)[None])[0]


# -- every humanoid --


@robots
@pytest.mark.few("human", "talos")
def test_every_humanoid_gets_something_where_a_cape_hangs(robot: str):
    hitboxes, body = fitted(robot), body_of(robot)
    names = [solid.name for solid in hitboxes.solids]
    assert len(set(names)) == len(names)
    assert {solid.bone for solid in hitboxes.solids} <= set(body.bones)
    for part in ("chest", "pelvis", *(f"{s}_{limb}" for s in ("left", "right") for limb in LIMBS)):
        assert any(name == part or name.removeprefix(part).strip("_").isdigit() for name in names) or (
            robot == "simple_humanoid" and any(part in name for name in names)
        ), part
    # Shoulders are within reach of something: a hand's breadth from where the upper arm hangs.
    for side in ("left", "right"):
        joint = body.rest.joint(f"{side}_upper_arm")
        distances = [signed_distance(solid, into_bone(body, solid, joint))[0] for solid in hitboxes.solids]
        assert min(distances) < 0.05


LIMBS = ("upper_arm", "forearm", "hand", "thigh", "shin", "foot")


def into_bone(body: Skeleton, solid: Shape, point: np.ndarray) -> np.ndarray:
    return body.rest.into_bone(body.bones.index(solid.bone), point)[None] if solid.bone else point[None]


@meshed
def test_the_surface_of_every_link_is_held_but_for_the_share(robot: str):
    hitboxes = fitted(robot)
    solids = named(hitboxes)
    surfaces = {kind: surfaces_of(robot, kind) for kind in ("collision", "visual")}
    for link, quality in hitboxes.qualities.items():
        corners = np.concatenate([s.vertices for s in surfaces[quality.geometry] if s.link == link])
        distances = np.min([signed_distance(solids[name], corners) for name in quality.solids], axis=0)
        assert quality.outside <= 1.0 - QUANTILE + ROUNDING
        assert 0.0 <= quality.p99 <= quality.most
        # A hundredth sticks out farther than p99, so p99 is above zero where more than that sticks out.
        assert (quality.p99 > ROUNDING) == (quality.outside > 0.01)
        # Corners of the mesh are among the points. On an edge no point is farther from a convex solid than its ends.
        assert max(distances.max(), 0.0) <= quality.most + ROUNDING
        if len(quality.solids) == 1:
            assert max(distances.max(), 0.0) == pytest.approx(quality.most, abs=ROUNDING)
        assert quality.most < 0.016
        assert quality.volume_ratio >= 0.8
    assert np.median([quality.volume_ratio for quality in hitboxes.qualities.values()]) < 1.8


@meshed
def test_what_is_left_out_of_the_limbs_is_small_or_inside_of_the_others(robot: str):
    hitboxes, body = fitted(robot), body_of(robot)
    assert not set(hitboxes.left_out) & set(hitboxes.qualities)
    surfaces = [*surfaces_of(robot, "collision"), *surfaces_of(robot, "visual")]
    of_size = {surface.link: surface for surface in reversed(surfaces)}
    for link, reason in hitboxes.left_out.items():
        surface = of_size[link]
        if "small" in reason:
            assert np.linalg.norm(np.ptp(surface.vertices, axis=0)) < 0.05 * body.height()
        else:
            assert reason.startswith("inside of ")
            points = in_neutral_pose(body, surface.bone, surface.vertices)
            distances = [
                signed_distance(solid, np.concatenate([into_bone(body, solid, point) for point in points[::20]]))
                for solid in hitboxes.solids
            ]
            # Vertices are not spread evenly, so a share of them may be far more than that share of the surface.
            assert np.quantile(np.min(distances, axis=0), 0.8) <= INSIDE


def test_a_robots_fingers_are_left_out_of_the_limbs():
    hitboxes = fitted("romeo")
    fingers = [link for link in hitboxes.left_out if "Finger" in link or "Thumb" in link]
    assert len(fingers) == 24
    assert all("hand" in hitboxes.left_out[finger] for finger in fingers)
    assert not any("inger" in solid.name or "Thumb" in solid.name for solid in hitboxes.solids)


def test_a_solid_larger_than_the_body_is_left_out_and_proportions_take_over():
    body, hitboxes = body_of("simple_humanoid"), fitted("simple_humanoid")
    assert hitboxes.left_out["BODY_0"] == "2.00 m thick, on a body 1.51 m tall"
    assert [solid.name for solid in hitboxes.solids] == [capsule.name for capsule in body.capsules()]
    assert any("proportions" in decision for decision in hitboxes.decisions)
    assert "head" in hitboxes.left_out


def test_collision_geometry_that_only_touches_the_ground_is_no_foot():
    hitboxes = fitted("g1")
    assert hitboxes.qualities["left_ankle_roll_link"].geometry == "visual"
    assert any("left_ankle_roll_link" in decision for decision in hitboxes.decisions)
    assert hitboxes.qualities["left_knee_link"].geometry == "collision"
    assert isinstance(named(hitboxes)["left_foot"], Capsule)


def test_limbs_taper_where_that_saves_room():
    solids = named(fitted("romeo"))
    assert isinstance(solids["left_thigh"], TaperedCapsule)
    assert any(isinstance(solid, Capsule) for solid in solids.values())


def test_a_broad_chest_gets_two_capsules():
    solids = named(fitted("talos"))
    assert {"chest_1", "chest_2"} <= set(solids)
    assert "chest" not in solids


def test_meshes_whose_file_has_another_axis_up_lie_along_their_links():
    body, solids = body_of("icub"), named(fitted("icub"))
    for limb, following in (("thigh", "shin"), ("shin", "foot"), ("upper_arm", "forearm")):
        for side in ("left", "right"):
            solid = solids[f"{side}_{limb}"]
            ends = [into_bone(body, solid, body.rest.joint(f"{side}_{part}")) for part in (limb, following)]
            middle = np.mean(ends, axis=0)
            assert signed_distance(solid, middle)[0] < 0.0, solid.name


def test_a_mesh_whose_triangles_leave_vertices_out_is_replaced_by_its_hull():
    body = body_of("icub")
    for kind in ("collision", "visual"):
        solids = {solid.name: solid for solid in geometry_model(body, kind).geometryObjects}
        for surface in surfaces_of("icub", kind):
            solid = solids[surface.name]
            reach = np.linalg.norm(solid.geometry.vertices(), axis=1).max()
            assert np.linalg.norm(surface.vertices - solid.placement.translation, axis=1).max() == pytest.approx(reach)


# -- left and right --


def test_left_and_right_limbs_of_g1_are_mirror_images():
    body, solids = body_of("g1"), named(fitted("g1"))
    pairs = [(name, name.replace("left", "right")) for name in solids if name.startswith("left")]
    assert len(pairs) >= 10
    across = body.rest.left
    for left, right in pairs:
        a, b = solids[left], solids[right]
        assert type(a) is type(b)
        for point in ("start", "end"):
            offset = seen(body, a, point) - body.rest.middle("thigh")
            image = body.rest.middle("thigh") + offset - 2.0 * (offset @ across) * across
            assert image == pytest.approx(seen(body, b, point), abs=1e-6)
        # A link that its twin's image holds a little less of is made as much thicker: by what their meshes differ.
        assert volume(a) == pytest.approx(volume(b), rel=0.02)


# -- options --


def test_all_is_everything_with_a_surface(tmp_path: Path):
    body = Skeleton.from_urdf(urdf_of(tmp_path, ['<sphere radius="1.4"/>']))
    assert hitboxes_of(body).left_out == {"arm": "inside of base"}
    everything = hitboxes_of(body, which="all", quantile=0.9)
    assert [solid.name for solid in everything.solids] == ["base", "arm"]
    assert not everything.left_out
    assert 0.05 < everything.qualities["arm"].outside <= 0.1
    assert isinstance(hitboxes_of(body, which="all", kind="tapered_capsule").solids[1], TaperedCapsule)


def test_a_clip_gets_capsules_by_proportions():
    import motions

    body = Skeleton.from_clip(motions.load("walk"))
    assert [solid.name for solid in hitboxes_of(body).solids] == [capsule.name for capsule in body.capsules()]


@pytest.mark.parametrize(
    ("options", "word"),
    [({"which": "arms"}, "limbs"), ({"kind": "sphere"}, "tapered_capsule"), ({"quantile": 0.0}, "above 0")],
)
def test_an_option_that_makes_no_sense_is_refused(options: dict, word: str):
    with pytest.raises(ValueRangeError, match=word):
        hitboxes_of(body_of("simple_humanoid"), **options)


def test_solids_of_the_file_are_taken_as_they_are(tmp_path: Path):
    body = Skeleton.from_urdf(urdf_of(tmp_path, ['<sphere radius="0.2"/>', '<box size="0.1 0.2 0.3"/>']))
    hitboxes = hitboxes_of(body, which="all")
    ball, box, arm = hitboxes.solids
    assert isinstance(ball, Sphere)
    assert (ball.name, ball.bone, ball.radius) == ("base_1", "root_joint", 0.2)
    assert isinstance(box, Box)
    assert box.half_sizes == pytest.approx([0.05, 0.1, 0.15], abs=ROUNDING)
    assert (arm.name, arm.bone) == ("arm", "hinge")
    assert isinstance(arm, Capsule)
    # A cylinder of 0.1 m by 0.5 m, of which caps of a capsule could cut only the rims.
    assert 0.095 < arm.radius < 0.115


# -- files --

lengths = st.floats(-1e6, 1e6)
sizes = st.floats(1e-300, 1e6)
vectors = st.tuples(lengths, lengths, lengths).map(np.array)
texts = st.text(st.characters(codec="utf-8"))
extras = {"friction": st.none() | st.floats(0.0, 1e6), "thickness": st.none() | st.floats(0.0, 1e6)}
common = {"bone": st.none() | texts, **extras}
solids_of_any_kind = st.one_of(
    st.builds(Capsule, name=texts, start=vectors, end=vectors, radius=sizes, **common),
    st.builds(TaperedCapsule, name=texts, start=vectors, end=vectors, start_radius=sizes, end_radius=sizes, **common),
    st.builds(Sphere, name=texts, center=vectors, radius=sizes, **common),
    st.builds(
        Box,
        name=texts,
        center=vectors,
        half_sizes=st.tuples(sizes, sizes, sizes).map(np.array),
        rotation_wxyz=st.floats(0.0, 6.3).map(lambda a: np.array([np.cos(a), 0.6 * np.sin(a), 0.0, 0.8 * np.sin(a)])),
        **common,
    ),
)


def same(a: Shape, b: Shape) -> bool:
    """Whether two solids have the same bits."""
    return type(a) is type(b) and all(
        np.array_equal(getattr(a, label), getattr(b, label)) for label in a.__dataclass_fields__
    )


@settings(max_examples=60, deadline=None)
@given(texts, st.lists(solids_of_any_kind, max_size=4, unique_by=lambda solid: solid.name))
def test_what_is_read_is_what_was_written(tmp_path_factory: pytest.TempPathFactory, robot: str, solids: list):
    path = tmp_path_factory.getbasetemp() / "round_trip.toml"
    Hitboxes(robot, tuple(solids)).save(path)
    back = load_hitboxes(path)
    assert back.robot == robot
    assert len(back.solids) == len(solids)
    assert all(same(a, b) for a, b in zip(solids, back.solids, strict=True))


def test_a_file_tells_a_person_what_it_holds(tmp_path: Path):
    fitted("g1").save(tmp_path / "g1.toml")
    text = (tmp_path / "g1.toml").read_text()
    assert text.startswith("# Hitboxes of a robot")
    assert "metres" in text
    assert "# torso_link, collision geometry: 2.0% of the surface sticks out" in text
    assert tomllib.loads(text)["robot"] == body_of("g1").model.name
    assert [path.name for path in tmp_path.iterdir()] == ["g1.toml"]
    back = load_hitboxes(tmp_path / "g1.toml", body_of("g1"))
    assert all(same(a, b) for a, b in zip(fitted("g1").solids, back.solids, strict=True))


def test_a_file_that_cant_be_written_says_so(tmp_path: Path):
    with pytest.raises(FileError, match="can't write"):
        Hitboxes("g1", ()).save(tmp_path / "nowhere" / "g1.toml")


GOOD = '[[solid]]\nname = "head"\nkind = "sphere"\nbone = "neck"\ncenter = [0, 0, 0.1]\nradius = 0.1\n'


CAPSULE = GOOD.replace("sphere", "capsule").replace("center", "start") + "end = [0, 0, 1]\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("solid = 3", ["tables"]),
        ("robot = 3", ["robot"]),
        ("robot = 'x'\nheight = 1.0", ["height", "available: robot, solid"]),
        ("[[solid]", ["no TOML"]),
        (GOOD.replace('name = "head"\n', ""), ["solid 1", "'name'"]),
        (GOOD.replace('kind = "sphere"\n', ""), ["solid 1 ('head')", "'kind'"]),
        (GOOD.replace('"sphere"', '"ball"'), ["'head'", "'ball'", "capsule, tapered_capsule, sphere, box"]),
        (GOOD.replace('"sphere"', "1"), ["'head'", "kind is a text"]),
        (GOOD.replace("radius", "radus"), ["'head'", "'radus'", "radius"]),
        (GOOD.replace("radius = 0.1", ""), ["'head'", "lacks radius"]),
        (GOOD.replace("radius = 0.1", "radius = -0.1"), ["'head'", "positive"]),
        (GOOD.replace("radius = 0.1", "radius = nan"), ["'head'", "radius is a number"]),
        (GOOD.replace("radius = 0.1", "radius = true"), ["'head'", "radius is a number"]),
        (GOOD.replace("[0, 0, 0.1]", "[0, 0.1]"), ["'head'", "center", "list of 3"]),
        (GOOD.replace("[0, 0, 0.1]", "0.1"), ["'head'", "center", "list of 3"]),
        (GOOD + "friction = -1.0", ["'head'", "friction"]),
        (CAPSULE + "thickness = -1", ["thickness"]),
        (GOOD + GOOD, ["solid 2 ('head')", "already"]),
        (GOOD.replace('"neck"', '"nek"'), ["'head'", "'nek'", "available: neck, spine"]),
        (GOOD.replace("sphere", "box").replace("radius = 0.1", "half_sizes = [1, 1, 0]"), ["'head'", "half_sizes"]),
    ],
)  # fmt: skip
def test_an_error_in_a_file_names_its_table_and_what_there_is(tmp_path: Path, text: str, words: list[str]):
    path = tmp_path / "some.toml"
    path.write_text(text)
    with pytest.raises(FileError) as caught:
        read_solids(path, ("neck", "spine"))
    for word in (str(path), *words):
        assert word in str(caught.value)


def test_a_file_that_isnt_there_or_no_text_is_refused(tmp_path: Path):
    with pytest.raises(FileError, match="No such file"):
        load_hitboxes(tmp_path / "none.toml")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(FileError, match="no TOML"):
        load_hitboxes(tmp_path / "bytes.toml")


def test_a_file_by_hand_may_leave_out_what_has_a_default(tmp_path: Path):
    path = tmp_path / "hand.toml"
    path.write_text(GOOD + '[[solid]]\nname = "plate"\nkind = "box"\ncenter = [0, 0, 1]\nhalf_sizes = [1, 1, 1]\n')
    hitboxes = load_hitboxes(path)
    head, plate = hitboxes.solids
    assert hitboxes.robot == ""
    assert isinstance(head, Sphere)
    assert (head.radius, head.friction, head.thickness) == (0.1, None, None)
    assert isinstance(plate, Box)
    assert plate.bone is None
    assert plate.rotation_wxyz.tolist() == [1.0, 0.0, 0.0, 0.0]


# -- in Pinocchio --

HAND, THIGH = "left_wrist_yaw_joint", "right_hip_yaw_joint"  # bones of g1, 0.3 m and more apart in the poses below
GOLDEN = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(3000)
LEVELS = np.linspace(-1.0, 1.0, 3000)
BALL = np.stack([np.sqrt(1 - LEVELS**2) * np.cos(GOLDEN), np.sqrt(1 - LEVELS**2) * np.sin(GOLDEN), LEVELS], axis=1)
COARSE = 0.001  # m; the nearest of the ball's points is at most 0.05 off, 0.05^2 / 2 of a radius up to 0.1 m and more

PAIRS = {
    "capsules": (
        Capsule("hand", HAND, np.array([0.0, 0.05, 0.0]), np.array([0.1, 0.0, 0.02]), 0.05),
        Capsule("thigh", THIGH, np.array([0.0, 0.0, -0.2]), np.array([0.05, 0.02, 0.1]), 0.07),
    ),
    "tapered capsules": (
        TaperedCapsule(name="hand", bone=HAND, end=np.array([0.1, 0.0, 0.1]), start_radius=0.03, end_radius=0.06),
        TaperedCapsule(name="thigh", bone=THIGH, end=np.array([0.0, 0.1, -0.3]), start_radius=0.1, end_radius=0.05),
    ),
    "sphere and box": (
        Sphere(name="hand", bone=HAND, center=np.array([0.02, 0.0, 0.05]), radius=0.06),
        Box(
            name="thigh",
            bone=THIGH,
            center=np.array([0.0, 0.05, -0.1]),
            half_sizes=np.array([0.04, 0.05, 0.2]),
            rotation_wxyz=np.array([0.8, 0.0, 0.6, 0.0]),
        ),
    ),
    "capsule and cylinder": (
        Capsule("hand", HAND, np.array([0.0, 0.05, 0.0]), np.array([0.1, 0.0, 0.02]), 0.05),
        Cylinder(name="thigh", bone=THIGH, start=np.array([0, 0.05, -0.3]), end=np.array([0.05, 0, 0.1]), radius=0.06),
    ),
    "sphere and ellipsoid": (
        Sphere(name="hand", bone=HAND, center=np.array([0.02, 0.0, 0.05]), radius=0.06),
        Ellipsoid(
            name="thigh",
            bone=THIGH,
            center=np.array([0.0, 0.05, -0.1]),
            radii=np.array([0.06, 0.05, 0.2]),
            rotation_wxyz=np.array([0.8, 0.0, 0.6, 0.0]),
        ),
    ),
    "sphere and plane": (
        Sphere(name="hand", bone=HAND, center=np.array([0.02, 0.0, 0.05]), radius=0.06),
        Plane(name="floor", point=np.array([0.0, 0.0, -1.5]), normal=np.array([0.1, 0.0, 2.0])),
    ),
    "capsule of no length and tapered capsule that is a sphere": (
        Capsule("hand", HAND, np.full(3, 0.02), np.full(3, 0.02), 0.05),
        TaperedCapsule(name="thigh", bone=THIGH, end=np.array([0.0, 0.0, 0.02]), start_radius=0.1, end_radius=0.05),
    ),
    "without a bone": (
        Capsule("hand", HAND, np.zeros(3), np.array([0.1, 0.0, 0.0]), 0.05),
        Sphere(name="post", center=np.array([1.0, 0.5, 0.2]), radius=0.1),
    ),
}


def surface(solid: Shape) -> np.ndarray:
    """Points on and in a round solid, its surface among them, in its bone's frame [m], shape (N, 3)."""
    if isinstance(solid, Sphere):
        return solid.center + solid.radius * BALL
    assert isinstance(solid, Capsule | TaperedCapsule)
    radii = (solid.radius,) * 2 if isinstance(solid, Capsule) else (solid.start_radius, solid.end_radius)
    shares = np.linspace(0.0, 1.0, 41)[:, None, None]
    spheres = (1 - shares) * solid.start + shares * solid.end + ((1 - shares) * radii[0] + shares * radii[1]) * BALL
    return spheres.reshape(-1, 3)


def brute_distance(body: Skeleton, first: Shape, second: Shape, configuration: np.ndarray) -> float:
    """From points on the first solid to the second [m]."""
    track = body.track(configuration[None], fps=1.0)
    points = quaternions.rotate(track.rotations_wxyz[0, track.index(HAND)], surface(first))
    points += track.positions[0, track.index(HAND)]
    if second.bone is not None:
        index = track.index(second.bone)
        back = quaternions.conjugate(track.rotations_wxyz[0, index])
        points = quaternions.rotate(back, points - track.positions[0, index])
    return float(signed_distance(second, points).min())


@pytest.mark.parametrize("pair", PAIRS)
@pytest.mark.parametrize("pose", ["neutral", "any"])
def test_pinocchio_measures_the_distances_that_brute_force_finds(pair: str, pose: str):
    body = body_of("g1")
    configuration = pin.neutral(body.model)
    if pose == "any":
        step = 0.3 * np.sin(np.arange(body.model.nv))
        configuration = pin.integrate(body.model, configuration, step)
    first, second = PAIRS[pair]
    geometry = add_to_geometry_model([first, second], body)
    geometry.addAllCollisionPairs()
    data, geometry_data = body.model.createData(), geometry.createData()
    pin.computeDistances(body.model, data, geometry, geometry_data, configuration)
    distance = geometry_data.distanceResults[0].min_distance
    expected = brute_distance(body, first, second, configuration)
    assert expected > 0.05
    # A tapered capsule is a polyhedron around it, 0.5 % of the larger radius farther out at most.
    slack = sum(0.005 * max(s.start_radius, s.end_radius) for s in (first, second) if isinstance(s, TaperedCapsule))
    assert expected - COARSE - slack <= distance <= expected + ROUNDING
    assert not pin.computeCollisions(body.model, data, geometry, geometry_data, configuration, False)
    larger = [first.grown(distance + 0.002), second]  # which is a round one, that grows as far in all directions
    geometry = add_to_geometry_model(larger, body)
    geometry.addAllCollisionPairs()
    assert pin.computeCollisions(body.model, data, geometry, geometry.createData(), configuration, False)


def test_hitboxes_join_a_geometry_model_that_is_there():
    body, hitboxes = body_of("g1"), fitted("g1")
    geometry = add_to_geometry_model([Sphere(name="ball", radius=0.1)], body)
    assert add_to_geometry_model(hitboxes, body, geometry) is geometry
    assert geometry.ngeoms == 1 + len(hitboxes.solids)
    chest = geometry.geometryObjects[geometry.getGeometryId("chest")]
    assert body.model.names[chest.parentJoint] == body.role("chest")
    solid = named(hitboxes)["chest"]
    assert isinstance(solid, Capsule)
    assert isinstance(chest.geometry, coal.Capsule)
    assert chest.geometry.halfLength == pytest.approx(np.linalg.norm(solid.end - solid.start) / 2, rel=1e-12)
    ends = chest.placement.translation + np.outer([-1, 1], chest.geometry.halfLength * chest.placement.rotation[:, 2])
    assert ends == pytest.approx(np.stack([solid.start, solid.end]), abs=1e-12)


def test_what_doesnt_fit_a_geometry_model_leaves_it_as_it_was():
    body = body_of("g1")
    geometry = add_to_geometry_model([Sphere(name="ball")], body)
    with pytest.raises(ValueRangeError, match="'ball' already"):
        add_to_geometry_model([Sphere(name="other"), Sphere(name="ball")], body, geometry)
    with pytest.raises(UnknownNameError, match="no bone for the hitbox 'other' named 'tail'; available: root_joint"):
        add_to_geometry_model([Sphere(name="more"), Sphere(name="other", bone="tail")], body, geometry)
    assert geometry.ngeoms == 1
