"""What contact leaves out of sight: nothing that touches, by brute force over random motions.

The kernels also run with the compiler off: NUMBA_DISABLE_JIT=1.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from cape.kernels.bones import MotionRoom
from cape.kernels.contact import watch
from cape.kernels.contact.faces import PIERCED, SHARE
from cape.kernels.contact.shapes import MOMENT, Colliders
from cape.kernels.contact.watch import GAIN, TILE
from cape.kernels.state import State
from motions import quaternions
from skeleton.shapes import Box, Capsule, Cylinder, Ellipsoid, Plane, TaperedCapsule
from tests.support.shapes import (
    KINDS,
    FloatArray,
    Kind,
    collide,
    faces_record,
    keep_out,
    kind_of,
    moving,
    record,
    reference_distance,
    tapered_sizes,
    together,
    touching,
)

FRAME = 1.0 / 60.0  # s
THICKNESS = 0.005  # m
every_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda k: k.__name__)


def random_sizes(kind: Kind, rng: np.random.Generator) -> tuple[float, ...]:
    if kind is Capsule:
        return (rng.choice([0.0, 0.3]), rng.uniform(0.02, 0.1), 0.0, 0.0)
    if kind is TaperedCapsule:
        return tapered_sizes(0.3, rng.uniform(0.02, 0.1), rng.uniform(0.02, 0.1))
    if kind is Box:
        return (*rng.uniform(0.02, 0.1, 3), 0.0)
    if kind is Cylinder:
        return (*rng.uniform(0.04, 0.15, 2), 0.0, 0.0)
    if kind is Ellipsoid:
        return (*rng.uniform(0.04, 0.15, 3), 0.0)
    return (0.0, 0.0, 0.0, 0.0)


@dataclass
class World:
    """Vertices in loose tiles and colliders on as many bones, in random motion for a frame.

    Vertices gain at most half of `GAIN` in the frame, and no bone turns so fast that a vertex gains the other half by
    coming nearer to its axis.
    """

    shapes: Colliders
    state: State
    places: FloatArray
    rotations: FloatArray
    velocity: FloatArray
    spin: FloatArray
    pull: FloatArray

    @classmethod
    def random(cls, kind: Kind, seed: int, *, speed: float, reach: float, cloth: float) -> "World":
        """Colliders within `reach` [m] and tiles within `cloth` [m], at up to `speed` [m/s]."""
        rng = np.random.default_rng(seed)
        count, tiles = 5, 3
        size = tiles * TILE - 3
        middles = np.repeat(rng.uniform(-cloth, cloth, (tiles, 3)), TILE, axis=0)[:size]
        drift = np.repeat(rng.uniform(-speed, speed, (tiles, 3)), TILE, axis=0)[:size]
        p = middles + rng.uniform(-0.04, 0.04, (size, 3))
        v = drift + rng.uniform(-0.5, 0.5, (size, 3))
        shapes = record(
            kind, [random_sizes(kind, rng) for _ in range(count)], thickness=THICKNESS, friction=0.2,
            bones=np.arange(count), origins=rng.uniform(-0.1, 0.1, (count, 3)),
            frames=quaternions.to_matrix(quaternions.normalize(rng.standard_normal((count, 4)))), vertices=size,
        )  # fmt: skip
        pull = rng.standard_normal((size, 3))
        return cls(
            shapes,
            State(*np.array(p.T), *np.array(v.T)),
            rng.uniform(-reach, reach, (count, 3)),
            quaternions.normalize(rng.standard_normal((count, 4))),
            rng.uniform(-speed, speed, (count, 3)),
            rng.uniform(-4.0, 4.0, (count, 3)),
            0.5 * GAIN / FRAME * pull / np.linalg.norm(pull, axis=1, keepdims=True),
        )

    def bones(self, time: float) -> MotionRoom:
        """Poses and speeds of the bones."""
        turned = quaternions.multiply(quaternions.from_rotation_vector(time * self.spin), self.rotations)
        return moving(
            self.velocity,
            spin=self.spin,
            place=self.places + time * self.velocity,
            matrix=quaternions.to_matrix(turned),
        )

    def fall(self, step: float) -> None:
        """Move the vertices on by a step, without contact."""
        for axis in range(3):
            self.state[3 + axis][:] += step * self.pull[:, axis]
            self.state[axis][:] += step * self.state[3 + axis]

    def distances(self, time: float) -> FloatArray:
        """Of all vertices from all colliders [m], (C, N)."""
        return self.distances_in([(self.points, self.bones(time))])[0]

    @property
    def points(self) -> FloatArray:
        """Where the vertices are [m], (N, 3)."""
        return np.stack(self.state[:3], axis=1).astype(float)

    def distances_in(self, moments: list[tuple[FloatArray, MotionRoom]]) -> FloatArray:
        """Of points (N, 3) from all colliders [m] in each of some moments, (M, C, N)."""
        found = [self.distance_of(moments, c).reshape(len(moments), -1) for c in range(len(self.shapes.records))]
        return np.stack(found, axis=1)

    def distance_of(self, moments: list[tuple[FloatArray, MotionRoom]], c: int) -> FloatArray:
        """Of points (N, 3) in each of some moments from a collider [m], (M N,)."""
        in_bone = np.concatenate([(points - m.positions[c]) @ m.matrices[c] for points, m in moments])
        in_shape = (in_bone - self.shapes.records.origin[c]) @ self.shapes.records.frame[c]
        kind, sizes = kind_of(self.shapes, c), self.shapes.records.sizes[c]
        if kind is Ellipsoid:  # by bisection, which test_distance.py holds against brute force
            return Ellipsoid(radii=sizes[:3]).distances(in_shape)
        return reference_distance(kind, sizes, in_shape)


@every_kind
def test_no_pair_that_comes_near_within_the_frame_is_left_out(kind: Kind):
    near = left_out = 0
    for seed in range(40):
        world = World.random(kind, seed, speed=2.0, reach=0.3, cloth=0.05)
        watch.begin(0, world.state.x.size, world.state, world.shapes, world.bones(0.0), FRAME)
        active = set(world.shapes.active[1 : 1 + world.shapes.active[0]].tolist())
        moments, steps = [(world.points, world.bones(0.0))], 8
        for k in range(1, steps + 1):
            world.fall(FRAME / steps)
            moments.append((world.points, world.bones(k * FRAME / steps)))
        touched = world.distances_in(moments).min(axis=(0, 2)) < THICKNESS
        assert set(np.flatnonzero(touched).tolist()) <= active
        near += int(touched.sum())
        left_out += len(touched) - len(active)
    assert near > 10
    # It is a choice, but for planes, which reach everywhere.
    assert left_out > 10 or kind is Plane


@pytest.mark.parametrize("speed", [0.0, 3.0, 30.0])
@pytest.mark.parametrize("moves", ["the ball", "the cloth"])
def test_a_collider_is_active_as_far_as_the_cloth_comes_in_a_frame(speed: float, moves: str):
    radius, size = 0.1, 3
    for share, active in ((0.99, 1), (1.01, 0)):
        gap = THICKNESS + share * (speed + GAIN) * FRAME
        shapes = record(Capsule, (0, radius, 0, 0), thickness=THICKNESS, vertices=size)
        s = State(*np.zeros((6, size)))
        s.vx[:] = speed if moves == "the cloth" else 0.0
        m = moving([[-speed if moves == "the ball" else 0.0, 0, 0]], place=[[radius + gap, 0, 0]])
        watch.begin(0, size, s, shapes, m, FRAME)
        assert shapes.active[0] == active


def test_a_frame_forgets_what_the_one_before_has_noted():
    size = 2 * TILE
    shapes = record(Capsule, (0, 0.1, 0, 0), thickness=THICKNESS, vertices=size)
    s, free = State(*np.zeros((6, size))), np.ones(size, bool)
    far, here = moving(np.zeros((1, 3)), place=[[1.0, 0.0, 0.0]]), moving(np.zeros((1, 3)), place=[[0.101, 0.0, 0.0]])
    for m, touched in ((far, False), (here, True)):
        watch.begin(0, size, s, shapes, m, 1.0)
        before = s.x.copy()
        collide(0, size, free, s, None, shapes, m, 1.0, 0, 0.001)
        assert (s.x != before).all() == touched


@every_kind
@pytest.mark.parametrize(("speed", "substeps"), [(1.0, 100), (6.0, 40), (6.0, 8)])
def test_what_sleeps_never_hides_a_contact(kind: Kind, speed: float, substeps: int):
    step, contacts, asleep = FRAME / substeps, 0, 0
    for seed in range(3 if substeps == 100 else 4):
        world = World.random(kind, seed, speed=speed, reach=0.25, cloth=0.25)
        count = world.state.x.size
        free = np.ones(count, bool)
        watch.begin(0, count, world.state, world.shapes, world.bones(0.0), FRAME)
        moments, moved = [], []
        for turn in range(substeps):
            world.fall(step)
            before, m = world.points, world.bones((turn + 1) * step)
            moments.append((before, m))
            asleep += int((world.shapes.wake > turn).sum())
            collide(0, count, free, world.state, None, world.shapes, m, 1.0, turn, step)
            moved.append((world.points != before).any(axis=1))
        inside = (world.distances_in(moments) < THICKNESS - 1e-9).any(axis=1)
        assert np.array(moved)[inside].all()
        contacts += int(inside.sum())
    assert contacts > 20
    assert asleep > 100 or substeps == 8


@pytest.mark.parametrize("kind", [Capsule, Box], ids=lambda k: k.__name__)
@pytest.mark.parametrize(("speed", "substeps"), [(1.0, 60), (6.0, 40)])
def test_triangles_that_sleep_never_hide_a_contact(kind: Kind, speed: float, substeps: int):
    step, contacts, asleep = FRAME / substeps, 0, 0
    u, v = np.divmod(np.arange(64), 8)
    weights = np.stack([u, v, 7 - u - v], axis=1)[u + v <= 7] / 7
    for seed in range(3):
        world = World.random(kind, seed, speed=speed, reach=0.18, cloth=0.18)
        rng, count = np.random.default_rng(seed), world.state.x.size
        corners = np.sort([TILE * (k // 12) + rng.choice(TILE - 3, 3, replace=False) for k in range(36)], axis=1)
        groups = np.arange(0, 37, 6)
        tiles = np.repeat(np.arange(3), 2)
        faces = faces_record(corners.T, groups, tiles, world.shapes)
        watch.begin(0, count, world.state, world.shapes, world.bones(0.0), FRAME)
        for turn in range(substeps):
            world.fall(step)
            m, before = world.bones((turn + 1) * step), np.stack(world.state[:3])
            points = np.einsum("wk,ktc->wtc", weights, before.T[corners.T])
            inside = np.zeros(len(corners), bool)
            for c in range(5):
                distances = world.distance_of([(points.reshape(-1, 3), m)], c).reshape(len(weights), -1).min(axis=0)
                deep = -0.9 * PIERCED * world.shapes.records.core[c]
                # The search for the deepest point may leave some tenths of a millimetre of these long triangles.
                inside |= (distances < SHARE * THICKNESS - 5e-4) & (distances > deep)
            asleep += int((faces.wake > turn).sum())
            pinched = world.shapes.pinched.copy()
            keep_out(touching(world.state, world.shapes, m), faces, turn, step)
            moved = (np.stack(world.state[:3]) != before).any(axis=0)
            # A triangle whose corner two capsules pinch gets as deep as that does.
            inside &= ~(pinched | world.shapes.pinched)[corners].any(axis=1)
            assert moved[corners[inside]].any(axis=1).all()
            contacts += int(inside.sum())
    assert contacts > 20
    assert asleep > 100


OBSTACLES = {
    Capsule: (0.0, 0.2, 0.0, 0.0),
    TaperedCapsule: tapered_sizes(0.3, 0.2, 0.1),
    Box: (0.2, 0.2, 0.2, 0.0),
    Plane: (0.0, 0.0, 0.0, 0.0),
    Cylinder: (0.2, 0.2, 0.0, 0.0),
    Ellipsoid: (0.2, 0.3, 0.25, 0.0),
}


@every_kind
def test_what_is_hit_hard_looks_around_at_once(kind: Kind):
    # A ball at 30 m/s throws a tile at rest towards an obstacle 5 cm away, which could have slept for 12 ms.
    size, step, speed, gap = TILE, 5e-4, 30.0, 0.05
    p = np.zeros((3, size))
    p[1] = np.linspace(-0.001, 0.001, size)
    s = State(*p, *np.zeros((3, size)))
    # Of the obstacle, +Z points back at the tile where it has a side there, and its middle lies behind its surface.
    back = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    matrix = back if kind is Plane else np.eye(3)
    middle = np.array([gap + (0.0 if kind is Plane else 0.2), 0.0, 0.0])

    # The ball is carried by bone 0, the obstacle by bone 1.
    ball = record(Capsule, (0.0, 0.05, 0.0, 0.0), thickness=THICKNESS, vertices=size)
    obstacle = record(
        kind, OBSTACLES[kind], thickness=THICKNESS, bones=[1], origins=middle, frames=[matrix], vertices=size
    )
    shapes = together(ball, obstacle)

    def bones(time: float) -> MotionRoom:
        """The ball hits in the second step, when the obstacle sleeps, and comes to a stop after 2 ms."""
        place = -0.08 + speed * min(time, 0.002)
        return moving([[speed if time <= 0.002 else 0.0, 0, 0], [0, 0, 0]], place=[[place, 0, 0], [0, 0, 0]])

    watch.begin(0, size, s, shapes, bones(0.0), FRAME)
    nearest = []
    for turn in range(24):
        s.x[:] += step * s.vx
        s.y[:] += step * s.vy
        m = bones((turn + 1) * step)
        keep_out(touching(s, shapes, m), None, turn, step)
        where = (np.stack(s[:3], axis=1).astype(float) - middle) @ matrix
        nearest.append(reference_distance(kind, OBSTACLES[kind], where).min())
    assert nearest[0] > gap - 1e-9
    assert 0.0 < min(nearest) < THICKNESS + 1e-3


@every_kind
def test_a_look_tells_who_is_inside_and_how_far_the_nearest_is(kind: Kind):
    insides = 0
    for seed in range(20):
        world = World.random(kind, seed, speed=0.0, reach=0.1, cloth=0.1)
        m = world.bones(0.0)
        world.shapes.clock[MOMENT] += 1
        watch.place(world.shapes, 1, m)
        gaps = world.distances(0.0)[1, :TILE] - THICKNESS
        gap = watch.look(world.shapes, 1, world.state, 0, TILE, THICKNESS)
        np.testing.assert_allclose(world.shapes.points.gaps[:TILE], gaps, atol=1e-9)
        assert gap == pytest.approx(gaps.min(), abs=1e-9)
        insides += gap < 0.0
    assert insides > 0


def test_a_nap_ends_before_what_speeds_up_has_come():
    rng = np.random.default_rng(5)
    for _ in range(1000):
        gap, speed, step = 10.0 ** rng.uniform((-6, -3, -5), (0, 2, -2))
        speed *= rng.choice([0.0, 1.0])
        turns = watch.nap(gap, speed, step)

        def way(time: float, speed: float = speed) -> float:
            """What is covered in a time at a speed that grows at `RISE`, and by `GAIN` at most."""
            return min(speed * time + watch.RISE * time**2 / 2, (speed + GAIN) * time)

        assert way((turns - 1) * step) <= gap * (1 + 1e-9)
        assert way(turns * step) >= gap * (1 - 1e-9) or turns > watch.LONGEST
    assert watch.nap(0.0, 1.0, 1.0) == watch.nap(-1e-3, 0.0, 1.0) == 1


def test_the_spread_bounds_all_of_a_tile():
    rng = np.random.default_rng(2)
    s = State(*rng.standard_normal((6, 40)))
    far, fast = watch.spread(s, 8, 24)
    middle = 16
    p, v = np.stack(s[:3]), np.stack(s[3:])
    assert far == pytest.approx(np.linalg.norm(p[:, 8:24] - p[:, [middle]], axis=0).max())
    assert fast == pytest.approx(np.linalg.norm(v[:, 8:24] - v[:, [middle]], axis=0).max())


def test_the_approach_bounds_the_speed_of_all_of_a_tile_against_a_bone():
    rng = np.random.default_rng(2)
    # All together, and each cause by itself.
    for scales in np.repeat([(1, 1, 1), (0, 1, 0), (1, 0, 0), (0, 0, 1)], 10, axis=0):
        s = State(*rng.standard_normal((3, TILE)), *(scales[0] * rng.standard_normal((3, TILE))))
        velocity, spin, place = rng.standard_normal((3, 2, 3))
        velocity, spin = scales[1] * velocity, scales[2] * spin
        m = moving(velocity, spin=spin, place=place)
        far, fast = watch.spread(s, 0, TILE)
        bound = watch.approach(s, TILE // 2, far, fast, 1, m)
        p, v = np.stack(s[:3], axis=1), np.stack(s[3:], axis=1)
        against = np.linalg.norm(v - velocity[1] - np.cross(spin[1], p - place[1]), axis=1)
        assert against.max() <= bound


def test_tiles_of_a_thread():
    assert watch.tiles(0, 5 * TILE) == (0, 5)
    assert watch.tiles(2 * TILE, 4 * TILE + 1) == (2, 5)
    assert watch.tiles(4 * TILE, 4 * TILE) == (4, 4)
