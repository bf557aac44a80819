"""Error against run time of a scene: every solver at several steps, next to one reference."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cape.bench.figures import Figures
from cape.report.measured.accuracy import (
    LAST,
    SURE,
    Error,
    Reference,
    apart_mm,
    converge,
    error_of,
    own_limit,
    window_ends,
)
from cape.report.measured.trajectory import EXACT, WINDOW, Setting, Stage, Trajectory
from cape.report.plan import Plan
from cape.run.auto import Auto
from cape.solvers import SOLVERS

REFINED = (1.5, 2.0, 4.0, 8.0)  # times as many steps as an explicit solver needs
AIM_MM = 0.01  # smallest error to be told from none in a smooth scene
REFERENCE_SHARE = 0.35  # of the time for a scene
LEFT_OUT = "left out"
SHOWN_MM = 10.0  # error that the run which is shown of a solver may have

Told = Callable[[int], Callable[[], None]]
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Row(Figures):
    """One point of a work-precision diagram; numbers that a run did not come to are not a number.

    Attributes:
        scene: its name.
        solver: its name.
        setting: what was asked of it.
        substeps: steps in a frame.
        seconds_per_second: wall time per second of motion, of the quickest whole run; 1 is real time.
        rms_mm: as in `Error`.
        max_mm: the same.
        shape_mm: the same.
        window_mm: error after a tenth of a second from the reference's state (`window_error`), where a scene is not
            smooth, and the solver isn't so slow that this alone takes longer than all runs of the scene may.
        stretch_max: largest strain of a thread.
        penetration_max_mm: deepest penetration of a vertex [mm].
        lowest_m: height of the lowest vertex, in the mean over the last `LAST` seconds [m].
        kinetic_energy_j: the same mean of the kinetic energy [J].
        retaken: frames that were taken again in shorter steps, or did not converge.
        frames: that it got through.
        result: "finished", or why it broke off or was left out.
        step_mm: the part of `window_mm` that is the time step's: the distance, at the same time, from where ever
            shorter steps of the same solver lead (`own_limit`).
        model_mm: the rest, which no step makes any smaller: how far that limit is from the reference, as the solver
            models contact in another way. The same for all settings of a solver.
        cpu_seconds_per_second: CPU time per second of motion of that run.
        disturbed: whether something else had the processor whenever it was run.
    """

    scene: str
    solver: str
    setting: str
    substeps: int
    seconds_per_second: float
    rms_mm: float = math.nan
    max_mm: float = math.nan
    shape_mm: float = math.nan
    window_mm: float = math.nan
    stretch_max: float = math.nan
    penetration_max_mm: float = math.nan
    lowest_m: float = math.nan
    kinetic_energy_j: float = math.nan
    retaken: int = 0
    frames: int = 0
    result: str = "finished"
    cpu_seconds_per_second: float = math.nan
    disturbed: bool = False
    step_mm: float = math.nan
    model_mm: float = math.nan

    @property
    def left_out(self) -> bool:
        """Whether it was not run at all."""
        return self.result.startswith(LEFT_OUT)

    @property
    def finished(self) -> bool:
        """Whether the run came to the motion's end."""
        return self.result == "finished"


@dataclass(frozen=True, eq=False)
class Sweep:
    """All runs of a scene.

    Attributes:
        stage: the scene.
        reference: that errors refer to.
        uncertainty: a row of the reference itself; its errors are how far it may be off.
        rows: a row for each setting.
        shown: of each solver the fastest run with an error of `SHOWN_MM`, or else the one with the smallest.
    """

    stage: Stage
    reference: Reference
    uncertainty: Row
    rows: list[Row]
    shown: dict[str, Trajectory]


def settings_for(stage: Stage, solver: str, *, every: int = 1) -> list[Setting]:
    """The settings at which a solver is measured, its own choice first: then every second, third... number of steps."""
    steps = SOLVERS[solver].measured_steps
    if not steps:
        needed = stage.needed_substeps(solver)
        steps = tuple(math.ceil(times * needed) for times in REFINED)
    return [Setting(solver), *(Setting(solver, count) for count in steps[::every])]


def sweep(stage: Stage, plan: Plan, told: Told = lambda steps: lambda: None) -> Sweep:
    """Run a scene at all settings, and at a step so short that the result stands for the exact solution.

    A setting that would take more than its solver's share of the time is left out, and its row says so.

    Args:
        stage: the scene.
        plan: which solvers and settings, how often, and how long that may take.
        told: called with the number of steps; gives what is called after each.
    """
    settings = {solver: settings_for(stage, solver, every=plan.every) for solver in plan.solvers}
    if stage.standard.smooth:
        asked = [Setting(Auto.name, options=(("tolerance", 1e-3 * mm),)) for mm in plan.tolerances_mm]
        settings[Auto.name] = asked
    advance = told(1 + sum(map(len, settings.values())))
    begun = time.process_time()
    reference = converge(
        stage,
        EXACT.solver,
        substeps=stage.first_refinement * stage.needed_substeps("euler"),
        aim_mm=AIM_MM,
        options=EXACT.options,
        enough=lambda: time.process_time() - begun > REFERENCE_SHARE * plan.scene_s,
    )
    advance()
    name, rows = stage.standard.name, []
    shown: dict[str, Trajectory] = {}
    best: dict[str, Row] = {}
    most = (1.0 - REFERENCE_SHARE) * plan.scene_s
    left = max(plan.scene_s - (time.process_time() - begun), most)
    for k, solver in enumerate(settings):
        share, ends = left / (len(settings) - k), {}
        first = len(rows)
        for row, run in _runs(stage, settings[solver], plan.repeats, share, most, reference.trajectory, ends):
            rows.append(row)
            if run is not None:
                left -= run.spent
            if run is not None and _is_to_be_shown(row, best):
                best[solver], shown[solver] = row, run
            advance()
        rows[first:] = _with_limits(rows[first:], ends, stage, reference.trajectory)
    uncertainty = row_of(name, reference.trajectory, reference.uncertainty, reference.window_mm)
    return Sweep(stage, reference, uncertainty, rows, shown)


def shown_again(
    stage: Stage, rows: Sequence[Row], uncertainty: Row, plan: Plan, told: Told = lambda steps: lambda: None
) -> Sweep:
    """A sweep of which the rows are known, with the reference and the runs that are shown taken once more.

    Args:
        stage: the scene, as long as it was.
        rows: of the settings.
        uncertainty: row of the reference.
        plan: by which it was measured.
        told: called with the number of steps; gives what is called after each.
    """
    best: dict[str, Row] = {}
    for row in rows:
        if not row.left_out and _is_to_be_shown(row, best):
            best[row.solver] = row
    advance = told(1 + len(best))
    exact = stage.run(replace(EXACT, substeps=uncertainty.substeps))
    advance()
    off = Error(uncertainty.rms_mm, uncertainty.max_mm, uncertainty.shape_mm)
    reference = Reference(exact, off, uncertainty.window_mm, off.rms_mm <= SURE * AIM_MM)
    shown = {}
    for solver, row in best.items():
        settings = {str(setting): setting for setting in settings_for(stage, solver, every=plan.every)}
        shown[solver] = replace(stage.run(settings[row.setting]), seconds=row.seconds_per_second)
        advance()
    return Sweep(stage, reference, uncertainty, list(rows), shown)


def _runs(
    stage: Stage,
    settings: list[Setting],
    repeats: int,
    share: float,
    windows_in: float,
    reference: Trajectory,
    ends: dict[int, FloatArray],
):
    """Yield a row for each setting, and its run, None where that would have taken too long.

    All runs may take `share`, and the windows of each `windows_in` of CPU time [s]; where these end is added to `ends`,
    by substeps.
    """
    spent, last = 0.0, None
    windows_s = 0.0 if stage.standard.smooth else WINDOW * len(stage.window_starts)
    for setting in settings:
        steps, expected = setting.substeps or 0, 0.0
        if last is not None:
            expected = last.cpu_seconds * stage.seconds * (steps / last.substeps) ** _growth(setting.solver)
        if last is not None and spent + expected > share:
            why, name = f"{LEFT_OUT}: it takes about {_seconds(expected)}", stage.standard.name
            yield Row(name, setting.solver, str(setting), steps, math.nan, result=why), None
            continue
        most = share / len(settings)
        last = stage.run(setting, repeats=repeats, enough=lambda taken, most=most: taken > most)
        known = not stage.standard.smooth and last.cpu_seconds * windows_s <= windows_in
        window_mm = math.nan
        if known and reference.snapshots:
            found = ends[last.substeps] = stage.run_windows(setting, reference)
            window_mm = apart_mm(found, window_ends(stage, reference))
        spent += last.spent
        yield row_of(stage.standard.name, last, error_of(last, reference), window_mm), last


def _with_limits(rows: list[Row], ends: dict[int, FloatArray], stage: Stage, reference: Trajectory) -> list[Row]:
    """The rows of one solver, with what is the step's and what the contact model's where its windows tell."""
    limit = own_limit(ends)
    if limit is None:
        return rows
    model_mm = apart_mm(limit, window_ends(stage, reference))
    steps = {substeps: apart_mm(found, limit) for substeps, found in ends.items()}
    return [replace(row, step_mm=steps.get(row.substeps, math.nan), model_mm=model_mm) for row in rows]


def _seconds(duration: float) -> str:
    return f"{duration:.0f} s" if duration >= 10.0 else f"{duration:.2g} s"


def _is_to_be_shown(row: Row, best: Mapping[str, Row]) -> bool:
    """Tell whether a run is to be shown instead of the best one of its solver so far."""
    if row.solver == Auto.name:
        return False
    before = best.get(row.solver)
    if before is None:
        return True
    if not row.finished or math.isnan(row.rms_mm):
        return False
    if before.rms_mm <= SHOWN_MM:
        return row.rms_mm <= SHOWN_MM and row.seconds_per_second < before.seconds_per_second
    return not row.rms_mm >= before.rms_mm


def row_of(scene: str, run: Trajectory, error: Error, window_mm: float) -> Row:
    """A run in figures."""
    last = run.times > run.times[-1] - LAST
    return Row(
        scene=scene,
        solver=run.setting.solver,
        setting=str(run.setting),
        substeps=run.substeps,
        seconds_per_second=run.seconds,
        rms_mm=error.rms_mm,
        max_mm=error.max_mm,
        shape_mm=error.shape_mm,
        window_mm=window_mm,
        stretch_max=float(run.stretch.max()),
        penetration_max_mm=1e3 * float(run.penetration.max()),
        lowest_m=float(run.positions[last, :, 2].min(axis=1).mean()),
        kinetic_energy_j=float(np.mean(run.kinetic_energy[last])),
        retaken=run.retaken,
        frames=len(run.times),
        result=run.result,
        cpu_seconds_per_second=run.cpu_seconds,
        disturbed=run.disturbed,
    )


def _growth(solver: str) -> float:
    """Power of the steps that a solver's cost grows by."""
    return SOLVERS[solver].cost_growth if solver in SOLVERS else 1.0
