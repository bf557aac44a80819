"""`cape report`: error against run time."""

import json
import sys
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from cape.bench.plot import require_matplotlib
from cape.cli.measuring import require_folder, sections
from cape.report.measured.sweep import Sweep
from cape.report.plan import FULL, QUICK, Plan
from cape.report.run import Report, forget_parts, has_parts, run
from cape.report.shown import page
from cape.report.shown.plot import save_diagram, save_energy, save_space_diagram
from cape.report.shown.recording import save_runs
from cape.scene.standard_scenes import STANDARD_SCENES
from cape.solvers import SOLVERS
from motions.errors import FileError, UnknownNameError, UserError, require_package
from motions.files import write_text


def report(
    *, output: Path, quick: bool, scenes: tuple[str, ...], solvers: tuple[str, ...], only: str | None = None
) -> int:
    """Measure, and write what was found; gives the exit status."""
    require_package("rerun", "cape report")
    plan = chosen(QUICK if quick else FULL, scenes, solvers)
    if only is not None:
        plan = plan.only(only)
    try:
        output.mkdir(exist_ok=True)
    except OSError as error:
        raise FileError(f"can't make the folder {output}: {error.strerror}") from error
    require_folder(output)
    drawn = _can_draw()

    def recording(scene: str) -> Path:
        return output / f"{scene}.rrd"

    def record(done: Sweep) -> None:
        save_runs(done, recording(done.stage.standard.name))

    try:
        with sections() as told:
            found = run(plan, output, told, keep=(record,))
        if drawn:
            _draw(found, output)
        write_text(output / "report.json", json.dumps(found.as_json(), indent=1) + "\n")
        recorded = [scene.name for scene in found.scenes if recording(scene.name).exists()]
        command = _command(quick, scenes, solvers, only)
        text = page.write(found, output, pictures=drawn, recordings=recorded, command=command)
    except KeyboardInterrupt:
        print("interrupted: the same command goes on with the scene that it was at", file=sys.stderr)
        return 130
    except FileError as error:
        kept = "; what was measured is kept, and the same command goes on from there" if has_parts(output) else ""
        raise FileError(f"{error}{kept}") from error
    forget_parts(output)
    _print(text, output)
    return 0


def _draw(found: Report, output: Path) -> None:
    for scene in found.scenes:
        save_diagram(scene, output / f"{scene.name}.png")
    if found.space:
        save_space_diagram(found.space, output / "space.png")
    for name in found.plan.balances:
        save_energy([account for account in found.energy if account.scene == name], output / f"{name}_energy.png")


def chosen(plan: Plan, scenes: tuple[str, ...], solvers: tuple[str, ...]) -> Plan:
    """A plan with just these scenes and solvers, where any are named.

    Raises:
        UnknownNameError: there is no scene or no solver of that name.
    """
    for kind, names, known in (("standard scene", scenes, STANDARD_SCENES), ("solver", solvers, SOLVERS)):
        for name in names:
            if name not in known:
                raise UnknownNameError(kind, name, tuple(known))
    scenes = scenes or plan.scenes
    balances = tuple(name for name in plan.balances if name in scenes)
    return replace(plan, scenes=scenes, solvers=solvers or plan.solvers, balances=balances)


def _can_draw() -> bool:
    try:
        require_matplotlib()
    except UserError as error:
        print(f"no diagrams: {error}", file=sys.stderr)
        return False
    return True


def _command(quick: bool, scenes: tuple[str, ...], solvers: tuple[str, ...], only: str | None) -> str:
    """The command line that asks for this."""
    options = ["--quick"] * quick + [f"--scene {name}" for name in scenes] + [f"--solver {name}" for name in solvers]
    options += [] if only is None else [f"--only {only}"]
    return " ".join(["cape report", *options])


def _print(text: str, output: Path) -> None:
    """Print the page's first two sections, and where the rest is."""
    from rich.markdown import Markdown

    width = None if sys.stdout.isatty() else 200
    for section in text.split("\n## ")[1:3]:
        Console(width=width).print(Markdown("## " + section))
    print(f"{output / 'REPORT.html'}, {output / 'REPORT.md'}, {output / 'report.json'}")
