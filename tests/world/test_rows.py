"""What becomes of the figures: verdicts, JSON, the page, and reports of one section alone."""

import json
import math
from pathlib import Path

import pytest

from cape.cloth.fabrics import FABRICS
from cape.report.measured.world.rows import Row, mean, scatter
from cape.report.measured.world.trials import TESTS, trials_of
from cape.report.plan import FULL, QUICK, SECTIONS, Plan
from cape.report.run import run
from cape.report.shown import page, world
from motions.errors import UnknownNameError


def row(simulated: float, *, expected: float = 2.0, relative: bool = False, result: str = "finished") -> Row:
    return Row(
        test="pendulum", subject="90 degrees", variant="euler", quantity="period", unit="s", simulated=simulated,
        expected=expected, allowed=0.1, relative=relative, result=result, source="a | book",
    )  # fmt: skip


def test_verdicts():
    assert [row(value).verdict for value in (1.95, 2.05, 2.15, 1.85)] == ["passes", "passes", "degrades", "degrades"]
    assert row(2.15, relative=True).verdict == "passes"
    assert row(2.15, relative=True).difference == pytest.approx(0.075)
    assert row(2.0, result="does not come to rest").verdict == "fails"
    assert row(2.0, expected=math.nan).verdict == ""
    assert row(math.nan).verdict == "degrades"


def test_means_and_scatter():
    assert mean([1.0, 2.0, 6.0]) == 3.0
    assert scatter([1.0, 2.0, 6.0]) == pytest.approx(math.sqrt(7.0))
    assert math.isnan(mean([]))
    assert math.isnan(scatter([1.0]))


def test_a_row_survives_json_with_its_digits():
    this = row(1.23456789, expected=math.nan)
    fields = json.loads(json.dumps(this.as_json()))
    assert fields["expected"] is None
    again = Row.from_json(fields)
    assert again.simulated == pytest.approx(1.23456789, rel=1e-6)
    assert math.isnan(again.expected)


def test_every_fabric_is_in_the_cantilever_both_ways_and_draped():
    names = [trial.name for trial in trials_of(FULL.world)]
    assert len(names) == len(set(names))
    for fabric in FABRICS:
        assert {f"cantilever of {fabric}, warp, grid", f"cantilever of {fabric}, weft, grid"} <= set(names)
        assert f"drape of {fabric}, random" in names
    assert FULL.world == tuple(TESTS)
    with pytest.raises(UnknownNameError, match="pendulum"):
        trials_of(["plumb line"])


def test_a_report_of_one_section_alone(tmp_path: Path):
    plan = QUICK.only("world")
    assert plan.world == QUICK.world
    assert plan.scenes == plan.cases == plan.spacings == plan.balances == ()
    assert {section for section in SECTIONS if FULL.only(section) == FULL} == set()
    with pytest.raises(UnknownNameError, match="stress"):
        QUICK.only("weather")


def test_figures_reach_page_and_json(monkeypatch: pytest.MonkeyPatch):
    from cape.report.measured.world import trials

    found = [row(2.01), row(2.5), row(2.0, result="does not come to rest")]
    monkeypatch.setitem(trials.TESTS, "pendulum", lambda: iter([trials.Trial("swings", lambda: found)]))
    plan = Plan(scenes=(), every=1, repeats=1, seconds=1.0, scene_s=1.0, cases=(), case_repeats=1, world=("pendulum",))
    report = run(plan)
    assert [each["verdict"] for each in report.as_json()["world"]] == ["passes", "degrades", "fails"]
    text = page.markdown(report, pictures=False, recordings=False, command="cape report --only world")
    assert "## Against the world" in text
    assert "1 of 3 figures pass" in text
    assert "How to read it" not in text
    assert '<td class="fails">' in page.html(text)


def test_cells_tell_how_far_off_a_figure_is():
    assert world._cell(None) == ""
    assert world._cell(row(2.05, relative=True)) == "passes: 2.05 (+2.50%)"
    assert world._cell(row(2.15)) == "degrades: 2.15 (+0.15)"
    assert world._cell(row(2.15, expected=math.nan)) == "2.15"
