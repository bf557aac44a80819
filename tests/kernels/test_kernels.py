"""Kernels against slow loops over their formulas, on random arrays, without any of the package's objects.

They also run with the compiler off: NUMBA_DISABLE_JIT=1.
"""

import numpy as np
import pytest

from cape.kernels import bones
from cape.kernels.bones import Motion, MotionRoom
from cape.kernels.cloth import measure
from cape.kernels.solve import euler
from motions import quaternions

ROWS, COLUMNS = 5, 4
N = ROWS * COLUMNS
# A few dozen operations on numbers near one.
ROUNDING = 1e-13


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def grid_points(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Positions of a crumpled grid of unit cells and velocities, each of shape (3, N)."""
    y, x = np.divmod(np.arange(N, dtype=float), COLUMNS)
    return np.stack([x, y, 0 * x]) + 0.3 * rng.standard_normal((3, N)), rng.standard_normal((3, N))


def test_advance_takes_a_step_of_symplectic_euler(rng: np.random.Generator):
    p, v = grid_points(rng)
    forces, weights, gravity, dt = rng.standard_normal((3, N)), rng.uniform(1, 2, N), (0.1, 0.2, -9.0), 0.01
    following = v + dt * (weights * forces + np.array(gravity)[:, None])
    x, u = p.copy(), v.copy()
    euler.step_all(dt, *gravity, weights, *forces, *x, *u)
    np.testing.assert_allclose(u, following, atol=ROUNDING)
    np.testing.assert_allclose(x, p + dt * following, atol=ROUNDING)


def random_motion(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    turns = quaternions.normalize(rng.standard_normal((2, count, 4)))
    places = rng.standard_normal((2, count, 3))
    return places[0], turns[0], places[1], turns[1]


def test_bones_end_where_they_are_sent_and_turn_evenly(rng: np.random.Generator):
    count, duration, substeps = 6, 0.1, 7
    motion = Motion(*random_motion(rng, count))
    # One bone does not turn at all, and one is given as the opposite quaternion of nearly the same turn.
    motion[3][0] = motion[1][0]
    motion[3][1] = -quaternions.normalize(motion[1][1] + 1e-3)
    room = MotionRoom.blank(count)
    matrices, velocity, spin, positions = room.matrices, room.velocity, room.spin, room.positions
    bones.start_motion(motion, room, duration, substeps)
    np.testing.assert_array_equal(positions, motion[0])
    np.testing.assert_allclose(matrices, quaternions.to_matrix(motion[1].astype(float)), atol=ROUNDING)
    before = matrices.copy()
    for k in range(1, substeps + 1):
        before[:] = matrices
        bones.move_bones(motion, room, k * duration / substeps)
        share = k / substeps
        np.testing.assert_allclose(positions, (1 - share) * motion[0] + share * motion[2], atol=ROUNDING)
        along = quaternions.slerp(motion[1].astype(float), motion[3].astype(float), np.full(count, share))
        np.testing.assert_allclose(matrices, quaternions.to_matrix(along), atol=ROUNDING)
    np.testing.assert_allclose(velocity, (motion[2] - motion[0]) / duration, atol=ROUNDING / duration)
    # Over a turn by the angle a, a point moves by 2 tan(a / 2) times the axis crossed with the middle of both places.
    half = np.linalg.norm(spin, axis=1) * duration / substeps / 2
    for b in range(1, count):
        crossed = np.cross(spin[b], ((before + matrices) / 2)[b].T).T
        rate = (matrices - before)[b] * substeps / duration
        np.testing.assert_allclose(rate, crossed * np.tan(half[b]) / half[b], atol=1e-10)
    assert np.abs(spin[0]).max() < 1e-12


def test_whereabouts_and_what_is_not_sound(rng: np.random.Generator):
    p, v = grid_points(rng)
    *center, sound = measure.whereabouts(*p, *v, 100.0, 50.0)
    assert sound
    np.testing.assert_allclose(center, p.mean(axis=1), atol=ROUNDING)
    for component in range(6):
        for value in (np.nan, -np.inf, 101.0):
            state = [*p.copy(), *v.copy()]
            state[component][3] = value
            assert not measure.whereabouts(*state, 100.0, 50.0)[3]


def test_strain_and_its_histogram(rng: np.random.Generator):
    p, _ = grid_points(rng)
    first, second, rest = np.array([0, 1, 2, 3]), np.array([1, 2, 3, 3]), rng.uniform(0.5, 3, 4)
    histogram = np.zeros(measure.BINS, dtype=np.int64)
    largest = measure.strain(*p, first, second, rest, histogram)
    strains = np.linalg.norm(p[:, second] - p[:, first], axis=0) / rest - 1
    assert largest == pytest.approx(strains.max(), abs=ROUNDING)
    bins = (np.clip(strains, 0, measure.WIDEST * (1 - 1e-9)) / measure.WIDEST * measure.BINS).astype(int)
    np.testing.assert_array_equal(histogram, np.bincount(bins, minlength=measure.BINS))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_strained_spring_of_a_grid_is_found_wherever_it_is(rng: np.random.Generator, dtype: type):
    rows, columns = 7, 5
    offsets = np.array([1, columns, columns + 1, columns - 1])
    places = np.stack([*np.divmod(np.arange(rows * columns), columns), np.zeros(rows * columns)]).astype(dtype)
    present = np.array([[np.hypot(*(places[:2, i + o] - places[:2, i])) < 1.5 if i + o < rows * columns else False
                         for i in range(rows * columns)] for o in offsets])  # fmt: skip
    assert present.sum() == rows * (columns - 1) + (rows - 1) * columns + 2 * (rows - 1) * (columns - 1)
    x, y, z = places + rng.normal(0.0, 0.1, places.shape).astype(dtype)
    squared = np.full(present.shape, np.inf, dtype)
    for f, i in zip(*np.nonzero(present), strict=True):
        j = i + offsets[f]
        squared[f, i] = 1.001 * ((x[j] - x[i]) ** 2 + (y[j] - y[i]) ** 2 + (z[j] - z[i]) ** 2)
    assert not measure.is_grid_strained(x, y, z, offsets, squared)
    for f, i in zip(*np.nonzero(present), strict=True):
        one = squared.copy()
        one[f, i] *= 0.998
        assert measure.is_grid_strained(x, y, z, offsets, one)


def test_kinetic_energy(rng: np.random.Generator):
    _, v = grid_points(rng)
    mass = rng.uniform(1, 2, N)
    assert measure.kinetic_energy(mass, *v) == pytest.approx(0.5 * mass @ (v**2).sum(axis=0), rel=ROUNDING)
