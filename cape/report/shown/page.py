"""The report as a page that is read in a minute: Markdown, and the same as HTML."""

import math
import re
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

from cape.bench.plot import NAMES
from cape.report.cases import CASES, JITTER
from cape.report.measured import resolution
from cape.report.measured.accuracy import LAST
from cape.report.measured.clock import LEAST_SHARE
from cape.report.measured.energy import Account
from cape.report.measured.resolution import Row as SpaceRow
from cape.report.measured.stability import DEGRADES, FAILS, GROWTH, PASSES, PATIENCE, PENETRATION, SCATTER, Outcome
from cape.report.measured.sweep import Row
from cape.report.measured.trajectory import WINDOW
from cape.report.plan import ACCURACIES_MM
from cape.report.run import Report, Scene
from cape.report.shown import world
from cape.report.shown.tables import number, table
from cape.run.auto import Auto
from motions.files import write_text

VIEWPORT = "<meta name='viewport' content='width=device-width, initial-scale=1'>"
ENERGY_TERMS = ("kinetic", "elastic", "potential", "attachments", "contacts", "air", "damping", "numerical")
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1100px; margin: 2em auto; padding: 0 1em; color: #222 }
table { border-collapse: collapse; margin: 1em 0; display: block; max-width: 100%; overflow-x: auto }
td.passes { background: #dff0d8 } td.degrades { background: #fdf0c4 } td.fails { background: #f6cfc9 }
@media (max-width: 40em) { body { font-size: 13px; margin: 1em auto } th, td { padding: 2px 6px } }
th, td { padding: 3px 10px; border-bottom: 1px solid #ddd; text-align: left }
td { font-variant-numeric: tabular-nums }
img { max-width: 100% }
"""


def markdown(report: Report, *, pictures: bool, recordings: bool | Collection[str], command: str) -> str:
    """The page.

    Args:
        report: what to show.
        pictures: whether there is NAME.png for each scene, NAME_energy.png where its energy is accounted for, and
            space.png.
        recordings: whether there is NAME.rrd for each scene, or the names of those for which there is.
        command: that made it.
    """
    machine, versions = report.machine, ", ".join(f"{name} {v}" for name, v in report.versions.items())
    lines = [
        "# What a time step costs, and what it is worth",
        "",
        f"`{command}` on {machine['processor'] or machine['architecture']}, one thread; {versions}.",
    ]
    lines += ["", *_accuracy(report)]
    lines += ["", *_faults(report)]
    lines += ["", *_stability(report)]
    lines += ["", *_space(report, pictures=pictures)]
    lines += ["", *_energy(report, pictures=pictures)]
    lines += ["", *world.section(report.world)]
    for scene in report.scenes:
        recorded = recordings if isinstance(recordings, bool) else scene.name in recordings
        lines += ["", *_section(scene, pictures=pictures, recorded=recorded)]
    if report.plan.scenes:
        lines += ["", *_notes()]
    return "\n".join(lines) + "\n"


def html(text: str) -> str:
    """The page as HTML."""
    from markdown_it import MarkdownIt

    body = MarkdownIt("commonmark").enable("table").render(text)
    # A table has no other place for the class of a cell than its first word.
    body = re.sub(rf"<td>({PASSES}|{DEGRADES}|{FAILS})\b", r'<td class="\1">\1', body)
    head = f"<meta charset='utf-8'>\n{VIEWPORT}\n<title>What a time step costs</title>\n<style>{STYLE}</style>"
    return f"<!doctype html>\n{head}\n{body}"


def choice(scene: Scene, accuracy_mm: float) -> Row | None:
    """The fastest run of a scene that is as accurate [mm], of those whose solver was given.

    None where there is none or the reference is not surer.
    """
    if not _error(scene, scene.uncertainty) <= accuracy_mm:
        return None
    good = [row for row in _given(scene) if row.finished and _error(scene, row) <= accuracy_mm]
    return min(good, key=lambda row: row.seconds_per_second, default=None)


def _given(scene: Scene) -> list[Row]:
    return [row for row in scene.rows if row.solver != Auto.name]


def _asked(scene: Scene) -> list[str]:
    """What became of the tolerances that were asked for, next to the fastest setting that keeps to them."""
    rows = []
    for row in scene.rows:
        if row.solver == Auto.name and row.finished:
            best = choice(scene, float(row.setting.removesuffix(" mm")))
            fixed = "" if best is None else f"{NAMES[best.solver]}, {best.setting}: {_speed(best)}"
            rows.append([row.setting, f"{number(row.rms_mm)} mm", _speed(row), fixed])
    if not rows:
        return []
    return ["", *table(["asked for", "error", "speed", "fastest setting as accurate"], rows)]


def _choices(scene: Scene) -> list[str]:
    result = []
    for accuracy in ACCURACIES_MM:
        row = choice(scene, accuracy)
        if row is None:
            unsure = not _error(scene, scene.uncertainty) <= accuracy
            result.append("not known: the reference is not as sure" if unsure else "none of these")
        elif len(_run_of(scene, row.solver)) < 2:
            result.append(f"not told: of {NAMES[row.solver]} one setting alone was run")
        else:
            result.append(f"{NAMES[row.solver]}, {row.setting}: {_speed(row)}")
    return result


def _run_of(scene: Scene, solver: str) -> list[Row]:
    """The settings of a solver that were run."""
    return [row for row in scene.rows if row.solver == solver and not row.left_out]


def _left_out(scene: Scene) -> str:
    """How many settings of which solvers were not run, which the choice therefore knows nothing of."""
    texts = []
    for solver in dict.fromkeys(row.solver for row in scene.rows):
        every = sum(row.solver == solver for row in scene.rows)
        run = len(_run_of(scene, solver))
        if run < every:
            texts.append(f"{NAMES[solver]}: {every - run} of {every}")
    return ", ".join(texts)


def _accuracy(report: Report) -> list[str]:
    """What to choose for which accuracy in each scene."""
    if not report.plan.scenes:
        return []
    return [
        "## Which solver for which accuracy",
        "",
        "The fastest setting whose error is at most so large, and how many times faster than real time it is. "
        "Where contact or buckling make single trajectories diverge, the error is what a run gathers "
        f"within {WINDOW:g} s from states of the reference.",
        "",
        *table(
            ["scene", "error of", *(f"{mm:g} mm" for mm in ACCURACIES_MM), "left out"],
            [[scene.name, _measure(scene), *_choices(scene), _left_out(scene)] for scene in report.scenes],
        ),
    ]


def _faults(report: Report) -> list[str]:
    """What does not pass, in a line for each solver."""
    if not report.stability:
        return []
    lines = ["## What fails", ""]
    for solver in report.plan.solvers:
        outcomes = [outcome for outcome in report.stability if outcome.solver == solver]
        texts = [f"passes {sum(outcome.result == PASSES for outcome in outcomes)} of {len(outcomes)} stress cases"]
        for result in (DEGRADES, FAILS):
            cases = [outcome.case for outcome in outcomes if outcome.result == result]
            texts += [f"{result} in {', '.join(cases)}"] if cases else []
        lines.append(f"- **{NAMES[solver]}** {'; '.join(texts)}")
    return lines


def _space(report: Report, *, pictures: bool) -> list[str]:
    """What the spacing of the vertices is worth."""
    if not report.space:
        return []
    columns: list[tuple[str, Callable[[SpaceRow], str]]] = [
        ("solver", lambda row: NAMES[row.solver]),
        ("spacing cm", lambda row: f"{100.0 * row.spacing_m:g}"),
        ("vertices", lambda row: f"{row.vertices:,}"),
        ("substeps", lambda row: str(row.substeps)),
        ("hem height m", lambda row: _fixed(row.hem_height_m, 4)),
        ("hem width m", lambda row: _fixed(row.hem_width_m, 4)),
        ("shape error mm", lambda row: number(row.shape_mm)),
        ("order", lambda row: _fixed(row.shape_order, 1)),
        ("period s", lambda row: _fixed(row.period_s, 4)),
        ("error", lambda row: "" if math.isnan(row.period_error) else f"{row.period_error:+.3%}"),
        ("order", lambda row: _fixed(row.period_order, 1)),
        ("s per s", lambda row: number(row.seconds_per_second) if row.result == "finished" else row.result),
        ("CPU s per s", lambda row: number(row.cpu_seconds_per_second) + " (disturbed)" * row.disturbed),
    ]
    return [
        "## What resolution buys",
        "",
        "One sheet at several spacings, every solver at its default settings. At rest: the top edge is held in two "
        "waves, and the hem opens; the shape error is the distance from the finest sheet by "
        f"{NAMES[resolution.REFERENCE]}, as a root mean square over the same points of the pattern. Swinging: the flat "
        "sheet's slowest swing, against the period of a chain that does not stretch, 4 pi / 2.4048 sqrt(L / g). The "
        "order p tells that halving the spacing divides what is left of the error by 2^p; a negative one, that the "
        "figure does not converge. At order 2 the finest sheet is itself still off by a third of what the last halving "
        "has changed; the period's error does not end at zero, since threads that stretch slow the swing. Symplectic "
        "Euler shortens its steps with the spacing; XPBD, each of whose steps solves a finer mesh less well, once a "
        "hanging cloth would else be too long. Last, wall and CPU time per second of motion.",
        "",
        *(["![One sheet at several spacings](space.png)", ""] if pictures else []),
        *table([name for name, _ in columns], [[of(row) for _, of in columns] for row in report.space]),
    ]


def _fixed(value: float, digits: int) -> str:
    return "" if math.isnan(value) else f"{value:.{digits}f}"


def _stability(report: Report) -> list[str]:
    """Each stress case and what became of it with each solver."""
    found = {(outcome.case, outcome.solver): outcome for outcome in report.stability}
    if not found:
        return []
    repeats = max(outcome.repeats for outcome in report.stability)
    rows = [
        [
            f"**{case}**: {CASES[case].about}",
            _allowed([found[case, solver] for solver in report.plan.solvers]),
            *(_cell(found[case, solver]) for solver in report.plan.solvers),
        ]
        for case in report.plan.cases
    ]
    return [
        "## Stress cases",
        "",
        f"Every solver at its default settings, {repeats} runs of each from starts jittered by {1e6 * JITTER:g} "
        "micrometre; the worst is shown: largest strain, deepest penetration, growth of energy after the bones have "
        "come to rest as a share of weight times size, the wall time of one run, and how many frames were taken again "
        "in shorter steps or did not converge. It degrades by more strain than the case allows for, deeper than "
        f"{1e3 * PENETRATION:g} mm, energy grown by more than {GROWTH:.0%}, or over {PATIENCE:g} s of CPU time; it "
        "fails where it breaks off, with a word on what to change, and what was computed till then stays. Energy "
        "counts from the frame on in which the bones rest. Of a cloth that tears it is told how many edges part in the "
        "run in which fewest do; it degrades, too, where none does, its mass changes or a fold hangs by a vertex. "
        f"Where runs differ by more than {SCATTER:.0%} in strain, or in what becomes of them, they are chaotic, and "
        "the least strain is shown, too.",
        "",
        *table(["case", "strain allowed", *(NAMES[solver] for solver in report.plan.solvers)], rows),
    ]


def _allowed(outcomes: Sequence[Outcome]) -> str:
    """The strain that is no fault in a case, and why; some solvers may have needed no more than the usual."""
    widest = max(outcomes, key=lambda outcome: outcome.stretch_limit)
    return f"{widest.stretch_limit:.3g}: {widest.limit}"


def _cell(outcome: Outcome) -> str:
    growth = "" if math.isnan(outcome.energy_growth) else f", +{outcome.energy_growth:.1%}"
    strain = f"{outcome.stretch_max:.1%}"
    if outcome.chaotic:
        strain = f"chaotic, {outcome.stretch_least:.1%} to {strain}"
    torn = f", {outcome.tears} edges torn" if outcome.tears else ""
    numbers = f"{strain}, {number(outcome.penetration_max_mm)} mm{growth}{torn}, {outcome.seconds:.2f} s"
    again = f", {outcome.retaken} again" if outcome.retaken else ""
    return f"{outcome.result}: {numbers}{again}" + (f" ({outcome.why})" if outcome.why else "")


def _energy(report: Report, *, pictures: bool) -> list[str]:
    """Where the energy of some scenes comes from and goes with each solver."""
    if not report.energy:
        return []
    lines = [
        "## Energy",
        "",
        "By the end of the run, in mJ: by how much kinetic, elastic and potential energy have changed; what bones that "
        "hold the cloth, colliders and the air have done on it; what the damping of the springs has dissipated; and "
        "what the method itself has added or, below zero, lost. The gap is what is missing between the former and the "
        "latter at most at any time, as a share of the largest of all these amounts.",
    ]
    for name in report.plan.balances:
        rows = [_account(account) for account in report.energy if account.scene == name]
        lines += ["", f"**{name}**", ""]
        if pictures:
            lines += [f"![{name}: energy over time]({name}_energy.png)", ""]
        lines += table(["solver", "setting", *ENERGY_TERMS, "gap"], rows)
    return lines


def _account(account: Account) -> list[str]:
    terms = [number(1e3 * account.curves[term][-1]) for term in ENERGY_TERMS]
    why = "" if account.result == "finished" else f" ({account.result})"
    return [NAMES[account.solver], account.setting + why, *terms, f"{account.gap:.0e}"]


def _section(scene: Scene, *, pictures: bool, recorded: bool) -> list[str]:
    sure = scene.uncertainty
    lines = [f"## {scene.name}", ""]
    if pictures:
        lines += [f"![{scene.name}: run time against error]({scene.name}.png)", ""]
    lines += [
        f"{scene.vertices:,} vertices, {scene.seconds:g} s. The reference, {NAMES[sure.solver]} in double precision "
        f"at {sure.substeps} substeps, changes by {number(sure.rms_mm)} mm (at most {number(sure.max_mm)} mm, mean "
        f"shape {number(sure.shape_mm)} mm{_and_window(sure)}) when its step is halved."
        + (f" Side by side: `rerun {scene.name}.rrd`." if recorded else ""),
        "",
    ]
    columns: list[tuple[str, Callable[[Row], str]]] = [
        ("solver", lambda row: NAMES[row.solver]),
        ("setting", lambda row: row.setting),
        ("speed", lambda row: _speed(row) if row.finished else row.result),
        ("CPU s per s", lambda row: number(row.cpu_seconds_per_second)),
        ("RMS mm", lambda row: number(row.rms_mm)),
        ("max mm", lambda row: number(row.max_mm)),
        (f"RMS mm after {WINDOW:g} s", lambda row: number(row.window_mm)),
        ("the step's", lambda row: number(row.step_mm)),
        ("contact model's", lambda row: number(row.model_mm)),
        ("mean shape mm", lambda row: number(row.shape_mm)),
        ("stretch", lambda row: "" if math.isnan(row.stretch_max) else f"{row.stretch_max:.1%}"),
        ("lowest m", lambda row: number(row.lowest_m)),
        ("kinetic energy J", lambda row: number(row.kinetic_energy_j)),
        ("penetration mm", lambda row: number(row.penetration_max_mm)),
        ("frames retaken", lambda row: str(row.retaken)),
    ]
    if scene.smooth:
        apart = (
            f"RMS mm after {WINDOW:g} s",
            "the step's",
            "contact model's",
            "mean shape mm",
            "lowest m",
            "penetration mm",
        )
        columns = [column for column in columns if column[0] not in apart]
    shown = [[of(row) for _, of in columns] for row in [*_given(scene), sure]]
    return [*lines, *table([name for name, _ in columns], shown), *_asked(scene)]


def _and_window(sure: Row) -> str:
    return "" if math.isnan(sure.window_mm) else f", {number(sure.window_mm)} mm within {WINDOW:g} s"


def _notes() -> list[str]:
    return [
        "## How to read it",
        "",
        "Errors are distances between the vertices of a run and those of the reference, over all vertices and "
        "frames. All runs of a scene set out from the same state of a cape that has settled, and use the same mesh: "
        "what the mesh itself gets wrong is another matter. Speed counts the steps alone, of the quickest whole run; "
        "compiling, settling and measuring are apart. A run that had less than "
        f"{LEAST_SHARE:.0%} of a processor is taken again, and marked as disturbed where that did not help.",
        "",
        "With contact, or where cloth buckles, which of two sides a fold falls to is decided by arbitrarily small "
        "differences: trajectories of any two steps diverge, however short they are. What stays comparable is the "
        f"error that a run gathers within {WINDOW:g} s from the reference's own state, the mean shape, stretch, the "
        f"lowest point and the kinetic energy, the last two as means over the last {LAST:g} s. The explicit solvers "
        "stop the cloth at a collider, the implicit ones push it out by a stiff force, so that their limits differ. "
        "That error is therefore split: into how far a setting is from where ever shorter steps of the same solver "
        "lead, which is the step's; and how far that limit is from the reference, which is the contact model's, and "
        "which no step makes smaller. They add up as vectors do. "
        f"Where solvers are so slow that this would take too long, there is no error after {WINDOW:g} s.",
    ]


def _measure(scene: Scene) -> str:
    return "trajectories" if scene.smooth else f"{WINDOW:g} s"


def _error(scene: Scene, row: Row) -> float:
    return row.rms_mm if scene.smooth else row.window_mm


def _speed(row: Row) -> str:
    return f"{number(1.0 / row.seconds_per_second)} x" + " (disturbed)" * row.disturbed


def write(report: Report, folder: Path, *, pictures: bool, recordings: bool | Collection[str], command: str) -> str:
    """Write REPORT.md and REPORT.html into a folder, and give the text of the first."""
    text = markdown(report, pictures=pictures, recordings=recordings, command=command)
    write_text(folder / "REPORT.md", text)
    write_text(folder / "REPORT.html", html(text))
    return text
