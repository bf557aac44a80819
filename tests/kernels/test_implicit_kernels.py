"""Kernels of the implicit solvers against dense matrices and slow formulas."""

import numpy as np
import pytest

from cape.assembly.mesh.links import mesh_bends_record, thinned
from cape.assembly.mesh.springs import mesh_springs
from cape.cloth.fabric import Fabric
from cape.forces.elastic import Elastic
from cape.kernels import bones
from cape.kernels.bones import Motion, MotionRoom
from cape.kernels.cloth.mesh import BLOCK
from cape.kernels.cloth.mesh_bending import SIDE, SUMS, MeshBends
from cape.kernels.implicit import conjugate_gradients, points, stages
from cape.kernels.program import run
from motions import quaternions
from tests.solvers.linear import LAYOUTS, B, Linear
from tests.support.scenes import grid_cloth, irregular, mesh_cloth


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_matrix_is_the_derivative_of_the_forces_where_all_springs_are_stretched(layout: str, rng):
    linear = Linear(layout, 1.2, rng)
    step, columns = 1e-6, []
    for unit in np.eye(3 * linear.count).reshape(-1, 3, linear.count):
        # Velocities follow the positions as v = (x - xt) / b, from rest.
        plus, minus = (linear.forces(linear.x + d * unit, d * unit / B) for d in (step, -step))
        columns.append(((minus - plus) / (2 * step)).ravel())
    expected = np.stack(columns) + np.diag(np.tile(linear.assembly.mass / B**2, 3))
    # Central differences: rounding of forces near 10 N over 1e-6 m.
    np.testing.assert_allclose(linear.dense(), expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("layout", LAYOUTS)
def test_forces_at_rest_are_minus_the_gradient_of_the_energy(layout: str, rng):
    linear = Linear(layout, 1.2, rng)
    step, expected = 1e-6, np.zeros((3, linear.count))
    for axis, vertex in np.ndindex(expected.shape):
        moved = np.zeros_like(expected)
        moved[axis, vertex] = step
        plus, minus = (Elastic.energy(linear.assembly, (linear.x + sign * moved).T) for sign in (1.0, -1.0))
        expected[axis, vertex] = (minus - plus) / (2.0 * step)
    forces = linear.forces(linear.x, np.zeros_like(linear.x))
    # Central differences: energies of some joules are rounded to 1e-16 of them, over 1e-6 m.
    np.testing.assert_allclose(forces, expected, atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("stretched", [0.5, 1.2])
def test_the_matrix_is_symmetric_and_positive_definite_also_compressed(layout: str, stretched: float, rng):
    linear = Linear(layout, stretched, rng)
    dense = linear.dense()
    np.testing.assert_allclose(dense, dense.T, atol=1e-12 * np.abs(dense).max())
    # M / b^2 is what a stiffness without negative directions leaves at least.
    assert np.linalg.eigvalsh(dense).min() > 0.999 * linear.assembly.mass.min() / B**2


def test_what_is_left_of_sums_that_are_zero_is_no_bending():
    side = 0.03 * np.arange(9)
    cloth = mesh_cloth(side, side, Fabric())
    bends = mesh_bends_record(mesh_springs(cloth), cloth.vertices, np.float64)
    dense = np.abs(dense_rows(bends))
    # Between the weakest pair of whole cells, which are all alike, and rounding lies much.
    assert dense[dense > 0.0].min() > 1e-8 * dense.max()
    np.testing.assert_allclose(dense, dense.T, rtol=1e-9, atol=1e-13 * dense.max())


def test_damping_adds_to_the_stiffness_of_a_membrane_and_not_to_its_tension(rng):
    linear = Linear("membrane", 1.2, rng)
    expected = linear.dense()
    # Faster than all strains grow, so that damping would tighten or slacken every triangle.
    linear.forces(linear.x, rng.standard_normal(linear.x.shape))
    run(linear.system.linearise, linear.team, 0, 1, B)
    np.testing.assert_array_equal(linear.dense(), expected)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_points_are_fetched_from_where_they_were_kept_and_summed_up(dtype: type[np.floating], rng):
    rows = rng.standard_normal((5, 3, BLOCK)).astype(dtype)
    kept, fetched = np.zeros((len(rows) + 1) * BLOCK * points.SIDE, dtype), np.zeros(3 * BLOCK, dtype)
    for k, row in enumerate(rows):
        points.keep_row(row.ravel(), kept, k * BLOCK * points.SIDE)
    row, lane = rng.integers(len(rows), size=BLOCK), rng.integers(BLOCK, size=BLOCK)
    places = (points.PAIRS * (row * BLOCK + points.order_kept(BLOCK)[lane])).astype(np.uint32)
    points.fetch_row(places, kept, fetched)
    found = rows[row, :, lane]
    np.testing.assert_array_equal(fetched.reshape(3, BLOCK), found.T)
    # Two are added in one way only, and none are nothing.
    assert points.sum_points(places, kept, 0, 2) == tuple((found[0] + found[1]).tolist())
    assert points.sum_points(places, kept, 7, 7) == (0.0, 0.0, 0.0)


def test_bending_that_is_next_to_nothing_is_left_out_of_both_rows_of_a_pair(rng):
    side = 0.03 * np.arange(9)
    cloth = irregular(grid_cloth(side, side, Fabric()), rng)
    bends = mesh_bends_record(mesh_springs(cloth), cloth.vertices, np.float64)
    least = 10.0 ** rng.uniform(-5.0, -2.0, cloth.vertices)
    fewer = thinned(bends, least, np.float64)
    whole, thin = dense_rows(bends), dense_rows(fewer)
    weak = np.abs(whole) <= np.minimum(least[:, None], least)
    assert 0.1 < weak[whole != 0.0].mean() < 0.9
    assert (thin == np.where(weak, 0.0, whole)).all()
    # Sums of the same products in another order.
    np.testing.assert_allclose(thin, thin.T, rtol=1e-12)
    # Rows are of whole SUMS, filled up with nothing.
    assert (np.diff(fewer.start) % SUMS == 0).all()


def dense_rows(bends: MeshBends) -> np.ndarray:
    """Weights of all pairs (N, N) [N/m]."""
    count = len(bends.start) - 1
    dense = np.zeros((count, count))
    np.add.at(dense, (np.repeat(np.arange(count), np.diff(bends.start)), bends.others // SIDE), bends.weight)
    return dense


@pytest.mark.parametrize("layout", ["grid", "mesh"])
def test_the_preconditioner_inverts_each_vertex_s_own_block(layout: str, rng):
    linear = Linear(layout, 1.1, rng)
    dense = linear.dense().reshape(3, linear.count, 3, linear.count)
    xx, yy, zz, xy, xz, yz = linear.matrix.inverse[:, linear.own]
    for i in range(linear.count):
        inverse = np.array([[xx[i], xy[i], xz[i]], [xy[i], yy[i], yz[i]], [xz[i], yz[i], zz[i]]])
        expected = np.linalg.inv(dense[:, i, :, i]) if linear.assembly.free[i] else np.zeros((3, 3))
        np.testing.assert_allclose(inverse, expected, atol=1e-12 * np.abs(inverse).max() + 1e-18)


def test_the_preconditioner_of_a_membrane_is_near_each_vertex_s_own_block(rng):
    """It leaves out how triangles are coupled; Jacobi's method needs no more than the size of the block."""
    linear = Linear("membrane", 1.1, rng)
    dense = linear.dense().reshape(3, linear.count, 3, linear.count)
    xx, yy, zz, xy, xz, yz = linear.matrix.inverse[:, linear.own]
    for i in np.flatnonzero(linear.assembly.free):
        inverse = np.array([[xx[i], xy[i], xz[i]], [xy[i], yy[i], yz[i]], [xz[i], yz[i], zz[i]]])
        shares = np.linalg.eigvals(inverse @ dense[:, i, :, i]).real
        assert shares.min() > 0.6
        assert shares.max() < 1.8


@pytest.mark.parametrize("layout", LAYOUTS)
def test_conjugate_gradients_solve_the_system_of_the_free_vertices(layout: str, rng):
    linear = Linear(layout, 1.1, rng)
    free = linear.assembly.free
    r = rng.standard_normal((3, linear.count)) * free
    vectors = linear.matrix.vectors
    vectors[1][:, linear.own] = r
    assert linear.system.settings.linear_iterations == 500
    iterations, slope, _ = conjugate_gradients.solve_linear(linear.system, B, 1e-12, 0.0, linear.team)
    solution = vectors[0][:, linear.own].copy()
    kept = np.tile(free, 3)
    expected = np.zeros(3 * linear.count)
    expected[kept] = np.linalg.solve(linear.dense()[np.ix_(kept, kept)], r.ravel()[kept])
    np.testing.assert_allclose(solution.ravel(), expected, atol=1e-10 * np.abs(expected).max())
    assert slope == pytest.approx(float(np.sum(solution * r)), rel=1e-10)
    assert iterations < 100


def test_sums_of_chunks(rng):
    terms, sums = rng.standard_normal(192), np.zeros(3)
    conjugate_gradients.sum_chunks(terms, sums)
    np.testing.assert_allclose(sums, terms.reshape(3, 64).sum(axis=1), atol=1e-13)


def test_bones_are_placed_at_any_time_of_the_frame(rng):
    count, duration = 5, 0.1
    turns = quaternions.normalize(rng.standard_normal((2, count, 4)))
    turns[1][0] = turns[0][0]
    places = rng.standard_normal((2, count, 3))
    motion, room = Motion(places[0], turns[0], places[1], turns[1]), MotionRoom.blank(count)
    bones.start_motion(motion, room, duration, 1)
    for share in (0.0, 0.3, 1.0):
        stages.place_at(share * duration, motion, room)
        np.testing.assert_allclose(room.positions, (1 - share) * places[0] + share * places[1], atol=1e-13)
        along = quaternions.slerp(turns[0], turns[1], np.full(count, share))
        np.testing.assert_allclose(room.matrices, quaternions.to_matrix(along), atol=1e-12)


def test_a_nan_is_longer_than_all():
    d = np.ones((3, 8))
    assert stages.longest(d, 0, 8) == pytest.approx(np.sqrt(3))
    d[1, 2] = np.nan
    assert np.isnan(stages.longest(d, 0, 8))
    assert stages.longest(d, 3, 8) == pytest.approx(np.sqrt(3))
