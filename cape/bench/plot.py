"""The benchmark in one picture."""

from pathlib import Path
from typing import Any

from cape.bench.run import Report
from cape.bench.sheets import OFF
from cape.solvers import SOLVERS
from motions.errors import UserError
from motions.files import whole_file

COLOURS = {name: kind.colour for name, kind in SOLVERS.items()} | {"scalar": "#555555", "limit": "#aaaaaa"}
NAMES = {name: kind.title for name, kind in SOLVERS.items()} | {
    "scalar": "scalar loop",
    "limit": "limit kernel",
    "auto": "chosen for a tolerance",
}


def require_matplotlib() -> None:
    """Check that pictures can be drawn.

    Raises:
        UserError: matplotlib is not installed.
    """
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise UserError("a plot needs matplotlib: pip install 'cape[plots]'") from None


def save_plot(report: Report, path: Path) -> None:
    """Draw the report into a PNG file.

    Raises:
        UserError: matplotlib is not installed.
    """
    require_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 9.0), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.15, 1.0))
    _draw_vertices(figure.add_subplot(grid[0, 0]), report)
    _draw_features(figure.add_subplot(grid[0, 1]), report)
    _draw_threads(figure.add_subplot(grid[1, 0]), report)
    _draw_capes(figure.add_subplot(grid[1, 1]), report)
    name = report.machine["processor"] or report.machine["architecture"]
    figure.suptitle(f"cape {report.versions['cape']} on {name}, {report.machine['cores']} cores", fontsize=13)
    with whole_file(path) as partial:
        figure.savefig(partial, dpi=120)


def _draw_vertices(axes: Any, report: Report) -> None:
    rows = report.section("vertices")
    curves = dict.fromkeys((row.solver, row.layout, row.precision) for row in rows)
    for solver, layout, precision in curves:
        if solver in ("scalar", "limit") and precision == "double":
            continue
        points = sorted(
            (row.vertices, row.ns_per_vertex_substep)
            for row in rows
            if (row.solver, row.layout, row.precision) == (solver, layout, precision)
        )
        axes.plot(
            *zip(*points, strict=True),
            color=COLOURS.get(solver, "black"),
            linestyle="-" if layout == "grid" else "--",
            marker=None if solver in ("scalar", "limit") else "o",
            markersize=4,
            linewidth=1.2 if solver in ("scalar", "limit") else 1.8,
            label=f"{NAMES.get(solver, solver)}, {layout}, {precision}",
        )
    axes.set(xscale="log", yscale="log", xlabel="vertices", ylabel="ns per vertex and substep")
    axes.set_title("Cost against size, one thread (implicit: a whole step)")
    axes.grid(True, which="major", alpha=0.3)
    axes.xaxis.set_major_formatter("{x:,.0f}")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.legend(fontsize=8, ncols=3, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.14))


def _draw_features(axes: Any, report: Report) -> None:
    features = report.features[::-1]
    labels = [f.label if f.over is None or f.label == OFF else f"+ {f.label}" for f in features]
    base = [0.0 if f.added_ns is None else f.ns_per_vertex_substep - f.added_ns for f in features]
    added = [f.ns_per_vertex_substep - b for f, b in zip(features, base, strict=True)]
    axes.barh(labels, base, color="#cfd8e3", label="without it")
    axes.barh(labels, added, left=base, color=COLOURS["euler"], label="added")
    for place, (low, more) in enumerate(zip(base, added, strict=True)):
        text = f"{more:+.2f}" if low else f"{more:.2f}"
        axes.text(max(low, low + more), place, f" {text}", va="center", fontsize=8)
    axes.set(xlabel="ns per vertex and substep")
    axes.set_title("What features add (symplectic Euler, grid, single)")
    axes.margins(x=0.12)
    axes.legend(fontsize=8, frameon=False, loc="lower right")


def _draw_threads(axes: Any, report: Report) -> None:
    rows = [row for row in report.section("threads") if row.solver == "euler"]
    groups = sorted({(row.layout, row.vertices) for row in rows})
    counts = sorted({row.threads for row in rows})
    width = 0.8 / max(1, len(counts))
    for k, threads in enumerate(counts):
        cost = {(row.layout, row.vertices): row.ns_per_vertex_substep for row in rows if row.threads == threads}
        places = [g + (k - (len(counts) - 1) / 2.0) * width for g in range(len(groups))]
        colour = COLOURS["euler"] if k else "#9bbfdb"
        bars = axes.bar(
            places, [cost[g] for g in groups], width, color=colour, label=f"{threads} thread" + "s" * (threads > 1)
        )
        axes.bar_label(bars, fmt="%.2g", fontsize=8)
    axes.set_xticks(range(len(groups)), [f"{layout}\n{vertices:,}" for layout, vertices in groups])
    axes.set(xlabel="layout, vertices", ylabel="ns per vertex and substep")
    axes.set_title("Threads that share one cape (symplectic Euler)")
    axes.margins(y=0.1)
    axes.legend(fontsize=8, frameon=False)


def _draw_capes(axes: Any, report: Report) -> None:
    rows = report.section("capes")
    alone = max((1e3 / row.ns_per_vertex_substep for row in rows if row.capes == 1 and row.threads == 1), default=1.0)
    for threads in sorted({row.threads for row in rows}):
        points = sorted((row.capes, 1e3 / row.ns_per_vertex_substep / alone) for row in rows if row.threads == threads)
        axes.plot(
            *zip(*points, strict=True),
            color=COLOURS["euler"] if threads > 1 else "#9bbfdb",
            marker="o",
            label=f"{threads} core" + "s" * (threads > 1),
        )
    ticks = sorted({row.capes for row in rows})
    axes.set_xscale("log", base=2)
    axes.set_xticks(ticks, [str(t) for t in ticks])
    axes.set_ylim(bottom=0.0)
    axes.set(xlabel="capes stepped in one call", ylabel="throughput, one cape on one core = 1")
    vertices = rows[0].vertices if rows else 0
    axes.set_title(f"Many capes of {vertices:,} vertices")
    axes.grid(True, alpha=0.3)
    axes.legend(fontsize=8, frameon=False)
