"""From colliders to records: every collider has a kind, and is where its fields say, in any pose of its bone.

The kernels also run with the compiler off: NUMBA_DISABLE_JIT=1.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import grid_cloth
from shapes import FloatArray, box_distance, capsule_distance, moving, record, tapered_distance, tapered_sizes

from cape import Box, Capsule, Collider, Fabric, Plane, Scene, Sphere
from cape.colliders import TaperedCapsule
from cape.contact import KINDS, contacts_of, for_another_thread
from cape.kernels.shapes import DISTANCES, MOMENT, Boxes, Capsules, Planes, Shapes, TaperedCapsules, distance_to, place
from motions import quaternions
from skeleton.shapes import SHAPES

ROUNDING = 1e-12  # a few dozen operations on lengths up to 5 m
CLOTH = grid_cloth([0, 0.01, 0.02], [0, 0.01], Fabric())

numbers = st.floats(-1, 1, allow_subnormal=False)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
radii = st.floats(0.01, 1.0)
turns = st.tuples(*(numbers,) * 4).filter(lambda q: np.linalg.norm(q) > 0.1)
rotations = turns.map(lambda q: quaternions.normalize(np.array(q)))

compiling = settings(deadline=None)


def contacts(*colliders: Collider, threads: int = 1, **settings):
    """Records of colliders, and their order."""
    return contacts_of(Scene(CLOTH, colliders=list(colliders), **settings), CLOTH, np.ones(CLOTH.vertices, bool))


def only_group(collider: Collider) -> Shapes:
    (group,) = list(contacts(collider)[0].groups or ())
    return group


def distance_in(group: Shapes, pose: tuple[FloatArray, FloatArray], point: FloatArray) -> tuple[float, FloatArray]:
    """Distance from the only collider of a group, and the normal, in the world, with its bone at a pose."""
    m = moving(np.zeros((1, 3)), place=pose[0][None], matrix=quaternions.to_matrix(pose[1])[None])
    group.clock[MOMENT] += 1
    place(group, 0, m.positions, m.matrices)
    distance, *normal = distance_to(group, 0, *map(float, point))
    return distance, np.array(normal)


# -- kinds --


def test_every_collider_has_one_kind_and_every_kind_a_distance():
    registered = [collider for kind in KINDS.values() for collider in kind]
    assert len(registered) == len(set(registered))
    assert set(registered) == set(SHAPES.values())
    assert set(KINDS) == set(DISTANCES) == set(Shapes.__subclasses__())


@pytest.mark.parametrize(
    ("arm", "kinds", "grouped"),
    [
        (Capsule("arm", "a", np.zeros(3), np.ones(3), 0.1), [Capsules, Boxes, Planes], ([1, 2, 3], [4], [0, 5])),
        # What is round is of one kind, so that it is seen to pinch what is between.
        (TaperedCapsule(name="arm", bone="a"), [TaperedCapsules, Boxes, Planes], ([1, 2, 3], [4], [0, 5])),
    ],
    ids=["capsule", "tapered"],
)
def test_colliders_are_grouped_by_kind_and_told_apart(arm, kinds, grouped):
    named = [
        Plane(name="floor", friction=0.7),
        Sphere(name="head", bone="b", thickness=0.02),
        arm,
        Capsule("leg", "a", np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.1),
        Box(name="table"),
        Plane(name="wall", bone="a"),
    ]
    scene = Scene(CLOTH, colliders=named, friction=0.1, thickness=0.003)
    groups, order = contacts(*named, friction=0.1, thickness=0.003)
    assert groups.groups is not None
    assert [type(g) for g in groups.groups] == kinds
    assert order == grouped
    for group, indices in zip(groups.groups, order, strict=True):
        for c, index in enumerate(indices):
            collider = named[index]
            bone = len(scene.bones) if collider.bone is None else scene.bones.index(collider.bone)
            assert group.colliders.bone[c] == bone
            assert group.colliders.friction[c] == (0.7 if collider.name == "floor" else 0.1)
            assert group.colliders.thickness[c] == (0.02 if collider.name == "head" else 0.003)


def test_without_colliders_there_is_nothing():
    found, order = contacts()
    assert found.groups is None
    assert found.faces is None
    assert order == ()
    assert for_another_thread(found) is found


def test_threads_share_notes_of_vertices_and_have_their_own_of_colliders():
    found, _ = contacts(Sphere(), Box(), Plane())
    other = for_another_thread(found)
    assert found.groups is not None
    assert other.groups is not None
    for one, two in zip(found.groups, other.groups, strict=True):
        assert type(one) is type(two)
        own = {name for name in one._fields if getattr(one, name) is not getattr(two, name)}
        # What is indexed by collider alone, or is room for a tile at work; of the rest a thread has its own rows.
        assert own == {"colliders", "clock", "active", "hot", "gaps", "touches", "before"}


# -- layouts --


def rotated(rotation: FloatArray, v: FloatArray) -> FloatArray:
    return quaternions.rotate(rotation, v)


@compiling
@given(vectors, rotations, vectors, st.tuples(vectors, vectors), radii)
def test_a_capsule_is_where_its_fields_say(position, rotation, point, ends, radius):
    capsule = Capsule("limb", "bone", ends[0], ends[1], radius)
    distance, normal = distance_in(only_group(capsule), (position, rotation), point)
    start, end = (position + rotated(rotation, p) for p in ends)
    assert distance == pytest.approx(capsule_distance(point[None], start, end, radius)[0], abs=3 * ROUNDING)
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=ROUNDING)


@compiling
@given(vectors, rotations, vectors, vectors, radii)
def test_a_sphere_is_where_its_fields_say(position, rotation, point, center, radius):
    sphere = Sphere(bone="bone", center=center, radius=radius)
    distance, normal = distance_in(only_group(sphere), (position, rotation), point)
    off = point - position - rotated(rotation, center)
    assert distance == pytest.approx(np.linalg.norm(off) - radius, abs=ROUNDING)
    if np.linalg.norm(off) > 1e-3:
        np.testing.assert_allclose(normal, off / np.linalg.norm(off), atol=1e-9)


@compiling
@given(vectors, rotations, vectors, st.tuples(vectors, vectors), st.tuples(radii, radii))
def test_a_tapered_capsule_is_where_its_fields_say(position, rotation, point, ends, both):
    start, end = (position + rotated(rotation, p) for p in ends)
    shape = TaperedCapsule(bone="bone", start=ends[0], end=ends[1], start_radius=both[0], end_radius=both[1])
    distance, normal = distance_in(only_group(shape), (position, rotation), point)
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
    group = only_group(shape)
    for point in np.random.default_rng(3).uniform(-1, 1, (20, 3)):
        off = point - np.array(center)
        distance, normal = distance_in(group, (np.zeros(3), np.array([1.0, 0, 0, 0])), point)
        assert distance == pytest.approx(np.linalg.norm(off) - radius, abs=ROUNDING)
        np.testing.assert_allclose(normal, off / np.linalg.norm(off), atol=1e-9)
    assert group.colliders.core[0] == radius


def test_a_tapered_capsule_with_equal_radii_is_a_capsule():
    ends = np.array([0.1, 0.2, 0.3]), np.array([-0.4, 0.5, 0.1])
    tapered = only_group(TaperedCapsule(start=ends[0], end=ends[1], start_radius=0.2, end_radius=0.2))
    capsule = only_group(Capsule("", None, *ends, 0.2))
    for point in np.random.default_rng(3).uniform(-1, 1, (20, 3)):
        one, two = (distance_in(g, (np.zeros(3), np.array([1.0, 0, 0, 0])), point) for g in (tapered, capsule))
        assert one[0] == pytest.approx(two[0], abs=ROUNDING)
        np.testing.assert_allclose(one[1], two[1], atol=ROUNDING)


@compiling
@given(vectors, rotations, vectors, vectors, rotations, st.tuples(radii, radii, radii).map(np.array))
def test_a_box_is_where_its_fields_say(position, rotation, point, center, own, halves):
    box = Box(bone="bone", center=center, half_sizes=halves, rotation_wxyz=own)
    distance, normal = distance_in(only_group(box), (position, rotation), point)
    in_bone = rotated(quaternions.conjugate(rotation), point - position)
    in_box = rotated(quaternions.conjugate(own), in_bone - center)
    assert distance == pytest.approx(box_distance(in_box[None], halves)[0], abs=ROUNDING)
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=ROUNDING)


@compiling
@given(vectors, rotations, vectors, vectors, vectors.filter(lambda n: np.linalg.norm(n) > 0.1))
def test_a_plane_is_where_its_fields_say(position, rotation, point, through, across):
    plane = Plane(bone="bone", point=through, normal=across)
    distance, normal = distance_in(only_group(plane), (position, rotation), point)
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
    assert only_group(collider).colliders.core[0] == core


# -- poses --


def test_normals_are_gradients_in_the_world():
    rng, step = np.random.default_rng(5), 1e-6
    for shape in (
        Capsule("", "b", np.array([0.1, 0, 0]), np.array([0, 0.4, 0.3]), 0.2),
        TaperedCapsule(bone="b", start=np.array([0.1, 0, 0]), end=np.array([0, 0.4, 0.3])),
        Box(bone="b", half_sizes=np.array([0.3, 0.2, 0.1]), rotation_wxyz=np.array([0.6, 0.0, 0.8, 0.0])),
    ):
        group = only_group(shape)
        for point in rng.uniform(1.0, 1.5, (10, 3)):
            pose = rng.standard_normal(3) * 0.2, quaternions.normalize(rng.standard_normal(4))
            _, normal = distance_in(group, pose, point)
            gradient = [
                (distance_in(group, pose, point + e)[0] - distance_in(group, pose, point - e)[0]) / (2 * step)
                for e in step * np.eye(3)
            ]
            # Curvature is at most 1 / 0.5 m out here.
            np.testing.assert_allclose(gradient, normal, atol=2 * step + 1e-8)


def test_a_collider_is_placed_once_a_moment():
    group = record(TaperedCapsules, tapered_sizes(0.5, 0.2, 0.1), thickness=0.01)
    one, two = (moving(np.zeros((1, 3)), place=[[x, 0.0, 0.0]]) for x in (1.0, 2.0))
    group.clock[MOMENT] = 1
    place(group, 0, one.positions, one.matrices)
    place(group, 0, two.positions, two.matrices)
    assert group.colliders.placed[0, 9] == 1.0
    group.clock[MOMENT] = 2
    place(group, 0, two.positions, two.matrices)
    assert group.colliders.placed[0, 9] == 2.0
