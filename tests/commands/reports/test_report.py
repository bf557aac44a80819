"""The report: errors against a reference, how sure that is, and runs that all set out from one state."""

import dataclasses
import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cape import Simulation, Sphere, SymplecticEuler
from cape.cli.measuring import sections
from cape.report import run
from cape.report.measured.accuracy import SURE, converge, error_of, window_error
from cape.report.measured.clock import Clock, Timing, quickest
from cape.report.measured.energy import Account, accounts
from cape.report.measured.stability import Outcome
from cape.report.measured.sweep import Row, Sweep, sweep
from cape.report.measured.trajectory import EXACT, Setting, Stage, Trajectory
from cape.report.plan import Plan
from cape.report.run import PARTS, Scene, forget_parts
from cape.report.shown import page
from cape.report.shown.plot import draw, draw_energy, save_diagram, save_energy
from cape.scene.standard_scenes import StandardScene, worn
from cape.scene.standard_scenes import swing as swinging
from motions.errors import FileError, ValueRangeError
from motions.files import write_text
from tests.run.test_simulation import hanging, swing
from tests.support.command import Forks

FRAME = 1 / 60


def trajectory(positions: np.ndarray) -> Trajectory:
    """A run through positions (F, V, 3) at 60 frames a second."""
    none = np.zeros(len(positions))
    times = np.arange(len(positions), dtype=float) / 60.0
    return Trajectory(Setting("euler"), 1, times, positions, none, none, none, 1.0, 1.0, 0)


# -- errors --


def test_errors_are_distances_of_vertices():
    rng = np.random.default_rng(1)
    reference = rng.standard_normal((90, 5, 3))
    off = rng.standard_normal((90, 5, 3)) * 1e-3
    error = error_of(trajectory(reference + off), trajectory(reference))
    distances = np.linalg.norm(off[1:], axis=2)
    assert error.rms_mm == pytest.approx(1e3 * np.sqrt(np.mean(distances**2)), rel=1e-9)
    assert error.max_mm == pytest.approx(1e3 * distances.max(), rel=1e-9)


def test_what_swings_to_and_fro_has_the_same_mean_shape():
    reference = np.zeros((121, 4, 3))
    swung = reference.copy()
    swung[::2, :, 0], swung[1::2, :, 0] = 0.05, -0.05
    error = error_of(trajectory(swung), trajectory(reference))
    assert error.rms_mm == pytest.approx(50.0)
    assert error.shape_mm == pytest.approx(0.0, abs=1e-9)
    shifted = error_of(trajectory(np.add(swung, [0.0, 0.0, 0.003])), trajectory(reference))
    assert shifted.shape_mm == pytest.approx(3.0)


def test_a_run_that_breaks_off_is_compared_as_far_as_it_goes():
    reference = np.zeros((60, 4, 3))
    error = error_of(trajectory(reference[:20] + 0.001), trajectory(reference))
    assert error.max_mm == pytest.approx(np.sqrt(3.0))
    assert np.isnan(error_of(trajectory(reference[:1]), trajectory(reference)).rms_mm)


# -- one state to set out from --


@pytest.mark.parametrize("held_inside", [False, True])
def test_a_simulation_goes_on_like_another(held_inside: bool):
    scene = hanging()
    if held_inside:
        # What the bone holds is being led out of a ball.
        scene = dataclasses.replace(scene, colliders=[Sphere(center=scene.cloth.positions[0], radius=0.1)])
    one = Simulation(scene, solver=SymplecticEuler())
    one.start(swing(0.0))
    for frame in range(1, 6):
        one.step(swing(frame * FRAME), FRAME)
    other = Simulation(scene, solver=SymplecticEuler())
    other.start_from(one.snapshot())
    np.testing.assert_array_equal(other.positions, one.positions)
    for frame in range(6, 9):
        for simulation in (one, other):
            simulation.step(swing(frame * FRAME), FRAME)
    np.testing.assert_array_equal(other.positions, one.positions)
    np.testing.assert_array_equal(other.velocities, one.velocities)


def test_a_snapshot_is_of_a_scene_that_runs():
    one, other = Simulation(hanging()), Simulation(hanging())
    with pytest.raises(ValueRangeError, match="has not been started"):
        one.snapshot()
    one.start(swing(0.0))
    with pytest.raises(ValueRangeError, match="of its own scene"):
        other.start_from(one.snapshot())


@pytest.fixture(scope="module")
def stage() -> Stage:
    return Stage(small_swing())


def small_swing() -> StandardScene:
    return swinging(spacing=0.1, seconds=0.5)


@pytest.mark.parametrize("solver", ["euler", "xpbd", "backward_euler", "tr_bdf2"])
def test_all_runs_of_a_stage_set_out_from_the_same_place(stage: Stage, solver: str):
    run = stage.run(Setting(solver, 40), repeats=2)
    assert run.result == "finished"
    assert len(run.positions) == len(run.stretch) == len(run.penetration) == stage.frames
    start = stage.run(Setting("euler", options=(("precision", "double"),))).positions[0]
    # Single precision rounds it.
    np.testing.assert_allclose(run.positions[0], start, atol=2e-7)
    assert 0.0 < run.seconds < np.inf


def test_a_worn_cape_sets_out_settled():
    standard = worn("walk", vertices=200)
    stage = Stage(standard)
    run = stage.run(Setting("xpbd", 10))
    again = stage.run(Setting("euler"))
    np.testing.assert_allclose(run.positions[0], again.positions[0], atol=2e-6)


# -- the reference --


def test_the_reference_is_as_sure_as_it_says(stage: Stage):
    options = (("tolerance", 1e-10), ("forcing", 1e-6))
    reference = converge(stage, "tr_bdf2", substeps=8, aim_mm=0.1, options=options)
    assert reference.settled
    assert reference.uncertainty.rms_mm <= SURE * 0.1
    # Of second order: halving the step once more changes it by less than it changed before.
    finer = stage.run(Setting("tr_bdf2", 2 * reference.trajectory.substeps, options))
    assert error_of(reference.trajectory, finer).rms_mm < 0.5 * reference.uncertainty.rms_mm


def test_a_reference_that_ran_out_of_time_says_so(stage: Stage):
    reference = converge(stage, "euler", substeps=20, aim_mm=1e-9, enough=lambda: True)
    assert not reference.settled
    assert reference.uncertainty.rms_mm > 0.0
    assert reference.trajectory.substeps == 40


def test_a_window_starts_from_the_reference_itself(stage: Stage):
    reference = stage.run(Setting("euler", 80, EXACT.options))
    assert list(reference.snapshots) == sorted(stage.window_starts)
    assert stage.window == 6
    # The same steps from the same states end in the same places; longer ones do not.
    assert window_error(stage, reference.setting, reference) == 0.0
    coarse, fine = (window_error(stage, Setting("euler", n, EXACT.options), reference) for n in (20, 40))
    # Of first order, and the reference itself is off by 1/80: (1/20 - 1/80) / (1/40 - 1/80) = 3.
    assert coarse / fine == pytest.approx(3.0, abs=0.2)


def test_a_window_that_breaks_off_has_no_error(stage: Stage):
    reference = stage.run(Setting("euler", 80))
    snapshots = {frame: snapshot for frame, snapshot in list(reference.snapshots.items())[:1]}
    place = snapshots[next(iter(snapshots))].place
    torn = place._replace(state=place.state * 1e7)
    bad = {frame: snapshot._replace(place=torn) for frame, snapshot in snapshots.items()}
    assert math.isnan(window_error(stage, Setting("euler", 20), dataclasses.replace(reference, snapshots=bad)))


# -- the sweep --

TINY = Plan(scenes=("small",), solvers=("euler", "xpbd"), every=3, repeats=1, seconds=0.3, scene_s=30.0,
            cases=(), case_repeats=1)  # fmt: skip


def test_a_sweep_has_a_row_for_every_setting(stage: Stage):
    done = sweep(stage, TINY)
    names = [(row.solver, row.setting) for row in done.rows]
    assert names[0] == ("euler", "default")
    assert [setting for solver, setting in names if solver == "xpbd"] == [
        "default", "5 substeps", "40 substeps", "320 substeps",
    ]  # fmt: skip
    assert all(row.finished and row.frames == stage.frames for row in done.rows)
    assert done.uncertainty.rms_mm < min(row.rms_mm for row in done.rows)
    xpbd = [row for row in done.rows if row.solver == "xpbd"]
    assert xpbd[1].rms_mm > xpbd[2].rms_mm > xpbd[3].rms_mm
    # Of those that are good enough the fastest is shown.
    good = [row for row in xpbd if row.rms_mm <= 10.0]
    assert str(done.shown["xpbd"].setting) == min(good, key=lambda row: row.seconds_per_second).setting


def test_what_would_take_too_long_is_left_out_and_named(stage: Stage):
    done = sweep(stage, dataclasses.replace(TINY, scene_s=1e-3))
    left_out = [row for row in done.rows if not row.finished]
    # The first of each solver tells how long the others would take.
    assert {row.setting for row in done.rows if row.finished} == {"default", "10 mm"}
    assert len(left_out) == len(done.rows) - 3
    assert all(row.result.startswith("left out: it takes about") for row in left_out)
    assert all(math.isnan(row.rms_mm) for row in left_out)


@pytest.mark.parametrize(("scene_s", "unknown"), [(30.0, False), (1e-6, True)])
def test_short_trajectories_are_left_out_where_these_alone_take_too_long(scene_s: float, unknown: bool):
    stage = Stage(dataclasses.replace(small_swing(), smooth=False))
    done = sweep(stage, dataclasses.replace(TINY, scene_s=scene_s))
    assert {math.isnan(row.window_mm) for row in done.rows if row.finished} == {unknown}


# -- the whole report --


def row(**fields: Any) -> Row:
    plain = Row("small", "euler", "default", 20, 0.1, rms_mm=1.0, window_mm=1.0)
    return dataclasses.replace(plain, **fields)


def scene(*rows: Row, unsure: float = 0.01, smooth: bool = True) -> Scene:
    return Scene("small", smooth, 100, 2.0, row(rms_mm=unsure, window_mm=unsure, substeps=999), list(rows))


def test_a_row_survives_json():
    before = row(max_mm=3.25, result="diverged")
    fields = json.loads(json.dumps(before.as_json(), allow_nan=False))
    assert fields["shape_mm"] is None
    after = Row.from_json(fields)
    assert math.isnan(after.shape_mm)
    assert after.max_mm == 3.25
    assert after.result == "diverged"


def test_an_interrupted_report_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    measured: list[str] = []

    def build(name: str) -> StandardScene:
        measured.append(name)
        if measured == ["first", "second"]:
            raise KeyboardInterrupt
        return dataclasses.replace(swinging(spacing=0.2, seconds=0.3), name=name)

    monkeypatch.setattr(run, "standard_scene", build)
    monkeypatch.setattr(run, "compile_all", lambda plan: None)
    plan = dataclasses.replace(TINY, scenes=("first", "second"), cases=("jerky",), balances=("third",))
    with pytest.raises(KeyboardInterrupt):
        run.run(plan, tmp_path)
    report = run.run(plan, tmp_path)
    assert measured == ["first", "second", "second", "third"]
    assert [(account.scene, account.solver) for account in report.energy] == [
        ("third", "euler"), ("third", "euler"), ("third", "xpbd"), ("third", "xpbd"),
    ]  # fmt: skip
    assert run.run(plan, tmp_path).energy == report.energy
    assert len(measured) == 4
    assert [found.name for found in report.scenes] == ["first", "second"]
    assert [(outcome.case, outcome.solver) for outcome in report.stability] == [("jerky", "euler"), ("jerky", "xpbd")]
    # By another plan nothing of it counts.
    run.run(dataclasses.replace(plan, repeats=2, scenes=("first",), balances=()), tmp_path)
    assert measured[4:] == ["first"]
    forget_parts(tmp_path)
    assert not (tmp_path / PARTS).exists()


def test_what_was_measured_is_kept_where_its_recording_can_not_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Then the runs that are recorded are taken again, and nothing is measured twice."""
    swept, offered, written = [], [], []

    def full(done: Sweep) -> None:
        offered.append(done)
        raise FileError("can't write it: No space left on device")

    def once(stage: Stage, *rest: Any) -> Sweep:
        swept.append(stage)
        return sweep(stage, *rest)

    monkeypatch.setattr(run, "standard_scene", lambda name: dataclasses.replace(small_swing(), name=name))
    monkeypatch.setattr(run, "compile_all", lambda plan: None)
    monkeypatch.setattr(run, "sweep", once)
    plan = dataclasses.replace(TINY, scenes=("first",), cases=())
    for _ in range(2):
        with pytest.raises(FileError):
            run.run(plan, tmp_path, keep=(full,))
    found = run.run(plan, tmp_path, keep=(written.append,))
    assert (len(swept), len(offered), len(written)) == (1, 2, 1)
    assert [each.name for each in found.scenes] == ["first"]
    before, (after,) = offered[0], written
    assert list(after.shown) == list(before.shown) == ["euler", "xpbd"]
    pairs = [(before.reference.trajectory, after.reference.trajectory)]
    pairs += [(before.shown[solver], after.shown[solver]) for solver in before.shown]
    for one, other in pairs:
        assert (one.setting, one.substeps) == (other.setting, other.substeps)
        np.testing.assert_array_equal(one.positions, other.positions)
    assert after.reference.uncertainty.rms_mm == pytest.approx(before.reference.uncertainty.rms_mm, rel=1e-3)
    run.run(plan, tmp_path, keep=(written.append,))
    assert len(written) == 1


def test_the_page_names_the_recordings_that_there_are():
    scenes = [dataclasses.replace(scene(row()), name=name) for name in ("first", "second")]
    text = page.markdown(run.Report(TINY, scenes, []), pictures=False, recordings=["second"], command="cape report")
    assert "rerun second.rrd" in text
    assert "rerun first.rrd" not in text


def test_the_choice_is_the_fastest_that_is_accurate_enough():
    fast, good, slow = (
        row(solver=solver, rms_mm=error, seconds_per_second=cost)
        for solver, error, cost in (("xpbd", 5.0, 0.01), ("euler", 0.5, 0.1), ("tr_bdf2", 0.1, 1.0))
    )
    broken = row(rms_mm=0.001, seconds_per_second=1e-3, result="diverged at frame 3")
    found = scene(fast, good, slow, broken)
    assert [page.choice(found, mm) for mm in (10.0, 3.0, 0.3, 0.05)] == [fast, good, slow, None]
    # What the reference itself can't tell is not told.
    assert page.choice(scene(fast, good, slow, unsure=0.7), 0.5) is None
    assert page.choice(scene(fast, good, unsure=math.nan), 10.0) is None


def test_scenes_that_are_not_smooth_are_judged_by_short_trajectories():
    chaotic = row(rms_mm=50.0, window_mm=0.2)
    assert page.choice(scene(chaotic, smooth=False), 0.3) == chaotic
    assert page.choice(scene(chaotic), 0.3) is None


def test_the_page_shows_all_rows_and_what_could_not_be_told():
    report = run.Report(
        TINY,
        [
            scene(
                row(solver="xpbd", setting="5 substeps", rms_mm=12.345, cpu_seconds_per_second=0.08),
                row(result="left out: it takes about 9 s"),
            )
        ],
        [],
    )
    text = page.markdown(report, pictures=True, recordings=True, command="cape report --quick")
    assert "| XPBD | 5 substeps | 10.0 x | 0.0800 | 12.3 |" in text
    assert "left out: it takes about 9 s" in text
    assert "none of these" in text
    assert "![small: run time against error](small.png)" in text
    rendered = page.html(text)
    assert rendered.count("<table>") == 2
    assert "<td>12.3</td>" in rendered
    assert "width=device-width" in rendered


def first_table(*rows: Row) -> str:
    """The line of the first table for a scene with these rows."""
    text = page.markdown(run.Report(TINY, [scene(*rows)], []), pictures=False, recordings=False, command="cape report")
    return next(line for line in text.splitlines() if line.startswith("| small"))


def test_nothing_is_concluded_from_a_single_setting():
    alone = row(solver="xpbd", setting="default", rms_mm=2.0)
    missing = row(solver="xpbd", setting="20 substeps", result="left out: it takes about 9 s")
    told = "not told: of XPBD one setting alone was run"
    assert first_table(alone, missing).split(" | ")[2:] == [
        told,
        told,
        "none of these",
        "none of these",
        "XPBD: 1 of 2 |",
    ]
    both = first_table(alone, dataclasses.replace(missing, result="finished", rms_mm=0.1))
    assert told not in both
    assert both.endswith("|  |")
    # One that broke off tells something as well.
    assert told not in first_table(alone, dataclasses.replace(missing, result="diverged at frame 3"))


def test_a_disturbed_run_is_marked():
    rows = row(disturbed=True), row(setting="40 substeps", rms_mm=0.1, seconds_per_second=0.2)
    assert "symplectic Euler, default: 10.0 x (disturbed)" in first_table(*rows)
    assert "disturbed" not in first_table(*(dataclasses.replace(each, disturbed=False) for each in rows))


def outcome(case: str, solver: str, result: str, **fields: Any) -> Outcome:
    plain = Outcome(case, solver, 2, result, "", 0.05, 0.0, math.nan, 0.3, 0, stretch_limit=0.1, limit="usual")
    return dataclasses.replace(plain, **fields)


def test_what_fails_is_told_in_a_line_and_coloured_in_the_table():
    outcomes = [
        outcome("shaken", "euler", "passes"),
        outcome(
            "shaken",
            "xpbd",
            "degrades",
            why="strain above 0.3",
            retaken=7,
            stretch_max=0.4,
            stretch_least=0.2,
            chaotic=True,
            stretch_limit=0.3,
            limit="1.1 times the 27.3% of a converged run",
        ),
        outcome("jerky", "euler", "passes"),
        outcome("jerky", "xpbd", "fails", why="repeat 0: it explodes"),
    ]
    plan = dataclasses.replace(TINY, cases=("shaken", "jerky"))
    text = page.markdown(run.Report(plan, [], outcomes), pictures=False, recordings=False, command="cape report")
    assert "- **symplectic Euler** passes 2 of 2 stress cases\n" in text
    assert "- **XPBD** passes 0 of 2 stress cases; degrades in shaken; fails in jerky\n" in text
    # The answers come first.
    assert text.index("## Which solver") < text.index("## What fails") < text.index("## Stress cases")
    rendered = page.html(text)
    assert rendered.count('<td class="passes">passes: 5.0%, 0 mm, 0.30 s</td>') == 2
    degraded = "degrades: chaotic, 20.0% to 40.0%, 0 mm, 0.30 s, 7 again (strain above 0.3)"
    assert f'<td class="degrades">{degraded}</td>' in rendered
    assert "<td>0.3: 1.1 times the 27.3% of a converged run</td>" in rendered
    assert "<td>0.1: usual</td>" in rendered
    assert rendered.count('<td class="fails">') == 1
    assert all(ord(sign) < 0x2000 for sign in rendered), "a sign that a plain font may lack"


# -- time --


def quickest_of(*clocks: tuple[float, float], repeats: int, enough: float = math.inf) -> tuple[Timing, int]:
    """The timing of runs with these wall and CPU times, and how many of them were taken."""
    waiting = [Clock(*clock) for clock in clocks]
    timing = quickest(lambda: waiting.pop(0), repeats=repeats, enough=lambda spent: spent > enough)
    return timing, len(clocks) - len(waiting)


def test_the_quickest_undisturbed_run_counts_and_others_are_taken_again():
    assert quickest_of((2.0, 2.0), (1.5, 1.4), (1.7, 1.7), repeats=3) == (Timing(1.5, 1.4, False, 5.1), 3)
    # The second had half of a processor: another is taken, and it counts for nothing however quick it was.
    assert quickest_of((2.0, 2.0), (1.0, 0.5), (1.8, 1.7), repeats=2) == (Timing(1.8, 1.7, False, 4.2), 3)
    # Twice as many as asked for were disturbed.
    assert quickest_of((2.0, 1.0), (1.0, 0.5), (9.0, 9.0), repeats=1) == (Timing(1.0, 0.5, True, 1.5), 2)
    assert quickest_of((2.0, 2.0), (1.0, 1.0), repeats=2, enough=1.0) == (Timing(2.0, 2.0, False, 2.0), 1)


def test_a_clock_counts_blocks_and_the_cpu_time_of_all_threads():
    clock = Clock()
    assert clock.share(1) == 1.0
    with pytest.raises(ValueError, match="within"), clock.running():
        raise ValueError("within")
    assert clock.wall > 0.0
    assert Clock(2.0, 3.0).share(2) == 0.75


def test_the_page_shows_what_became_of_the_tolerances_that_were_asked_for():
    given = row(solver="xpbd", setting="20 substeps", rms_mm=2.0, seconds_per_second=0.05)
    asked = row(solver="auto", setting="3 mm", rms_mm=2.5, seconds_per_second=0.04)
    found = scene(given, asked)
    assert page.choice(found, 3.0) == given
    text = page.markdown(run.Report(TINY, [found], []), pictures=False, recordings=False, command="cape report")
    assert "| 3 mm | 2.50 mm | 25.0 x | XPBD, 20 substeps: 20.0 x |" in text


def test_the_diagram_has_a_curve_for_each_solver_a_band_and_the_line_of_real_time(tmp_path: Path):
    from matplotlib.figure import Figure

    found = scene(row(), row(setting="40 substeps", substeps=40, rms_mm=0.5, seconds_per_second=0.2),
                  row(solver="xpbd", rms_mm=4.0, seconds_per_second=0.05))  # fmt: skip
    axes = Figure().add_subplot()
    draw(axes, found, "rms_mm")
    curves = {line.get_label(): np.asarray(line.get_xydata()).tolist() for line in axes.get_lines()}
    assert curves["symplectic Euler"] == [[1.0, 0.1], [0.5, 0.2]]
    assert curves["XPBD"] == [[4.0, 0.05]]
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert [text.get_text() for text in axes.texts] == ["real time"]
    save_diagram(dataclasses.replace(found, smooth=False), tmp_path / "small.png")
    assert (tmp_path / "small.png").read_bytes().startswith(b"\x89PNG")


def test_progress_is_told_in_lines_where_there_is_no_terminal(capsys: pytest.CaptureFixture[str]):
    with sections() as told:
        advance = told("swing", 20)
        for _ in range(20):
            advance()
        told("walk", 3)()
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        "swing: 20 steps",
        *(f"swing: {n} of 20" for n in range(2, 21, 2)),
        "walk: 3 steps",
        "walk: 1 of 3",
    ]


# -- energy --


def test_accounts_close_at_both_settings_and_tell_what_the_method_adds(stage: Stage):
    usual, finer = accounts(stage, "backward_euler")
    assert (usual.setting, usual.substeps, finer.setting) == ("default", 8, "16 substeps")
    for account in (usual, finer):
        last = account.figures
        change = last["kinetic_j"] + last["elastic_j"] + last["potential_j"]
        done = last["attachments_j"] + last["contacts_j"] + last["air_j"] - last["damping_j"] + last["numerical_j"]
        assert account.result == "finished"
        assert account.gap < 1e-4
        # Kept to five digits of the largest.
        assert change == pytest.approx(done, abs=2e-4 * max(abs(last["attachments_j"]), abs(change)))
        assert len(account.curves["times"]) == len(account.curves["kinetic"]) == stage.frames
    assert usual.figures["numerical_j"] < finer.figures["numerical_j"] < 0.0


def account(solver: str, setting: str = "default", **curves: list[float]) -> Account:
    terms = ("kinetic", "elastic", "potential", "attachments", "contacts", "air", "damping", "numerical", "moved")
    given = {"times": [0.0, 0.5], **{term: [0.0, 0.0] for term in terms}, **curves}
    return Account("small", solver, setting, 20, "finished", 2e-8, given)


def test_the_page_and_the_diagram_show_where_energy_goes(tmp_path: Path):
    from matplotlib.figure import Figure

    found = [account("euler", damping=[0.0, 0.004], kinetic=[0.0, -0.004]), account("euler", "40 substeps")]
    report = run.Report(dataclasses.replace(TINY, balances=("small",)), [scene(row())], [], energy=found)
    text = page.markdown(report, pictures=True, recordings=True, command="cape report")
    assert "| symplectic Euler | default | -4.00 | 0 | 0 | 0 | 0 | 0 | 4.00 | 0 | 2e-08 |" in text
    assert "![small: energy over time](small_energy.png)" in text
    axes = Figure().add_subplot()
    draw_energy(axes, found[0])
    curves = {line.get_label(): np.asarray(line.get_xydata()).tolist() for line in axes.get_lines()}
    # What is dissipated takes from the energy.
    assert curves["damping"] == curves["energy"] == [[0.0, 0.0], [0.5, -4.0]]
    save_energy(found, tmp_path / "small_energy.png")
    assert (tmp_path / "small_energy.png").read_bytes().startswith(b"\x89PNG")


# -- the command --


@pytest.mark.parametrize(("option", "name"), [("--scene", "hop"), ("--solver", "magic")])
def test_the_command_refuses_what_does_not_exist(option: str, name: str, tmp_path: Path, forks: Forks):
    done = forks("report", option, name, "-o", tmp_path, folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert name in done.stderr
    assert "available" in done.stderr


def reported(folder: Path, *, largest: int = -1) -> subprocess.CompletedProcess[str]:
    """A small report by the command, in the subfolder out, where no file may be larger than `largest` [bytes]."""
    plan = dataclasses.replace(
        TINY, scenes=("swing",), solvers=("euler",), every=4, cases=("jerky",), spacings=(0.06, 0.03)
    )
    script = f"""
import resource
import sys
from cape.report.plan import Plan
from cape.cli import main
from cape.cli.commands import report
report.QUICK = {plan!r}
sys.argv = ["cape", "report", "--quick", "-o", {str(folder / "out")!r}]
resource.setrlimit(resource.RLIMIT_FSIZE, ({largest}, -1))
if __name__ == "__main__":
    main()
"""
    path = folder / "command.py"
    path.write_text(script)
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}  # what is cut short stays so
    return subprocess.run([sys.executable, path], capture_output=True, text=True, timeout=300, env=environment)


@pytest.mark.extra
def test_a_full_disk_leaves_what_was_measured_and_the_same_command_goes_on(tmp_path: Path):
    goes_on = "; what was measured is kept, and the same command goes on from there"
    folder = tmp_path / "out"
    first = reported(tmp_path, largest=100_000)
    assert first.returncode == 2
    told = first.stderr.splitlines()[-1]
    assert told.startswith(f"cape: can't write {folder}/swing.rrd: ")
    assert told.endswith(goes_on)
    kept = {path: path.read_bytes() for path in (folder / PARTS).iterdir()}
    assert [path.name for path in kept] == ["swing.json"]
    second = reported(tmp_path, largest=100_000)
    assert second.returncode == 2
    assert second.stderr.splitlines()[-1] == told
    assert "swing: " not in second.stderr
    assert {path.name for path in folder.iterdir()} == {PARTS}
    assert all(path.read_bytes() == before for path, before in kept.items())
    third = reported(tmp_path)
    assert third.returncode == 0
    assert {path.name for path in folder.iterdir()} == {
        "REPORT.md",
        "REPORT.html",
        "report.json",
        "swing.png",
        "swing.rrd",
        "space.png",
    }
    assert "swing.rrd" in (folder / "REPORT.md").read_text()


def test_the_command_writes_page_diagrams_facts_and_recordings(tmp_path: Path):
    import rerun as rr

    done = reported(tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Which solver for which accuracy" in done.stdout
    folder = tmp_path / "out"
    assert {found.name for found in folder.iterdir()} == {
        "REPORT.md", "REPORT.html", "report.json", "swing.png", "swing.rrd", "space.png",
    }  # fmt: skip
    facts = json.loads((folder / "report.json").read_text())
    assert set(facts) == {"machine", "versions", "plan", "rows", "stability", "space", "energy", "references", "world"}
    assert {"scene", "solver", "setting", "substeps", "seconds_per_second", "rms_mm", "max_mm"} <= set(facts["rows"][0])
    assert {
        "case", "solver", "repeats", "result", "stretch_max", "penetration_max_mm", "energy_growth", "seconds",
    } <= set(facts["stability"][0])  # fmt: skip
    assert [row["spacing_m"] for row in facts["space"]] == [0.06, 0.03]
    assert "<h2>What resolution buys</h2>" in (folder / "REPORT.html").read_text()
    entities = {str(chunk.entity_path) for chunk in rr.chunk.RrdReader(folder / "swing.rrd").stream()}
    assert {"/runs/reference/cape", "/runs/euler/cape", "/plots/euler"} <= entities


def test_a_text_file_appears_complete_or_not_at_all(tmp_path: Path):
    path = tmp_path / "page.md"
    write_text(path, "one")
    write_text(path, "two")
    assert path.read_text() == "two"
    with pytest.raises(UnicodeEncodeError):
        write_text(path, "three \ud800")
    assert path.read_text() == "two"
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(FileError, match=r"can't write .*missing"):
        write_text(tmp_path / "missing" / "page.md", "text")
