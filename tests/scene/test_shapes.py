"""From colliders to records: every collider has a kind, and is where its fields say, in any pose of its bone.

The kernels also run with the compiler off: NUMBA_DISABLE_JIT=1.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cape import Box, Capsule, Collider, Fabric, Plane, Scene, Sphere
from cape.assembly.contact import Contacts, contacts_of, for_another_thread, link_distances
from cape.kernels.contact.shapes import MOMENT, Colliders, distance_to, place
from cape.kernels.linking import Linker
from motions import quaternions
from skeleton.shapes import SHAPES, TaperedCapsule
from tests.support.scenes import grid_cloth
from tests.support.shapes import (
    FloatArray,
    box_distance,
    capsule_distance,
    kind_of,
    moving,
    record,
    tapered_distance,
    tapered_sizes,
)

ROUNDING = 1e-12  # a few dozen operations on lengths up to 5 m
CLOTH = grid_cloth([0, 0.01, 0.02], [0, 0.01], Fabric())

numbers = st.floats(-1, 1, allow_subnormal=False)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
radii = st.floats(0.01, 1.0)
turns = st.tuples(*(numbers,) * 4).filter(lambda q: np.linalg.norm(q) > 0.1)
rotations = turns.map(lambda q: quaternions.normalize(np.array(q)))

compiling = settings(deadline=None)


def contacts(*colliders: Collider, **settings) -> Contacts:
    """What those colliders are in a scene, with the code of their distances."""
    scene, linker = Scene(CLOTH, colliders=list(colliders), **settings), Linker()
    found = contacts_of(scene, CLOTH, np.ones(CLOTH.vertices, bool))
    if found.colliders is not None:
        link_distances(scene, found.colliders, found.faces, linker)
        linker.link()
    return found


def only(collider: Collider) -> Colliders:
    found = contacts(collider).colliders
    assert found is not None
    return found


def distance_in(found: Colliders, pose: tuple[FloatArray, FloatArray], point: FloatArray) -> tuple[float, FloatArray]:
    """Distance from an only collider, and the normal, in the world, with its bone at a pose."""
    m = moving(np.zeros((1, 3)), place=pose[0][None], matrix=quaternions.to_matrix(pose[1])[None])
    found.clock[MOMENT] += 1
    place(found, 0, m)
    distance, *normal = distance_to(found, 0, *map(float, point))
    return distance, np.array(normal)


# -- kinds --


@pytest.mark.parametrize(
    "arm",
    [Capsule("arm", "a", np.zeros(3), np.ones(3), 0.1), TaperedCapsule(name="arm", bone="a")],
    ids=["capsule", "tapered"],
)
def test_colliders_are_in_the_scene_s_order_each_with_its_own_distance(arm: Collider):
    named = [
        Plane(name="floor", friction=0.7),
        Sphere(name="head", bone="b", thickness=0.02),
        arm,
        Capsule("leg", "a", np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.1),
        Box(name="table"),
        Plane(name="wall", bone="a"),
    ]
    scene = Scene(CLOTH, colliders=named, friction=0.1, thickness=0.003)
    found = contacts(*named, friction=0.1, thickness=0.003).colliders
    assert found is not None
    assert len(found.records) == len(named)
    for collider, row in zip(named, found.records, strict=True):
        assert row.bone == (len(scene.bones) if collider.bone is None else scene.bones.index(collider.bone))
        assert row.friction == (0.7 if collider.name == "floor" else 0.1)
        assert row.thickness == (0.02 if collider.name == "head" else 0.003)
    kinds = [Capsule if type(collider) is Sphere else type(collider) for collider in named]
    assert [kind_of(found, c) for c in range(len(named))] == kinds


def test_every_distance_of_the_registry_has_an_address_of_its_own():
    every = {shape: shape() for shape in SHAPES.values() if shape is not Capsule}
    every[Sphere] = Capsule("", None, np.zeros(3), np.ones(3), 0.1)  # whose distance is a sphere's, too
    made = contacts(*every.values())
    found = made.colliders
    assert found is not None
    assert made.faces is not None
    thin = made.faces.exposed.any(axis=0)
    everything = [*found.records.nearest, *found.records.gaps, *found.records.planes[thin]]
    assert len(set(everything)) == len(everything)
    # A box and a cylinder have edges; code that triangles alone need is not there without any.
    assert thin.any()
    assert not thin.all()
    assert (found.records.planes[~thin] == 0).all()


def test_without_colliders_there_is_nothing():
    found = contacts()
    assert found.colliders is None
    assert found.faces is None
    assert for_another_thread(found) is found


def test_threads_share_notes_of_vertices_and_have_their_own_of_colliders():
    found = contacts(Sphere(), Box(), Plane())
    other = for_another_thread(found)
    one, two = found.colliders, other.colliders
    assert one is not None
    assert two is not None
    own = {name for name in one._fields if getattr(one, name) is not getattr(two, name)}
    # What is indexed by collider alone, or is room for a tile at work; of the rest a thread has its own rows.
    assert own == {"records", "clock", "active", "hot", "points", "touches", "before"}


# -- layouts --


def rotated(rotation: FloatArray, v: FloatArray) -> FloatArray:
    return quaternions.rotate(rotation, v)


@compiling
@given(vectors, rotations, vectors, st.tuples(vectors, vectors), radii)
def test_a_capsule_is_where_its_fields_say(position, rotation, point, ends, radius):
    capsule = Capsule("limb", "bone", ends[0], ends[1], radius)
    distance, normal = distance_in(only(capsule), (position, rotation), point)
    start, end = (position + rotated(rotation, p) for p in ends)
    assert distance == pytest.approx(capsule_distance(point[None], start, end, radius)[0], abs=3 * ROUNDING)
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=ROUNDING)


@compiling
@given(vectors, rotations, vectors, vectors, radii)
def test_a_sphere_is_where_its_fields_say(position, rotation, point, center, radius):
    sphere = Sphere(bone="bone", center=center, radius=radius)
    distance, normal = distance_in(only(sphere), (position, rotation), point)
    off = point - position - rotated(rotation, center)
    assert distance == pytest.approx(np.linalg.norm(off) - radius, abs=ROUNDING)
    if np.linalg.norm(off) > 1e-3:
        np.testing.assert_allclose(normal, off / np.linalg.norm(off), atol=1e-9)


@compiling
@given(vectors, rotations, vectors, st.tuples(vectors, vectors), st.tuples(radii, radii))
def test_a_tapered_capsule_is_where_its_fields_say(position, rotation, point, ends, both):
    start, end = (position + rotated(rotation, p) for p in ends)
    shape = TaperedCapsule(bone="bone", start=ends[0], end=ends[1], start_radius=both[0], end_radius=both[1])
    distance, normal = distance_in(only(shape), (position, rotation), point)
    # Where one sphere nearly holds the other the axis is nearly parallel to the surface's normal: as the root of 2^-53.
    expected = tapered_distance(point[None], start, end, both)[0]
    assert distance == pytest.approx(expected, abs=1e-7)
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(
    ("start", "end", "both", "center", "radius"),
    [
        ((0, 0, 0), (0.1, 0, 0), (0.3, 0.1), (0, 0, 0), 0.3),
        ((0, 0, 0), (0.1, 0, 0), (0.1, 0.3), (0.1, 0, 0), 0.3),
        ((0, 0, 0), (0.25, 0, 0), (0.5, 0.25), (0, 0, 0), 0.5),
        ((0.1, 0.2, 0), (0.1, 0.2, 0), (0.2, 0.2), (0.1, 0.2, 0), 0.2),
        ((0.1, 0.2, 0), (0.1, 0.2, 0), (0.1, 0.2), (0.1, 0.2, 0), 0.2),
    ],
    ids=["the end inside", "the start inside", "touching from within", "no length", "no length, two radii"],
)
def test_where_one_sphere_holds_the_other_there_is_a_sphere(start, end, both, center, radius):
    shape = TaperedCapsule(start=np.array(start), end=np.array(end), start_radius=both[0], end_radius=both[1])
    found = only(shape)
    for point in np.random.default_rng(3).uniform(-1, 1, (20, 3)):
        off = point - np.array(center)
        distance, normal = distance_in(found, (np.zeros(3), np.array([1.0, 0, 0, 0])), point)
        assert distance == pytest.approx(np.linalg.norm(off) - radius, abs=ROUNDING)
        np.testing.assert_allclose(normal, off / np.linalg.norm(off), atol=1e-9)
    assert found.records.core[0] == radius


def test_a_tapered_capsule_with_equal_radii_is_a_capsule():
    ends = np.array([0.1, 0.2, 0.3]), np.array([-0.4, 0.5, 0.1])
    tapered = only(TaperedCapsule(start=ends[0], end=ends[1], start_radius=0.2, end_radius=0.2))
    capsule = only(Capsule("", None, *ends, 0.2))
    for point in np.random.default_rng(3).uniform(-1, 1, (20, 3)):
        one, two = (distance_in(g, (np.zeros(3), np.array([1.0, 0, 0, 0])), point) for g in (tapered, capsule))
        assert one[0] == pytest.approx(two[0], abs=ROUNDING)
        np.testing.assert_allclose(one[1], two[1], atol=ROUNDING)


@compiling
@given(vectors, rotations, vectors, vectors, rotations, st.tuples(radii, radii, radii).map(np.array))
def test_a_box_is_where_its_fields_say(position, rotation, point, center, own, halves):
    box = Box(bone="bone", center=center, half_sizes=halves, rotation_wxyz=own)
    distance, normal = distance_in(only(box), (position, rotation), point)
    in_bone = rotated(quaternions.conjugate(rotation), point - position)
    in_box = rotated(quaternions.conjugate(own), in_bone - center)
    assert distance == pytest.approx(box_distance(in_box[None], halves)[0], abs=ROUNDING)
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=ROUNDING)


@compiling
@given(vectors, rotations, vectors, vectors, vectors.filter(lambda n: np.linalg.norm(n) > 0.1))
def test_a_plane_is_where_its_fields_say(position, rotation, point, through, across):
    plane = Plane(bone="bone", point=through, normal=across)
    distance, normal = distance_in(only(plane), (position, rotation), point)
    n = rotated(rotation, across / np.linalg.norm(across))
    assert distance == pytest.approx(n @ (point - position - rotated(rotation, through)), abs=ROUNDING)
    np.testing.assert_allclose(normal, n, atol=ROUNDING)


@pytest.mark.parametrize(
    ("collider", "core"),
    [
        (Capsule("", None, np.zeros(3), np.ones(3), 0.1), 0.1),
        (Sphere(radius=0.3), 0.3),
        (TaperedCapsule(start_radius=0.2, end_radius=0.1), 0.1),
        (TaperedCapsule(start_radius=0.1, end_radius=0.2), 0.1),
        (Box(half_sizes=np.array([0.3, 0.1, 0.2])), 0.1),
        (Plane(), np.inf),
    ],
    ids=["capsule", "sphere", "tapered capsule", "tapered capsule, thin first", "box", "plane"],
)
def test_the_core_is_the_least_way_to_the_middle(collider: Collider, core: float):
    assert only(collider).records.core[0] == core


# -- poses --


def test_normals_are_gradients_in_the_world():
    rng, step = np.random.default_rng(5), 1e-6
    for shape in (
        Capsule("", "b", np.array([0.1, 0, 0]), np.array([0, 0.4, 0.3]), 0.2),
        TaperedCapsule(bone="b", start=np.array([0.1, 0, 0]), end=np.array([0, 0.4, 0.3])),
        Box(bone="b", half_sizes=np.array([0.3, 0.2, 0.1]), rotation_wxyz=np.array([0.6, 0.0, 0.8, 0.0])),
    ):
        found = only(shape)
        for point in rng.uniform(1.0, 1.5, (10, 3)):
            pose = rng.standard_normal(3) * 0.2, quaternions.normalize(rng.standard_normal(4))
            _, normal = distance_in(found, pose, point)
            gradient = [
                (distance_in(found, pose, point + e)[0] - distance_in(found, pose, point - e)[0]) / (2 * step)
                for e in step * np.eye(3)
            ]
            # Curvature is at most 1 / 0.5 m out here.
            np.testing.assert_allclose(gradient, normal, atol=2 * step + 1e-8)


def test_a_collider_is_placed_once_a_moment():
    found = record(TaperedCapsule, tapered_sizes(0.5, 0.2, 0.1), thickness=0.01)
    one, two = (moving(np.zeros((1, 3)), place=[[x, 0.0, 0.0]]) for x in (1.0, 2.0))
    found.clock[MOMENT] = 1
    place(found, 0, one)
    place(found, 0, two)
    assert found.records.placed[0, 9] == 1.0
    found.clock[MOMENT] = 2
    place(found, 0, two)
    assert found.records.placed[0, 9] == 2.0
