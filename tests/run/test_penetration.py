"""The judge of contact: depths of vertices and faces, and what passed through, against closed forms and brute force."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from cape import Box, Capsule, Cylinder, Ellipsoid, Plane, Sphere, TaperedCapsule
from cape.results.penetration import crossings, penetration
from cape.results.solid_cores import core
from motions import quaternions
from motions.errors import ValueRangeError
from skeleton.solid_measures import signed_distance
from tests.support.figures import matrices_of
from tests.support.shapes import (
    box_distance,
    capsule_distance,
    cylinder_distance,
    ellipsoid_distance,
    least_on_triangle,
)
from tests.support.takes import take_of

FloatArray = NDArray[np.float64]

SPACING = 0.002  # m
SINGLE = 1e-7  # m, a rounding of positions below 1 m in single precision
APART = SPACING / np.sqrt(3)  # m that a point of a face is from a sample at most

numbers = st.floats(-0.5, 0.5).map(lambda x: round(x, 9))  # no shorter length than a nanometre but zero
points = st.tuples(numbers, numbers, numbers).map(np.array)
sizes = st.floats(0.02, 0.4)
turns = st.tuples(*(st.floats(-1, 1),) * 4).filter(lambda q: np.linalg.norm(q) > 0.1).map(np.array)


def cone_of(start: FloatArray, end: FloatArray, start_radius: float, end_radius: float) -> TaperedCapsule:
    return TaperedCapsule(start=start, end=end, start_radius=start_radius, end_radius=end_radius)


def cone_distance(at: FloatArray, cone: TaperedCapsule) -> FloatArray:
    """To the nearest of all spheres between the two, found by halving: the distance is convex along the axis."""
    axis = cone.end - cone.start

    def from_sphere(share: FloatArray) -> FloatArray:
        radius = cone.start_radius + share * (cone.end_radius - cone.start_radius)
        return np.linalg.norm(at - cone.start - share[:, None] * axis, axis=1) - radius

    low, high = np.zeros(len(at)), np.ones(len(at))
    for _ in range(80):
        first, second = (2 * low + high) / 3, (low + 2 * high) / 3
        falls = from_sphere(first) > from_sphere(second)
        low, high = np.where(falls, first, low), np.where(falls, high, second)
    return np.min([from_sphere(share) for share in (low, high, 0 * low, 0 * low + 1)], axis=0)


# -- distances --


@given(points, points, points, sizes, sizes)
def test_distance_from_a_tapered_capsule(p: FloatArray, a: FloatArray, b: FloatArray, first: float, last: float):
    cone = cone_of(a, b, first, last)
    assert signed_distance(cone, p[None])[0] == pytest.approx(cone_distance(p[None], cone)[0], abs=1e-9)


SINE = 0.25  # of the lean of the surface between spheres of 0.5 and 0.25 m, 1 m apart
NORMAL = np.array([SINE, np.sqrt(1 - SINE**2), 0.0])


@pytest.mark.parametrize(
    ("point", "distance"),
    [
        ([0.5, 0.0, 0.0] + (0.375 + 0.3) * NORMAL, 0.3),
        ([0.5, 0.0, 0.0] + 0.1 * NORMAL, 0.1 - 0.375),
        ([0.9, 0.0, 0.0] - (0.275 + 0.2) * NORMAL * [-1, 1, 1], 0.2),
        ([-1.0, 0.0, 0.0], 0.5),
        ([1.3, 0.0, 0.0], 0.05),
        ([0.0, 0.0, 0.0], -0.5),
        ([1.0, 0.0, 0.0], -0.25),
        ([0.0, 0.0, 0.6], 0.1),
        ([-0.1, 0.0, 0.0], -0.4),
        ([0.5, 0.0, 0.0], -0.375),
    ],
    ids=[
        "beside", "inside beside the axis", "on the other side", "before the thick end", "beyond the thin end",
        "thick centre", "thin centre", "where the thick sphere begins", "inside the thick cap", "on the axis",
    ],
)  # fmt: skip
def test_a_tapered_capsule_case_by_case(point, distance: float):
    cone = cone_of(np.zeros(3), np.array([1.0, 0.0, 0.0]), 0.5, 0.25)
    back = cone_of(np.array([1.0, 0.0, 0.0]), np.zeros(3), 0.25, 0.5)
    for solid in (cone, back):
        assert signed_distance(solid, np.array([point]))[0] == pytest.approx(distance, abs=1e-12)


def test_of_two_spheres_one_in_the_other_the_larger_counts():
    for a, b, first, last in ((0.0, 0.1, 0.5, 0.2), (0.1, 0.0, 0.2, 0.5), (0.0, 0.0, 0.5, 0.5), (0.0, 0.3, 0.5, 0.2)):
        cone = cone_of(np.array([0.0, 0.0, a]), np.array([0.0, 0.0, b]), first, last)
        assert signed_distance(cone, np.array([[0.0, 2.0, 0.0]]))[0] == pytest.approx(1.5, abs=1e-12)


@given(points, points, points, sizes, st.tuples(sizes, sizes, sizes).map(np.array), turns)
def test_distances_equal_the_references(p, a, b, radius: float, halves, turn):
    assert signed_distance(Capsule("c", None, a, b, radius), p[None])[0] == pytest.approx(
        capsule_distance(p[None], a, b, radius)[0], abs=1e-12
    )
    assert signed_distance(Sphere(center=a, radius=radius), p[None])[0] == pytest.approx(
        np.linalg.norm(p - a) - radius, abs=1e-12
    )
    turn = turn / np.linalg.norm(turn)
    box = Box(center=a, half_sizes=halves, rotation_wxyz=turn)
    inside = (p - a)[None] @ matrices_of(turn)
    assert signed_distance(box, p[None])[0] == pytest.approx(box_distance(inside, halves)[0], abs=1e-12)
    if np.linalg.norm(b) > 1e-3:
        plane = Plane(point=a, normal=b)
        assert signed_distance(plane, p[None])[0] == pytest.approx((p - a) @ b / np.linalg.norm(b), abs=1e-12)


# -- depths in closed form --

RADIUS, DEPTH = 0.1, 0.03  # m
# A large triangle around the z axis, its corners far outside of all shapes below.
WIDE = np.array([[0.5, -0.03, 0.0], [-0.4, 0.45, 0.0], [-0.3, -0.5, 0.0]])


def raised(height: float) -> FloatArray:
    return WIDE + np.array([0.0, 0.0, height])


CONE = cone_of(np.array([-0.2, 0.0, 0.0]), np.array([0.2, 0.0, 0.0]), 0.12, 0.08)
LEAN = np.arcsin(0.04 / 0.4)  # of the cone's surface
# Where the radius of curvature is r, a sample that is `APART` from the deepest point is too shallow by this.
CURVED = APART**2 / (2 * (RADIUS - DEPTH))

CASES = {
    "sphere": (Sphere(radius=RADIUS), raised(RADIUS - DEPTH), DEPTH, CURVED),
    "sphere's middle": (Sphere(radius=RADIUS), WIDE, RADIUS, APART),
    "capsule, along": (
        Capsule("c", None, np.array([-0.1, 0, 0]), np.array([0.1, 0, 0]), RADIUS),
        raised(RADIUS - DEPTH), DEPTH, CURVED,
    ),
    "capsule, across": (
        Capsule("c", None, np.array([0, 0, -0.3]), np.array([0, 0, 0.3]), RADIUS), WIDE, RADIUS, APART,
    ),
    "capsule, cap": (
        Capsule("c", None, np.array([0, 0, -0.3]), np.array([0, 0, 0]), RADIUS),
        raised(RADIUS - DEPTH), DEPTH, CURVED,
    ),
    "box": (Box(half_sizes=np.array([0.2, 0.1, 0.1])), raised(0.1 - DEPTH), DEPTH, 0.0),
    "turned box": (
        Box(half_sizes=np.full(3, 0.1), rotation_wxyz=np.array([np.cos(np.pi / 8), np.sin(np.pi / 8), 0, 0])),
        # Cut off an edge on top at 0.1 sqrt(2): the middle of the cut is deepest, at its depth over sqrt(2).
        raised(np.sqrt(2) * 0.1 - DEPTH), DEPTH / np.sqrt(2), APART / np.sqrt(2),
    ),
    "cylinder, lying": (
        Cylinder(start=np.array([-0.2, 0, 0]), end=np.array([0.2, 0, 0]), radius=RADIUS),
        raised(RADIUS - DEPTH), DEPTH, CURVED,
    ),
    "cylinder, standing": (
        Cylinder(start=np.array([0, 0, -0.3]), end=np.array([0, 0, 0.1]), radius=0.1), raised(0.1 - DEPTH), DEPTH, 0.0,
    ),
    # The triangle goes through the middle, from where its depth falls with the way.
    "cylinder's middle": (Cylinder(start=np.array([0, 0, -0.3]), end=np.array([0, 0, 0.3])), WIDE, RADIUS, APART),
    "ellipsoid": (Ellipsoid(radii=np.array([0.15, 0.12, 0.1])), raised(0.1 - DEPTH), DEPTH, CURVED),
    "turned ellipsoid": (
        Ellipsoid(
            radii=np.array([0.1, 0.15, 0.12]), rotation_wxyz=np.array([np.sqrt(0.5), 0, -np.sqrt(0.5), 0])
        ),  # its x axis is up
        raised(0.1 - DEPTH), DEPTH, CURVED,
    ),
    "plane": (Plane(normal=np.array([0, 0, 7.0])), WIDE + np.array([[0, 0, 0.01], [0, 0, 0.02], [0, 0, -DEPTH]]),
              DEPTH, 0.0),
    "tapered capsule": (
        CONE,
        # At the middle the surface lies 0.1 / cos off the axis, and leans with x towards the thin end.
        WIDE @ np.array([[np.cos(LEAN), 0, -np.sin(LEAN)], [0, 1, 0], [np.sin(LEAN), 0, np.cos(LEAN)]])
        + [0, 0, (RADIUS - DEPTH) / np.cos(LEAN)], DEPTH, CURVED,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("carried", [False, True], ids=["in the world", "on a bone"])
def test_depth_of_a_face_in_closed_form(name: str, carried: bool):
    solid, corners, depth, error = CASES[name]
    poses = {}
    if carried:
        place, turn = np.array([0.3, -0.2, 0.4]), quaternions.normalize(np.array([0.4, -0.3, 0.7, 0.2]))
        corners = corners @ matrices_of(turn).T + place
        poses["bone"] = (place, turn)
        solid = replace(solid, bone="bone")
    measured = penetration(take_of(corners, [0, 1, 2], [solid], poses=poses), spacing=SPACING)
    assert depth - error - SINGLE <= measured.faces.depth[0] <= depth + SINGLE
    assert (measured.faces.collider[0], measured.faces.index[0]) == (0, 0)
    if name != "plane":
        assert measured.vertices.depth[0] == 0.0
        assert (measured.vertices.collider[0], measured.vertices.index[0]) == (-1, -1)


def test_depth_of_a_vertex_is_that_of_its_faces_too():
    corners = [[0.0, 0.0, 0.06], [0.3, 0.0, 0.2], [0.0, 0.3, 0.2]]
    measured = penetration(take_of(corners, [0, 1, 2], [Sphere(radius=RADIUS)]))
    assert measured.vertices.depth[0] == pytest.approx(0.04, abs=SINGLE)
    assert (measured.vertices.collider[0], measured.vertices.index[0]) == (0, 0)
    assert measured.faces.depth[0] >= measured.vertices.depth[0]


# -- brute force --

corners_of = st.tuples(points, points, points).map(np.stack)


def reference_depth(solid, at: FloatArray) -> FloatArray:
    """Depths of points in the world in a solid that stands in it."""
    if isinstance(solid, Sphere):
        return solid.radius - np.linalg.norm(at - solid.center, axis=1)
    if isinstance(solid, Capsule):
        return -capsule_distance(at, solid.start, solid.end, solid.radius)
    if isinstance(solid, Box):
        return -box_distance((at - solid.center) @ matrices_of(solid.rotation_wxyz), solid.half_sizes)
    if isinstance(solid, TaperedCapsule):
        return -cone_distance(at, solid)
    if isinstance(solid, Cylinder):
        up = quaternions.from_z_axis(solid.end - solid.start)
        own = (at - (solid.start + solid.end) / 2) @ matrices_of(up)
        return -cylinder_distance(own, float(np.linalg.norm(solid.end - solid.start)) / 2, solid.radius)
    if isinstance(solid, Ellipsoid):
        return -ellipsoid_distance((at - solid.center) @ matrices_of(solid.rotation_wxyz), solid.radii)
    return (solid.point - at) @ solid.normal / np.linalg.norm(solid.normal)


def some_solid(kind: int, a: FloatArray, b: FloatArray, first: float, last: float, turn: FloatArray):
    turn = turn / np.linalg.norm(turn)
    return (
        Sphere(center=a, radius=first),
        Capsule("capsule", None, a, b, first),
        Box(center=a, half_sizes=np.array([first, last, first]), rotation_wxyz=turn),
        Plane(point=a, normal=matrices_of(turn)[0]),
        cone_of(a, b, first, last),
        Cylinder(start=a, end=a + last * matrices_of(turn)[0], radius=first),
        Ellipsoid(center=a, radii=np.array([first, last, 0.7 * first]), rotation_wxyz=turn),
    )[kind]


solids_of_any_kind = st.builds(some_solid, st.integers(0, 6), points, points, sizes, sizes, turns)


@settings(max_examples=60, deadline=None)
@given(corners_of, solids_of_any_kind)
def test_no_point_of_a_face_is_deeper_than_the_samples_tell(corners: FloatArray, solid):
    spacing = 0.05
    corners = corners.astype(np.float32).astype(float)
    measured = penetration(take_of(corners, [0, 1, 2], [solid]), spacing=spacing).faces.depth[0]
    depth = max(0.0, -least_on_triangle(lambda where: -reference_depth(solid, where), corners))
    # The reference's last grid has a step of 1 in 10,000 of the edges, of up to two metres.
    assert depth - spacing / np.sqrt(3) - 1e-6 <= measured <= depth + 2e-4


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31), st.lists(solids_of_any_kind, min_size=1, max_size=4))
def test_of_many_faces_and_solids_none_is_missed(seed: int, some: list):
    random = np.random.default_rng(seed)
    vertices = random.uniform(-0.5, 0.5, (30, 3)).astype(np.float32).astype(float)
    starts = vertices[random.integers(0, 30, 12)]
    corners = np.concatenate([starts[:, None], starts[:, None] + random.normal(0, 0.05, (12, 2, 3))], axis=1)
    corners = corners.astype(np.float32).astype(float)
    measured = penetration(take_of(corners.reshape(-1, 3), np.arange(36), some), spacing=0.01)
    alone = np.array([
        [penetration(take_of(triangle, [0, 1, 2], [solid]), spacing=0.01).faces.depth[0] for solid in some]
        for triangle in corners
    ])  # fmt: skip
    assert measured.faces.depth[0] == alone.max()
    if alone.max() > 0.0:
        assert alone[measured.faces.index[0], measured.faces.collider[0]] == alone.max()
    depths = np.stack([reference_depth(solid, corners.reshape(-1, 3)) for solid in some])
    assert measured.vertices.depth[0] == pytest.approx(max(0.0, depths.max()), abs=1e-6)


def test_memory_is_bounded_and_the_result_the_same(monkeypatch: pytest.MonkeyPatch):
    random = np.random.default_rng(0)
    corners = random.uniform(-0.3, 0.3, (40, 3, 3))
    take = take_of(corners.reshape(-1, 3), np.arange(120), [Sphere(radius=0.2)])
    whole = penetration(take, spacing=0.01).faces
    monkeypatch.setattr("cape.results.penetration.MOST_SAMPLES", 1)
    assert penetration(take, spacing=0.01).faces.depth == whole.depth
    assert penetration(take, spacing=0.01).faces.index == whole.index


# -- what is asked for --


def test_of_several_frames_each_has_its_own():
    fall = WIDE + np.array([0, 0, 1.0]) * np.array([0.3, 0.09, 0.05])[:, None, None]
    take = take_of(fall, [0, 1, 2], [Sphere(name="far", center=np.full(3, 9.0)), Sphere(radius=RADIUS)])
    measured = penetration(take)
    np.testing.assert_allclose(measured.faces.depth, [0.0, 0.01, 0.05], atol=CURVED + SINGLE)
    np.testing.assert_array_equal(measured.faces.collider, [-1, 1, 1])
    some = penetration(take, frames=[2, 0])
    np.testing.assert_array_equal(some.frames, [2, 0])
    np.testing.assert_array_equal(some.faces.depth, measured.faces.depth[[2, 0]])


def test_a_solid_is_where_its_bone_is_in_each_frame():
    still = np.tile([1.0, 0, 0, 0], (2, 1))
    poses = {"hand": ([[0, 0, -1.0], [0, 0, 0]], still), "foot": ([[0, 0, 0.05], [0, 0, 1.0]], still)}
    solids = [Sphere(name=bone, bone=bone, radius=RADIUS) for bone in poses]
    measured = penetration(take_of([WIDE, WIDE], [0, 1, 2], solids, poses=poses))
    np.testing.assert_allclose(measured.faces.depth, [0.05, RADIUS], atol=APART)
    np.testing.assert_array_equal(measured.faces.collider, [1, 0])


def test_what_does_not_count_is_left_out():
    corners = np.array([[0, 0, 0.05], [1, 0, 1], [0, 1, 1], [0, 0, 0.08], [1, 0, 1], [0, 1, 1.0]])
    take = take_of(corners, [[0, 1, 2], [3, 4, 5]], [Sphere(radius=RADIUS)])
    assert penetration(take).vertices.depth[0] == pytest.approx(0.05, abs=SINGLE)
    counted = np.array([False, True, True, True, True, True])
    free = penetration(take, counted=counted)
    assert free.vertices.depth[0] == pytest.approx(0.02, abs=SINGLE)
    assert (free.vertices.index[0], free.faces.index[0]) == (3, 1)


def test_a_margin_grows_the_solids():
    take = take_of(raised(0.104), [0, 1, 2], [Sphere(radius=RADIUS), Plane(normal=np.array([0.0, 0.0, 1.0]))])
    assert penetration(take).faces.depth[0] == 0.0
    assert penetration(take, margin=0.005).faces.depth[0] == pytest.approx(0.001, abs=CURVED + SINGLE)


@pytest.mark.parametrize(
    "options", [{"spacing": 0.0}, {"margin": -1.0}, {"frames": [3]}, {"frames": [0.5]}, {"counted": [1, 1, 1]}]
)
def test_nonsense_is_refused(options: dict):
    with pytest.raises(ValueRangeError):
        penetration(take_of(WIDE, [0, 1, 2], []), **options)


# -- passing through --

LIMB = Capsule("limb", "arm", np.array([0, -0.5, 0]), np.array([0, 0.5, 0]), 0.05)
SHAPES = {
    "capsule": LIMB,
    "sphere": Sphere(name="ball", bone="arm", radius=0.05),
    "box": Box(name="plate", bone="arm", half_sizes=np.array([0.05, 0.4, 0.4])),
    "tapered capsule": replace(cone_of(np.array([0, -0.5, 0]), np.array([0, 0.5, 0]), 0.06, 0.04), bone="arm"),
}


def swept(solid, way: FloatArray, vertices: FloatArray, turn: FloatArray | None = None) -> list[int]:
    """Crossings in each frame while the bone `arm` is led along places (F, 3) through vertices (V, 3) that stand."""
    turn = np.tile([1.0, 0, 0, 0], (len(way), 1)) if turn is None else turn
    take = take_of(np.tile(vertices, (len(way), 1, 1)), [0, 1, 2], [solid], poses={"arm": (way, turn)})
    return crossings(take)[:, 0].tolist()


@pytest.mark.parametrize("shape", SHAPES)
def test_what_a_fast_limb_leaves_behind_is_counted_once(shape: str):
    # One vertex in the middle, one 6 mm beside what is left of a radius of 5 cm, one far off.
    vertices = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.011], [0.0, 0.0, 0.9]])
    hit = 2 if shape == "box" else 1
    jump = np.array([[-0.5, 0, 0], [-0.3, 0, 0], [0.4, 0, 0], [0.9, 0, 0]])
    assert swept(SHAPES[shape], jump, vertices) == [0, 0, hit, 0]
    slow = np.stack([np.linspace(-0.0801, 0.0799, 17), np.zeros(17), np.zeros(17)], axis=1)
    assert sum(swept(SHAPES[shape], slow, vertices)) == hit


def test_what_moves_with_a_limb_or_stops_short_of_its_core_did_not_pass():
    way = np.array([[0.0, 0, 0], [1.0, 0, 0]])
    vertices = np.array([[0.02, 0, 0], [0, 0, 0.5], [0, 0, 0.6]])
    take = take_of(np.stack([vertices, vertices + way[1]]), [0, 1, 2], [LIMB],
                   poses={"arm": (way, np.tile([1.0, 0, 0, 0], (2, 1)))})  # fmt: skip
    assert crossings(take).sum() == 0
    # From 0.1 m in front to 4 cm deep, 1 cm from the axis; and another one to 0.4 cm from it.
    assert swept(LIMB, np.array([[0.0, 0, 0], [0.09, 0, 0]]), np.array([[0.1, 0, 0], [0, 0, 1], [0, 1, 1.0]])) == [0, 0]
    assert swept(LIMB, np.array([[0.0, 0, 0], [0.096, 0, 0]]), np.array([[0.1, 0, 0], [0, 0, 1], [0, 1, 1.0]])) == [
        0, 1,
    ]  # fmt: skip


def test_a_turning_limb_passes_what_it_sweeps():
    # By 60 degrees about z: from along y to past a vertex that lies at 30 degrees.
    turn = quaternions.from_rotation_vector(np.array([[0, 0, 0.0], [0, 0, -np.pi / 3]]))
    vertices = np.array([[0.2, 0.2 * np.sqrt(3), 0.0], [0.0, 0.0, 0.3], [-0.2, 0.2 * np.sqrt(3), 0.0]])
    assert swept(LIMB, np.zeros((2, 3)), vertices, turn) == [0, 1]


def test_a_core_is_a_tenth_and_a_half_space_has_none():
    assert core(Plane()) is None
    box = core(SHAPES["box"])
    assert isinstance(box, Box)
    np.testing.assert_allclose(box.half_sizes, [0.005, 0.355, 0.355])
    disc = core(Cylinder(end=np.array([0.0, 0.0, 0.2]), radius=0.3))
    assert isinstance(disc, Cylinder)
    np.testing.assert_allclose([*disc.start, *disc.end, disc.radius], [0, 0, 0.09, 0, 0, 0.11, 0.21], atol=1e-15)
    lens = core(Ellipsoid(radii=np.array([0.3, 0.2, 0.1])))
    assert isinstance(lens, Ellipsoid)
    np.testing.assert_allclose(lens.radii, [0.03, 0.02, 0.01])
    fall = np.stack([raised(1.0), raised(-1.0)])
    assert crossings(take_of(fall, [0, 1, 2], [Plane()])).sum() == 0


def test_crossings_of_what_counts_in_the_frames_asked_for():
    fall = np.stack([WIDE * 0 + [0, 0, 1.0], WIDE * 0 - [0, 0, 1.0]])
    take = take_of(fall, [0, 1, 2], [Sphere(radius=RADIUS)])
    np.testing.assert_array_equal(crossings(take), [[0], [3]])
    np.testing.assert_array_equal(crossings(take, frames=1, counted=np.array([True, False, True])), [[2]])
