"""`cape bench`: what the solvers cost on this machine."""

import json as json_format
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from cape.bench import FULL, QUICK, Report, run
from cape.bench.plot import require_matplotlib, save_plot
from cape.bench.rows import Row
from cape.bench.run import LINEAR
from cape.bench.sections.plain import AIM_MS
from cape.cli.figures.rows import print_rows
from cape.cli.measuring import require_folder, sections
from motions.errors import UserError
from motions.files import write_text


def bench(*, quick: bool, json: bool, output: Path | None) -> int:
    """Measure, print, and write what is asked for; gives the exit status."""
    if output is not None:
        require_folder(output)
    with sections() as told:
        report = run(QUICK if quick else FULL, told)
    facts = json_format.dumps(report.as_json(), indent=None if json else 1)
    if json:
        print(facts)
    else:
        _print_report(report)
    if output is not None:
        write_text(output / "bench.json", facts + "\n")
        _plot(report, output / "bench.png")
    return 0


def _plot(report: Report, path: Path) -> None:
    try:
        require_matplotlib()
    except UserError as error:
        print(f"no plot: {error}", file=sys.stderr)
        return
    save_plot(report, path)


def _print_report(report: Report) -> None:
    machine = report.machine
    caches = ", ".join(f"{name} {size / 1024:,.0f} kB" for name, size in machine["caches"].items())
    print_rows(
        [
            ("processor", f"{machine['processor']}, {machine['cores']} cores, {machine['system']}"),
            ("caches of a core", caches or "unknown"),
            ("versions", ", ".join(f"{name} {version}" for name, version in report.versions.items())),
        ]
    )
    _print_plain(report)
    _print_solvers(report)
    _print_vertices(report)
    _print_threads(report)
    _print_capes(report)
    _print_features(report)
    print_rows([("compile time", f"{report.compile_s:.1f} s in all, counted in no other figure")])


def _print_plain(report: Report) -> None:
    table = _table(f"A cape behind six moving capsules, one core; the aim is {AIM_MS} ms per frame", "solver")
    for name in ("frames", "substeps", "ms per frame", "largest stretch", "deepest penetration", "compile"):
        table.add_column(name, justify="right")
    table.add_column("result")
    for plain in report.plain:
        table.add_row(
            plain.solver,
            str(plain.frames),
            str(plain.substeps),
            f"{plain.ms_per_frame:.3f}",
            f"{plain.stretch_max:.1%}",
            f"{plain.penetration_max_mm:.2f} mm",
            f"{plain.compile_s:.1f} s",
            plain.result,
        )
    _print(table)


def _print_solvers(report: Report) -> None:
    table = _table("Solvers and layouts, one thread; a substep of an implicit solver is a whole solve", "solver")
    for name in ("layout", "precision"):
        table.add_column(name)
    for name in ("vertices", "substeps", "ns per vertex and substep", "speed / scalar loop", "cost / limit", "compile"):
        table.add_column(name, justify="right")
    for row in report.section("solvers"):
        table.add_row(
            row.solver,
            row.layout,
            row.precision,
            f"{row.vertices:,}",
            "" if row.substeps is None else str(row.substeps),
            f"{row.ns_per_vertex_substep:.2f}",
            _ratio(row.ratio_to_scalar),
            _ratio(row.ratio_to_limit),
            f"{row.compile_s:.1f} s",
        )
    _print(table)


def _print_vertices(report: Report) -> None:
    rows = report.section("vertices")
    curves = list(dict.fromkeys((row.solver, row.layout, row.precision) for row in rows))
    table = _table("Cost against vertices, ns per vertex and substep, one thread", "vertices")
    for curve in curves:
        table.add_column("\n".join(curve), justify="right")
    costs = {(row.solver, row.layout, row.precision, row.vertices): row.ns_per_vertex_substep for row in rows}
    for vertices in sorted({row.vertices for row in rows}):
        cells = [costs.get((*curve, vertices)) for curve in curves]
        table.add_row(f"{vertices:,}", *("" if cell is None else f"{cell:.2f}" for cell in cells))
    _print(table)
    texts = [f"{layout} up to {vertices:,} vertices" for layout, vertices in report.linear_to.items()]
    print_rows([("linear", f"{', '.join(texts)}: within {LINEAR:g} times the cost of a vertex among 1,500")])


def _print_threads(report: Report) -> None:
    rows = report.section("threads")
    table = _table("Threads that share a cape, ns per vertex and substep", "layout")
    table.add_column("vertices", justify="right")
    counts = sorted({row.threads for row in rows})
    for threads in counts:
        table.add_column(f"{threads} thread" + "s" * (threads > 1), justify="right")
    table.add_column("gain", justify="right")
    costs = {
        (row.layout, row.vertices, row.threads): row.ns_per_vertex_substep for row in rows if row.substeps is not None
    }
    for layout, vertices in sorted({key[:2] for key in costs}):
        cells = [costs[layout, vertices, threads] for threads in counts]
        table.add_row(layout, f"{vertices:,}", *(f"{cell:.2f}" for cell in cells), f"{cells[0] / cells[-1]:.2f}")
    _print(table)


def _print_capes(report: Report) -> None:
    rows = report.section("capes")
    counts = sorted({row.threads for row in rows})
    table = _table(f"Many capes of {rows[0].vertices:,} vertices in one call, ms per cape and frame", "capes")
    for threads in counts:
        table.add_column(f"{threads} core" + "s" * (threads > 1), justify="right")
    table.add_column("throughput", justify="right")
    for capes in sorted({row.capes for row in rows}):
        cells = {row.threads: row for row in rows if row.capes == capes}
        table.add_row(
            str(capes), *(f"{_frame_ms(cells[threads]):.3f}" for threads in counts), f"{report.capes_gain[capes]:.2f}"
        )
    _print(table)


def _frame_ms(row: Row) -> float:
    return 1e-6 * row.ns_per_vertex_substep * row.vertices * (row.substeps or 0)


def _print_features(report: Report) -> None:
    table = _table("Features of a scene, symplectic Euler on a grid in single precision", "feature")
    table.add_column("compared with")
    table.add_column("ns per vertex and substep", justify="right")
    table.add_column("added", justify="right")
    table.add_column("compiled code")
    for feature in report.features:
        table.add_row(
            feature.label,
            feature.over or "",
            f"{feature.ns_per_vertex_substep:.2f}",
            "" if feature.added_ns is None else f"{feature.added_ns:+.2f}",
            "" if feature.same_code is None else "the same" if feature.same_code else "its own",
        )
    _print(table)


def _ratio(ratio: float | None) -> str:
    return "" if ratio is None else f"{ratio:.2f}"


def _table(title: str, first: str) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False)
    table.add_column(first, no_wrap=True)
    return table


def _print(table: Table) -> None:
    print()
    # In a file or a pipe nothing needs to be folded.
    width = None if sys.stdout.isatty() else 160
    Console(highlight=False, markup=False, width=width).print(table)
