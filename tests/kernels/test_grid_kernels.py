"""The grid's force kernels against slow formulas, on random arrays, and what the compiler made of them."""

import itertools
import re

import numpy as np
import pytest

from cape.kernels.cloth import baselines, grid
from cape.kernels.cloth.grid import GridAir, GridAirForces, GridForces, GridSprings
from cape.kernels.state import State
from tests.support.code import MACHINE, assembly, assembly_of_unit, compiled_only

ROWS, COLUMNS = 9, 7
N = ROWS * COLUMNS
OFFSETS, BEND_OFFSETS = np.array([1, COLUMNS, COLUMNS + 1, COLUMNS - 1]), np.array([1, COLUMNS])
STEPS = ((1, 0), (0, 1), (1, 1), (-1, 1))
TAU, BEND_TAU = 0.1, 0.05
# A few hundred operations on numbers near ten.
ROUNDING = 1e-12


def belongs(across: int, down: int) -> np.ndarray:
    """Whether the vertex that far from each is on the grid, shape (N,)."""
    row, column = np.divmod(np.arange(N), COLUMNS)
    return (column + across >= 0) & (column + across < COLUMNS) & (row + down < ROWS)


class Sheet:
    """A crumpled grid of unit cells with random velocities, springs and bend springs."""

    def __init__(self, dtype: type = np.float64) -> None:
        rng = np.random.default_rng(7)
        row, column = np.divmod(np.arange(N, dtype=float), COLUMNS)
        self.p = np.stack([column, row, 0 * row]) + 0.3 * rng.standard_normal((3, N))
        self.v = rng.standard_normal((3, N))
        self.stiffness = np.stack([np.where(belongs(*step), rng.uniform(1, 2, N), 0.0) for step in STEPS])
        self.rest = rng.uniform(0.5, 1.5, (4, N))
        self.bends = np.stack([np.where(belongs(*step), rng.uniform(1, 2, N), 0.0) for step in ((2, 0), (0, 2))])
        self.twists = np.where(belongs(1, 1), rng.uniform(1, 2, N), 0.0)
        self.cells = belongs(1, 1).astype(dtype)
        self.state = State(*(np.array(c, dtype=dtype) for c in (*self.p, *self.v)))
        self.dtype = dtype

    def group(
        self, *, damping: float | None = TAU, bend_damping: float | None = BEND_TAU, bends: bool = True
    ) -> GridForces:
        """Springs and bend springs as the kernels take them, with forces that are not numbers yet."""
        springs = GridSprings(OFFSETS, self.stiffness.astype(self.dtype), self.rest.astype(self.dtype))
        bending = grid.grid_bends(self.bends, self.twists, COLUMNS, self.dtype) if bends else None
        forces, room = np.full((3, N), np.nan, self.dtype), grid.grid_room(self.dtype)
        return GridForces(self.state, springs, bending, damping, bend_damping if bends else None, forces, room)

    def forces(
        self, cuts=(0, N), *, damping: float | None = TAU, bend_damping: float | None = BEND_TAU, bends: bool = True
    ) -> np.ndarray:
        """Of springs and bend springs, in ranges between the cuts."""
        group = self.group(damping=damping, bend_damping=bend_damping, bends=bends)
        for lo, hi in itertools.pairwise(cuts):
            before = group.forces.copy()
            grid.grid_forces(group, lo, hi)
            outside = np.r_[0:lo, hi:N]
            np.testing.assert_array_equal(group.forces[:, outside], before[:, outside])
        return group.forces

    def air(self, cuts=(0, N), wind=(1.0, -2.0, 0.5)) -> np.ndarray:
        """Of the air, added to ones."""
        air = GridAir(np.array(wind), DENSITY * DRAG / 12, DENSITY * LIFT / 12, self.cells, COLUMNS)
        group = GridAirForces(self.state, air, np.ones((3, N), self.dtype), grid.grid_room(self.dtype))
        for lo, hi in itertools.pairwise(cuts):
            grid.grid_air_forces(group, lo, hi)
        return group.forces

    def lists(self) -> tuple:
        """Springs and bend springs as lists: first, second, stiffness, rest; vertices, coefficients, stiffness."""
        family, first = np.nonzero(self.stiffness)
        bend_family, start = np.nonzero(self.bends)
        # A vertex of another row with the coefficient 0 makes three of them four.
        triples = start[:, None] + BEND_OFFSETS[bend_family, None] * np.arange(3)
        fours = np.column_stack([triples, (start + 3 * COLUMNS + 3) % N])
        cells = np.flatnonzero(self.twists)
        corners = cells[:, None] + np.array([0, 1, COLUMNS, COLUMNS + 1])
        coefficients = np.repeat([[1.0, -2.0, 1.0, 0.0], [1.0, -1.0, -1.0, 1.0]], [len(start), len(cells)], axis=0)
        return (
            (first, first + OFFSETS[family], self.stiffness[family, first], self.rest[family, first]),
            (np.concatenate([fours, corners]), coefficients, np.r_[self.bends[bend_family, start], self.twists[cells]]),
        )


DENSITY, DRAG, LIFT = 1.2, 1.1, 0.6


def slow_forces(sheet: Sheet, *, bends: bool = True) -> np.ndarray:
    """One spring after the other, and bending as minus the gradient of its energy 1/2 k (D p)^2."""
    (first, second, stiffness, rest), (members, coefficients, bend_stiffness) = sheet.lists()
    expected = np.zeros((3, N))
    for i, j, k, natural in zip(first, second, stiffness, rest, strict=True):
        d, r = sheet.p[:, j] - sheet.p[:, i], sheet.v[:, j] - sheet.v[:, i]
        length = np.linalg.norm(d)
        force = k * (length - natural + TAU * (r @ d) / length) * d / length
        expected[:, i] += force
        expected[:, j] -= force
    if bends:
        difference = np.zeros((len(members), N))
        np.put_along_axis(difference, members, coefficients, axis=1)
        bend = (sheet.p + BEND_TAU * sheet.v) @ difference.T
        expected -= (bend_stiffness * bend) @ difference
    return expected


@pytest.mark.parametrize("bends", [True, False])
def test_forces_of_springs_and_bend_springs(bends: bool):
    sheet = Sheet()
    np.testing.assert_allclose(sheet.forces(bends=bends), slow_forces(sheet, bends=bends), atol=ROUNDING)


def test_forces_in_single_precision():
    sheet = Sheet(np.float32)
    # The same few hundred operations.
    np.testing.assert_allclose(sheet.forces(), slow_forces(sheet), atol=ROUNDING / 2**-53 * 2**-24)


def random_cuts(count: int) -> list[list[int]]:
    rng = np.random.default_rng(3)
    return [
        [0, *sorted(rng.choice(np.arange(1, N), rng.integers(1, 6), replace=False).tolist()), N] for _ in range(count)
    ]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_ranges_give_the_same_bits_wherever_they_are_split(dtype: type):
    sheet = Sheet(dtype)
    whole, air = sheet.forces(), sheet.air()
    for cuts in [*random_cuts(20), list(range(N + 1))]:
        np.testing.assert_array_equal(sheet.forces(cuts), whole)
        np.testing.assert_array_equal(sheet.air(cuts), air)


def test_tiles_give_the_same_bits_as_ranges(monkeypatch: pytest.MonkeyPatch):
    """A cloth of three tiles, against ranges that no tile fits."""
    rows, columns = 700, 7
    n = rows * columns
    assert n > 2 * grid.SMALL_TILE
    rng = np.random.default_rng(1)
    state = State(*(rng.standard_normal(n) for _ in range(6)))
    offsets = np.array([1, columns, columns + 1, columns - 1])
    springs, bends, rest = rng.uniform(1, 2, (4, n)), rng.uniform(1, 2, (2, n)), np.ones((4, n))
    twist = np.where(np.arange(n) < n - columns - 1, rng.uniform(1, 2, n), 0.0)
    for family, offset in enumerate(offsets):
        springs[family, n - offset :] = 0
    for family, offset in enumerate((1, columns)):
        bends[family, n - 2 * offset :] = 0
    cells = np.where(np.arange(n) < n - columns - 1, 1.0, 0.0)
    results = []
    for cuts in ([0, n], [0, 1000, 2500, 4000, n]):
        forces, room = np.zeros((3, n)), grid.grid_room(np.float64)
        for lo, hi in itertools.pairwise(cuts):
            families, bending = GridSprings(offsets, springs, rest), grid.grid_bends(bends, twist, columns, np.float64)
            grid.grid_forces(GridForces(state, families, bending, TAU, BEND_TAU, forces, room), lo, hi)
            air = GridAir(np.ones(3), 0.1, 0.1, cells, columns)
            grid.grid_air_forces(GridAirForces(state, air, forces, room), lo, hi)
        results.append(forces)
    np.testing.assert_array_equal(*results)


def test_what_is_none_counts_as_zero():
    sheet = Sheet()
    np.testing.assert_array_equal(sheet.forces(damping=None), sheet.forces(damping=0.0))
    np.testing.assert_array_equal(sheet.forces(bend_damping=None), sheet.forces(bend_damping=0.0))
    without = sheet.forces(bends=False)
    sheet.bends[:] = 0
    sheet.twists[:] = 0
    np.testing.assert_array_equal(without, sheet.forces())


def test_a_used_room_leaves_no_trace():
    """What a diverged cloth left in the room must not reach the next one, not even times zero."""
    sheet = Sheet()
    group = sheet.group()
    group.room.window[:], group.room.fluxes[:] = np.nan, np.nan
    grid.grid_forces(group, 0, N)
    np.testing.assert_array_equal(group.forces, sheet.forces())


def test_springs_of_no_length_pull_nowhere():
    sheet = Sheet()
    for component in sheet.state:
        component[:] = 0.0
    np.testing.assert_array_equal(sheet.forces(), 0.0)


def test_air_forces():
    sheet, wind = Sheet(), np.array([1.0, -2.0, 0.5])
    expected = np.ones((3, N))
    for i in np.flatnonzero(sheet.cells):
        for corners in ([i, i + 1, i + COLUMNS], [i + COLUMNS + 1, i + COLUMNS, i + 1]):
            a, b, c = sheet.p[:, corners].T
            doubled = np.cross(b - a, c - a)
            area, n = np.linalg.norm(doubled) / 2, doubled / np.linalg.norm(doubled)
            u = wind - sheet.v[:, corners].mean(axis=1)
            n = n if n @ u > 0 else -n
            speed = np.linalg.norm(u)
            force = DENSITY / 2 * area * (n @ u) * (DRAG * u + LIFT * (speed * n - (n @ u) / speed * u))
            expected[:, corners] += force[:, None] / 3
    np.testing.assert_allclose(sheet.air(), expected, atol=ROUNDING)


def test_air_exerts_nothing_where_there_is_no_flow_or_no_area():
    sheet = Sheet()
    for component in sheet.state[3:]:
        component[:] = 0.0
    np.testing.assert_array_equal(sheet.air(wind=(0.0, 0.0, 0.0)), 1.0)
    for component in sheet.state[:3]:
        component[:] = 1.0
    np.testing.assert_array_equal(sheet.air(), 1.0)


@pytest.mark.parametrize("bends", [True, False])
def test_the_scalar_yardstick_computes_the_same_forces(bends: bool):
    sheet = Sheet()
    springs, bending = sheet.lists()
    state, forces, step = [c.copy() for c in sheet.state], np.zeros((3, N)), 1e-3
    bent = (*bending, BEND_TAU) if bends else (None, None, None, None)
    baselines.scalar_step(1, step, np.ones(N), *springs, TAU, *bent, *forces, *state)
    expected = slow_forces(sheet, bends=bends)
    np.testing.assert_allclose(forces, expected, atol=ROUNDING)
    np.testing.assert_allclose(state[3:], sheet.v + step * expected, atol=ROUNDING)
    np.testing.assert_allclose(state[:3], sheet.p + step * np.array(state[3:]), atol=ROUNDING)


def machine_code(dtype: type, *, damping: float | None, bends: bool) -> str:
    """Assembly of the loop over springs."""
    from numba import typeof
    from numba.core import types

    array, u64, number = typeof(np.zeros(1, dtype)), types.uint64, typeof(dtype(0))
    table = typeof(np.zeros((4, 2), dtype))
    tau = types.none if damping is None else number
    signature = (u64, u64, u64, u64, u64, array, table, table, tau, table if bends else types.none, array)
    return assembly(grid.set_fluxes, signature)


PACKED = {
    ("x86_64", np.float32): (r"vsqrtps\s+%?[yz]mm", r"vdivps\s+.*[yz]mm"),
    ("x86_64", np.float64): (r"vsqrtpd\s+%?[yz]mm", r"vdivpd\s+.*[yz]mm"),
    ("aarch64", np.float32): (r"fsqrt(\.4s\s+v|\s+v\d+\.4s)", r"fdiv(\.4s\s+v|\s+v\d+\.4s)"),
    ("aarch64", np.float64): (r"fsqrt(\.2d\s+v|\s+v\d+\.2d)", r"fdiv(\.2d\s+v|\s+v\d+\.2d)"),
}


@compiled_only
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_springs_are_computed_several_at_a_time(dtype: type):
    if (MACHINE, dtype) not in PACKED:
        pytest.skip(f"no patterns are known for the machine code of {MACHINE}")
    code = machine_code(dtype, damping=TAU, bends=True)
    root, quotient = PACKED[MACHINE, dtype]
    # One of each family.
    assert len(re.findall(root, code)) >= 4
    assert len(re.findall(quotient, code)) >= 4


@compiled_only
def test_what_is_absent_is_not_in_the_machine_code():
    variants = ((TAU, True), (None, True), (None, False))
    codes = [machine_code(np.float32, damping=damping, bends=bends) for damping, bends in variants]
    # A product may be one with a sum: fmadd and the like of x86, fmla and fmls of ARM.
    kinds = (r"\bv?f?(mul[ps.\s]|n?m(add|sub|la|ls))", r"\bv?f?sub[ps.\s]")
    products, differences = ([len(re.findall(kind, code)) for code in codes] for kind in kinds)
    # A damped spring has four products and three differences more, and there are four; bending has two more each along
    # every coordinate, of bend springs across and down and of twist.
    assert products[0] - products[1] >= 16
    assert differences[0] - differences[1] >= 12
    assert products[1] - products[2] >= 18
    assert differences[1] - differences[2] >= 18


@compiled_only
def test_a_unit_has_no_code_for_what_its_group_lacks():
    sheet = Sheet()
    groups = (sheet.group(), sheet.group(damping=None), sheet.group(damping=None, bends=False))
    lines = [len(assembly_of_unit(grid.grid_springs, group).splitlines()) for group in groups]
    assert lines[0] > lines[1] + 20
    assert lines[1] > lines[2] + 20


def test_what_is_absent_is_not_read():
    sheet = Sheet()
    expected = sheet.forces(damping=None, bends=False)
    for component in sheet.state[3:]:
        component[:] = np.nan
    np.testing.assert_array_equal(sheet.forces(damping=None, bends=False), expected)
