"""All sections of the benchmark, in one report."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from cape.bench.machine import machine, versions
from cape.bench.plan import Plan
from cape.bench.rows import Case, Row, measure
from cape.bench.sections.capes import gains, measure_capes
from cape.bench.sections.features import Feature, measure_features
from cape.bench.sections.plain import AIM_MS, Plain, measure_plain
from cape.bench.sheets import LAYOUTS
from cape.solvers import SOLVERS
from cape.solvers.threads import available_cores

PRECISIONS = ("single", "double")
LINEAR = 1.25  # times the cost per vertex of a small cloth: beyond it cost no longer grows linearly
SMALL = 1_500  # vertices, of that cloth

Told = Callable[[str, int], Callable[[], None]]


@dataclass(frozen=True)
class Report:
    """What was measured.

    Attributes:
        machine: see `machine.machine`.
        versions: of Python and packages.
        plain: the plain-arrays scene, a row a solver.
        rows: all costs.
        features: what each feature adds.
        linear_to: for each layout, the largest cloth measured up to which cost grows linearly [vertices].
        capes_gain: for each number of capes, throughput of all cores relative to one.
    """

    machine: dict[str, Any]
    versions: dict[str, str]
    plain: list[Plain]
    rows: list[Row]
    features: list[Feature]
    linear_to: dict[str, int]
    capes_gain: dict[int, float]

    def as_json(self) -> dict[str, Any]:
        """The report as one JSON object."""
        return {
            "machine": self.machine,
            "versions": self.versions,
            "plain": {"aim_ms_per_frame": AIM_MS, "solvers": [p.as_json() for p in self.plain]},
            "linear_to_vertices": self.linear_to,
            "capes_gain": {str(capes): float(f"{gain:.4g}") for capes, gain in self.capes_gain.items()},
            "features": [f.as_json() for f in self.features],
            "rows": [row.as_json() for row in self.rows],
        }

    @property
    def compile_s(self) -> float:
        """What compiling or loading took in all [s]."""
        return sum(item.compile_s for item in (*self.plain, *self.rows))

    def section(self, name: str) -> list[Row]:
        """The rows of a section."""
        return [row for row in self.rows if row.section == name]


def run(plan: Plan, told: Told = lambda section, steps: lambda: None) -> Report:
    """Measure all that the plan asks for.

    Args:
        plan: how much.
        told: called before each section with its name and the number of its steps; gives what is called at each step.
    """
    plain = measure_plain(plan, told("plain scene", len(plan.solvers)))
    rows = []
    for section, cases in (
        ("solvers", solver_cases(plan)),
        ("vertices", vertices_cases(plan)),
        ("threads", threads_cases(plan)),
    ):
        rows += measure(section, cases, plan, partial(told, section))
    rows += measure_capes(plan, partial(told, "capes"))
    more, features = measure_features(plan, partial(told, "features"))
    rows += more
    return Report(machine(), versions(), plain, rows, features, linear_to(rows), gains(rows))


def solver_cases(plan: Plan) -> list[Case]:
    """All solvers and layouts, in the precisions of the plan."""
    return [
        Case(solver, layout, precision, vertices)
        for vertices in plan.table
        for solver in plan.solvers
        for layout in LAYOUTS
        for precision in (
            PRECISIONS if solver == "euler" or plan.all_precisions else (SOLVERS[solver].usual_precision,)
        )
    ]


def vertices_cases(plan: Plan) -> list[Case]:
    """Cloths of all sizes."""
    others = [name for name in plan.solvers if name != "euler"]
    return [
        *(Case("euler", "grid", "single", vertices) for vertices in plan.vertices),
        *(Case("euler", "mesh", "single", vertices) for vertices in plan.mesh_vertices),
        *(
            Case(solver, "grid", SOLVERS[solver].usual_precision, vertices)
            for solver in others
            for vertices in plan.other_vertices
        ),
    ]


def threads_cases(plan: Plan) -> list[Case]:
    """One thread, and two where there are as many cores."""
    counts = sorted({1, min(2, available_cores())})
    return [
        Case("euler", layout, "single", vertices, threads)
        for vertices in plan.thread_vertices
        for layout in LAYOUTS
        for threads in counts
    ]


def linear_to(rows: list[Row]) -> dict[str, int]:
    """For each layout, the largest cloth before the first whose vertices cost `LINEAR` times those of a small one."""
    result = {}
    for layout in LAYOUTS:
        sizes = sorted(
            (row.vertices, row.ns_per_vertex_substep)
            for row in rows
            if row.section == "vertices" and row.solver == "euler" and row.layout == layout
        )
        if not sizes:
            continue
        small = min(sizes, key=lambda size: abs(size[0] - SMALL))
        result[layout] = small[0]
        for vertices, ns in sizes:
            if vertices > small[0]:
                if ns > LINEAR * small[1]:
                    break
                result[layout] = vertices
    return result
