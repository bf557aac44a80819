"""Vertices that pass through a whole shape in one step, against the first point where their way meets it.

The kernels also run with the compiler off: NUMBA_DISABLE_JIT=1.
"""

import numpy as np
import pytest

from cape.kernels.contact import contact
from cape.kernels.contact.distance import to_box, to_capsule, to_plane, to_tapered_capsule
from cape.kernels.jit import formula_of, routine
from cape.kernels.state import State
from motions import quaternions
from tests.support.shapes import FloatArray, collide, moving, record, reference_distance, tapered_sizes

STEP = 1.0 / 60.0 / 8.0  # s
THICKNESS = 0.005  # m
SKIN = contact.SKIN * THICKNESS
COUNT = 48

SIZES = {
    "arm": (to_capsule, (0.5, 0.04, 0.0, 0.0)),
    "rod": (to_capsule, (0.5, 0.005, 0.0, 0.0)),
    "ball": (to_capsule, (0.0, 0.06, 0.0, 0.0)),
    "thigh": (to_tapered_capsule, tapered_sizes(0.5, 0.08, 0.04)),
    "cone": (to_tapered_capsule, tapered_sizes(0.3, 0.005, 0.1)),
    "board": (to_box, (0.2, 0.01, 0.3, 0.0)),
    "cube": (to_box, (0.1, 0.1, 0.1, 0.0)),
    "wall": (to_plane, (0.0, 0.0, 0.0, 0.0)),
}
every_shape = pytest.mark.parametrize("name", SIZES)


class Shots:
    """Vertices shot at or past a shape that moves and turns, seen from the shape: a way from `start` to `end` each."""

    def __init__(self, name: str, spin: float, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.kind, self.sizes = SIZES[name]
        self.shapes = record(self.kind, self.sizes, thickness=THICKNESS, vertices=COUNT)
        # Ways of one to six radii that meet places in and around the shape in their middle half.
        core = min(float(self.shapes.records.core[0]), 0.1)
        target = self.near(rng, core)
        way = rng.standard_normal((COUNT, 3))
        way *= core * rng.uniform(1.2, 6.0, (COUNT, 1)) / np.linalg.norm(way, axis=1, keepdims=True)
        self.start = target - rng.uniform(0.25, 0.75, (COUNT, 1)) * way
        self.end = self.start + way
        # A bone that moves and turns, and where it is at both ends of the step.
        velocity, axis = rng.uniform(-5, 5, 3), rng.standard_normal(3)
        omega = spin * axis / np.linalg.norm(axis)
        rotation = quaternions.normalize(rng.standard_normal(4))
        earlier = quaternions.multiply(quaternions.from_rotation_vector(-STEP * omega), rotation)
        origin, frame = rng.uniform(-0.1, 0.1, 3), quaternions.to_matrix(quaternions.normalize(rng.standard_normal(4)))
        place = rng.uniform(-0.5, 0.5, 3)
        self.after = quaternions.to_matrix(rotation) @ frame, place + quaternions.rotate(rotation, origin)
        before = quaternions.to_matrix(earlier) @ frame, place - STEP * velocity + quaternions.rotate(earlier, origin)
        self.m = moving([velocity], spin=[omega], place=[place], matrix=[quaternions.to_matrix(rotation)])
        self.old = self.start @ before[0].T + before[1]
        new = self.end @ self.after[0].T + self.after[1]
        self.state = State(*new.T.copy(), *((new - self.old) / STEP).T.copy())
        self.shapes.records.origin[:], self.shapes.records.frame[:] = origin, frame

    def near(self, rng: np.random.Generator, core: float) -> FloatArray:
        """Places in the shape and not far from it."""
        found = np.zeros((0, 3))
        while len(found) < COUNT:
            tried = rng.uniform(-0.6, 0.6, (2000, 3))
            found = np.concatenate([found, tried[self.distance(tried) < core + 2 * THICKNESS]])
        return found[:COUNT]

    def collide(self, earlier: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Positions after contact, seen from the shape, and velocities against the shape's surface there."""
        collide(0, COUNT, np.ones(COUNT, bool), self.state, earlier, self.shapes, self.m, 1.0, 0, STEP)
        points, speeds = np.stack(self.state[:3], axis=1), np.stack(self.state[3:], axis=1)
        surface = self.m.velocity[0] + np.cross(self.m.spin[0], points - self.m.positions[0])
        return (points - self.after[1]) @ self.after[0], (speeds - surface) @ self.after[0]

    def distance(self, points: FloatArray) -> FloatArray:
        return reference_distance(self.kind, self.sizes, points)

    def along(self, share: FloatArray) -> FloatArray:
        return self.start + share[:, None] * (self.end - self.start)

    def first_hits(self) -> tuple[FloatArray, FloatArray]:
        """Least distance along each way [m], and the share at which it first comes down to the skin.

        The distance along a way is convex: ternary search for its least, then bisection on the way down to it.
        """
        low, high = np.zeros(COUNT), np.ones(COUNT)
        for _ in range(45):
            one, two = low + (high - low) / 3, high - (high - low) / 3
            down = self.distance(self.along(one)) < self.distance(self.along(two))
            low, high = np.where(down, low, one), np.where(down, two, high)
        least, nearest = self.distance(self.along(high)), high
        low = np.zeros(COUNT)
        for _ in range(45):
            middle = (low + high) / 2
            over = self.distance(self.along(middle)) > SKIN
            low, high = np.where(over, middle, low), np.where(over, high, middle)
        return np.minimum(least, self.distance(self.along(nearest))), low


@routine
def carried(x, y, z, step, m):
    """Where a point at the start of a step would be at its end, moved along with the first bone."""
    return contact.carried(x, y, z, 0, contact.turn_of(0, step, m), step, m)


def test_what_a_bone_carries_moves_and_turns_with_it():
    rng = np.random.default_rng(3)
    for angle in (0.0, 1e-9, 0.01, 1.0, 3.0):
        axis, velocity, place, point = rng.standard_normal((4, 3))
        axis /= np.linalg.norm(axis)
        m = moving([velocity], spin=[angle / STEP * axis], place=[place])
        found = carried(*map(float, point), STEP, m)
        turned = quaternions.rotate(quaternions.from_rotation_vector(angle * axis), point - (place - STEP * velocity))
        np.testing.assert_allclose(found, place + turned, atol=1e-13)


@every_shape
@pytest.mark.parametrize("spin", [0.0, 20.0], ids=["carried", "turning"])
@pytest.mark.parametrize("slower", [None, 0.7], ids=["by its velocity", "from where it was"])
def test_what_crosses_a_shape_stays_before_the_plane_that_it_hits(name: str, spin: float, slower: float | None):
    if name == "wall" and slower is not None:
        pytest.skip("behind a wall is no other side: what is left of the depth goes as fast as it may")
    hits = passed = misses = 0
    for seed in range(4):
        shots = Shots(name, spin, seed)
        least, share = shots.first_hits()
        hit = (shots.distance(shots.start) > SKIN + 1e-4) & (least < SKIN - 1e-4)
        missed = least > THICKNESS
        earlier = None
        if slower is not None:
            # As in TR-BDF2, whose velocity at a step's end isn't the way over the time.
            earlier = shots.old.T.copy()
            for component in shots.state[3:]:
                component *= slower
        before = np.stack(shots.state)
        points, against = shots.collide(earlier)
        where = shots.along(share)
        normals = np.array([formula_of(shots.kind)(*p, *shots.sizes)[1:] for p in where])
        # Within the thickness, contact moves it along the normal there, which may be another one.
        ahead = np.sum((points - where) * normals, axis=1)
        assert (ahead[hit] > -THICKNESS).all()
        assert (shots.distance(points)[hit] > SKIN - 2 * contact.ARRIVED).all()
        # Nothing goes on inwards. Both find the place of the hit to 1e-5 m, over which the normal of the thinnest shape
        # turns by 2e-3; the speed of a turning surface changes by spin x way from there to where the vertex ends.
        inwards, way = -np.sum(against * normals, axis=1), np.linalg.norm(shots.end - shots.start, axis=1)
        assert (inwards[hit] < 1e-3 * way[hit] / STEP + spin * way[hit]).all()
        np.testing.assert_array_equal(np.stack(shots.state)[:, missed], before[:, missed])
        hits += int(hit.sum())
        passed += int((hit & (shots.distance(shots.end) > 0)).sum())
        misses += int(missed.sum())
    assert min(hits, misses) > 5
    assert passed > 3 or name == "wall"
