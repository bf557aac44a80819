"""Kernels of contact and depth against plain loops and independent distances, without any of the package's objects.

They also run with the compiler off: NUMBA_DISABLE_JIT=1.
"""

import numpy as np
import pytest

from cape.kernels.bones import MotionRoom
from cape.kernels.cloth import measure
from cape.kernels.contact import contact, pinch
from cape.kernels.contact.distance import to_box, to_capsule, to_plane, to_tapered_capsule
from cape.kernels.contact.shapes import Colliders
from cape.kernels.contact.watch import TILE
from cape.kernels.state import State
from motions import quaternions
from tests.support.scenes import turn_about
from tests.support.shapes import (
    FloatArray,
    Kind,
    capsule_distance,
    collide,
    moving,
    record,
    reference_distance,
    still,
    tapered_sizes,
    touching,
)

# A few dozen operations on numbers near one.
ROUNDING = 1e-13

SIZES = {
    to_capsule: (0.4, 0.3, 0.0, 0.0),
    to_tapered_capsule: tapered_sizes(0.5, 0.4, 0.2),
    to_box: (0.6, 0.4, 0.5, 0.0),
    to_plane: (0.0, 0.0, 0.0, 0.0),
}
every_kind = pytest.mark.parametrize("kind", SIZES, ids=lambda k: k.__name__)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def state(positions: FloatArray, velocities: FloatArray | None = None) -> State:
    """A state of copies; both (3, N)."""
    speeds = np.zeros_like(positions) if velocities is None else velocities
    return State(*(np.array(c, float) for c in (*positions, *speeds)))


def places(s: State) -> FloatArray:
    return np.stack(s[:3]).astype(float)


def speeds(s: State) -> FloatArray:
    return np.stack(s[3:]).astype(float)


def stopped(r: FloatArray, n: FloatArray, friction: float) -> FloatArray:
    """A velocity relative to a surface, after contact."""
    into = -(r @ n)
    if into <= 0:
        return r
    slides = r + into * n
    speed = np.linalg.norm(slides)
    return slides if speed == 0 else slides * max(0.0, 1 - friction * into / speed)


# -- the law of contact --


@pytest.mark.parametrize("friction", [0.0, 0.3, 5.0])
def test_what_is_stopped_keeps_no_speed_inwards_and_loses_what_coulomb_s_cone_allows(rng, friction):
    for _ in range(50):
        r, n = rng.standard_normal((2, 3))
        n /= np.linalg.norm(n)
        *after, inwards = contact.stopped(*r, *n, friction)
        assert inwards == pytest.approx(-(r @ n), abs=ROUNDING)
        np.testing.assert_allclose(after, stopped(r, n, friction), atol=ROUNDING)
        impulse = np.array(after) - r
        if r @ n >= 0:
            np.testing.assert_array_equal(after, r)
            continue
        assert np.array(after) @ n == pytest.approx(0.0, abs=ROUNDING)
        pressed, dragged = impulse @ n, impulse - (impulse @ n) * n
        assert np.linalg.norm(dragged) <= friction * pressed + ROUNDING
        # It slides on the way it did, or sticks.
        slides = r - (r @ n) * n
        assert np.linalg.norm(np.cross(after, slides)) < ROUNDING
        assert np.array(after) @ slides >= 0.0
        if np.linalg.norm(after) > ROUNDING:
            assert np.linalg.norm(dragged) == pytest.approx(friction * pressed, abs=ROUNDING)


def test_what_does_not_slide_has_no_friction_to_divide_by():
    assert contact.stopped(0.0, 0.0, -2.0, 0.0, 0.0, 1.0, 0.5) == (0.0, 0.0, 0.0, 2.0)


def responded(p, v, depth, n, friction, back, most, surface) -> tuple[FloatArray, FloatArray]:
    """Contact of one vertex, as the module's text says it: position and velocity after."""
    relative = v - surface
    if relative @ n < 0:
        after = surface + stopped(relative, n, friction)
        p, v, depth = p + back * (after - v), after, depth - back * (after - v) @ n
    return p + min(max(depth, 0.0), most) * n, v


@pytest.mark.parametrize("friction", [0.0, 0.3, 5.0])
def test_response_to_contact(rng: np.random.Generator, friction: float):
    p, v = rng.standard_normal((2, 3, 40))
    here, velocity, spin = rng.standard_normal((3, 2, 3))
    m, s, back, most = moving(velocity, spin=spin, place=here), state(p, v), 0.05, 0.04
    wall = record(to_plane, SIZES[to_plane], thickness=0.0, friction=friction, bones=[1])
    for i in range(40):
        n = rng.standard_normal(3)
        n /= np.linalg.norm(n)
        depth = rng.uniform(-0.05, 0.1)
        surface = velocity[1] + np.cross(spin[1], p[:, i] - here[1])
        speed = contact.respond(touching(s, wall, m), 0, i, depth, *n, back, most)
        expected = responded(p[:, i], v[:, i], depth, n, friction, back, most, surface)
        np.testing.assert_allclose(places(s)[:, i], expected[0], atol=ROUNDING)
        np.testing.assert_allclose(speeds(s)[:, i], expected[1], atol=ROUNDING)
        assert speed == pytest.approx(-(v[:, i] - surface) @ n, abs=ROUNDING)


# -- out of shapes --


def tilted(kind: Kind, rng: np.random.Generator, **settings) -> tuple[Colliders, MotionRoom, FloatArray]:
    """A collider aslant on a bone that is aslant; the bone; shape_to_world as a matrix (3, 4)."""
    bone, frame = turn_about((0.6, 0.0, 0.8), 0.7), turn_about((0, 0.6, 0.8), 0.4)
    here, origin = np.array([0.1, 0.2, -0.1]), np.array([0.05, -0.1, 0.2])
    turned = quaternions.to_matrix(frame)
    shapes = record(kind, SIZES[kind], origins=origin, frames=turned[None], **settings)
    matrix = quaternions.to_matrix(bone)
    m = moving(np.zeros((1, 3)), place=here[None], matrix=matrix[None])
    return shapes, m, np.column_stack([matrix @ turned, here + matrix @ origin])


def world_distance(kind: Kind, to_world: FloatArray, points: FloatArray) -> FloatArray:
    """Reference distance of points (3, N) of the world."""
    return reference_distance(kind, SIZES[kind], (points.T - to_world[:, 3]) @ to_world[:, :3])


@every_kind
def test_colliding_takes_every_free_vertex_out(rng: np.random.Generator, kind: Kind):
    count, thickness, step = 8 * TILE + 5, 0.02, 0.5
    p = rng.uniform(-0.6, 0.8, (3, count))
    shapes, m, to_world = tilted(kind, rng, thickness=thickness, friction=0.3, vertices=count)
    s, free = state(p), rng.uniform(size=count) < 0.8
    collide(0, count, free, s, None, shapes, m, 1.0, 0, step)
    entered = free & (world_distance(kind, to_world, p) < thickness)
    assert 3 < entered.sum() < count - 3
    np.testing.assert_allclose(world_distance(kind, to_world, places(s))[entered], thickness, atol=1e-12)
    np.testing.assert_array_equal(places(s)[:, ~entered], p[:, ~entered])
    # At rest, so depth has not turned into speed.
    np.testing.assert_array_equal(speeds(s), 0.0)


@every_kind
def test_what_is_deep_inside_leaves_no_faster_than_it_may(rng: np.random.Generator, kind: Kind):
    count, thickness, step = 2 * TILE, 0.02, 0.01
    shapes, m, to_world = tilted(kind, rng, thickness=thickness, vertices=count)
    p = to_world[:, 3:] + 0.25 * rng.uniform(-1, 1, (3, count))
    s, free = state(p), np.ones(count, bool)
    before = world_distance(kind, to_world, p)
    for turn in range(3):
        collide(0, count, free, s, None, shapes, m, 1.0, turn, step)
    after = world_distance(kind, to_world, places(s))
    assert (before < thickness - 3 * contact.EXIT * step).sum() > 4
    np.testing.assert_allclose(
        after, np.where(before < thickness, np.minimum(before + 3 * contact.EXIT * step, thickness), before), atol=1e-12
    )
    np.testing.assert_array_equal(speeds(s), 0.0)


def test_only_the_asked_vertices_and_share_of_the_thickness_are_kept_out():
    count, thickness = 3 * TILE, 0.02
    shapes = record(to_plane, SIZES[to_plane], thickness=thickness, vertices=count)
    p = np.zeros((3, count))
    s = state(p)
    collide(TILE, 2 * TILE, np.ones(count, bool), s, None, shapes, still(), 0.5, 0, 0.1)
    np.testing.assert_allclose(s.z[TILE : 2 * TILE], 0.5 * thickness, atol=ROUNDING)
    np.testing.assert_array_equal(s.z[:TILE], 0.0)
    np.testing.assert_array_equal(s.z[2 * TILE :], 0.0)


@pytest.mark.parametrize("count", [1, 2, 3], ids=["one sphere", "two that overlap", "three in a row"])
def test_vertices_are_led_around_all_that_overlap(rng: np.random.Generator, count: int):
    size, thickness, step = 3 * TILE - 5, 0.02, 0.5
    centers = np.zeros((count, 3))
    centers[:, 0] = [0.0, 0.2, 0.65][:count]
    shapes = record(
        to_capsule, np.tile((0, 0.5, 0, 0), (count, 1)), thickness=thickness, origins=centers, vertices=size
    )
    # Beside the plane between two of them, where out is not far: nearer to their axis they pinch what is there.
    p = rng.uniform(-0.02, 0.02, (3, size))
    p[1] += 0.42
    p[0] += rng.choice([0.1, 0.425], size)
    s, free = state(p), rng.uniform(size=size) < 0.9
    collide(0, size, free, s, None, shapes, still(), 1.0, 0, step)

    def distance(points: FloatArray) -> FloatArray:
        return np.min([capsule_distance(points.T, c, c, 0.5) for c in centers], axis=0)

    entered = free & (distance(p) < thickness)
    assert TILE < entered.sum() < size
    # The way out of one may lead into another: what is left is no more than a vertex may graze.
    assert distance(places(s))[entered].min() > thickness - (contact.GRAZE if count > 1 else 0.0) - ROUNDING
    np.testing.assert_array_equal(places(s)[:, ~entered], p[:, ~entered])
    np.testing.assert_array_equal(speeds(s), 0.0)


def test_what_two_pinch_is_held_midway_moves_with_both_and_is_squeezed_out(rng: np.random.Generator):
    size, thickness, step, radius = TILE, 0.02, 1e-3, 0.5
    centers = np.array([[0.0, 0.0, 0.0], [0.7, 0.0, 0.0]])
    shapes = record(
        to_capsule,
        np.tile((0, radius, 0, 0), (2, 1)),
        thickness=thickness,
        origins=centers,
        bones=[0, 1],
        vertices=size,
    )
    motion = np.array([[0.3, -0.4, 0.2], [-0.5, 0.1, 0.0]])
    p = rng.uniform(-0.05, 0.05, (3, size))
    p[0] += 0.35
    v = rng.uniform(-1.0, 1.0, (3, size))
    s = state(p, v)
    collide(0, size, np.ones(size, bool), s, None, shapes, moving(motion, place=np.zeros((2, 3))), 1.0, 0, step)
    assert shapes.pinched.all()

    away = p.T[:, None] - centers
    normals = away / np.linalg.norm(away, axis=2, keepdims=True)
    gaps = np.linalg.norm(away, axis=2) - radius - thickness
    across = normals[:, 0] - normals[:, 1]
    twice = np.linalg.norm(across, axis=1)
    across /= twice[:, None]
    out = normals.sum(axis=1)
    wide = np.linalg.norm(out, axis=1)
    out /= wide[:, None]
    relative = v.T - motion.mean(axis=0)
    relative -= np.sum(relative * across, axis=1)[:, None] * across
    leaving = np.sum(relative * out, axis=1)
    needed = np.minimum(-gaps.sum(axis=1) / (wide * step), contact.EXIT)
    relative += np.clip(needed - leaving, 0.0, pinch.SQUEEZE * step)[:, None] * out
    velocity = motion.mean(axis=0) + relative
    moved = step * (velocity - v.T)
    most = contact.EXIT * step
    off = np.clip((gaps[:, 1] - gaps[:, 0]) / twice - np.sum(moved * across, axis=1), -most, most)
    np.testing.assert_allclose(speeds(s).T, velocity, atol=1e-12)
    np.testing.assert_allclose(places(s).T, p.T + moved + off[:, None] * across, atol=1e-12)


# -- what is measured --


@every_kind
def test_contacts_and_the_deepest_of_each_kind_of_shape(rng: np.random.Generator, kind: Kind):
    p, counted, thickness = rng.uniform(-1, 1, (3, 300)), rng.uniform(size=300) < 0.7, 0.1
    rotation, here = turn_about((0.6, 0.0, 0.8), 0.7), np.array([0.1, 0.2, -0.1])
    origins = rng.uniform(-0.5, 0.5, (2, 3))
    frames = quaternions.to_matrix(quaternions.normalize(rng.standard_normal((2, 4))))
    shapes = record(kind, [SIZES[kind]] * 2, thickness=thickness, origins=origins, frames=frames, bones=[0, 1])
    bones = np.array([here, [0.3, 0.0, 0.0]]), np.array([rotation, [1.0, 0.0, 0.0, 0.0]])

    def distances_to(c: int, points: FloatArray) -> FloatArray:
        in_bone = (points - bones[0][c]) @ quaternions.to_matrix(bones[1][c])
        return reference_distance(kind, SIZES[kind], (in_bone - origins[c]) @ frames[c])

    distances = np.array([distances_to(c, p.T) for c in range(2)])
    expected = [(i, c) for c in range(2) for i in np.flatnonzero(counted & (distances[c] < thickness + measure.NEAR))]
    deepest = -distances[:, counted].min(axis=1)

    vertices, colliders, places = np.full(700, -1), np.full(700, -1), np.zeros((700, 7))
    depth, which, count = measure.touching(
        measure.Touch(state(p), counted, shapes, still(2), *bones, vertices[:650], colliders[:650], places[:650])
    )
    assert (depth, which) == (pytest.approx(deepest.max(), abs=1e-12), np.argmax(deepest))
    assert len(expected) == count > 3
    assert list(zip(vertices[:count], colliders[:count], strict=True)) == expected
    for (i, c), row in zip(expected, places, strict=False):
        point, normal = row[:3], row[3:6]
        assert row[6] == pytest.approx(thickness - distances[c, i], abs=1e-12)
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-12)
        assert distances_to(c, point[None])[0] == pytest.approx(0.0, abs=1e-9)
        np.testing.assert_allclose(point + distances[c, i] * normal, p[:, i], atol=1e-12)

    # Too little room: what fits is the same, nothing is written beyond, and all are counted.
    few, of, at = np.full(700, -1), np.full(700, -1), np.zeros((700, 7))
    again = measure.touching(measure.Touch(state(p), counted, shapes, still(2), *bones, few[:3], of[:3], at[:3]))
    assert again == (depth, which, count)
    np.testing.assert_array_equal(few[:3], vertices[:3])
    np.testing.assert_array_equal(at[:3], places[:3])
    assert (few[3:] == -1).all()
    nothing = np.zeros(300, dtype=bool)
    none = measure.touching(measure.Touch(state(p), nothing, shapes, still(2), *bones, few, of, at))
    assert none == (0.0, -1, 0)


@pytest.mark.parametrize("explicit", [False, True], ids=["by its velocity", "from where it was"])
@pytest.mark.parametrize("kind", [to_capsule, to_tapered_capsule, to_box], ids=lambda k: k.__name__)
def test_what_springs_draw_past_the_middle_in_every_step_gets_out(kind: Kind, explicit: bool):
    # Springs to both sides draw it farther than to the middle: whichever side it is on, it would leave by the other.
    step, pull, thickness = 2e-4, 120.0, 0.005
    sizes = {
        to_capsule: (0.4, 0.1, 0.0, 0.0),
        to_tapered_capsule: tapered_sizes(0.5, 0.1, 0.1),
        to_box: (0.1, 0.4, 0.5, 0.0),
    }[kind]
    shapes = record(kind, sizes, thickness=thickness)
    s = state(np.array([[0.018], [0.0], [0.2 if kind is to_tapered_capsule else 0.0]]))
    turns = 2 + int((0.1 + thickness) / (contact.EXIT * step))
    for turn in range(turns):
        was = np.stack(s[:3])
        s.vx[:] = -pull * np.sign(s.x)
        s.x[:] += step * s.vx
        collide(0, 1, np.ones(1, bool), s, was if explicit else None, shapes, still(), 1.0, turn, step)
        assert (np.abs(s.x - was[0]) <= contact.EXIT * step * (1 + ROUNDING)).all()
    assert np.abs(s.x[0]) == pytest.approx(0.1 + thickness, abs=1e-6)
