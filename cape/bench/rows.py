"""The measured quantity."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from cape.bench.baselines import Limit, Scalar
from cape.bench.figures import Figures
from cape.bench.plan import Plan
from cape.bench.sheets import FABRIC, assembled
from cape.bench.subject import Subject
from cape.bench.timing import Timing, take_turns
from cape.solvers import SOLVERS

Told = Callable[[int], Callable[[], None]]


@dataclass(frozen=True, kw_only=True)
class Row(Figures):
    """What one variant costs.

    Attributes:
        section: of the benchmark.
        solver: its name; or "scalar" and "limit", the two loops that solvers are compared with.
        layout: grid or mesh.
        precision: single or double.
        features: what the scene has.
        vertices: of a cape.
        threads: that share a cape, or take one cape after the other.
        capes: that are stepped in one call.
        substeps: in a frame of a 60th of a second.
        ns_per_vertex_substep: least wall time of a call over its substeps and over all vertices [ns]. A substep of an
            implicit solver is one of its few steps, in which equations are solved.
        ratio_to_scalar: how many times faster than the scalar loop on the same cloth; None where that does not apply.
        ratio_to_limit: how many times slower than the limit kernel on the same cloth; None where that does not apply.
        compile_s: to compile, shared by number of pieces where several rows do that at once, and to load [s].
    """

    section: str
    solver: str
    layout: str
    precision: str
    features: tuple[str, ...] = FABRIC
    vertices: int
    threads: int = 1
    capes: int = 1
    substeps: int | None = None
    ns_per_vertex_substep: float
    ratio_to_scalar: float | None = None
    ratio_to_limit: float | None = None
    compile_s: float


@dataclass(frozen=True)
class Case:
    """A row yet to be measured: who steps which sheet."""

    solver: str
    layout: str
    precision: str
    vertices: int
    threads: int = 1


class Loops:
    """The scalar loop and the limit kernel for every cloth that is measured, each once."""

    def __init__(self) -> None:
        """Start with none."""
        self._keys: list[tuple[Any, ...]] = []
        self.probes: list[Scalar | Limit] = []

    def add(self, key: tuple[Any, ...], subject: Subject) -> None:
        """Add both loops for the cloth of a subject; `key` tells cloths apart."""
        if key not in self._keys:
            self._keys.append(key)
            self.probes += [Scalar(subject), Limit(subject)]

    def of(self, key: tuple[Any, ...], timings: Sequence[Timing]) -> tuple[Timing, Timing]:
        """Scalar and limit timings of a cloth, from those of `probes`."""
        place = 2 * self._keys.index(key)
        return timings[place], timings[place + 1]

    def rows(self, section: str, timings: Sequence[Timing]) -> list[Row]:
        """A row for each loop."""
        rows = []
        for key in self._keys:
            scalar, limit = self.of(key, timings)
            probe = self.probes[2 * self._keys.index(key)]
            for name, timing in (("scalar", scalar), ("limit", limit)):
                rows.append(
                    Row(
                        section=section,
                        solver=name,
                        layout=probe.layout,
                        precision=probe.precision,
                        vertices=probe.vertices,
                        **against(timing, scalar, limit),
                    )
                )
        return rows


def against(timing: Timing, scalar: Timing, limit: Timing) -> dict[str, Any]:
    """Fields of a row: its cost, and what that is next to the two loops."""
    return {
        "ns_per_vertex_substep": timing.ns,
        "ratio_to_scalar": scalar.ns / timing.ns,
        "ratio_to_limit": timing.ns / limit.ns,
        "compile_s": timing.compile_s,
    }


def measure(section: str, cases: Sequence[Case], plan: Plan, told: Told) -> list[Row]:
    """Measure cases in turn, and the two loops on the same cloths."""
    subjects, loops = [], Loops()
    for case in cases:
        solver = SOLVERS[case.solver](precision=case.precision)  # pyright: ignore[reportArgumentType]
        subjects.append(Subject(*assembled(case.vertices, case.layout), solver, threads=case.threads))
        loops.add((case.layout, case.precision, case.vertices), subjects[-1])
    timings = take_turns([*subjects, *loops.probes], repeats=plan.repeats, least=plan.least, told=told)
    of_loops = timings[len(subjects) :]
    rows = [
        Row(
            section=section,
            solver=case.solver,
            layout=case.layout,
            precision=case.precision,
            vertices=subject.assembly.cloth.vertices,
            threads=case.threads,
            substeps=subject.frame_substeps,
            **against(timing, *loops.of((case.layout, case.precision, case.vertices), of_loops)),
        )
        for case, subject, timing in zip(cases, subjects, timings, strict=False)
    ]
    return rows + loops.rows(section, of_loops)
