"""Kernels that put vertices where bones hold them.

They also run with the compiler off: NUMBA_DISABLE_JIT=1.
"""

import numpy as np
import pytest

from cape.kernels.bones import Motion, MotionRoom
from cape.kernels.contact.shapes import MOMENT, Colliders
from cape.kernels.solve import attachments
from cape.kernels.solve.attachments import Attached
from cape.kernels.solve.lift import EXIT, SLACK, Ties, clear, lift_held
from cape.kernels.state import State
from motions import quaternions
from skeleton.shapes import Capsule, Plane
from tests.support.scenes import turn_about
from tests.support.shapes import FloatArray, moving, record, together

N = 20
# A few dozen operations on numbers near one.
ROUNDING = 1e-13


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


class Held:
    """Three vertices of twenty on two moving bones, lifted and drifting."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.p, self.v = rng.standard_normal((2, 3, N))
        points, lift, drift = rng.standard_normal((3, 3, 3))
        self.attached = Attached(np.array([3, 0, 7]), np.array([1, 0, 1]), points, lift, drift)
        velocity, spin, place = rng.standard_normal((3, 2, 3))
        matrix = quaternions.to_matrix(quaternions.normalize(rng.standard_normal((2, 4))))
        self.room: MotionRoom = moving(velocity, spin=spin, place=place, matrix=matrix)
        self.state = State(*(c.copy() for c in (*self.p, *self.v)))

    def place(self, k: int, time: float) -> FloatArray:
        """Where attachment k is held."""
        point, bone = self.attached.points[k], self.attached.bones[k]
        point = point + self.attached.lift[k] + time * self.attached.drift[k]
        return self.room.positions[bone] + self.room.matrices[bone] @ point

    @property
    def after(self) -> tuple[FloatArray, FloatArray]:
        return np.stack(self.state[:3]).astype(float), np.stack(self.state[3:]).astype(float)

    def own(self, lo: int, hi: int) -> list[tuple[int, int]]:
        """Attachments of vertices lo to hi, and those; nothing else has changed."""
        own = [(k, int(i)) for k, i in enumerate(self.attached.vertices) if lo <= i < hi]
        others = np.setdiff1d(np.arange(N), [i for _, i in own])
        np.testing.assert_array_equal(self.after[0][:, others], self.p[:, others])
        np.testing.assert_array_equal(self.after[1][:, others], self.v[:, others])
        return own


ranges = pytest.mark.parametrize(("lo", "hi"), [(0, N), (1, 7), (3, 4), (8, N)])


@ranges
def test_held_vertices_have_the_velocity_that_brings_them(rng: np.random.Generator, lo: int, hi: int):
    held, step, time = Held(rng), 0.01, 0.3
    attachments.hold(lo, hi, held.state, held.attached, held.room, time, step)
    x, u = held.after
    for k, i in held.own(lo, hi):
        there = held.place(k, time)
        np.testing.assert_allclose(x[:, i], there, atol=ROUNDING)
        # The step that came before has moved the vertex by its velocity.
        np.testing.assert_allclose(u[:, i], (there - (held.p[:, i] - step * held.v[:, i])) / step, atol=ROUNDING / step)


@ranges
def test_aim_gives_the_velocity_that_leads_there(rng: np.random.Generator, lo: int, hi: int):
    held, step, time = Held(rng), 0.01, 0.3
    attachments.aim(lo, hi, held.state, held.attached, held.room, time, step)
    x, u = held.after
    np.testing.assert_array_equal(x, held.p)
    for k, i in held.own(lo, hi):
        np.testing.assert_allclose(x[:, i] + step * u[:, i], held.place(k, time), atol=ROUNDING)


@ranges
def test_rigidly_held_vertices_move_with_their_place(rng: np.random.Generator, lo: int, hi: int):
    held, time, b, target = Held(rng), 0.3, 0.02, np.zeros((6, N))
    attachments.hold_rigidly(lo, hi, held.state, held.attached, held.room, time, b, target)
    x, u = held.after
    for k, i in held.own(lo, hi):
        there, bone = held.place(k, time), held.attached.bones[k]
        np.testing.assert_allclose(x[:, i], there, atol=ROUNDING)
        arm = there - held.room.positions[bone]
        velocity = held.room.velocity[bone] + np.cross(held.room.spin[bone], arm)
        if held.attached.drift is not None:
            velocity = velocity + held.room.matrices[bone] @ held.attached.drift[k]
        np.testing.assert_allclose(u[:, i], velocity, atol=ROUNDING)
        np.testing.assert_allclose(target[:3, i], there - b * velocity, atol=ROUNDING)
    others = np.setdiff1d(np.arange(N), [i for _, i in held.own(lo, hi)])
    np.testing.assert_array_equal(target[:, others], 0.0)
    np.testing.assert_array_equal(target[3:], 0.0)


# -- out of colliders --


def two_walls_and_a_ball(thickness: float) -> Colliders:
    """The ground and a wall at x = 0, and a ball of 0.1 m at the origin of bone 1; bone 0 stands still."""
    upright = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    walls = record(Plane, np.zeros((2, 4)), thickness=thickness, frames=[np.eye(3), upright])
    return together(walls, record(Capsule, (0, 0.1, 0, 0), thickness=thickness, bones=[1]))


def untied(count: int) -> Ties:
    """No threads between so many held vertices."""
    return tied(count, [], [])


def tied(count: int, pairs: list[tuple[int, int]], longest: list[float]) -> Ties:
    first, second = np.array(pairs, np.int64).reshape(-1, 2).T.copy()
    return Ties(first, second, np.array(longest, float), np.zeros((count, 3)), np.zeros((count, 3)))


def test_a_point_is_led_out_of_all_that_it_is_in():
    thickness, m = 0.01, moving(np.zeros((2, 3)), place=[[0, 0, 0], [0.05, 2.0, 0.05]])
    colliders = two_walls_and_a_ball(thickness)
    colliders.clock[MOMENT] += 1
    np.testing.assert_allclose(clear(-0.3, 5.0, -0.2, colliders, m), (thickness, 5.0, thickness), atol=1e-15)
    assert clear(0.5, 5.0, 0.5, colliders, m) == (0.5, 5.0, 0.5)
    # Out of the ball alone, straight away from its centre.
    out = np.array(clear(0.12, 2.0, 0.05, colliders, m))
    np.testing.assert_allclose(out, (0.05 + 0.11, 2.0, 0.05), atol=1e-15)
    # What the cloth can't meet in this frame isn't looked at.
    colliders.active[:2] = 1, 2
    assert clear(-0.3, 5.0, -0.2, colliders, m) == (-0.3, 5.0, -0.2)


def test_between_colliders_each_pass_leads_further_out():
    thickness, m = 0.01, moving(np.zeros((2, 3)), place=[[0, 0, 0], [0.09, 2.0, 0.09]])
    colliders = two_walls_and_a_ball(thickness)
    colliders.clock[MOMENT] += 1
    x, y, z = clear(0.0, 2.001, 0.0, colliders, m)
    ball = np.linalg.norm(np.array([x, y, z]) - [0.09, 2.0, 0.09]) - 0.1
    assert min(x, z, ball) > thickness - 0.005
    assert min(x, z) >= 0.0


def test_what_is_held_drifts_to_where_it_is_clear_at_the_frame_s_end():
    thickness, duration = 0.01, 1 / 60
    colliders = two_walls_and_a_ball(thickness)
    # A bone that comes down by 3 cm and turns by 90 degrees about the upright axis, far from the wall.
    place0, place1 = np.array([[0, 0, 0], [1.0, 0.0, 0.03]]), np.array([[0, 0, 0], [1.0, 0.0, 0.0]])
    turn0 = np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))
    turn1 = np.array([[1.0, 0.0, 0.0, 0.0], turn_about((0, 0, 1), np.pi / 2)])
    points = np.array([[0.3, 0.0, 0.005], [0.3, 0.0, 0.5], [0.3, 0.0, -1.0], [0.3, 0.0, 0.5], [0.0, 0.0, 0.5]])
    lift = np.zeros((5, 3))
    lift[3] = [0.01, 0.0, 0.02]
    attached = Attached(np.arange(5), np.array([1, 1, 1, 1, 0]), points, lift, np.full((5, 3), np.nan))
    before = lift.copy()
    m = MotionRoom.blank(2)
    lift_held(attached, untied(5), colliders, Motion(place0, turn0, place1, turn1), m, duration)
    assert attached.drift is not None
    expected = [
        [0.0, 0.0, 0.005 / duration],  # lacks 5 mm of the thickness above the ground
        [0.0, 0.0, 0.0],  # is clear
        [0.0, 0.0, EXIT],  # is deep below the ground
        -lift[3] / duration,  # was lifted, and need no longer be: back at 1.34 m/s
        [thickness / duration, 0.0, 0.0],  # of the bone that stands still, in the wall
    ]
    np.testing.assert_allclose(attached.drift, expected, atol=1e-12)
    np.testing.assert_array_equal(lift, before)
    # The bones are at the frame's end.
    np.testing.assert_array_equal(m.positions, place1)
    np.testing.assert_allclose(m.matrices, quaternions.to_matrix(turn1), atol=1e-15)


def test_the_drift_is_in_the_frame_of_the_bone():
    colliders = two_walls_and_a_ball(0.01)
    # A bone that lies on its side: its +X points down.
    turned = np.array([[1.0, 0.0, 0.0, 0.0], turn_about((0, 1, 0), np.pi / 2)])
    places = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    attached = Attached(np.array([0]), np.array([1]), np.array([[0.0, 0.2, 0.0]]), np.zeros((1, 3)), np.zeros((1, 3)))
    m = MotionRoom.blank(2)
    lift_held(attached, untied(1), colliders, Motion(places, turned, places, turned), m, 0.5)
    assert attached.drift is not None
    np.testing.assert_allclose(attached.drift, [[-0.01 / 0.5, 0.0, 0.0]], atol=1e-15)


def on_a_rail(count: int, spacing: float) -> FloatArray:
    """Points along X, the middle one at 1 mm beside the upright axis."""
    points = np.zeros((count, 3))
    points[:, 0] = spacing * (np.arange(count) - count // 2) + 0.001
    return points


def lifted_from_a_bar(count: int, ties: Ties, points: FloatArray, duration: float) -> FloatArray:
    """Goals of points in the world [m] that are lifted out of an upright bar of 2 cm, once that has had its time."""
    bar = record(Capsule, (2.0, 0.02, 0, 0), thickness=0.0, origins=[0.0, 0.0, -1.0])
    lift, drift = np.zeros((count, 3)), np.zeros((count, 3))
    attached = Attached(np.arange(count), np.zeros(count, np.int64), points, lift, drift)
    still = np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]])
    lift_held(attached, ties, bar, Motion(*still, *still), MotionRoom.blank(1), duration)
    return points + lift + duration * drift


def test_neighbours_on_either_side_of_a_limb_are_not_led_apart():
    points = np.array([[-0.005, 0.0, 0.0], [0.005, 0.0, 0.0]])
    apart = lifted_from_a_bar(2, untied(2), points, 1.0)
    np.testing.assert_allclose(apart, [[-0.02, 0, 0], [0.02, 0, 0]], atol=1e-12)
    together = lifted_from_a_bar(2, tied(2, [(0, 1)], [0.0104]), points, 1.0)
    np.testing.assert_allclose(np.linalg.norm(np.diff(together, axis=0)), 0.0104, rtol=1e-12)
    np.testing.assert_allclose(together.mean(axis=0), points.mean(axis=0), atol=1e-12)


def test_what_one_vertex_needs_is_spread_over_its_neighbours():
    count, spacing = 41, 0.01
    points = on_a_rail(count, spacing)
    points[:, 1] = 0.002
    longest = 1.04 * spacing
    ties = tied(count, [(k, k + 1) for k in range(count - 1)], [longest] * (count - 1))
    led = lifted_from_a_bar(count, ties, points, 1.0)
    lengths = np.linalg.norm(np.diff(led, axis=0), axis=1)
    alone = np.linalg.norm(np.diff(lifted_from_a_bar(count, untied(count), points, 1.0), axis=0), axis=1)
    assert alone.max() > 1.4 * spacing
    assert lengths.max() < longest * (1 + 2 * SLACK)
    # All of it is led to the side on which most of it was, and out.
    assert np.hypot(led[:, 0], led[:, 1]).min() > 0.02 - 1e-3
    # What is far away stays.
    np.testing.assert_array_equal(led[[0, -1]], points[[0, -1]])


def test_what_a_long_chain_needs_reaches_its_ends():
    """81 threads that give hardly at all, of which those in the bar need more than their neighbours have."""
    count, spacing = 81, 0.005
    points = on_a_rail(count, spacing)
    points[:, 1] = 0.002
    longest = 1.004 * spacing
    ties = tied(count, [(k, k + 1) for k in range(count - 1)], [longest] * (count - 1))
    led = lifted_from_a_bar(count, ties, points, 1.0)
    assert np.linalg.norm(np.diff(led, axis=0), axis=1).max() < longest * (1 + 2 * SLACK)


def test_what_bones_have_drawn_apart_may_stay_so():
    points = np.array([[0.1, 0.0, 0.0], [0.5, 0.0, 0.0]])
    led = lifted_from_a_bar(2, tied(2, [(0, 1)], [0.01]), points, 1.0)
    np.testing.assert_array_equal(led, points)
    points[0, 0] = 0.015
    led = lifted_from_a_bar(2, tied(2, [(0, 1)], [0.01]), points, 1.0)
    np.testing.assert_allclose(led, [[0.02, 0, 0], [0.5, 0, 0]], atol=1e-12)
