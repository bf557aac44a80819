"""What each feature of a scene costs when it is there, and that nothing of it is left when it is not."""

from dataclasses import dataclass
from typing import Any

from cape.bench.figures import Figures
from cape.bench.plan import Plan
from cape.bench.rows import Loops, Row, Told, against
from cape.bench.sheets import FABRIC, assemble_standing, sheet, variants
from cape.bench.subject import Subject
from cape.bench.timing import take_turns
from cape.solvers import SymplecticEuler

SUBSTEPS = 100  # a frame, the same for all variants and stable for each
WARM = 60  # frames until the sheet lies against what it touches
SECTION = "features"


@dataclass(frozen=True)
class Feature(Figures):
    """What a feature adds.

    Attributes:
        label: what is there.
        over: label of what it is compared with, None for the first.
        ns_per_vertex_substep: cost [ns].
        added_ns: beyond that without it [ns], None for the first.
        same_code: the compiled code is that of the scene without it, None for the first.
    """

    label: str
    over: str | None
    ns_per_vertex_substep: float
    added_ns: float | None
    same_code: bool | None


def measure_features(plan: Plan, told: Told) -> tuple[list[Row], list[Feature]]:
    """Measure all variants in turn, with symplectic Euler in single precision on one thread."""
    chosen = variants(plan.cape_vertices)
    track = sheet(plan.cape_vertices).track
    subjects, loops = {}, Loops()
    for variant in chosen:
        solver = SymplecticEuler(substeps=SUBSTEPS, precision="single")
        subject = Subject(assemble_standing(variant.scene), track, solver, warm=WARM, read=variant.read)
        subjects[variant.label] = subject
        if set(variant.features) <= set(FABRIC):
            loops.add(variant.features, subject)
    probes = [*subjects.values(), *loops.probes]
    timings = take_turns(probes, repeats=plan.repeats, least=plan.least, told=told)
    of_loops = timings[len(subjects) :]
    rows, features, cost = [], [], {}
    for variant, subject, timing in zip(chosen, subjects.values(), timings, strict=False):
        cost[variant.label] = timing.ns
        features.append(
            Feature(variant.label, None, timing.ns, None, None)
            if variant.over is None
            else Feature(
                variant.label,
                variant.over,
                timing.ns,
                timing.ns - cost[variant.over],
                subject.code == subjects[variant.over].code,
            )
        )
        fields: dict[str, Any] = {"ns_per_vertex_substep": timing.ns, "compile_s": timing.compile_s}
        if set(variant.features) <= set(FABRIC):
            fields = against(timing, *loops.of(variant.features, of_loops))
        rows.append(
            Row(
                section=SECTION,
                solver="euler",
                layout="grid",
                precision="single",
                features=variant.features,
                vertices=subject.assembly.cloth.vertices,
                substeps=SUBSTEPS,
                **fields,
            )
        )
    return rows, features
