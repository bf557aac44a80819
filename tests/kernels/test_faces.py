"""Triangles against shapes: the nearest and the deepest point by brute force, and what contact gives to the corners.

The kernels also run with the compiler off: NUMBA_DISABLE_JIT=1.
"""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cape import Box, Capsule, Cloth, Collider, Fabric, MeshCloth, Plane, Scene, Sphere
from cape.assembly.contact import STRETCHED, Contacts, contacts_of
from cape.kernels.bones import MotionRoom
from cape.kernels.contact import deepest as search
from cape.kernels.contact import faces
from cape.kernels.contact.faces import FaceContact
from cape.kernels.contact.shapes import MOMENT, Colliders, Faces, place
from cape.kernels.contact.watch import JOLT, NEVER, TILE
from cape.kernels.jit import routine
from cape.kernels.state import State
from skeleton.shapes import Cylinder, Ellipsoid, TaperedCapsule
from tests.support.scenes import grid_cloth
from tests.support.shapes import (
    FloatArray,
    faces_record,
    grid_of_weights,
    kind_of,
    least_on_triangle,
    moving,
    record,
    reference_distance,
    still,
    tapered_sizes,
    touching,
)

ROUNDING = 1e-12

numbers = st.one_of(st.integers(-8, 8).map(lambda k: k / 8), st.floats(-1, 1, allow_subnormal=False))
points = st.tuples(numbers, numbers, numbers).map(np.array)
triangles = st.tuples(points, points, points).map(np.array)


DENSE = grid_of_weights(60)


# -- the nearest point --


def nearest_weights(p: FloatArray, corners: FloatArray) -> FloatArray:
    return np.array(search.weights_of_nearest(*map(float, p), *map(float, corners.ravel())))


@settings(deadline=None)  # the first one compiles
@given(points, triangles)
def test_no_point_of_a_triangle_is_nearer_than_the_nearest(p, corners):
    weights = nearest_weights(p, corners)
    assert weights.min() >= -ROUNDING
    assert weights.sum() == pytest.approx(1.0, abs=ROUNDING)
    nearest = np.linalg.norm(weights @ corners - p)
    sampled = np.linalg.norm(DENSE @ corners - p, axis=1).min()
    # Slivers: their height is known to a few roundings over their length.
    assert nearest <= sampled + 1e-7


@pytest.mark.parametrize(
    ("p", "weights"),
    [
        ((-1, -1, 1), (1, 0, 0)),
        ((3, -1, 1), (0, 1, 0)),
        ((-1, 3, 1), (0, 0, 1)),
        ((0.5, -1, 1), (0.5, 0.5, 0)),
        ((-1, 0.25, 1), (0.75, 0, 0.25)),
        ((1, 1, 1), (0, 0.5, 0.5)),
        ((0.25, 0.25, 1), (0.5, 0.25, 0.25)),
        ((0, 0, 0), (1, 0, 0)),
        ((0.5, 0.5, 0), (0, 0.5, 0.5)),
    ],
    ids=["corner a", "corner b", "corner c", "edge ab", "edge ac", "edge bc", "inside", "on a corner", "on an edge"],
)
def test_the_nearest_point_region_by_region(p, weights):
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
    np.testing.assert_allclose(nearest_weights(np.array(p, float), corners), weights, atol=1e-15)
    # Whichever corner comes first.
    for order in ([1, 2, 0], [2, 0, 1], [0, 2, 1]):
        turned = nearest_weights(np.array(p, float), corners[order])
        np.testing.assert_allclose(turned, np.array(weights)[order], atol=1e-15)


@pytest.mark.parametrize(
    "corners",
    [
        [[0, 0, 0]] * 3,
        [[0, 0, 0], [0, 0, 0], [1, 0, 0]],
        [[0, 0, 0], [1, 0, 0], [1, 0, 0]],
        [[1, 0, 0], [0, 0, 0], [1, 0, 0]],
        [[0, 0, 0], [1, 0, 0], [0.25, 0, 0]],
    ],
    ids=["a point", "a on b", "b on c", "c on a", "three in a row"],
)
def test_triangles_of_no_area_have_a_nearest_point(corners):
    corners = np.array(corners, float)
    for p in np.random.default_rng(1).uniform(-1, 2, (30, 3)):
        weights = nearest_weights(p, corners)
        assert weights.min() >= 0.0
        assert weights.sum() == pytest.approx(1.0, abs=ROUNDING)
        sampled = np.linalg.norm(DENSE @ corners - p, axis=1).min()
        assert np.linalg.norm(weights @ corners - p) <= sampled + ROUNDING


# -- the deepest point --


@routine
def deepest(shapes, limit, ax, ay, az, bx, by, bz, cx, cy, cz):
    return search.deepest_on_triangle(shapes, 0, (ax, ay, az), (bx, by, bz), (cx, cy, cz), limit)


@routine
def known(triangles, c, ax, ay, az, bx, by, bz, cx, cy, cz):
    return faces.known_gap(triangles, 0, c, (ax, ay, az), (bx, by, bz), (cx, cy, cz))


@routine
def remember(triangles, c, bound, ax, ay, az, bx, by, bz, cx, cy, cz):
    faces.remember_gap(triangles, 0, c, (ax, ay, az), (bx, by, bz), (cx, cy, cz), bound)


@routine
def clearance(shapes, ax, ay, az, bx, by, bz, cx, cy, cz):
    return faces.clearance(shapes, 0, (ax, ay, az), (bx, by, bz), (cx, cy, cz))


@routine
def respond(contact, i, j, k, u, v, w, depth, nx, ny, nz, step, most):
    return faces.respond_on_triangle(contact, 0, (i, j, k), (u, v, w), depth, (nx, ny, nz), step, most)


def random_shape(kind: str, rng: np.random.Generator) -> Colliders:
    """A shape of 5 to 50 mm."""
    radius = rng.uniform(0.005, 0.05)
    if kind == "capsule":
        return record(Capsule, (rng.uniform(0.05, 0.3), radius, 0, 0), thickness=0.005)
    if kind == "sphere":
        return record(Capsule, (0, radius, 0, 0), thickness=0.005)
    if kind == "box":
        return record(Box, (*rng.uniform(0.005, 0.05, 3), 0), thickness=0.005)
    if kind == "cylinder":
        return record(Cylinder, (*rng.uniform(0.005, 0.05, 2), 0, 0), thickness=0.005)
    if kind == "ellipsoid":
        return record(Ellipsoid, (*rng.uniform(0.005, 0.05, 3), 0), thickness=0.005)
    length, other = rng.uniform(0.06, 0.3), rng.uniform(0.005, 0.05)
    return record(TaperedCapsule, tapered_sizes(length, radius, other), thickness=0.005)


def triangle_near(shapes: Colliders, rng: np.random.Generator) -> FloatArray:
    """A triangle with edges of about 10 to 40 mm whose middle is less than its size off the surface."""
    reach = 0.02 + shapes.records.sizes[0, :3].max()
    while True:
        edge = rng.uniform(0.01, 0.04)
        corners = rng.uniform(-1, 1, (3, 3))
        sides = corners[[1, 2, 0]] - corners
        squares = (sides * sides).sum(axis=1)
        scale = edge / np.sqrt(squares.max())
        corners = scale * corners
        corners += rng.uniform(-reach, reach, 3) - corners.mean(axis=0)
        area = np.sqrt(max(squares[0] * squares[1] - (sides[0] @ sides[1]) ** 2, 0.0)) * scale**2 / 2
        if area > 0.05 * edge**2 and abs(distance_at(shapes, corners.mean(axis=0)[None])[0]) < edge:
            return corners


def distance_at(shapes: Colliders, where: FloatArray) -> FloatArray:
    kind, sizes = kind_of(shapes), shapes.records.sizes[0]
    if kind is Ellipsoid:  # by bisection, which test_distance.py holds against brute force
        return Ellipsoid(radii=sizes[:3]).distances(where)
    return reference_distance(kind, sizes, where)


def refined_depth(shapes: Colliders, corners: FloatArray) -> float:
    """Least signed distance on a triangle."""
    return least_on_triangle(lambda where: distance_at(shapes, where), corners)


KINDS = ("capsule", "sphere", "tapered capsule", "box", "cylinder", "ellipsoid")


@pytest.mark.parametrize("kind", KINDS)
def test_the_deepest_point_of_a_triangle(kind: str):
    rng = np.random.default_rng(4)
    inside = 0
    for _ in range(40 if kind == "tapered capsule" else 150):
        shapes = random_shape(kind, rng)
        corners = triangle_near(shapes, rng)
        distance, nx, ny, nz, *weights, bound = deepest(shapes, np.inf, *map(float, corners.ravel()))
        assert distance - 5e-5 < bound <= distance
        assert min(weights) >= -ROUNDING
        assert sum(weights) == pytest.approx(1.0, abs=ROUNDING)
        where = np.array(weights) @ corners
        assert distance == pytest.approx(distance_at(shapes, where[None])[0], abs=1e-9)
        assert np.linalg.norm((nx, ny, nz)) == pytest.approx(1.0, abs=1e-9)
        least = refined_depth(shapes, corners)
        assert bound <= least + 1e-12
        if least > -faces.PIERCED * shapes.records.core[0]:
            # Where the search stands still for want of a promise, a slope of a few parts in ten thousand is left.
            assert distance < least + 2e-5
            inside += least < 0
    assert inside > 5


@pytest.mark.parametrize("kind", KINDS)
def test_a_search_ends_early_where_a_triangle_is_surely_beyond_a_limit(kind: str):
    rng = np.random.default_rng(4)
    early = within = 0
    for _ in range(60):
        shapes = random_shape(kind, rng)
        corners = triangle_near(shapes, rng)
        limit = rng.choice([0.0, 0.005, 0.02])
        whole, short = (deepest(shapes, least, *map(float, corners.ravel())) for least in (np.inf, limit))
        if whole[0] <= limit:
            assert short == whole
            within += 1
        elif short != whole:
            # As much is sure as its caller relies on.
            assert limit < short[-1] <= refined_depth(shapes, corners) + 1e-12
            assert short[-1] - limit > search.SURE * (short[0] - limit)
            early += 1
    assert min(early, within) > 5


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_known_of_a_triangle_bounds_where_it_has_gone_since(kind: str):
    rng = np.random.default_rng(4)
    for _ in range(30):
        shapes = random_shape(kind, rng)
        corners = triangle_near(shapes, rng)
        _, triangles = one_triangle(corners, np.zeros((3, 3)), shapes)
        assert known(triangles, 0, *map(float, corners.ravel())) == -np.inf
        least = refined_depth(shapes, corners)
        remember(triangles, 0, least, *map(float, corners.ravel()))
        assert known(triangles, 0, *map(float, corners.ravel())) == least
        assert known(triangles, 1, *map(float, corners.ravel())) == -np.inf
        moved = corners + rng.uniform(-0.01, 0.01, (3, 3)) * rng.choice([0.0, 1.0], (3, 1))
        bound = known(triangles, 0, *map(float, moved.ravel()))
        assert bound == pytest.approx(least - np.linalg.norm(moved - corners, axis=1).max(), abs=ROUNDING)
        assert bound <= refined_depth(shapes, moved) + 1e-4  # as fine as the grid is


@pytest.mark.parametrize("kind", KINDS)
def test_clearance_is_never_more_than_a_triangle_s_distance(kind: str):
    rng = np.random.default_rng(4)
    loose = []
    for _ in range(60):
        shapes = random_shape(kind, rng)
        corners = triangle_near(shapes, rng)
        bound = clearance(shapes, *map(float, corners.ravel()))
        least = refined_depth(shapes, corners)
        assert bound <= least + 1e-12
        loose.append(least - bound)
    # Of use: it misses by less than the size of a triangle.
    assert np.median(loose) < 0.01


def test_a_look_at_a_group_tells_the_clearance_of_each():
    rng = np.random.default_rng(4)
    shapes = record(Capsule, (0.2, 0.03, 0, 0), thickness=0.005, origins=(0.1, 0.2, 0.3))
    m = moving(np.zeros((1, 3)), place=[[0.5, 0.0, 0.0]])
    shapes.clock[MOMENT] += 1
    place(shapes, 0, m)
    points = rng.uniform(-0.1, 0.1, (5, 3)) + np.array([0.6, 0.2, 0.3])
    corners = np.array([[0, 1, 2], [4, 2, 3], [1, 3, 4]])
    s, group = one_triangle(points, np.zeros((5, 3)), shapes)
    group = group._replace(corners=np.ascontiguousarray(corners.T))
    least = faces.look_at_group(touching(s, shapes, m), group, 1, 3, 0, 0.02)
    own = points[corners[1:]] - [0.6, 0.2, 0.3]
    expected = np.array([clearance(shapes, *map(float, t.ravel())) for t in own]) - 0.02
    np.testing.assert_allclose(group.middles.gaps[:2], expected, atol=1e-15)
    assert least == pytest.approx(expected.min(), abs=1e-15)


# -- what the corners get --


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("held", [(), (1,), (0, 2), (0, 1, 2)], ids=["free", "one held", "two held", "all held"])
def test_a_point_of_a_triangle_is_stopped_by_impulses_on_its_corners(held: tuple[int, ...], friction: float):
    rng, back, most = np.random.default_rng(4), 0.01, 0.002
    corners, parts = [3, 1, 4], []
    wall = record(Plane, np.zeros(4), thickness=0.0, friction=friction)
    for _ in range(30):
        p, v = rng.standard_normal((2, 3, 6))
        s = State(*p.copy(), *v.copy())
        mass = rng.uniform(0.5, 2.0, 6)
        inverse = 1.0 / mass
        inverse[[corners[k] for k in held]] = 0.0
        w = rng.dirichlet((1, 1, 1))
        n, velocity, spin, here = rng.standard_normal((4, 3))
        n /= np.linalg.norm(n)
        m = moving([velocity], spin=[spin], place=[here])
        depth = rng.uniform(0.0, 0.05)
        contact = touching(s, wall, m)._replace(inverse_mass=inverse)
        hit = respond(contact, *corners, *w, depth, *n, back, most)
        moved, gained = np.stack(s[:3]) - p, np.stack(s[3:]) - v
        others = np.setdiff1d(np.arange(6), [corners[k] for k in range(3) if k not in held])
        np.testing.assert_array_equal(moved[:, others], 0.0)
        np.testing.assert_array_equal(gained[:, others], 0.0)
        if len(held) == 3:
            continue
        point, speed = p[:, corners] @ w, v[:, corners] @ w
        against = speed - velocity - np.cross(spin, point - here)
        # No corner is moved farther than so many times what the point needs: then the point gets a part of it.
        shares = w * inverse[corners] / (w * w @ inverse[corners])
        part = min(1.0, faces.LEVER / shares.max())
        parts.append(part)
        after = against + gained[:, corners] @ w / part
        inwards = -(against @ n)
        assert hit == pytest.approx(inwards)
        if inwards <= 0:
            np.testing.assert_array_equal(gained, 0.0)
        else:
            assert after @ n == pytest.approx(0.0, abs=ROUNDING)
            slides = against + inwards * n
            sliding = np.linalg.norm(slides)
            kept = max(0.0, 1 - friction * inwards / sliding)
            np.testing.assert_allclose(after, kept * slides, atol=ROUNDING)
        # Impulses of free corners are as their weights.
        impulses = mass[corners] * gained[:, corners]
        for k, one in itertools.permutations(set(range(3)) - set(held), 2):
            np.testing.assert_allclose(impulses[:, k] * w[one], impulses[:, one] * w[k], atol=ROUNDING)
        # The point moves by what its velocity does, and by what is left of the depth.
        left = min(max(depth - back * ((after - against) @ n), 0.0), most)
        np.testing.assert_allclose(moved[:, corners] @ w, part * (back * (after - against) + left * n), atol=ROUNDING)
    assert max(parts, default=1.0) == 1.0
    assert len(held) in (0, 3) or min(parts) < 0.5


# -- which triangles --


def contacts(cloth: Cloth, *colliders: Collider, thickness: float = 0.005) -> Contacts:
    scene = Scene(cloth, colliders=list(colliders), thickness=thickness)
    return contacts_of(scene, cloth, np.ones(cloth.vertices, bool))


def faces_of(cloth: Cloth, *colliders: Collider, thickness: float = 0.005) -> Faces:
    found = contacts(cloth, *colliders, thickness=thickness).faces
    assert found is not None
    return found


def scattered_mesh(rng: np.random.Generator) -> MeshCloth:
    """Triangles of all forms, each by itself, with edges of 2 to 60 mm."""
    flat = rng.uniform(-0.03, 0.03, (120, 3, 2))
    flat += 0.1 * np.stack(np.divmod(np.arange(120), 11), axis=1)[:, None]
    flat = flat.reshape(-1, 2)
    places = np.column_stack([flat, np.zeros(len(flat))])
    return Cloth.from_mesh(places, np.arange(360).reshape(-1, 3), pattern=flat)


def cover(flat: FloatArray) -> FloatArray:
    """Farthest that a point of each triangle (T, 3, 2) is from its nearest corner, sampled."""
    inside = np.einsum("wk,tkc->twc", DENSE, flat)
    return np.linalg.norm(inside[:, :, None] - flat[:, None], axis=3).min(axis=2).max(axis=1)


def test_chosen_are_all_triangles_that_vertices_do_not_hold_off():
    cloth = scattered_mesh(np.random.default_rng(6))
    flat = cloth.corners
    radius, thickness = 0.03, 0.005
    found = faces_of(cloth, Sphere(radius=radius), thickness=thickness)
    chosen = {tuple(sorted(c)) for c in found.corners.T.tolist()}
    assert len(chosen) == found.corners.shape[1]
    # (r + t)^2 - p^2 < r^2, with triangles stretched by 5 %.
    reach = STRETCHED * cover(flat)
    needed = (radius + thickness) ** 2 - reach**2 < radius**2
    everyone = [tuple(sorted(c)) for c in cloth.triangles.tolist()]
    assert {t for t, n in zip(everyone, needed, strict=True) if n} <= chosen
    # Sampling misses a few percent of an edge; of the obtuse ones half the longest edge stands for the point.
    edges = np.sort(np.linalg.norm(flat - np.roll(flat, 1, axis=1), axis=2), axis=1)
    acute = edges[:, 0] ** 2 + edges[:, 1] ** 2 > edges[:, 2] ** 2
    bound = np.where(acute, 1.03 * reach, STRETCHED * edges[:, 2] / 2)
    spared = (radius + thickness) ** 2 - bound**2 > radius**2
    assert not {t for t, n in zip(everyone, spared, strict=True) if n} & chosen
    assert min(needed.sum(), spared.sum(), (needed & acute).sum(), (spared & acute).sum()) > 5


def test_groups_of_triangles_hang_on_one_tile_each():
    cloth = grid_cloth(np.linspace(0, 0.5, 21), np.linspace(0, 0.4, 17), Fabric())
    found = faces_of(cloth, Sphere(radius=0.002))
    assert found.starts[0] == 0
    assert found.starts[-1] == found.corners.shape[1] == len(cloth.triangles)
    assert (np.diff(found.starts) > 0).all()
    assert np.diff(found.starts).max() <= faces.GROUP
    assert len(found.tiles) == len(found.next) == len(found.wake) == len(found.starts) - 1
    for g, tile in enumerate(found.tiles):
        corners = found.corners[:, found.starts[g] : found.starts[g + 1]]
        assert ((corners // TILE == tile).any(axis=0)).all()
    assert found.longest == pytest.approx(STRETCHED * np.hypot(0.025, 0.025))


def test_only_thin_colliders_are_watched_by_triangles():
    cloth = grid_cloth(np.linspace(0, 0.3, 11), np.linspace(0, 0.3, 11), Fabric())
    # The middle of a cell's diagonal is 22.3 mm from its ends when stretched: t (2 r + t) is more from 47.2 mm on.
    limit = ((STRETCHED * 0.015 * np.sqrt(2)) ** 2 / 0.005 - 0.005) / 2
    thin, thick = Sphere(name="thin", radius=0.999 * limit), Sphere(name="thick", radius=1.001 * limit)
    found = contacts(cloth, thick, thin).faces
    assert found is not None
    np.testing.assert_array_equal(found.exposed.any(axis=0), [False, True])
    assert contacts(cloth, thick).faces is None


def test_triangles_are_watched_for_those_colliders_that_are_thin_as_against_them():
    # Triangles of narrow cells reach 7.6 mm from their corners when stretched, of wide ones 21.4 mm; vertices hold them
    # off colliders of 2 mm and 30 mm up to 6.7 mm and 18 mm.
    columns = np.concatenate([np.linspace(0.0, 0.24, 21), np.linspace(0.28, 0.68, 11)])
    cloth = grid_cloth(columns, np.linspace(0.0, 0.08, 11), Fabric())
    found = faces_of(cloth, Sphere(name="thin", radius=0.002), Sphere(name="thick", radius=0.03))
    right = np.array([cloth.pattern[found.corners[:, f], 0].max() for f in range(found.corners.shape[1])])
    wide = np.array([r.max() > 0.25 for r in np.split(right, found.starts[1:-1])])
    assert 0 < wide.sum() < len(wide)
    np.testing.assert_array_equal(found.exposed[:, 1], wide)
    assert found.exposed[wide, 0].all()


@pytest.mark.parametrize(
    "collider",
    [
        Plane(),
        Plane(thickness=0.0),
        Sphere(radius=0.2),
        Capsule("", None, np.zeros(3), np.ones(3), 0.2),
        TaperedCapsule(start_radius=0.3, end_radius=0.2),
        Box(thickness=0.03),
        Cylinder(thickness=0.03),
        Ellipsoid(),
    ],
    ids=[
        "plane",
        "plane without thickness",
        "sphere",
        "capsule",
        "tapered capsule",
        "box in a thick skin",
        "cylinder in a thick skin",
        "ellipsoid",
    ],
)
@pytest.mark.filterwarnings("error")
def test_vertices_alone_keep_off_what_is_thick(collider: Collider):
    cloth = grid_cloth(np.linspace(0, 0.3, 11), np.linspace(0, 0.3, 11), Fabric())
    assert contacts(cloth, collider).faces is None


@pytest.mark.parametrize(
    "collider",
    [
        Sphere(radius=0.02),
        Sphere(radius=0.2, thickness=0.0),
        Capsule("", None, np.zeros(3), np.ones(3), 0.02),
        TaperedCapsule(start_radius=0.3, end_radius=0.02),
        TaperedCapsule(start_radius=0.02, end_radius=0.3),
        Box(half_sizes=np.full(3, 0.3)),
        Cylinder(),
        Ellipsoid(radii=np.array([0.3, 0.02, 0.3])),
    ],
    ids=["ball", "no skin", "rod", "cone", "cone, thin first", "the edges of a box", "those of a cylinder", "a disc"],
)
def test_triangles_keep_off_what_is_thin(collider: Collider):
    cloth = grid_cloth(np.linspace(0, 0.3, 11), np.linspace(0, 0.3, 11), Fabric())
    found = contacts(cloth, collider)
    assert found.faces is not None
    assert found.faces.corners.shape[1] == 200
    assert found.faces.exposed.all()


# -- a triangle at work --


def one_triangle(points: FloatArray, velocities: FloatArray, shapes: Colliders) -> tuple[State, Faces]:
    s = State(*np.array(points.T, float), *np.array(velocities.T, float))
    return s, faces_record(np.array([[0], [1], [2]]), [0, 1], [0], shapes)._replace(longest=0.1)


FLAT = np.array([[-0.02, -0.02, 0.0], [0.02, -0.02, 0.0], [0.0, 0.02, 0.0]])
STEP = 1.0 / 480.0  # s


def meet(s: State, triangles: Faces, ball: Colliders, m: MotionRoom, turn: int, earlier=None) -> None:
    """Contact of a triangle alone with a ball, as if its vertices were all out."""
    ball.clock[MOMENT] += 1
    faces.collide_faces(FaceContact(touching(s, ball, m, earlier=earlier), triangles), turn, STEP)


def gap_of(s: State, center: FloatArray, radius: float) -> float:
    """Distance of a triangle from a sphere."""
    return refined_depth(record(Capsule, (0, radius, 0, 0), thickness=0.0), np.stack(s[:3], axis=1) - center)


def test_a_needle_s_tip_is_kept_out_between_three_vertices():
    radius, thickness = 0.003, 0.005
    ball = record(Capsule, (0, radius, 0, 0), thickness=thickness, origins=(0.0, 0.0, 0.001))
    s, triangle = one_triangle(FLAT, np.zeros((3, 3)), ball)
    for turn in range(4):
        before = np.stack(s[:3])
        meet(s, triangle, ball, still(), turn)
        # No faster than it may, and downwards: its middle is below the ball's.
        moved = np.stack(s[:3]) - before
        assert np.linalg.norm(DENSE @ moved.T, axis=1).max() <= 3 * faces.EXIT * STEP
        assert (moved[2] <= 0.0).all()
    assert gap_of(s, np.array([0.0, 0.0, 0.001]), radius) == pytest.approx(faces.SHARE * thickness, abs=1e-5)
    np.testing.assert_array_equal(np.stack(s[3:]), 0.0)


@pytest.mark.parametrize("explicit", [False, True], ids=["by its velocity", "from where it was"])
@pytest.mark.parametrize("speed", [5.0, 30.0, 100.0])
@pytest.mark.parametrize("share", [0.3, 0.5, 0.9])
def test_a_needle_that_passes_in_one_step_takes_the_triangle_along(speed: float, share: float, explicit: bool):
    radius, thickness = 0.003, 0.005
    # At the start of the step it is below the triangle, out of its reach, at the end a share of its way above.
    way = max(speed * STEP, (radius + thickness) / (1 - share))
    speed = way / STEP
    center = np.array([0.002, 0.001, share * way])
    ball = record(Capsule, (0, radius, 0, 0), thickness=thickness)
    s, triangle = one_triangle(FLAT, np.zeros((3, 3)), ball)
    meet(s, triangle, ball, moving([[0.0, 0.0, speed]], place=[center]), 0, np.stack(s[:3]) if explicit else None)
    # The point that was hit is ahead of the needle and goes as fast, but for what others need that are hit thereafter.
    hit = nearest_weights(center, FLAT)
    assert hit @ s.z > center[2] + radius
    assert speed * (1 - 1e-9) < hit @ s.vz < 1.1 * speed
    assert gap_of(s, center, radius) > 0.0


@pytest.mark.parametrize("following", [False, True], ids=["at its place", "on its way"])
@pytest.mark.parametrize("hard", [False, True])
def test_what_a_triangle_hits_hard_is_awake_next_time(hard: bool, following: bool):
    # A corner may be given `LEVER` times the speed of the point that is hit; other colliders learn of more than `JOLT`,
    # and of all that is put back to where it was hit on its way.
    speed = (1.1 if hard else 0.9) * JOLT / faces.LEVER
    radius = 0.001 if following else 0.02
    assert (speed * STEP > 0.5 * radius) == following
    ball = record(Capsule, (0, radius, 0, 0), thickness=0.005)
    s, triangle = one_triangle(FLAT, np.zeros((3, 3)), ball)
    ball.alarm[:] = NEVER
    ball.spreads[:] = measured = (0.03, 0.0, 1.0)
    meet(s, triangle, ball, moving([[0.0, 0.0, speed]], place=[[0.0, 0.0, -radius]]), 3)
    assert s.vz.max() > 0.0
    assert (ball.alarm[0] == 3) == (hard or following)
    assert (tuple(ball.spreads[0]) != measured) == (hard or following)
