"""The multigrid preconditioner against dense matrices, and that finer cloth takes no more iterations with it."""

from dataclasses import replace

import numpy as np
import pytest

from cape.bench.sheets import assembled
from cape.bench.subject import Subject
from cape.cloth.cloth import Cloth
from cape.kernels.implicit import conjugate_gradients
from cape.kernels.implicit.implicit import LINEAR, NEWTON
from cape.kernels.implicit.levels import Level
from cape.kernels.implicit.multigrid import DAMPING
from cape.scene.holding.attachments import Attachment
from cape.scene.scene import Scene
from cape.solvers import TRBDF2, BackwardEuler
from cape.solvers.matrix import STIFFER
from tests.solvers.linear import FABRIC, LAYOUTS, B, Linear
from tests.support.scenes import Run, grid_cloth, irregular, irregular_swing, mesh_cloth

ROWS, COLUMNS = 25, 16
layouts = pytest.mark.parametrize("layout", LAYOUTS)
Array = np.ndarray


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(8)


def linear_of(layout: str, rng: np.random.Generator, *, times: float = 1.0, **properties: float) -> Linear:
    rows, columns = round(times * ROWS), round(times * COLUMNS)
    return Linear(layout, 1.1, rng, rows=rows, columns=columns, fabric=replace(FABRIC, **properties))


def levels_in(linear: Linear) -> list[Level]:
    assert linear.levels is not None
    return [linear.levels.first.level, *(above.level for above in linear.levels.above)]


def block(rows: Array) -> Array:
    """The 3x3 matrix of xx, yy, zz, xy, xz, yz."""
    xx, yy, zz, xy, xz, yz = rows
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def dense_of(level: Level) -> Array:
    """The matrix of a level, rows and columns by coordinate and node."""
    count = level.own.shape[1]
    dense = np.zeros((3, count, 3, count))
    for node in range(count):
        dense[:, node, :, node] += block(level.diagonal[:, node])
        for k, other in enumerate(level.neighbours[:, node]):
            dense[:, node, :, other] -= block(level.beside[k, :, node])
    return dense.reshape(3 * count, 3 * count)


def weights_of(linear: Linear) -> list[Array]:
    """The weights P of each level, (finer nodes, nodes), zero for what is held."""
    assert linear.levels is not None
    found = []
    for level in levels_in(linear):
        finer = linear.count if not found else found[-1].shape[1]
        weights = np.zeros((finer, level.own.shape[1]))
        if level.nodes.shape[1]:
            for k in range(3):
                np.add.at(weights, (np.arange(finer), level.nodes[k]), level.weights[k])
        else:
            between = linear.levels.first.between
            assert between is not None
            row, column = np.divmod(np.arange(finer), len(between.columns.first))
            for y, down in ((between.rows.first, between.rows.weight), (between.rows.second, 1 - between.rows.weight)):
                for x, across in (
                    (between.columns.first, between.columns.weight),
                    (between.columns.second, 1 - between.columns.weight),
                ):
                    node = y[row] * between.width + x[column]
                    np.add.at(weights, (np.arange(finer), node), down[row] * across[column])
            weights *= linear.assembly.free[:, None]
        found.append(weights)
    return found


def coupling_blocks(linear: Linear) -> Array:
    """Minus the block of the matrix between the ends of each spring, (E, 3, 3)."""
    fine, springs = linear.dense().reshape(3, linear.count, 3, linear.count), linear.assembly.springs
    return -fine[:, springs.first, :, springs.second]


def nearest_blocks(linear: Linear) -> Array:
    """k (1 + tau/b) u u' + k max(0, 1 - l0/l) (1 - u u') of the springs of a membrane's levels, (E, 3, 3)."""
    springs, x = linear.assembly.springs, linear.x.T
    assert springs.nearest is not None
    apart = x[springs.second] - x[springs.first]
    length = np.linalg.norm(apart, axis=1)
    along = np.einsum("ei,ej->eij", apart, apart) / (length**2)[:, None, None]
    tension = np.maximum(0.0, 1.0 - springs.rest / length)[:, None, None]
    damped = 1.0 + FABRIC.damping_time / B
    return STIFFER * springs.nearest[:, None, None] * (damped * along + tension * (np.eye(3) - along))


def cloth_of(layout: str, u: Array, v: Array) -> Cloth:
    """A cloth whose vertices lie at those coordinates, or near them where its material is a membrane."""
    if layout == "membrane":
        return irregular(grid_cloth(u, v, FABRIC), np.random.default_rng(0))
    return {"grid": grid_cloth, "mesh": mesh_cloth}[layout](u, v, FABRIC)


@layouts
def test_vertices_are_moved_by_weights_of_sum_one_and_held_ones_not_at_all(layout: str, rng):
    linear = linear_of(layout, rng)
    first, *others = weights_of(linear)
    np.testing.assert_allclose(first.sum(axis=1), linear.assembly.free, atol=1e-14)
    for weights in others:
        np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-14)
    assert all(weights.shape[1] < 0.5 * weights.shape[0] for weights in (first, *others))


@layouts
def test_a_link_of_a_level_is_the_sum_of_those_that_cross_by_their_share_of_the_distance(layout: str, rng):
    linear = linear_of(layout, rng, bend=0.0)
    level, assembly = levels_in(linear)[0], linear.assembly
    springs, start, free = assembly.springs, assembly.cloth.positions, assembly.free
    stiffness = {"membrane": nearest_blocks}.get(layout, coupling_blocks)(linear)
    members = np.split(level.gathered.members, level.gathered.start[1:-1])
    label = np.full(linear.count, -1)
    for node, vertices in enumerate(members):
        label[vertices] = node
    assert (label >= 0).tolist() == free.tolist()
    centre = np.array([start[label == node].mean(axis=0) for node in range(len(members))])
    count = len(members)
    expected = np.zeros((3, count, 3, count))
    for node, vertices in enumerate(members):
        expected[:, node, :, node] += assembly.mass[vertices].sum() / B**2 * np.eye(3)
    for i, j, between in zip(springs.first, springs.second, stiffness, strict=True):
        a, b = (i, j) if label[i] >= 0 else (j, i)
        p, q = label[a], label[b]
        if p == q:
            continue
        apart = (start[b] if q < 0 else centre[q]) - centre[p]
        share = min(abs(apart @ (start[b] - start[a])) / (apart @ apart), 1.0)
        added = share * between
        expected[:, p, :, p] += added
        if q >= 0:
            expected[:, q, :, q] += added
            expected[:, p, :, q] -= added
            expected[:, q, :, p] -= added
    expected = expected.reshape(3 * count, 3 * count)
    np.testing.assert_allclose(dense_of(level), expected, atol=1e-12 * np.abs(expected).max())


@layouts
def test_bending_is_left_out_of_the_levels(layout: str, rng):
    bent = levels_in(linear_of(layout, np.random.default_rng(8), bend=0.5))[0]
    plain = levels_in(linear_of(layout, np.random.default_rng(8), bend=0.0))[0]
    # A mesh without bending has the same links, in another order.
    expected = dense_of(plain)
    np.testing.assert_allclose(dense_of(bent), expected, atol=1e-9 * np.abs(expected).max())


@layouts
def test_no_eigenvalue_of_a_level_s_jacobi_step_is_above_two(layout: str, rng):
    for level in levels_in(linear_of(layout, rng)):
        count = level.own.shape[1]
        inverse = np.zeros((3, count, 3, count))
        for node in range(count):
            inverse[:, node, :, node] = block(level.inverse[:, node])
        product = inverse.reshape(3 * count, -1) @ dense_of(level)
        largest = np.linalg.eigvals(product).real.max()
        assert 1.0 <= largest <= 2.0 + 1e-12


@layouts
def test_the_cycle_is_that_of_dense_matrices(layout: str, rng):
    linear = linear_of(layout, rng, times=2.0)
    levels, weights = levels_in(linear), weights_of(linear)
    assert len(levels) > 2
    matrices = [dense_of(level) for level in levels]

    def cycle(k: int, r: Array) -> Array:
        count = levels[k].own.shape[1]
        step = np.zeros((3, count, 3, count))
        for node in range(count):
            step[:, node, :, node] = DAMPING * np.linalg.inv(block(levels[k].diagonal[:, node]))
        step = step.reshape(3 * count, -1)
        z = step @ r
        if k + 1 < len(levels):
            move = np.kron(np.eye(3), weights[k + 1])
            z += move @ cycle(k + 1, move.T @ (r - matrices[k] @ z))
        return z + step @ (r - matrices[k] @ z)

    r = rng.standard_normal((3, linear.count))  # also at held vertices, where it must not count
    move = np.kron(np.eye(3), weights[0])
    expected = (move @ cycle(0, move.T @ r.ravel())).reshape(3, -1)
    np.testing.assert_allclose(linear.preconditioned(r), expected, atol=1e-12 * np.abs(expected).max())


@layouts
def test_the_preconditioner_is_symmetric_and_adds_to_the_block_diagonal(layout: str, rng):
    linear = linear_of(layout, rng)
    unit = np.eye(3 * linear.count).reshape(-1, 3, linear.count)
    added = np.stack([linear.preconditioned(r).ravel() for r in unit])
    np.testing.assert_allclose(added, added.T, atol=1e-13 * np.abs(added).max())
    assert np.linalg.eigvalsh(added).min() > -1e-12 * np.abs(added).max()


@layouts
def test_conjugate_gradients_solve_the_system_of_the_free_vertices(layout: str, rng):
    linear = linear_of(layout, rng)
    free = linear.assembly.free
    r = rng.standard_normal((3, linear.count)) * free
    vectors = linear.matrix.vectors
    vectors[1][:, linear.own] = r
    iterations, *_ = conjugate_gradients.solve_linear(linear.system, B, 1e-12, 0.0, linear.team)
    kept = np.tile(free, 3)
    expected = np.zeros(3 * linear.count)
    expected[kept] = np.linalg.solve(linear.dense()[np.ix_(kept, kept)], r.ravel()[kept])
    np.testing.assert_allclose(vectors[0][:, linear.own].ravel(), expected, atol=1e-10 * np.abs(expected).max())
    assert iterations < 60


@layouts
def test_a_step_within_the_tolerance_is_not_taken_where_equations_may_be_settled(layout: str, rng):
    linear = linear_of(layout, rng)
    vectors = linear.matrix.vectors
    r = rng.standard_normal((3, linear.count)) * linear.assembly.free
    found = []
    for tolerance in (1e-3, 1e-2):
        vectors[1][:, linear.own] = r
        found.append(conjugate_gradients.solve_linear(linear.system, B, 0.5, tolerance, linear.team))
    largest = [first * tolerance for (_, _, first), tolerance in zip(found, (1e-3, 1e-2), strict=True)]
    assert largest[0] == pytest.approx(largest[1], rel=1e-12)
    for within in (0.9, 1.1):
        vectors[1][:, linear.own] = r
        iterations, _, first = conjugate_gradients.solve_unless(
            linear.system, B, 1e-3, largest[0] / within, True, linear.team
        )
        assert first == pytest.approx(within, rel=1e-12)
        moved = np.abs(vectors[0][:, linear.own]).max()
        assert (moved == 0.0, iterations == 1) == ((True, True) if within < 1.0 else (False, False))


@layouts
def test_a_residual_far_below_the_tolerance_is_settled_without_a_product(layout: str, rng):
    linear = linear_of(layout, rng)
    vectors, free = linear.matrix.vectors, np.tile(linear.assembly.free, 3)
    r = rng.standard_normal((3, linear.count)) * linear.assembly.free
    z = linear.preconditioned(r)
    xx, yy, zz, xy, xz, yz = linear.matrix.inverse[:, linear.own]
    z += np.einsum("abn,bn->an", np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), r)
    moved = np.sqrt((z * free.reshape(3, -1)).ravel() @ z.ravel() / linear.count)
    for share, settled in ((0.2, True), (2.0, False)):
        vectors[1][:, linear.own], vectors[4][:] = r, np.nan
        iterations, _, first = conjugate_gradients.solve_unless(
            linear.system, B, 1e-3, moved / share, True, linear.team
        )
        assert np.isnan(vectors[4]).all() == settled
        assert (iterations == 1) == settled
        assert not settled or first == pytest.approx(share, rel=1e-9)


@layouts
@pytest.mark.parametrize("kind", [BackwardEuler, TRBDF2], ids=lambda kind: kind.name)
@pytest.mark.few("backward_euler-grid", "backward_euler-mesh", "tr_bdf2-membrane")
def test_finer_cloth_takes_no_more_iterations(kind: type[BackwardEuler | TRBDF2], layout: str):
    taken = []
    for vertices in (1_000, 8_000):
        sheet = irregular_swing(vertices) if layout == "membrane" else assembled(vertices, layout)
        subject = Subject(*sheet, kind())
        counts = np.sum([_counted(subject) for _ in range(3)], axis=0)
        taken.append(counts[LINEAR] / counts[NEWTON])
    # With the block diagonal alone they grow as the number of vertices along a side does, 2.8 times.
    assert taken[1] < 1.5 * taken[0]


def _counted(subject: Subject) -> Array:
    subject.call()
    return subject.running.arrays.counts[0].copy()


@layouts
@pytest.mark.parametrize("kind", [BackwardEuler, TRBDF2], ids=lambda kind: kind.name)
@pytest.mark.few("backward_euler-membrane", "tr_bdf2-grid", "tr_bdf2-mesh")
def test_threads_share_the_levels_to_the_last_bit(kind: type[BackwardEuler | TRBDF2], layout: str):
    side = np.linspace(0.0, 0.6, 31)
    cloth = cloth_of(layout, side, side[:29])
    scene = Scene(cloth, [Attachment(vertices=np.array([0, 30]), bone="hand")])
    found = []
    for threads in (1, 2, 3):
        run = Run(scene, kind(), threads=threads)
        for _ in range(3):
            assert run.step(1 / 60, 4) == 0
        found.append(run.positions)
    assert np.ptp(found[0][:, 2] - cloth.positions[:, 2]) > 1e-3
    assert all((other == found[0]).all() for other in found[1:])


@layouts
def test_a_cloth_all_of_which_is_held_needs_no_levels(layout: str):
    side = np.linspace(0.0, 0.6, 9)
    cloth = cloth_of(layout, side, side)
    held = Run(Scene(cloth, [Attachment(vertices=np.arange(81), bone="hand")]), BackwardEuler())
    assert held.running.arrays.levels is None
    assert held.step(1 / 60, 4) == 0
    np.testing.assert_allclose(held.positions, cloth.positions, atol=1e-15)
