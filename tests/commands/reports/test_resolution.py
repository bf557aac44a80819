"""What resolution buys: the sheet that is measured, how it comes to rest and swings, and orders of convergence."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh_tridiagonal

from cape import BackwardEuler, Diverged, Simulation, Solver
from cape.cloth.cloth import Cloth, GridCloth
from cape.report import run
from cape.report.measured import resolution
from cape.report.measured.resolution import (
    Measured,
    come_to_rest,
    first_mode,
    measure,
    order,
    period_of,
    rows_of,
    sampled,
)
from cape.report.plan import FULL, QUICK, Plan
from cape.report.shown import page
from cape.report.shown.plot import save_space_diagram
from cape.run.step_error import distance
from cape.scene.poses import Pose
from cape.scene.standard_scenes import curtain

G = 9.81
STILL = Pose(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]))


def rested(spacing: float, *, gather: float, push: float = 0.0, solver: Solver | None = None) -> np.ndarray:
    """Points of the pattern at rest [m], after the hem was pushed off by a distance [m]."""
    scene = curtain(spacing=spacing, gather=gather).scene
    simulation = Simulation(scene, solver=solver, threads=1)
    simulation.start(STILL)
    down = scene.cloth.pattern[:, 1:] / scene.cloth.pattern[:, 1].max()
    simulation.disturb(push * down**2 * np.array([1.0, 0.3, 0.0]))
    assert come_to_rest(simulation, STILL)
    assert isinstance(scene.cloth, GridCloth)
    return sampled(scene.cloth, simulation.positions)


# -- the sheet --


def test_a_curtain_starts_without_strain_and_finer_ones_hold_the_same_points():
    wide, narrow = (curtain(spacing=spacing).scene.cloth for spacing in (0.06, 0.0075))
    assert isinstance(wide, GridCloth)
    assert isinstance(narrow, GridCloth)
    every = narrow.positions.reshape(narrow.rows, narrow.columns, 3)[::8, ::8].reshape(-1, 3)
    np.testing.assert_allclose(every, wide.positions, atol=1e-9)
    edge = np.linalg.norm(np.diff(narrow.positions[: narrow.columns], axis=0), axis=1)
    # A chord of an arc of curvature up to k is shorter by (k h)^2 / 24; k = 4 pi / 0.72 m.
    deficit = (4.0 * np.pi / 0.72 * 0.0075) ** 2 / 24.0
    assert np.all(edge <= 0.0075 + 1e-9)
    assert np.all(edge >= 0.0075 * (1.0 - deficit) - 1e-9)
    # The mean of cos(sin x) is J0(1).
    assert np.ptp(narrow.positions[:, 1]) == pytest.approx(0.765197687 * 0.72, rel=1e-6)


def test_it_comes_to_rest_in_one_place_wherever_it_is_pushed_to():
    one, other = rested(0.06, gather=1.0), rested(0.06, gather=1.0, push=0.1)
    # At rest means a micrometre in half a second; what is left to go is of that size.
    assert distance(one, other) < 1e-5


def test_an_implicit_solver_comes_to_rest_in_the_same_shape():
    # The steps of both end where forces are in balance; at rest means a micrometre in half a second.
    assert distance(rested(0.06, gather=1.0), rested(0.06, gather=1.0, solver=BackwardEuler())) < 1e-5


def test_the_resting_shape_converges_with_the_square_of_the_spacing():
    shapes = [rested(spacing, gather=0.3) for spacing in (0.06, 0.03, 0.015)]
    changes = [distance(shapes[k], shapes[k + 1]) for k in range(2)]
    assert order(changes) == pytest.approx(2.0, abs=0.2)
    # Bending opens the hem: none of it is there without.
    assert distance(shapes[2], sampled_start(0.015, gather=0.3)) > 10.0 * changes[0]


def sampled_start(spacing: float, *, gather: float) -> np.ndarray:
    cloth = curtain(spacing=spacing, gather=gather).scene.cloth
    assert isinstance(cloth, GridCloth)
    return sampled(cloth, cloth.positions)


# -- the swing --


def test_a_chain_of_many_links_swings_as_the_closed_form_says():
    links = 400
    # Masses of one share of the length at the lower ends of links, the last one half: m x'' = T (dx / l) differences.
    weight = np.ones(links)
    weight[-1] = 0.5
    tension = np.cumsum(weight[::-1])[::-1]
    diagonal = (tension + np.append(tension[1:], 0.0)) / weight
    beside = -tension[1:] / np.sqrt(weight[1:] * weight[:-1])
    slowest, shapes = eigh_tridiagonal(diagonal, beside, select="i", select_range=(0, 0))
    # In units of g and the length, of which a link is 1 / links.
    period = 2.0 * np.pi / math.sqrt(slowest[0] * links)
    # Its error is of second order in a link, (1 / links)^2.
    assert period == pytest.approx(resolution.chain_period(1.0, 1.0), rel=links**-2.0 * 5.0)
    shape = shapes[:, 0] / np.sqrt(weight)
    below = 1.0 - np.arange(1, links + 1) / links
    np.testing.assert_allclose(shape / shape[-1], first_mode(below), atol=5.0 * links**-2.0)


def test_a_period_is_read_from_zero_crossings():
    times = np.arange(160) / 60.0
    # A line through a sine's crossing between two frames is off by less than (w h)^3 / 9 sqrt(3) / w.
    assert period_of(np.cos(2.0 * np.pi * times / 1.8)) == pytest.approx(1.8, abs=(2.0 * np.pi / 1.8 / 60.0) ** 3 / 10)
    assert math.isnan(period_of(np.cos(times)))


def stretched_share() -> float:
    """By how much of itself threads that stretch lengthen the period of a hanging sheet.

    To first order in the tension T = rho g s over Y: w^2 falls by the integral of T^2 / Y x'^2 over that of T x'^2
    (Rayleigh's principle), with the slope x' of the chain's own shape.
    """
    fabric = curtain(spacing=0.06).scene.cloth.fabric
    tension = fabric.density * G * 1.2 * np.linspace(0.0, 1.0, 2001)
    slope = np.gradient(first_mode(np.linspace(0.0, 1.0, 2001)))
    return 0.5 * float(np.sum(tension**2 / fabric.stretch_warp * slope**2) / np.sum(tension * slope**2))


@pytest.fixture(scope="module")
def coarse() -> Measured:
    return measure("euler", 0.06)


@pytest.mark.extra
def test_a_sheet_swings_as_a_chain_whose_threads_stretch(coarse: Measured):
    found = [coarse, *(measure("euler", spacing) for spacing in (0.03, 0.015))]
    rows = rows_of(found, found[-1])
    assert [row.result for row in rows] == ["finished"] * 3
    assert rows[-1].period_order == pytest.approx(2.0, abs=0.1)
    # Once the error of the spacing is extrapolated away, what is left is the stretch, to second order of a
    # thousandth, and the bending, B / (rho g L^3) = 4e-5 of the weight.
    limit = found[2].period + (found[2].period - found[1].period) / 3.0
    assert limit / found[2].chain_period - 1.0 == pytest.approx(stretched_share(), abs=4e-5)
    assert stretched_share() > 2e-4


# -- figures --


def test_an_order_is_the_power_of_the_spacing():
    assert order([0.4, 0.1]) == pytest.approx(2.0)
    assert order([0.1, 0.4]) == pytest.approx(-2.0)
    assert math.isnan(order([0.1]))
    assert math.isnan(order([0.0, 0.1]))
    assert math.isnan(order([0.1, math.nan]))


@pytest.mark.parametrize("spacing", [0.06, 0.05, 0.03])
def test_points_of_the_pattern_lie_where_the_vertices_span_them(spacing: float):
    cloth = Cloth.rectangle(width=0.72, height=1.2, spacing=spacing)
    u, v = cloth.pattern.T
    points = sampled(cloth, np.stack([u, v, u * v], axis=1))
    across, down = np.meshgrid(np.linspace(0.0, 0.72, 13), np.linspace(0.0, 1.2, 21))
    np.testing.assert_allclose(points, np.stack([across.ravel(), down.ravel(), (across * down).ravel()], axis=1))


def test_what_explodes_has_no_figures_and_says_why(monkeypatch: pytest.MonkeyPatch):
    def explode(*_: object) -> bool:
        raise Diverged("the cloth explodes")

    monkeypatch.setattr(resolution, "come_to_rest", explode)
    broken = measure("euler", 0.06)
    row = rows_of([broken], broken)[0]
    assert row.result == "diverged: the cloth explodes"
    assert row.vertices == 273
    assert math.isnan(row.hem_width_m)
    assert math.isnan(row.period_error)


def test_a_measurement_survives_json(coarse: Measured):
    again = Measured.from_json(json.loads(json.dumps(coarse.as_json())))
    np.testing.assert_array_equal(again.shape, coarse.shape)
    assert dataclasses.replace(again, shape=coarse.shape).as_json() == coarse.as_json()


# -- in the report --


def test_an_interrupted_report_does_not_measure_a_spacing_twice(
    tmp_path: Path, coarse: Measured, monkeypatch: pytest.MonkeyPatch
):
    asked: list[tuple[str, float]] = []

    def measured(solver: str, spacing: float, *, repeats: int) -> Measured:
        asked.append((solver, spacing))
        if len(asked) == 3:
            raise KeyboardInterrupt
        return dataclasses.replace(coarse, solver=solver, spacing=spacing)

    monkeypatch.setattr(resolution, "measure", measured)
    plan = Plan(scenes=(), solvers=("xpbd", "tr_bdf2"), every=1, repeats=1, seconds=1.0, scene_s=1.0, cases=(),
                case_repeats=1, spacings=(0.06, 0.03))  # fmt: skip
    steps: list[tuple[str, int]] = []

    def told(section: str, count: int):
        return lambda: steps.append((section, count))

    with pytest.raises(KeyboardInterrupt):
        run.run(plan, tmp_path, told)
    report = run.run(plan, tmp_path, told)
    # The reference comes first, whatever is asked for, and has no row of its own then.
    assert asked == [("euler", 0.03), ("xpbd", 0.06), ("xpbd", 0.03), ("xpbd", 0.03)]
    assert steps == [("spacings", 3)] * 5
    assert [(row.solver, row.spacing_m) for row in report.space] == [("xpbd", 0.06), ("xpbd", 0.03)]
    assert [row["spacing_m"] for row in report.as_json()["space"]] == [0.06, 0.03]
    # Of solvers that are not measured, none is asked for.
    assert run.run(dataclasses.replace(plan, solvers=("tr_bdf2",)), tmp_path, told).space == []
    assert len(asked) == 4


def test_only_the_full_report_measures_spacings():
    assert FULL.spacings == (0.06, 0.03, 0.015, 0.0075)
    assert QUICK.spacings == ()


def test_the_page_and_the_diagram_show_every_spacing(coarse: Measured, tmp_path: Path):
    found = [
        dataclasses.replace(coarse, spacing=spacing, shape=coarse.shape * (1.0 + spacing**2), period=1.0 + spacing**2)
        for spacing in (0.06, 0.03, 0.015)
    ]
    plan = dataclasses.replace(QUICK, scenes=(), cases=(), spacings=(0.06, 0.03, 0.015))
    report = run.Report(plan, [], [], rows_of(found, found[-1]))
    text = page.markdown(report, pictures=True, recordings=False, command="cape report")
    section = text.split("## What resolution buys")[1].split("## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("| symplectic Euler")]
    assert [line.split("|")[2].strip() for line in lines] == ["6", "3", "1.5"]
    assert f"{report.space[0].hem_width_m:.4f}" in lines[0]
    assert "![One sheet at several spacings](space.png)" in section
    assert "resolution buys" not in page.markdown(run.Report(plan, [], []), pictures=True, recordings=False, command="")
    save_space_diagram(report.space, tmp_path / "space.png")
    assert (tmp_path / "space.png").read_bytes().startswith(b"\x89PNG")
