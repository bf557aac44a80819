"""A picture of each recording of a batch, where this machine can draw."""

from collections.abc import Callable, Sequence

from cape.cli.batch.page import PICTURE_SIZE
from cape.cli.batch.plan import Task
from cape.cli.batch.results import PICTURE
from cape.cli.batch.task import last_line, run_cape, why
from cape.cli.exports.writing import RECORDED

SIDES = ("back", "front")
_SIZE = f"{PICTURE_SIZE[0] // len(SIDES)}x{PICTURE_SIZE[1]}"
SAID = "picture.log"


def missing(tasks: Sequence[Task]) -> list[Task]:
    """Those tasks whose recordings are newer than their pictures, or have none."""
    return [task for task in tasks if task.suffix == RECORDED and task.output.is_file() and not _is_drawn(task)]


def draw(task: Task, stopped: Callable[[], bool]) -> str:
    """Draw a task's recording from behind and from in front, halfway; gives what went wrong, if anything.

    Args:
        task: whose recording is there.
        stopped: tells whether nobody waits for it any more.
    """
    picture, said = task.own_folder / PICTURE, task.own_folder / SAID
    picture.unlink(missing_ok=True)
    command = ["render", str(task.output), "-o", str(picture), *(f"--from={side}" for side in SIDES), "--size", _SIZE]
    try:
        status, _ = run_cape(command, place=task.own_folder, said=said, stopped=stopped)
        return "" if status == 0 else last_line(said)
    except OSError as error:
        return why(error)
    finally:
        said.unlink(missing_ok=True)


def _is_drawn(task: Task) -> bool:
    picture = task.own_folder / PICTURE
    return picture.is_file() and picture.stat().st_mtime_ns >= task.output.stat().st_mtime_ns
