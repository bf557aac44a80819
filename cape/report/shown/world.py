"""The section on textile tests: how the simulated cloth compares with closed forms and with what was measured."""

import math

from cape.bench.plot import NAMES
from cape.report.measured.stability import PASSES
from cape.report.measured.world import cantilever, drape, pendulum, stretch
from cape.report.measured.world.rows import Row
from cape.report.shown.tables import table

ABOUT = {
    cantilever.TEST: (
        f"ASTM D1388: the length of a strip that hangs over an edge where its chord is at {cantilever.ANGLE:g} "
        f"degrees, in {cantilever.CELLS} cells, against that of the heavy elastica; a rigidity told from it is off by "
        f"three times as much. Allowed are {cantilever.ALLOWED:.0%}."
    ),
    drape.TEST: (
        f"Cusick's drapemeter: a disc of {200.0 * drape.DISC:g} cm on one of {200.0 * drape.PEDESTAL:g} cm, vertices "
        f"{1e3 * drape.SPACING:g} mm apart, falls from starts jittered by {1e3 * drape.NOISE:g} mm; means and standard "
        f"deviations of the starts. Against a measured coefficient {drape.ALLOWED:g} points are allowed, and "
        f"{drape.AGREE:g} points and {drape.AGREE_FOLDS:g} fold between the means of triangulations, by how much they "
        "lie apart. The cloth passes through itself, and no friction holds its folds. What that of its fibres is "
        f"worth at most is told {drape.RUBBING}: by a single drape, as stiff as friction makes a cloth where it is "
        "there in full from the first bend on, however small."
    ),
    stretch.TENSION: (
        f"A strip of {100.0 * stretch.LENGTH:g} by {100.0 * stretch.WIDTH:g} cm pulled by {stretch.STRAIN:.1%} between "
        "grips: tension per width and strain, and how much it narrows over how much, both in its middle third. Allowed "
        f"are {stretch.ALLOWED:.0%}, and {stretch.ALLOWED_NARROWING:g} of the narrowing."
    ),
    stretch.SHEAR: (
        f"A square of {100.0 * stretch.SIDE:g} cm sheared by {stretch.STRAIN:g} rad with its border held: shear force "
        f"per width and angle. Allowed are {stretch.ALLOWED:.0%}."
    ),
    pendulum.TEST: (
        f"A stiff strip of {100.0 * pendulum.LENGTH:g} cm let go at rest, {pendulum.SUBSTEPS} steps in each "
        f"{1e3 * pendulum.FRAME:.3g} ms: its period, against that of a rigid body. Allowed are {pendulum.ALLOWED:.1%}."
    ),
}


def section(rows: list[Row]) -> list[str]:
    """The lines of the section; none without rows."""
    if not rows:
        return []
    lines = [
        "## Against the world",
        "",
        "Tests that laboratories do on cloth, done on the simulated one: at rest by the implicit solver, so that no "
        "time step is in what they tell, except of the pendulum.",
    ]
    for test in dict.fromkeys(row.test for row in rows):
        lines += ["", f"### {test}", "", *_test([row for row in rows if row.test == test])]
    return lines


def _test(rows: list[Row]) -> list[str]:
    """What a test is, where its figures come from, and a line of the table for each quantity of each subject."""
    judged = [row for row in rows if row.verdict]
    good = sum(row.verdict == PASSES for row in judged)
    variants = list(dict.fromkeys(row.variant for row in rows))
    found: dict[tuple[str, ...], dict[str, Row]] = {}
    for row in rows:
        found.setdefault((row.subject, row.direction, row.quantity, row.unit), {})[row.variant] = row
    body = []
    for (subject, direction, quantity, unit), cells in found.items():
        expected = next((row.expected for name, row in cells.items() if name != drape.APART), math.nan)
        known = "" if math.isnan(expected) else _digits(expected)
        what = f"{quantity} [{unit}]" if unit else quantity
        body.append(
            [" ".join(filter(None, (subject, direction))), what, known, *(_cell(cells.get(name)) for name in variants)]
        )
    return [
        f"{ABOUT[rows[0].test]} {good} of {len(judged)} figures pass.",
        "",
        *table(["", "", "expected", *(NAMES.get(name, name) for name in variants)], body),
        "",
        *(f"- {source}" for source in dict.fromkeys(row.source for row in rows)),
    ]


def _cell(row: Row | None) -> str:
    if row is None:
        return ""
    spread = "" if math.isnan(row.scatter) else f" ± {row.scatter:.2g}"
    text = f"{_digits(row.simulated)}{spread}"
    if row.result != "finished":
        text += f" ({row.result})"
    elif row.verdict and row.variant != drape.APART:
        off = f"{row.difference:+.2%}" if row.relative else f"{row.difference:+.3g}"
        text += f" ({off})"
    return f"{row.verdict}: {text}" if row.verdict else text


def _digits(value: float) -> str:
    return f"{value:.4g}"
