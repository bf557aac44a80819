"""Kernels against slow loops over their formulas, on random arrays, without any of the package's objects.

They also run with the compiler off: NUMBA_DISABLE_JIT=1.
"""

import numpy as np
import pytest

from cape.kernels import bones, grid, measure, xpbd
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


def belongs(offset_columns: int, offset_rows: int) -> np.ndarray:
    """Whether the vertex that far from each is on the grid, shape (N,)."""
    row, column = np.divmod(np.arange(N), COLUMNS)
    column, row = column + offset_columns, row + offset_rows
    return (column >= 0) & (column < COLUMNS) & (row < ROWS)


@pytest.mark.parametrize(("across", "down"), [(1, 0), (0, 1), (1, 1), (-1, 1)])
def test_spring_forces(rng: np.random.Generator, across: int, down: int):
    p, v = grid_points(rng)
    offset, tau = down * COLUMNS + across, 0.1
    stiffness = np.where(belongs(across, down), rng.uniform(1, 2, N), 0.0)
    rest = rng.uniform(0.5, 1.5, N)
    forces, room = np.zeros((3, N)), np.zeros((3, N))
    grid.spring_forces(offset, *p, *v, stiffness, rest, tau, 1e-18, *room)
    grid.add_spring_forces(offset, *room, *forces)
    expected = np.zeros((3, N))
    for i in np.flatnonzero(stiffness):
        d, r = p[:, i + offset] - p[:, i], v[:, i + offset] - v[:, i]
        length = np.linalg.norm(d)
        u = d / length
        force = stiffness[i] * (length - rest[i] + tau * (r @ u)) * u
        expected[:, i] += force
        expected[:, i + offset] -= force
    np.testing.assert_allclose(forces, expected, atol=ROUNDING)


def test_a_spring_of_no_length_pulls_nowhere():
    zero, room = np.zeros(2), np.zeros((3, 2))
    grid.spring_forces(1, zero, zero, zero, zero, zero, zero, np.ones(2), np.ones(2), 0.1, 1e-18, *room)
    np.testing.assert_array_equal(room, 0.0)


@pytest.mark.parametrize("offset", [1, COLUMNS], ids=["across", "down"])
def test_bend_forces_are_minus_the_gradient_of_their_energy(rng: np.random.Generator, offset: int):
    (p, *_), (v, *_) = grid_points(rng)
    across = offset == 1
    stiffness = np.where(belongs(2 * across, 2 * (not across)), rng.uniform(1, 2, N), 0.0)
    tau = 0.1
    force, room = np.zeros(N), np.zeros(N)
    grid.add_bend_forces(offset, p, v, stiffness, tau, room, force)
    second = np.zeros((N, N))
    for i in np.flatnonzero(stiffness):
        second[i, [i, i + offset, i + 2 * offset]] = 1, -2, 1
    # E = 1/2 k (D p)^2, so f = -D^T k D p, and the same of the velocities for damping.
    np.testing.assert_allclose(force, -second.T @ (stiffness * (second @ (p + tau * v))), atol=ROUNDING)


def test_air_forces(rng: np.random.Generator):
    p, v = grid_points(rng)
    wind, density, drag, lift = np.array([1.0, -2.0, 0.5]), 1.2, 1.1, 0.6
    cells = belongs(1, 1).astype(float)
    room, forces = np.zeros((6, N)), np.zeros((3, N))
    grid.air_forces(COLUMNS, *p, *v, cells, *wind, 1 / 3, density * drag / 12, density * lift / 12, 1e-12, *room)
    for axis in range(3):
        grid.add_air_forces(COLUMNS, room[axis], room[3 + axis], forces[axis])
    expected = np.zeros((3, N))
    for i in np.flatnonzero(cells):
        for corners in ([i, i + 1, i + COLUMNS], [i + COLUMNS + 1, i + COLUMNS, i + 1]):
            a, b, c = p[:, corners].T
            doubled = np.cross(b - a, c - a)
            area, n = np.linalg.norm(doubled) / 2, doubled / np.linalg.norm(doubled)
            u = wind - v[:, corners].mean(axis=1)
            n = n if n @ u > 0 else -n
            speed = np.linalg.norm(u)
            force = density / 2 * area * (n @ u) * (drag * u + lift * (speed * n - (n @ u) / speed * u))
            expected[:, corners] += force[:, None] / 3
    # `tiny` of 1e-12 in squares near one.
    np.testing.assert_allclose(forces, expected, atol=1e-11)


def test_air_exerts_nothing_where_there_is_no_flow_or_no_area():
    p, q, zero = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0)
    assert grid.triangle_air_force(*p, *q, *zero, 0.1, 0.1, 1e-12) == (0.0, 0.0, 0.0)
    assert grid.triangle_air_force(*p, *p, 1.0, 2.0, 3.0, 0.1, 0.1, 1e-12) == (0.0, 0.0, 0.0)


def test_advance_and_predict_take_the_same_step(rng: np.random.Generator):
    p, v = grid_points(rng)
    forces, weights, gravity, dt = rng.standard_normal((3, N)), rng.uniform(1, 2, N), (0.1, 0.2, -9.0), 0.01
    following = v + dt * (weights * forces + np.array(gravity)[:, None])
    for take_step in (grid.advance, xpbd.predict):
        x, u, f, old = p.copy(), v.copy(), forces.copy(), np.zeros((3, N))
        rooms = () if take_step is grid.advance else tuple(old)
        take_step(dt, *gravity, weights, *f, *x, *u, *rooms)
        np.testing.assert_allclose(u, following, atol=ROUNDING)
        np.testing.assert_allclose(x, p + dt * following, atol=ROUNDING)
        np.testing.assert_array_equal(f, 0.0)
        if rooms:
            np.testing.assert_array_equal(old, p)
            xpbd.update_velocity(dt, *old, *x, *u)
            np.testing.assert_allclose(u, following, atol=ROUNDING / dt)


def test_stretch_constraints_one_after_the_other(rng: np.random.Generator):
    p, v = grid_points(rng)
    first, second = np.array([0, 1, 5, 2, 6, 7]), np.array([1, 2, 6, 6, 7, 7])
    rest, compliance = rng.uniform(0.5, 1.5, 6), rng.uniform(0.0, 1e-3, 6)
    weights = rng.uniform(1, 2, N)
    weights[[2, 6]] = 0.0
    tau, h = 0.02, 0.01
    old, lagrange = p - h * v, np.zeros(6)
    expected, multipliers = p.copy(), np.zeros(6)
    x = p.copy()
    for _ in range(2):
        xpbd.solve_stretch(first, second, rest, compliance, weights, tau, h, lagrange, *x, *old)
        for k, (i, j) in enumerate(zip(first, second, strict=True)):
            d = expected[:, j] - expected[:, i]
            length = np.linalg.norm(d)
            if length == 0 or weights[i] + weights[j] == 0:
                continue
            u = d / length
            # Macklin 2016, eq. 26, with alpha~ = 1 / k h^2 and gamma = tau / h.
            alpha, gamma = compliance[k] / h**2, tau / h
            moved = u @ (expected[:, j] - old[:, j] - expected[:, i] + old[:, i])
            change = -(length - rest[k]) - alpha * multipliers[k] - gamma * moved
            change /= (1 + gamma) * (weights[i] + weights[j]) + alpha
            multipliers[k] += change
            expected[:, i] -= weights[i] * change * u
            expected[:, j] += weights[j] * change * u
    np.testing.assert_allclose(x, expected, atol=ROUNDING)
    np.testing.assert_allclose(lagrange, multipliers, atol=ROUNDING)
    assert (x[:, [2, 6]] == p[:, [2, 6]]).all()


def test_bend_constraints_one_after_the_other(rng: np.random.Generator):
    (p, *_), (v, *_) = grid_points(rng)
    triples = np.array([[0, 1, 2], [1, 2, 3], [8, 4, 0], [5, 6, 7]])
    compliance, weights = rng.uniform(0.0, 1e-3, 4), rng.uniform(1, 2, N)
    weights[[5, 6, 7]] = 0.0
    tau, h = 0.02, 0.01
    old, lagrange, x = p - h * v, np.zeros(4), p.copy()
    xpbd.solve_bend(*(np.ascontiguousarray(t) for t in triples.T), compliance, weights, tau, h, lagrange, x, old)
    expected, gradient = p.copy(), np.array([1.0, -2.0, 1.0])
    for k, triple in enumerate(triples):
        w = weights[triple]
        if w.sum() == 0:
            continue
        alpha, gamma = compliance[k] / h**2, tau / h
        change = -gradient @ expected[triple] - gamma * gradient @ (expected[triple] - old[triple])
        change /= (1 + gamma) * (w @ gradient**2) + alpha
        expected[triple] += w * gradient * change
    np.testing.assert_allclose(x, expected, atol=ROUNDING)


def random_motion(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    turns = quaternions.normalize(rng.standard_normal((2, count, 4)))
    places = rng.standard_normal((2, count, 3))
    return places[0], turns[0], places[1], turns[1]


def test_bones_end_where_they_are_sent_and_turn_evenly(rng: np.random.Generator):
    count, duration, substeps = 6, 0.1, 7
    motion = random_motion(rng, count)
    # One bone does not turn at all, and one is given as the opposite quaternion of nearly the same turn.
    motion[3][0] = motion[1][0]
    motion[3][1] = -quaternions.normalize(motion[1][1] + 1e-3)
    matrices, turns, velocity, spin, positions = bones.blank_motion(count)
    bones.start_motion(*motion, duration, substeps, matrices, turns, velocity, spin)
    np.testing.assert_allclose(matrices, quaternions.to_matrix(motion[1]), atol=ROUNDING)
    before = matrices.copy()
    for k in range(1, substeps + 1):
        before[:] = matrices
        bones.move_bones(motion[0], velocity, turns, k * duration / substeps, positions, matrices)
        share = k / substeps
        np.testing.assert_allclose(positions, (1 - share) * motion[0] + share * motion[2], atol=ROUNDING)
        along = quaternions.slerp(motion[1], motion[3], np.full(count, share))
        np.testing.assert_allclose(matrices, quaternions.to_matrix(along), atol=ROUNDING)
    np.testing.assert_allclose(velocity, (motion[2] - motion[0]) / duration, atol=ROUNDING / duration)
    # Over a turn by the angle a, a point moves by 2 tan(a / 2) times the axis crossed with the middle of both places.
    half = np.linalg.norm(spin, axis=1) * duration / substeps / 2
    for b in range(1, count):
        crossed = np.cross(spin[b], ((before + matrices) / 2)[b].T).T
        rate = (matrices - before)[b] * substeps / duration
        np.testing.assert_allclose(rate, crossed * np.tan(half[b]) / half[b], atol=1e-10)
    assert np.abs(spin[0]).max() < 1e-12


def test_hold_puts_vertices_on_bones_with_the_velocity_that_brings_them(rng: np.random.Generator):
    p, v = grid_points(rng)
    held, of_bone, points = np.array([3, 0, 7]), np.array([1, 0, 1]), rng.standard_normal((3, 3))
    place, _, _, turn = random_motion(rng, 2)
    matrices, step = quaternions.to_matrix(turn), 0.01
    x, u = p.copy(), v.copy()
    bones.hold(held, of_bone, points, step, place, matrices, *x, *u)
    for k, i in enumerate(held):
        there = place[of_bone[k]] + matrices[of_bone[k]] @ points[k]
        np.testing.assert_allclose(x[:, i], there, atol=ROUNDING)
        # The step that came before has moved the vertex by its velocity.
        np.testing.assert_allclose(u[:, i], (there - (p[:, i] - step * v[:, i])) / step, atol=ROUNDING / step)
    others = np.setdiff1d(np.arange(N), held)
    np.testing.assert_array_equal(x[:, others], p[:, others])


def test_strain_and_its_histogram(rng: np.random.Generator):
    p, _ = grid_points(rng)
    first, second, rest = np.array([0, 1, 2, 3]), np.array([1, 2, 3, 3]), rng.uniform(0.5, 3, 4)
    histogram = np.zeros(measure.BINS, dtype=np.int64)
    largest = measure.strain(*p, first, second, rest, histogram)
    strains = np.linalg.norm(p[:, second] - p[:, first], axis=0) / rest - 1
    assert largest == pytest.approx(strains.max(), abs=ROUNDING)
    bins = (np.clip(strains, 0, measure.WIDEST * (1 - 1e-9)) / measure.WIDEST * measure.BINS).astype(int)
    np.testing.assert_array_equal(histogram, np.bincount(bins, minlength=measure.BINS))


def test_kinetic_energy(rng: np.random.Generator):
    _, v = grid_points(rng)
    mass = rng.uniform(1, 2, N)
    assert measure.kinetic_energy(mass, *v) == pytest.approx(0.5 * mass @ (v**2).sum(axis=0), rel=ROUNDING)
