"""Kernels of contact and depth against plain loops and independent distances, without any of the package's objects.

They also run with the compiler off: NUMBA_DISABLE_JIT=1.
"""

import numpy as np
import pytest
from scenes import turn_about
from shapes import box_distance, capsule_distance

from cape.kernels import contact, measure, records
from motions import quaternions

# A few dozen operations on numbers near one.
ROUNDING = 1e-13


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def responded(p, v, depth, n, friction, step, place, velocity, spin) -> tuple[np.ndarray, np.ndarray]:
    """Contact of one vertex, as the module's text says it: position and velocity after."""
    surface = velocity + np.cross(spin, p - place)
    relative = v - surface
    into = -(relative @ n)
    if into > 0:
        sliding = relative + into * n
        speed = np.linalg.norm(sliding)
        sliding = sliding * max(0.0, 1 - friction * into / speed) if speed > 0 else sliding
        moved = step * (surface + sliding - v)
        p, v, depth = p + moved, surface + sliding, depth - moved @ n
    return (p + depth * n, v) if depth > 0 else (p, v)


@pytest.mark.parametrize("friction", [0.0, 0.3, 5.0])
def test_response_to_contact(rng: np.random.Generator, friction: float):
    p, v = rng.standard_normal((2, 3, 20))
    place, velocity, spin = rng.standard_normal((3, 2, 3))
    x, u, step = p.copy(), v.copy(), 0.05
    for i in range(20):
        n = quaternions.normalize(rng.standard_normal(4))[1:]
        n /= np.linalg.norm(n)
        depth = rng.uniform(0, 0.1)
        contact.respond(i, depth, *n, 1, friction, step, place, velocity, spin, *x, *u)
        expected = responded(p[:, i], v[:, i], depth, n, friction, step, place[1], velocity[1], spin[1])
        np.testing.assert_allclose(x[:, i], expected[0], atol=ROUNDING)
        np.testing.assert_allclose(u[:, i], expected[1], atol=ROUNDING)


def capsules_in_space(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Bones, ends and radii of five capsules, the last of them a sphere."""
    starts, ends = 2 * rng.standard_normal((2, 5, 3))
    ends[4] = starts[4]
    return np.array([0, 1, 1, 0, 1]), starts, ends, rng.uniform(0.2, 0.6, 5)


def test_capsules_near_a_block_are_all_that_it_can_reach(rng: np.random.Generator):
    count, horizon, slack, thickness = 100, 0.05, 0.01, 0.005
    p, v = 3 * rng.standard_normal((3, count)), rng.standard_normal((3, count))
    owner, starts, ends, radius = capsules_in_space(rng)
    place, velocity, spin = rng.standard_normal((3, 2, 3))
    matrices = quaternions.to_matrix(quaternions.normalize(rng.standard_normal((2, 4))))
    placed, near = np.zeros((5, 8)), np.zeros((-(-count // contact.BLOCK), 6), dtype=np.int64)
    contact.place_capsules(owner, starts, ends, place, matrices, placed)
    for c in range(5):
        np.testing.assert_allclose(placed[c, :3], place[owner[c]] + matrices[owner[c]] @ starts[c], atol=ROUNDING)
        np.testing.assert_allclose(placed[c, 3:6], place[owner[c]] + matrices[owner[c]] @ ends[c], atol=ROUNDING)
    assert placed[4, 7] == 0.0
    contact.find_near(
        0, p.shape[1], *p, *v, placed, radius, thickness, owner, place, velocity, spin, horizon, slack, near
    )
    for block in range(near.shape[0]):
        members = slice(block * contact.BLOCK, (block + 1) * contact.BLOCK)
        fastest = np.linalg.norm(v[:, members], axis=0).max()
        expected = []
        for c, b in enumerate(owner):
            speeds = [np.linalg.norm(velocity[b] + np.cross(spin[b], placed[c, k : k + 3] - place[b])) for k in (0, 3)]
            reach = thickness + slack + horizon * (fastest + max(speeds))
            if capsule_distance(p[:, members].T, placed[c, :3], placed[c, 3:6], radius[c]).min() < reach:
                expected.append(c)
        assert near[block, 1 : 1 + near[block, 0]].tolist() == expected
    assert 0 < near[:, 0].sum() < near.shape[0] * 5


@pytest.mark.parametrize("count", [1, 2, 3], ids=["one sphere", "two that overlap", "three in a row"])
def test_colliding_takes_every_free_vertex_out(rng: np.random.Generator, count: int):
    size, thickness, step, radius = 3 * contact.BLOCK - 5, 0.02, 0.01, np.full(count, 0.5)
    placed = np.zeros((count, 8))
    placed[:, 0] = placed[:, 3] = np.array([0.0, 0.2, 0.75])[:count]
    p, u = rng.uniform(-0.1, 0.1, (3, size)), np.zeros((3, size))
    p[0] += rng.choice([0.1, 0.71], size)
    free = rng.uniform(size=size) < 0.9
    near = np.tile(np.array([count, *range(count)]), (-(-size // contact.BLOCK), 1))
    still, owner, friction = np.zeros((1, 3)), np.zeros(count, dtype=np.int64), np.full(count, 0.3)
    x, touched = p.copy(), np.zeros(contact.BLOCK, dtype=np.int64)
    contact.collide_capsules(
        0,
        x.shape[1],
        free,
        *x,
        *u,
        near,
        touched,
        owner,
        placed,
        radius,
        friction,
        thickness,
        step,
        still,
        still,
        still,
    )

    def distance(points: np.ndarray) -> np.ndarray:
        return np.min([capsule_distance(points.T, c[:3], c[3:6], 0.5) for c in placed], axis=0)

    entered = free & (distance(p) < thickness)
    assert contact.BLOCK < entered.sum() < size
    # The way out of one may lead into another: what is left is no more than a vertex may graze.
    assert distance(x)[entered].min() > thickness - (contact.GRAZE if count > 1 else ROUNDING)
    np.testing.assert_array_equal(x[:, ~entered], p[:, ~entered])
    # At rest, so depth has not turned into speed.
    np.testing.assert_array_equal(u, 0.0)


def tilted_bone() -> tuple[np.ndarray, np.ndarray]:
    """Position and matrix bone_to_world of a single bone, shapes (1, 3) and (1, 3, 3)."""
    return np.array([[0.1, 0.2, -0.1]]), quaternions.to_matrix(turn_about((0.6, 0.0, 0.8), 0.7))[None]


def test_colliding_with_a_plane_that_a_bone_carries(rng: np.random.Generator):
    thickness, step, still = 0.02, 0.01, np.zeros((1, 3))
    p, u = rng.uniform(-1, 1, (3, 60)), np.zeros((3, 60))
    place, matrices = tilted_bone()
    point, normal = np.array([[0.05, -0.1, 0.2]]), np.array([[0.48, 0.6, 0.64]])

    def height(points: np.ndarray) -> np.ndarray:
        return ((points.T - place) @ matrices[0] - point) @ normal[0]

    x, free = p.copy(), rng.uniform(size=60) < 0.8
    owner, friction = np.zeros(1, dtype=np.int64), np.array([0.3])
    contact.collide_planes(
        0, x.shape[1], free, *x, *u, owner, point, normal, friction, thickness, step, place, matrices, still, still
    )
    entered = free & (height(p) < thickness)
    assert 10 < entered.sum() < 50
    np.testing.assert_allclose(height(x)[entered], thickness, atol=ROUNDING)
    np.testing.assert_array_equal(x[:, ~entered], p[:, ~entered])


def test_colliding_with_a_box_that_a_bone_carries(rng: np.random.Generator):
    thickness, step, still = 0.02, 0.01, np.zeros((1, 3))
    p, u = rng.uniform(-1, 1, (3, 60)), np.zeros((3, 60))
    place, matrices = tilted_bone()
    center, halves = np.array([[0.05, -0.1, 0.2]]), np.array([[0.6, 0.4, 0.5]])
    frame = quaternions.to_matrix(turn_about((0, 0.6, 0.8), 0.4))[None]

    def distance(points: np.ndarray) -> np.ndarray:
        return box_distance(((points.T - place) @ matrices[0] - center) @ frame[0], halves[0])

    x, free = p.copy(), rng.uniform(size=60) < 0.8
    owner, friction = np.zeros(1, dtype=np.int64), np.array([0.3])
    contact.collide_boxes(
        0, x.shape[1], free, *x, *u, owner, center, halves, frame, np.zeros((3, 3)), friction, thickness, step,
        place, matrices, still, still,
    )  # fmt: skip
    entered = free & (distance(p) < thickness)
    assert 3 < entered.sum() < 50
    np.testing.assert_allclose(distance(x)[entered], thickness, atol=ROUNDING)
    np.testing.assert_array_equal(x[:, ~entered], p[:, ~entered])


def test_depth_in_each_kind_of_shape(rng: np.random.Generator):
    p = rng.uniform(-1, 1, (3, 60))
    counted = rng.uniform(size=60) < 0.7
    owner, zero, margin = np.zeros(2, dtype=np.int64), np.zeros(2), 0.01
    place, matrices = tilted_bone()
    in_bone = ((p.T - place) @ matrices[0])[counted]

    starts, ends, radius = rng.uniform(-1, 1, (2, 3)), rng.uniform(-1, 1, (2, 3)), np.array([0.4, 0.5])
    room = np.zeros((2, 8)), np.zeros((2, 3), np.int64), np.zeros(contact.BLOCK, np.int64)
    capsules = records.Capsules(owner, starts, ends, radius, zero, *room)
    depths = [margin - capsule_distance(in_bone, starts[c], ends[c], radius[c]).min() for c in range(2)]
    found = measure.depth_in_capsules(*p, counted, capsules, margin, place, matrices)
    assert found == (pytest.approx(max(depths), abs=ROUNDING), np.argmax(depths))

    points, normals = rng.uniform(-0.5, 0.5, (2, 3)), np.array([[0, 0.6, 0.8], [0.8, 0.0, -0.6]])
    planes = records.Planes(owner, points, normals, zero)
    depths = [margin - ((in_bone - points[k]) @ normals[k]).min() for k in range(2)]
    found = measure.depth_in_planes(*p, counted, planes, margin, place, matrices)
    assert found == (pytest.approx(max(depths), abs=ROUNDING), np.argmax(depths))

    halves = rng.uniform(0.2, 0.6, (2, 3))
    frames = quaternions.to_matrix(quaternions.normalize(rng.standard_normal((2, 4))))
    boxes = records.Boxes(owner, points, halves, frames, zero, np.zeros((3, 3)))
    depths = [margin - box_distance((in_bone - points[k]) @ frames[k], halves[k]).min() for k in range(2)]
    found = measure.depth_in_boxes(*p, counted, boxes, margin, place, matrices)
    assert found == (pytest.approx(max(depths), abs=ROUNDING), np.argmax(depths))

    away = np.zeros(60, dtype=bool)
    assert measure.depth_in_boxes(*p, away, boxes, margin, place, matrices) == (0.0, -1)
