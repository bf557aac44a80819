"""XPBD as a solver: its colours, its limit on both layouts, the same bits on any number of threads, any stiffness."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cape import XPBD, Fabric, Scene, SymplecticEuler, attach
from cape.assembly.coloring import by_color
from cape.cloth.cloth import Cloth
from cape.kernels.xpbd.grid import GridConstraints
from cape.solvers import Solver
from tests.support.scenes import Run, grid_cloth, turn_about

SOFT = Fabric(density=0.2, stretch=50.0, shear=10.0, bend=1e-4, damping_time=1e-3, bend_damping_time=1e-3)
LAYOUTS = ("grid", "mesh")


@settings(max_examples=60, deadline=None)
@given(st.integers(2, 4), st.data())
def test_no_two_constraints_of_one_colour_share_a_vertex(size: int, data: st.DataObject):
    rows = st.lists(st.permutations(range(12)).map(lambda p: p[:size]), max_size=150)
    members = np.array(data.draw(rows), dtype=np.int64).reshape(-1, size)
    colors = by_color(members)
    np.testing.assert_array_equal(np.sort(colors.order), np.arange(len(members)))
    assert colors.starts[0] == 0
    assert colors.starts[-1] == len(members)
    for start, end in zip(colors.starts[:-1], colors.starts[1:], strict=True):
        vertices = members[colors.order[start:end]].ravel()
        assert start < end
        assert len(np.unique(vertices)) == len(vertices)
    # A constraint that meets d others takes one of the first d + 1 colours.
    degree = np.bincount(members.ravel(), minlength=12)
    most = (degree[members] - 1).sum(axis=1).max(initial=0) + 1
    assert len(colors.starts) - 1 <= most


def cloth_of(layout: str, fabric: Fabric = SOFT, cells: tuple[int, int] = (4, 7)) -> Cloth:
    grid = grid_cloth(
        np.linspace(0, 0.1 * cells[0], cells[0] + 1), np.linspace(0, 0.1 * cells[1], cells[1] + 1), fabric
    )
    return grid if layout == "grid" else Cloth.from_mesh(grid.positions, grid.triangles, fabric=fabric)


def swung(layout: str, solver: Solver, substeps: int, *, frames: int = 12, threads: int = 1, **cloth) -> Run:
    """A cloth that hangs from a bone which is swung and turned."""
    made = cloth_of(layout, **cloth)
    top = np.flatnonzero(made.positions[:, 2] == 0.0)
    run = Run(Scene(made, [attach(made, "hand", top)]), solver, threads=threads)
    for frame in range(1, frames + 1):
        angle = 2 * np.pi * frame / 60
        pose = [[0.1 * np.sin(angle), 0.05 * np.sin(2 * angle), 0.0]], [turn_about((0, 0, 1), 0.5 * np.sin(angle))]
        run.step(1 / 60, substeps, pose)
    return run


@pytest.mark.parametrize(("vertices", "count"), [(1, 3), (1000, 2), (50, 9)])
def test_constraints_get_the_first_colour_left_in_the_order_of_their_vertices(vertices: int, count: int):
    members = np.random.default_rng(1).integers(0, vertices, (200, count))
    members[100:] = members[:100][:, ::-1]  # those on the same vertices stay in their order
    near = np.lexsort(np.sort(members, axis=1).T[::-1]).tolist()
    met: list[set[int]] = [set() for _ in range(vertices)]
    given = {}
    for constraint in near:
        taken = set().union(*(met[vertex] for vertex in members[constraint]))
        given[constraint] = next(color for color in range(len(members)) if color not in taken)
        for vertex in members[constraint]:
            met[vertex].add(given[constraint])
    colors = by_color(members)
    assert colors.order.tolist() == sorted(near, key=given.__getitem__)
    np.testing.assert_array_equal(np.diff(colors.starts), np.bincount(list(given.values())))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_first_order_and_the_limit_of_symplectic_euler(layout: str):
    limits, errors = [], []
    for solver in (XPBD(precision="double"), SymplecticEuler(precision="double")):
        coarse, middle, fine = (swung(layout, solver, substeps).positions for substeps in (160, 320, 640))
        order = np.log2(np.linalg.norm(coarse - middle) / np.linalg.norm(middle - fine))
        assert order == pytest.approx(1.0, abs=0.2), solver.name
        limits.append(2 * fine - middle)
        errors.append(np.abs(fine - limits[-1]).max())
    # Extrapolation leaves the second order: a twentieth of the coarser solver's error.
    assert np.abs(limits[0] - limits[1]).max() < 0.05 * max(errors)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_same_bits_on_two_threads_and_again(layout: str):
    # 25 columns in 19 rows: spans of threads end within rows, and a colour's middle lies anywhere.
    one, again, two = (swung(layout, XPBD(), 20, frames=3, threads=t, cells=(24, 18)) for t in (1, 1, 2))
    for run in (again, two):
        for mine, other in zip(run.state, one.state, strict=True):
            np.testing.assert_array_equal(mine, other)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_single_precision_stays_near_double(layout: str):
    single, double = (swung(layout, XPBD(precision=p), 40, frames=60).positions for p in ("single", "double"))
    finer = swung(layout, XPBD(precision="double"), 80, frames=60).positions
    # Positions as unknowns were off by more than 5 cm. As it is, rounding is far below what the size of the step does.
    assert 0 < np.linalg.norm(single - double) < 0.005 * np.linalg.norm(finer - double)


def test_several_sweeps_come_nearer_to_the_limit():
    limit = swung("grid", XPBD(precision="double"), 1280).positions
    errors = [
        np.linalg.norm(swung("grid", XPBD(precision="double", iterations=n), 10).positions - limit) for n in (1, 20)
    ]
    implicit = swung("grid", XPBD(precision="double", iterations=100), 10).positions
    # What is left after many sweeps is the error of implicit Euler, which 20 sweeps have nearly reached.
    assert np.linalg.norm(implicit - limit) < errors[1] * 1.2
    assert errors[1] < errors[0]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_what_is_absent_is_what_vanishes(layout: str):
    bare = dataclasses.replace(SOFT, shear=0.0, bend=0.0, damping_time=0.0, bend_damping_time=0.0)
    least = dataclasses.replace(SOFT, shear=1e-12, bend=1e-15, damping_time=1e-15, bend_damping_time=1e-15)
    without, with_little = (
        swung(layout, XPBD(precision="double"), 20, frames=2, fabric=f).positions for f in (bare, least)
    )
    arrays = XPBD().arrays(Run(Scene(cloth_of(layout, bare)), XPBD()).assembly)
    assert (arrays.damping, arrays.bend_damping, arrays.forces) == (None, None, {})
    constraints = arrays.constraints
    if isinstance(constraints, GridConstraints):
        assert constraints.diagonal is constraints.bend_down is constraints.twist is constraints.across.impulse is None
    else:
        assert constraints.springs is not None
        assert constraints.bends is constraints.membrane is constraints.springs.stretch.slack is None
    np.testing.assert_allclose(without, with_little, atol=1e-9)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("stretch", [1e2, 1e4, 1e6, 1e8])
def test_any_stiffness_is_finite_and_gains_no_energy(layout: str, stretch: float):
    fabric = Fabric(density=0.2, stretch=stretch, shear=stretch / 10, bend=1e-5, damping_time=0, bend_damping_time=0)
    cloth = cloth_of(layout, fabric)
    pulled = dataclasses.replace(cloth, positions=cloth.positions * 1.01)
    run = Run(Scene(pulled, gravity=(0.0, 0.0, 0.0)), XPBD())
    springs = run.assembly.springs

    def energy() -> float:
        p = run.assembly.inwards(run.positions)
        strain = np.linalg.norm(p[springs.second] - p[springs.first], axis=1) - springs.rest
        bend = np.einsum("ka,kac->kc", springs.bend_coefficients, p[springs.bend_vertices])
        held = 0.5 * springs.stiffness @ strain**2 + 0.5 * springs.bend_stiffness @ (bend**2).sum(axis=1)
        speed = sum(np.square(v, dtype=float) for v in run.state[3:])
        return float(held + 0.5 * run.assembly.mass @ speed)

    # Positions of up to 0.7 m are rounded to 2^-25 of them: so much energy stands in the springs of a cloth at rest.
    rounding = 0.5 * springs.stiffness.sum() * (0.7 * 2.0**-25) ** 2 * 4
    last = start = energy()
    for _ in range(60):
        run.step(1 / 60, run.solver.choose_substeps(run.running, 1 / 60))
        now = energy()
        assert now <= last + 1e-5 * start + rounding
        last = now
    assert last < start


@pytest.mark.parametrize(("layout", "spacing"), [("grid", 0.03), ("grid", 0.015), ("mesh", 0.015), ("grid", 0.005)])
def test_at_its_default_a_sheet_hangs_as_long_as_it_is_at_any_spacing(layout: str, spacing: float):
    length = 1.2
    cloth = Cloth.rectangle(width=2 * spacing, height=length, spacing=spacing)
    if layout == "mesh":
        cloth = Cloth.from_mesh(cloth.positions, cloth.triangles, fabric=cloth.fabric)
    top = np.flatnonzero(cloth.positions[:, 2] == cloth.positions[:, 2].max())
    run = Run(Scene(cloth, [attach(cloth, "rod", top)]), XPBD())
    run.settle(240, run.solver.choose_substeps(run.running, 1 / 60), damping=0.93)
    # Tension grows evenly from nothing at the hem to the sheet's weight.
    right = length + cloth.fabric.density * 9.81 * length**2 / (2 * cloth.fabric.stretch_warp)
    assert cloth.positions[:, 2].max() - run.positions[:, 2].min() == pytest.approx(right, rel=0.003)


def test_a_default_follows_the_spacing_and_what_is_given_stays():
    def chosen(solver: XPBD, spacing: float, **scene) -> int:
        cloth = Cloth.rectangle(width=0.1, height=1.2, spacing=spacing)
        run = Run(Scene(cloth, [attach(cloth, "rod", "top")], **scene), solver)
        return run.solver.choose_substeps(run.running, 1 / 60)

    coarse, middle, fine = (chosen(XPBD(), spacing) for spacing in (0.03, 0.01, 0.005))
    assert coarse == 40
    assert fine == pytest.approx(2 * middle, abs=1)  # the sag of a chain grows as the square of its springs
    assert chosen(XPBD(substeps=7), 0.005) == 7
    assert chosen(XPBD(), 0.005, gravity=(0.0, 0.0, 0.0)) == 40
