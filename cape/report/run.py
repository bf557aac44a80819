"""A whole report, scene after scene; what is measured stays measured when it is interrupted."""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from cape.bench.machine import machine, versions
from cape.kernels.store import ROOT
from cape.report.cases import CASES
from cape.report.compile import compile_all
from cape.report.measured import resolution
from cape.report.measured.energy import LONGEST, Account, accounts
from cape.report.measured.resolution import Row as SpaceRow
from cape.report.measured.stability import Outcome, stress
from cape.report.measured.sweep import REFERENCE_SHARE, Row, Sweep, shown_again, sweep
from cape.report.measured.trajectory import Stage
from cape.report.measured.world.rows import Row as WorldRow
from cape.report.measured.world.trials import summed_up, trials_of
from cape.report.plan import Plan
from cape.scene.standard_scenes import standard_scene
from motions.errors import FileError
from motions.files import write_text

PARTS = ".parts"

Told = Callable[[str, int], Callable[[], None]]


@dataclass(frozen=True)
class Scene:
    """What was measured of a scene.

    Attributes:
        name: its name.
        smooth: nothing touches the cloth, so that single trajectories can be compared.
        vertices: of its cloth.
        seconds: of its motion [s].
        uncertainty: a row of the reference; its errors are how far it may be off.
        rows: of all settings.
    """

    name: str
    smooth: bool
    vertices: int
    seconds: float
    uncertainty: Row
    rows: list[Row]

    @classmethod
    def of(cls, done: Sweep) -> "Scene":
        """The figures of a sweep."""
        standard = done.stage.standard
        vertices = standard.scene.cloth.vertices
        return cls(standard.name, standard.smooth, vertices, done.stage.seconds, done.uncertainty, done.rows)

    def as_json(self) -> dict[str, Any]:
        """The scene for a JSON object."""
        return {
            "name": self.name,
            "smooth": self.smooth,
            "vertices": self.vertices,
            "seconds": round(self.seconds, 4),
            "uncertainty": self.uncertainty.as_json(),
            "rows": [row.as_json() for row in self.rows],
        }

    @classmethod
    def from_json(cls, fields: dict[str, Any]) -> "Scene":
        """The scene that `as_json` gave."""
        rows = [Row.from_json(row) for row in fields["rows"]]
        return cls(**{**fields, "uncertainty": Row.from_json(fields["uncertainty"]), "rows": rows})


@dataclass(frozen=True)
class Report:
    """What was measured.

    Attributes:
        machine: see `cape.bench.machine.machine`.
        versions: of Python and packages.
        plan: what was asked for.
        scenes: error against run time.
        stability: what became of each stress case with each solver.
        space: what the spacing of the vertices is worth.
        energy: where it comes from and goes, of each scene in question with each solver, at two settings.
        world: figures of the textile tests.
    """

    plan: Plan
    scenes: list[Scene]
    stability: list[Outcome]
    space: list[SpaceRow] = field(default_factory=list)
    energy: list[Account] = field(default_factory=list)
    world: list[WorldRow] = field(default_factory=list)
    machine: dict[str, Any] = field(default_factory=machine)
    versions: dict[str, str] = field(default_factory=versions)

    def as_json(self) -> dict[str, Any]:
        """The report as one JSON object."""
        return {
            "machine": self.machine,
            "versions": self.versions,
            "plan": asdict(self.plan),
            "rows": [row.as_json() for scene in self.scenes for row in scene.rows],
            "stability": [outcome.as_json() for outcome in self.stability],
            "space": [row.as_json() for row in self.space],
            "energy": [account.figures for account in self.energy],
            "world": [row.as_json() | {"verdict": row.verdict} for row in self.world],
            "references": [scene.uncertainty.as_json() for scene in self.scenes],
        }


def run(
    plan: Plan,
    folder: Path | None = None,
    told: Told = lambda section, steps: lambda: None,
    keep: Sequence[Callable[[Sweep], None]] = (),
) -> Report:
    """Measure all that the plan asks for.

    Args:
        plan: how much.
        folder: where the figures of what is done are kept until all are there; an interrupted run goes on from them.
        told: called before each scene and before each other part, with a name and the number of
            steps; gives what is called at each step.
        keep: called with each scene's runs while they are in memory, once their figures are kept; with runs that are
            taken again, where an interrupted run has got no further than their figures.

    Raises:
        UnknownNameError: there is no scene or no solver of that name.
        FileError: the folder can't be written.
    """
    parts = _Parts(folder, plan)
    scenes = []
    if any(parts.read(name) is None for name in plan.scenes):
        compile_all(plan)
    for name in plan.scenes:
        known, done, kept = parts.read(name), None, f"{name}, its runs"
        if known is None:
            stage = Stage(standard_scene(name), seconds=plan.seconds, reference_s=REFERENCE_SHARE * plan.scene_s)
            done = sweep(stage, plan, partial(told, name))
            known = Scene.of(done).as_json()
            parts.write(name, known)  # first of all: what `keep` writes is larger, and may not find room
        scene = Scene.from_json(known)
        if keep and (done is not None or parts.read(kept) is None):
            done = done or _again(scene, plan, partial(told, f"{name}, what is recorded of it"))
            for each in keep:
                each(done)
            parts.write(kept, {})
        scenes.append(scene)
    outcomes: list[Outcome] = []
    advance = told("stress cases", len(plan.cases) * len(plan.solvers))
    for name in plan.cases:
        for solver in plan.solvers:
            part = f"{name}, {solver}"
            known = parts.read(part)
            if known is None:
                known = stress(CASES[name], solver, repeats=plan.case_repeats).as_json()
                parts.write(part, known)
            outcomes.append(Outcome.from_json(known))
            advance()
    return Report(
        plan, scenes, outcomes, _space(plan, parts, told), _energy(plan, parts, told), _world(plan, parts, told)
    )


def _again(known: Scene, plan: Plan, told: Callable[[int], Callable[[], None]]) -> Sweep:
    """Take those runs of a scene again that are shown, of which figures are known."""
    # These are rounded, by less than a frame's length.
    stage = Stage(standard_scene(known.name), seconds=known.seconds + 0.5e-4)
    return shown_again(stage, known.rows, known.uncertainty, plan, told)


def _space(plan: Plan, parts: "_Parts", told: Told) -> list[SpaceRow]:
    """Measure one cape at all spacings of the plan, the reference first."""
    wanted = [(solver, h) for solver in resolution.MEASURED if solver in plan.solvers for h in plan.spacings]
    if not wanted:
        return []
    reference = resolution.REFERENCE, min(plan.spacings)
    found: dict[tuple[str, float], resolution.Measured] = {}
    every = dict.fromkeys([reference, *wanted])
    advance = told("spacings", len(every))
    for solver, spacing in every:
        part = f"{solver} at {100.0 * spacing:g} cm"
        known = parts.read(part)
        if known is None:
            known = resolution.measure(solver, spacing, repeats=plan.repeats).as_json()
            parts.write(part, known)
        found[solver, spacing] = resolution.Measured.from_json(known)
        advance()
    return resolution.rows_of([found[each] for each in wanted], found[reference])


def _energy(plan: Plan, parts: "_Parts", told: Told) -> list[Account]:
    """The accounts of all scenes that the plan names, those that are known and those that are not yet."""
    found: list[Account] = []
    if plan.balances:
        advance = told("energy", len(plan.balances) * len(plan.solvers))
        for name in plan.balances:
            stage = None
            for solver in plan.solvers:
                part = f"energy of {name}, {solver}"
                known = parts.read(part)
                if known is None:
                    stage = stage or Stage(standard_scene(name), seconds=min(plan.seconds, LONGEST))
                    known = {"accounts": [asdict(account) for account in accounts(stage, solver)]}
                    parts.write(part, known)
                found += [Account(**fields) for fields in known["accounts"]]
                advance()
    return found


def _world(plan: Plan, parts: "_Parts", told: Told) -> list[WorldRow]:
    """The figures of all textile tests that the plan names, those that are known and those that are not yet."""
    wanted = trials_of(plan.world)
    if not wanted:
        return []
    found: list[WorldRow] = []
    advance = told("textile tests", len(wanted))
    for trial in wanted:
        known = parts.read(trial.name)
        if known is None:
            known = {"rows": [row.as_json() for row in trial.run()]}
            parts.write(trial.name, known)
        found += [WorldRow.from_json(row) for row in known["rows"]]
        advance()
    return summed_up(found)


class _Parts:
    """Figures of the scenes, cases and spacings that are done, in files that only an interrupted run leaves behind."""

    def __init__(self, folder: Path | None, plan: Plan) -> None:
        self._folder = None if folder is None else folder / PARTS
        sources = hashlib.sha256(b"".join(path.read_bytes() for path in sorted((ROOT / "cape").rglob("*.py"))))
        stamp = json.dumps([asdict(plan), versions(), machine(), sources.hexdigest()], sort_keys=True, default=str)
        self._key = hashlib.sha256(stamp.encode()).hexdigest()

    def read(self, name: str) -> dict[str, Any] | None:
        """What is there of a scene, case or spacing by the same plan on the same machine and version."""
        if self._folder is None:
            return None
        try:
            found = json.loads((self._folder / f"{name}.json").read_text())
        except (OSError, ValueError):
            return None
        return found["figures"] if isinstance(found, dict) and found.get("key") == self._key else None

    def write(self, name: str, figures: dict[str, Any]) -> None:
        """Keep the figures of a scene, case or spacing."""
        if self._folder is None:
            return
        try:
            self._folder.mkdir(exist_ok=True)
        except OSError as error:
            raise FileError(f"can't write to {self._folder}: {error.strerror}") from error
        write_text(self._folder / f"{name}.json", json.dumps({"key": self._key, "figures": figures}))


def has_parts(folder: Path) -> bool:
    """Tell whether there is anything that a run goes on from."""
    return any((folder / PARTS).glob("*.json"))


def forget_parts(folder: Path) -> None:
    """Remove what an interrupted run would have gone on from."""
    parts = folder / PARTS
    if parts.is_dir():
        for part in parts.iterdir():
            part.unlink()
        parts.rmdir()
