"""Work-precision diagrams, what accuracy costs; what the spacing of the vertices is worth; and diagrams of energy."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cape.bench.plot import COLOURS, NAMES, require_matplotlib
from cape.report.measured.energy import Account
from cape.report.measured.resolution import Row as SpaceRow
from cape.report.measured.trajectory import WINDOW
from cape.report.run import Scene
from motions.files import whole_file

FLOOR_MM = 1e-4  # smaller errors are drawn here
BAND = "#d9d9d9"
TERMS = {
    "attachments": "#1b6ca8",
    "contacts": "#c8553d",
    "air": "#6a994e",
    "damping": "#8e6bbf",
    "numerical": "#d4a017",
}


def save_diagram(scene: Scene, path: Path) -> None:
    """Draw run time against error into a PNG file, by whole trajectories and, where those diverge, by short ones.

    Raises:
        UserError: matplotlib is not installed.
    """
    kinds = [("rms_mm", "root mean square error of trajectories [mm]")]
    if not scene.smooth:
        kinds = [("window_mm", f"error after {WINDOW:g} s from the reference's states [mm]"), *kinds]
    figure = _figure(8.2 * len(kinds), 4.8)
    for axes, (kind, label) in zip(figure.subplots(1, len(kinds), squeeze=False)[0], kinds, strict=True):
        draw(axes, scene, kind)
        axes.set_xlabel(label)
    figure.suptitle(f"{scene.name}: {scene.vertices:,} vertices, {scene.seconds:g} s of motion")
    with whole_file(path) as partial:
        figure.savefig(partial, dpi=120)


def draw(axes: Any, scene: Scene, kind: str) -> None:
    """Draw a scene's runs, log-log; `kind` names the error on the horizontal axis."""
    unsure = max(getattr(scene.uncertainty, kind), FLOOR_MM)
    errors = [getattr(row, kind) for row in scene.rows if row.finished]
    left = 0.5 * max(min([unsure, *errors]), FLOOR_MM)
    axes.axvspan(left, unsure, color=BAND, label="the reference itself is no surer")
    axes.axhline(1.0, color="black", linewidth=1.0, linestyle=":")
    axes.text(0.99, 1.0, "real time", transform=axes.get_yaxis_transform(), ha="right", va="bottom", fontsize=8)
    for solver in dict.fromkeys(row.solver for row in scene.rows):
        runs = [row for row in scene.rows if row.solver == solver and row.finished]
        points = sorted((row.substeps, max(getattr(row, kind), FLOOR_MM), row.seconds_per_second) for row in runs)
        if not points:
            continue
        _, errors, costs = zip(*points, strict=True)
        colour = COLOURS.get(solver, "black")
        axes.plot(errors, costs, color=colour, marker="o", markersize=4, label=NAMES.get(solver, solver))
        for row in runs:
            if row.setting == "default":
                place = max(getattr(row, kind), FLOOR_MM), row.seconds_per_second
                axes.plot(*place, color=colour, marker="o", markersize=10, fillstyle="none")
    axes.plot([], [], color="black", marker="o", markersize=10, fillstyle="none", linestyle="", label="by default")

    axes.set(xscale="log", yscale="log", ylabel="wall time per second of motion [s]")
    axes.set_xlim(left=left)
    axes.grid(True, which="major", alpha=0.3)
    axes.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def save_space_diagram(rows: Sequence[SpaceRow], path: Path) -> None:
    """Draw the errors of the resting shape and of the period against the spacing into a PNG file.

    Raises:
        UserError: matplotlib is not installed.
    """
    figure = _figure(15.0, 4.8)
    shape, period = figure.subplots(1, 2)
    draw_space(shape, [(row, row.shape_mm) for row in rows], "distance from the finest sheet at rest [mm]")
    draw_space(period, [(row, 100.0 * abs(row.period_error)) for row in rows], "error of the period [%]")
    figure.suptitle("One sheet at several spacings")
    with whole_file(path) as partial:
        figure.savefig(partial, dpi=120)


def draw_space(axes: Any, errors: Sequence[tuple[SpaceRow, float]], label: str) -> None:
    """Draw errors, each with the row it belongs to, against the spacing, log-log."""
    for solver in dict.fromkeys(row.solver for row, _ in errors):
        points = [(100.0 * row.spacing_m, error) for row, error in errors if row.solver == solver and error > 0.0]
        if points:
            style = {"color": COLOURS.get(solver, "black"), "marker": "o", "markersize": 4}
            axes.plot(*zip(*points, strict=True), **style, label=NAMES.get(solver, solver))
    ticks = sorted({100.0 * row.spacing_m for row, _ in errors})
    axes.set(xscale="log", yscale="log", xlabel="spacing [cm]", ylabel=label)
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.grid(True, which="major", alpha=0.3)
    axes.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def save_energy(accounts: Sequence[Account], path: Path) -> None:
    """Draw what the energy of a scene's runs is made of, over time, into a PNG file: those at default settings.

    Raises:
        UserError: matplotlib is not installed.
    """
    usual = [account for account in accounts if account.setting == "default"]
    figure = _figure(3.4 * len(usual), 3.6)
    for axes, account in zip(figure.subplots(1, len(usual), sharey=True, squeeze=False)[0], usual, strict=True):
        draw_energy(axes, account)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=6, frameon=False)
    figure.axes[0].set_ylabel("change [mJ]")
    with whole_file(path) as partial:
        figure.savefig(partial, dpi=120)


def draw_energy(axes: Any, account: Account) -> None:
    """Draw the change of a run's energy, and what it comes from: each term with the sign that it adds to it."""
    curves = {name: 1e3 * np.array(values) for name, values in account.curves.items()}
    times = account.curves["times"]
    axes.plot(times, curves["kinetic"] + curves["elastic"] + curves["potential"], color="black", label="energy")
    for name, colour in TERMS.items():
        sign = -1.0 if name == "damping" else 1.0
        axes.plot(times, sign * curves[name], color=colour, linewidth=1.2, label=name)
    axes.set(title=NAMES.get(account.solver, account.solver), xlabel="time [s]")
    axes.grid(True, alpha=0.3)


def _figure(width: float, height: float) -> Any:
    """An empty figure of that size [in], which needs no window."""
    require_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure
