"""What a batch leaves: one file of figures, a table, and a page."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from cape.cli.batch.page import html
from cape.cli.batch.plan import Task
from cape.cli.batch.task import DONE, FAILED, LOG, STOPPED, Outcome
from motions.files import printable, write_text

RESULTS, PAGE, PICTURE = "results.json", "index.html", "picture.jpg"
WAITING = Outcome("", STOPPED, "not begun")


@dataclass
class Results:
    """A batch's tasks, and how those ended that have.

    Attributes:
        folder: of the batch.
        tasks: in their order.
        command: that made it.
        outcomes: by the tasks' names.
        notes: what else there is to tell, a sentence each.
        wall_s: time that it took so far [s].
    """

    folder: Path
    tasks: Sequence[Task]
    command: str
    outcomes: dict[str, Outcome] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    wall_s: float = 0.0

    def count(self, status: str) -> int:
        """How many tasks ended so."""
        return sum(outcome.status == status for _, outcome in self.rows())

    def rows(self) -> Iterator[tuple[Task, Outcome]]:
        """All tasks in their order, with how they ended."""
        return ((task, self.outcomes.get(task.name, WAITING)) for task in self.tasks)

    def figures(self) -> dict[str, Any]:
        """All of it as numbers, texts and lists."""
        return {
            "command": self.command,
            "done": self.count(DONE),
            "failed": self.count(FAILED),
            "stopped": self.count(STOPPED),
            "wall_s": round(self.wall_s, 2),
            "notes": self.notes,
            "runs": [
                {
                    "name": task.name,
                    "clip": task.clip,
                    "swept": dict(task.swept),
                    **{key: value for key, value in asdict(outcome).items() if key != "name"},
                    "output": _inside(task, task.output.name),
                    "picture": _inside(task, PICTURE),
                    "log": _inside(task, LOG),
                }
                for task, outcome in self.rows()
            ],
        }

    def write(self) -> None:
        """Write the figures and the page.

        Raises:
            FileError: they can't be written.
        """
        figures = self.figures()
        write_text(self.folder / RESULTS, json.dumps(figures, indent=1))
        write_text(self.folder / PAGE, html(figures))

    def print_table(self) -> None:
        """Print a row for each task."""
        table = Table(box=None, pad_edge=False)
        for title, side in COLUMNS.items():
            table.add_column(title, justify=side, overflow="fold")
        for run in self.figures()["runs"]:
            table.add_row(*map(printable, cells(run)))
        Console(highlight=False, markup=False).print(table)


COLUMNS: Mapping[str, Any] = {
    "run": "left",
    "frames": "right",
    "vertices": "right",
    "time": "right",
    "stretch": "right",
    "inside": "right",
    "result": "left",
}


def cells(run: Mapping[str, Any]) -> list[str]:
    """A row of the table, of a run as it stands in the figures."""
    facts = run["facts"]
    told = [""] * 5
    if facts:
        told = [
            str(facts["frames"]),
            str(facts["vertices"]),
            f"{run['seconds']:.1f} s",
            f"{facts['stretch_max']:.1%}",
            f"{facts['penetration_max_mm']:.1f} mm",
        ]
    result = run["error"] if run["status"] != DONE else facts["result"]
    return [run["name"], *told, result if run["status"] != FAILED else f"failed: {result}"]


def _inside(task: Task, name: str) -> str | None:
    """A file of a task as seen from the batch's folder, None where there is none."""
    return f"{task.name}/{name}" if (task.own_folder / name).is_file() else None
