"""XPBD's kernels against the textbook's loop, in positions and one constraint after the other."""

import numpy as np
import pytest

from cape.kernels.calling import Bound
from cape.kernels.jit import routine
from cape.kernels.state import State
from cape.kernels.team import Team
from cape.kernels.xpbd import bending, formulas, membrane, mesh, packed, xpbd
from cape.kernels.xpbd import grid as xpbd_grid
from cape.kernels.xpbd.formulas import Constraints
from cape.kernels.xpbd.grid import GridConstraints, GridSweeps

STEP, TAU = 0.01, 0.02
# A few dozen operations on numbers near one.
ROUNDING = 1e-13


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


class Textbook:
    """Macklin 2016: predicted positions p, eq. 17, and changes of the multipliers by eq. 26."""

    def __init__(self, old: np.ndarray, velocity: np.ndarray, weights: np.ndarray) -> None:
        self.old, self.weights = old, weights
        self.p = old + STEP * velocity
        self.multipliers: dict[object, float] = {}

    def project(self, key: object, c: float, gradients: dict[int, np.ndarray], stiffness: float, tau: float) -> None:
        """Solve the constraint C = c with a gradient for each of its vertices."""
        alpha, gamma = 1 / (stiffness * STEP**2), tau / STEP
        moved = sum(g @ (self.p[:, i] - self.old[:, i]) for i, g in gradients.items())
        total = sum(self.weights[i] * g @ g for i, g in gradients.items())
        change = (-c - alpha * self.multipliers.get(key, 0.0) - gamma * moved) / ((1 + gamma) * total + alpha)
        self.multipliers[key] = float(self.multipliers.get(key, 0.0) + change)
        for i, g in gradients.items():
            self.p[:, i] += self.weights[i] * g * change

    def stretch(self, i: int, j: int, stiffness: float, rest: float, tau: float) -> None:
        d = self.p[:, j] - self.p[:, i]
        length = float(np.linalg.norm(d))
        if length > 0:
            self.project((i, j), length - rest, {i: -d / length, j: d / length}, stiffness, tau)

    def bend(self, vertices: list[int], coefficients: np.ndarray, stiffness: float, tau: float, row: int = 0) -> None:
        for axis in range(3):
            along = np.eye(3)[axis]
            c = sum(a * self.p[axis, i] for i, a in zip(vertices, coefficients, strict=True))
            gradients = {i: a * along for i, a in zip(vertices, coefficients, strict=True)}
            self.project((*vertices, axis, row), c, gradients, stiffness, tau)


def prepared(
    stiffness: np.ndarray, rest: np.ndarray | None, mobility: np.ndarray, tau: float, axes: int
) -> Constraints:
    """Constraints of several sweeps with their gains; `axes` is 1 for springs, 3 for bend springs."""
    gain, slack = np.zeros_like(stiffness), np.zeros_like(stiffness)
    formulas.set_gains(STEP, STEP + tau, stiffness.ravel(), mobility.ravel(), gain.reshape(-1), slack.reshape(-1))
    shape = stiffness.shape if axes == 1 else (axes, *stiffness.shape)
    return Constraints(stiffness, rest, mobility, gain, slack, np.zeros(shape))


class Packed:
    """Vertices as the kernels want them, and room for a block of constraints."""

    def __init__(self, x: np.ndarray, v: np.ndarray, weights: np.ndarray) -> None:
        n = x.shape[1]
        self.vertices, self.rows = np.full(packed.SIDE * (n + 1), np.nan), np.zeros(4 * packed.NEXT)
        packed.pack(0, n, weights, *x, *v, self.vertices)

    @property
    def velocities(self) -> np.ndarray:
        u = np.zeros((3, len(self.vertices) // packed.SIDE - 1))
        packed.unpack(0, u.shape[1], self.vertices, *u)
        assert not self.vertices[-packed.SIDE :].any()  # nobody
        return u


def blocks_of_one(values: np.ndarray, nobody: float = 0.0) -> np.ndarray:
    """Numbers of constraints (E, m) in a block each, every one in another lane: (E, m lanes)."""
    values = np.reshape(values, (len(values), -1))
    blocks = np.full((*values.shape, packed.LANES), nobody, dtype=values.dtype)
    for k, numbers in enumerate(values):
        blocks[k, :, 3 * k % packed.LANES] = numbers
    return blocks.reshape(len(values), -1)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_vertices_side_by_side(rng: np.random.Generator, dtype: type[np.floating]):
    n, lanes = 40, packed.LANES
    x, v, w = (
        rng.standard_normal((3, n)).astype(dtype),
        rng.standard_normal((3, n)).astype(dtype),
        np.arange(n, dtype=dtype),
    )
    vertices, rows = np.zeros(packed.SIDE * (n + 1), dtype), np.zeros(packed.NEXT, dtype)
    packed.pack(0, n, w, *x, *v, vertices)
    which = rng.permutation(n)[:lanes].astype(np.uint32)
    Bound(fetch_block, vertices, which, rows)()
    np.testing.assert_array_equal(rows.reshape(-1, lanes), np.vstack([x, w, v])[:, which])
    rows[packed.VX :] *= 2
    Bound(put_block_back, vertices, which, rows)()
    u, expected = np.zeros_like(v), v.copy()
    packed.unpack(0, n, vertices, *u)
    expected[:, which] *= 2
    np.testing.assert_array_equal(u, expected)


@routine
def fetch_block(vertices, which, rows):
    for lane in range(0, packed.LANES, packed.HALF):
        packed.fetch(vertices, which, lane, rows, lane)


@routine
def put_block_back(vertices, which, rows):
    for lane in range(0, packed.LANES, packed.HALF):
        packed.put_back(vertices, which, lane, rows, lane)


@pytest.mark.parametrize("sweeps", [1, 2])
def test_springs_one_after_the_other(rng: np.random.Generator, sweeps: int):
    n = 8
    x, v = rng.standard_normal((3, n)), rng.standard_normal((3, n))
    first, second = np.array([[0, 1, 5, 2, 6, 3], [1, 2, 6, 6, 7, 4]], dtype=np.uint32)
    stiffness, rest, weights = 10 ** rng.uniform(2, 5, 6), rng.uniform(0.5, 1.5, 6), rng.uniform(1, 2, n)
    weights[[2, 6]] = 0.0
    # No length at all: it pulls nowhere.
    x[:, 4], v[:, 4] = x[:, 3], v[:, 3]
    book = Textbook(x, v, weights)
    mobility = blocks_of_one(weights[first] + weights[second]).ravel()
    springs = prepared(blocks_of_one(stiffness).ravel(), blocks_of_one(rest).ravel(), mobility, TAU, 1)
    kept = (springs.slack, springs.impulse) if sweeps > 1 else (None, None)
    mine, ends = Packed(x, v, weights), blocks_of_one(np.stack([first, second], axis=1), n)
    for _ in range(sweeps):
        mesh.stretch_blocks(0, 6, ends, STEP, TAU, 1e-18, springs.gain, springs.rest, *kept, mine.vertices, mine.rows)
        for k in range(6):
            book.stretch(int(first[k]), int(second[k]), stiffness[k], rest[k], TAU)
    u = mine.velocities
    np.testing.assert_allclose(x + STEP * u, book.p, atol=ROUNDING)
    np.testing.assert_array_equal(u[:, [2, 6]], v[:, [2, 6]])
    assert np.isfinite(u).all()


@pytest.mark.parametrize("sweeps", [1, 2])
def test_bends_one_after_the_other(rng: np.random.Generator, sweeps: int):
    n = 7
    x, v = rng.standard_normal((3, n)), rng.standard_normal((3, n))
    vertices = np.array([[0, 1, 2, 3], [3, 1, 4, 5], [6, 2, 0, 5]], dtype=np.uint32)
    coefficients, stiffness = rng.standard_normal((3, 3, 4)), 10 ** rng.uniform(1, 4, (3, 3))
    weights = rng.uniform(1, 2, n)
    weights[4] = 0.0
    book = Textbook(x, v, weights)
    coupled = np.einsum("krm,km,ksm->krs", coefficients, weights[vertices], coefficients)
    mobility = np.ascontiguousarray(np.diagonal(coupled, axis1=1, axis2=2))
    bends = prepared(stiffness.ravel(), None, mobility.ravel(), TAU, 3)
    assert bends.impulse is not None
    kept = (bends.slack, *bends.impulse) if sweeps > 1 else (None,) * 4
    mine, mixed = Packed(x, v, weights), coupled[:, (0, 0, 1), (1, 2, 2)].copy()
    listed = 4 * np.arange(4), vertices.ravel(), np.swapaxes(coefficients, 1, 2).ravel()
    for _ in range(sweeps):
        bending.bend_listed(*listed, mixed, STEP + TAU, bends.gain, *kept, mine.vertices)
        for k, row in np.ndindex(3, 3):
            book.bend(vertices[k].tolist(), coefficients[k, row], float(stiffness[k, row]), TAU, row)
    np.testing.assert_allclose(x + STEP * mine.velocities, book.p, atol=ROUNDING)


@pytest.mark.parametrize("sweeps", [1, 3])
def test_edges_of_a_membrane_one_after_the_other(rng: np.random.Generator, sweeps: int):
    """Against the same in matrices: F of both triangles from all vertices, three strains at once."""
    n, stiffness = 6, np.array([[900.0, 80.0, 0.0], [80.0, 400.0, 0.0], [0.0, 0.0, 60.0]])
    x, v, weights = rng.standard_normal((3, n)), rng.standard_normal((3, n)), rng.uniform(1, 2, n)
    weights[3] = 0.0
    # The second has a single triangle, and nobody beyond.
    vertices = np.array([[0, 1, 2, 3], [2, 4, 5, n], [1, 3, 4, 0]], dtype=np.uint32)
    slopes, area = rng.uniform(-1, 1, (3, 2, 4)), rng.uniform(0.1, 0.2, 3)
    shares = np.array([[0.3, 0.7], [1.0, 0.0], [0.5, 0.5]])
    mine, expected = Packed(x, v, weights), v.copy()
    numbers = blocks_of_one(np.concatenate([slopes.reshape(3, 8), shares, area[:, None]], axis=1))
    impulse, kept = np.zeros((3, 3 * packed.LANES)) if sweeps > 1 else None, np.zeros((3, 3))
    for _ in range(sweeps):
        membrane.stretch_edges(
            0, 3, blocks_of_one(vertices, n), numbers, STEP, TAU, 900.0, 400.0, 80.0, 60.0, 0.5, impulse, mine.vertices,
            mine.rows,
        )  # fmt: skip
        for k in range(3):
            p, strain, derivative = x + STEP * expected, np.zeros(3), np.zeros((3, 3, n))
            for t in range(2 if vertices[k, 3] < n else 1):
                i, j, m = vertices[k, [0, 1, 2 + t]].tolist()
                along, across = np.zeros(n), np.zeros(n)
                for slope, of in ((slopes[k, t, ::2], along), (slopes[k, t, 1::2], across)):
                    of[j] += slope[0]
                    of[m] += slope[1]
                    of[i] -= slope.sum()
                f, g = p @ along, p @ across
                strain += shares[k, t] * np.array([(f @ f - 1) / 2, (g @ g - 1) / 2, f @ g])
                for row, part in enumerate(
                    (np.outer(f, along), np.outer(g, across), np.outer(f, across) + np.outer(g, along))
                ):
                    derivative[row] += shares[k, t] * part
            rate = np.einsum("rci,ci->r", derivative, expected)
            weighted = area[k] * stiffness @ np.einsum("rci,i,sci->rs", derivative, weights, derivative)
            wanted = STEP * area[k] * stiffness @ (strain + TAU * rate) - (kept[k] if sweeps > 1 else 0.0)
            change = np.linalg.solve(np.eye(3) + STEP * (STEP + TAU) * weighted, wanted)
            kept[k] += change
            expected = expected - weights * np.einsum("rci,r->ci", derivative, change)
    u = mine.velocities
    np.testing.assert_allclose(u, expected, atol=ROUNDING * np.abs(v).max() * 100)
    np.testing.assert_array_equal(u[:, 3], v[:, 3])


ROWS, COLUMNS, HANDS = 8, 5, 3
LEANS = {"across": (0, 1), "down": (1, 0), "diagonal": (1, 1), "anti": (1, -1)}


def order_of(hand: int, down: int, right: int) -> list[tuple[int, int]]:
    """First vertices (row, column) that start in the rows of a hand, in the order in which their constraints are
    solved; each ends so far down and to the right."""
    return [
        (row, column)
        for first in range(HANDS)
        for row in range(hand, ROWS - down, HANDS)
        for column in range(first, COLUMNS, HANDS)
        if 0 <= column + right < COLUMNS
    ]


def textbook_sweep(book: Textbook, stiffness: dict[str, np.ndarray], rest: dict[str, np.ndarray], bend: np.ndarray):
    """All constraints of the grid in the order of its phases; bend springs and twist are equally stiff everywhere."""

    def springs(family: str, hand: int) -> None:
        down, right = LEANS[family]
        for row, column in order_of(hand, down, right):
            i = row * COLUMNS + column
            book.stretch(i, i + down * COLUMNS + right, stiffness[family][i], rest[family][i], TAU)

    def bends(hand: int, down: int, right: int) -> None:
        for row, column in order_of(hand, 2 * down, 2 * right):
            i, offset = row * COLUMNS + column, down * COLUMNS + right
            book.bend([i, i + offset, i + 2 * offset], np.array([1.0, -2.0, 1.0]), bend[i], 2 * TAU)

    def cells(hand: int) -> None:
        for row, column in order_of(hand, 1, 1):
            i = row * COLUMNS + column
            book.bend([i, i + 1, i + COLUMNS, i + COLUMNS + 1], np.array([1.0, -1.0, -1.0, 1.0]), bend[i], 2 * TAU)

    for hand in range(HANDS):
        springs("across", hand)
        bends(hand, 0, 1)
    for hand in range(HANDS):
        if hand == 2:
            bends(0, 1, 0)
        for family in ("down", "diagonal", "anti"):
            springs(family, hand)
        cells(hand)
    bends(1, 1, 0)
    bends(2, 1, 0)


def dealt(values: np.ndarray) -> np.ndarray:
    return xpbd_grid.dealt(values, COLUMNS, float)


def test_a_grid_is_solved_in_the_order_of_its_phases(rng: np.random.Generator):
    n = ROWS * COLUMNS
    row, column = np.divmod(np.arange(n), COLUMNS)
    x = np.stack([column, row, 0 * row]) + 0.3 * rng.standard_normal((3, n))
    v, weights = rng.standard_normal((3, n)), rng.uniform(1, 2, n)
    weights[:COLUMNS] = 0.0
    stiffness, rest = {}, {}
    families: list[Constraints] = []
    for name, (down, right) in LEANS.items():
        inside = (row + down < ROWS) & (column + right >= 0) & (column + right < COLUMNS)
        stiffness[name], rest[name] = np.where(inside, 10 ** rng.uniform(2, 5, n), 0.0), rng.uniform(0.5, 1.5, n)
        mobility = weights + np.roll(weights, -(down * COLUMNS + right))
        families.append(prepared(dealt(stiffness[name]), dealt(rest[name]), dealt(mobility), TAU, 1))
    bend = 10 ** rng.uniform(2, 5, n)
    for offset, inside in ((1, column + 2 < COLUMNS), (COLUMNS, row + 2 < ROWS)):
        mobility = weights + 4 * np.roll(weights, -offset) + np.roll(weights, -2 * offset)
        families.append(prepared(dealt(np.where(inside, bend, 0.0)), None, dealt(mobility), 2 * TAU, 3))
    inside = (row + 1 < ROWS) & (column + 1 < COLUMNS)
    mobility = np.sum([np.roll(weights, -offset) for offset in (0, 1, COLUMNS, COLUMNS + 1)], axis=0)
    families.append(prepared(dealt(np.where(inside, bend, 0.0)), None, dealt(mobility), 2 * TAU, 3))
    state = State(*(p.copy() for p in (*x, *v)))
    grid = GridConstraints(COLUMNS, xpbd_grid.hands_for(ROWS, COLUMNS, float), dealt(weights), *families)
    xpbd_grid.solve_grid(GridSweeps(state, grid, TAU, 2 * TAU, 2), Team.alone(n), 0, 1, STEP)
    book = Textbook(x, v, weights)
    for _ in range(2):
        textbook_sweep(book, stiffness, rest, bend)
    moved = np.stack(state[:3]) + STEP * np.stack(state[3:])
    np.testing.assert_allclose(moved, book.p, atol=10 * ROUNDING)
    np.testing.assert_array_equal(np.stack(state[:3]), x)


def test_one_spring_is_implicit_euler(rng: np.random.Generator):
    stiffness, mass, rest, start, speed = 300.0, 0.2, 0.5, 0.6, 0.3
    x, v = np.zeros((3, 2)), np.zeros((3, 2))
    x[2, 1], v[2, 1] = start, speed
    of_one = blocks_of_one(np.array([[stiffness, rest, 1 / mass]])).reshape(3, packed.LANES)
    springs = prepared(of_one[0], of_one[1], of_one[2], TAU, 1)
    mine = Packed(x, v, np.array([0.0, 1 / mass]))
    ends = blocks_of_one(np.array([[0, 1]], dtype=np.uint32), 2)
    mesh.stretch_blocks(
        0, 1, ends, STEP, TAU, 1e-18, springs.gain, springs.rest, None, None, mine.vertices, mine.rows
    )  # fmt: skip
    # m (v1 - v0) = -h k (x0 + h v1 - l0 + tau v1).
    pull = STEP * stiffness
    expected = (mass * speed - pull * (start - rest)) / (mass + pull * (STEP + TAU))
    assert mine.velocities[2, 1] == pytest.approx(expected, rel=1e-14)


def test_what_comes_before_and_after_the_constraints(rng: np.random.Generator):
    x, v, f, w = rng.standard_normal((3, 6)), rng.standard_normal((3, 6)), rng.standard_normal((3, 6)), np.arange(6.0)
    u, forces, p = v.copy(), f.copy(), x.copy()
    xpbd.blow(STEP, w, *forces, *u)
    xpbd.fall(0.1, 0.2, -0.3, *u)
    np.testing.assert_allclose(u, v + STEP * w * f + np.array([[0.1], [0.2], [-0.3]]), atol=ROUNDING)
    np.testing.assert_array_equal(forces, 0.0)
    xpbd.drift(STEP, *p, *u)
    np.testing.assert_allclose(p, x + STEP * u, atol=ROUNDING)


def test_patches_are_laid_out_as_numpy_does(rng: np.random.Generator):
    vertices, weights = rng.integers(0, 20, (7, 5)), rng.uniform(0.0, 3.0, 20)
    coefficients = rng.normal(size=(7, 3, 5)) * (rng.random((7, 3, 5)) < 0.6)
    coefficients[2] = 0.0
    used, order, counts = (coefficients != 0.0).any(axis=1), rng.permutation(7), np.zeros(7, np.int64)
    bending.count_members(coefficients, counts)
    np.testing.assert_array_equal(counts, used.sum(axis=1))
    total = counts.sum()
    first, members, table = np.zeros(8, np.int64), np.zeros(total, np.uint32), np.zeros(3 * total)
    mixed, mobility = np.zeros((2, 7, 3))
    bending.lay_bends(vertices, coefficients, weights, order, first, members, table, mixed, mobility)
    np.testing.assert_array_equal(first, np.append(0, np.cumsum(counts[order])))
    np.testing.assert_array_equal(members, vertices[order][used[order]])
    np.testing.assert_array_equal(table, np.swapaxes(coefficients[order], 1, 2)[used[order]].ravel())
    coupled = np.einsum("krm,km,ksm->krs", coefficients, weights[vertices], coefficients)[order]
    np.testing.assert_allclose(mobility, np.diagonal(coupled, axis1=1, axis2=2), rtol=1e-12)
    np.testing.assert_allclose(mixed, coupled[:, (0, 0, 1), (1, 2, 2)], atol=1e-12)
